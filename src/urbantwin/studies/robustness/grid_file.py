"""``grid.yaml``: what a study of robustness varies, with which seeds, and by whom it is judged."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from urbantwin.detections import DETECTED_CLASSES
from urbantwin.errors import InputError
from urbantwin.grid import Axis, Cell, factorial, one_at_a_time
from urbantwin.site import RigSpec
from urbantwin.site.conditions import Strict
from urbantwin.site.yaml_document import Document, must_exist, nearest, read_document
from urbantwin.studies.robustness.factors import FACTORS, FactorAsked, first_problem, rig_at

__all__ = ["DESIGNS", "StudyFile", "Training", "check_rigs", "load_study"]

DESIGNS = {"one at a time": one_at_a_time, "factorial": factorial}

Seed = Annotated[int, Field(ge=0, lt=2**31)]
_Level = Annotated[int | float | str, Field(union_mode="left_to_right")]
_Levels = Annotated[list[_Level], Field(min_length=1, max_length=100)]


class _Factor(Strict):
    levels: _Levels
    sensors: Annotated[list[str], Field(min_length=1)] | None = None
    set_before_s: Annotated[float, Field(ge=0.0, le=1e7)] = 3600.0
    memory_s: Annotated[float, Field(ge=0.1, le=1e6)] = 60.0


class Training(Strict):
    """A detector that is trained for the study, on recordings without faults.

    Attributes:
        steps: of the training.
        seeds: of the motions that it learns from, none of which judges.
        seed: of the weights and samples.
        reach: how far the detector looks along x and y, metres.
        cell: edge of its pillars, metres.
        batch: windows of frames in a step.
        width: multiple of the channels of its network.
    """

    steps: Annotated[int, Field(ge=1, le=10_000_000)]
    seeds: Annotated[list[Seed], Field(min_length=1, description="seeds of motions to learn from")]
    seed: Seed = 0
    reach: Annotated[float, Field(ge=5.0, le=500.0)] = 60.0
    cell: Annotated[float, Field(ge=0.05, le=2.0)] = 0.4
    batch: Annotated[int, Field(ge=1, le=256)] = 4
    width: Annotated[float, Field(ge=0.25, le=16.0)] = 1.0


class _Fields(Strict):
    twin: Annotated[str, Field(description="a twin's folder")]
    rig: str | None = None
    seeds: Annotated[
        list[Seed], Field(min_length=1, max_length=1000, description="seeds of the motions")
    ]
    seconds: Annotated[float, Field(ge=1.0, le=86400.0)] = 20.0
    start: Annotated[float, Field(ge=0.0, le=86400.0)] = 0.0
    every: Annotated[int, Field(ge=1, le=10_000)] = 1
    model: str | None = None
    train: Training | None = None
    classes: Annotated[list[str], Field(min_length=1)] | None = None
    design: Literal["one at a time", "factorial"] = "one at a time"
    factors: Annotated[
        dict[str, Any], Field(min_length=1, description="a factor and its levels at least")
    ]


@dataclass(frozen=True)
class StudyFile:
    """A study, its files found.

    Attributes:
        file: where it was read.
        twin: the twin's folder.
        rig: the rig's file; ``None`` for the twin's own.
        seeds: of the motions; each is replayed under every cell.
        seconds: length of the motions.
        start_s: no frame before.
        every: only each N-th frame of the rig.
        model: of a detector; ``None``: one is trained, or nothing is detected.
        train: how; ``None``: none is.
        classes: that are judged; all that there are if ``None``.
        design: one of `DESIGNS`.
        factors: at least one.
    """

    file: Path
    twin: Path
    rig: Path | None
    seeds: tuple[int, ...]
    seconds: float
    start_s: float
    every: int
    model: Path | None
    train: Training | None
    classes: tuple[str, ...] | None
    design: str
    factors: tuple[FactorAsked, ...]

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The factors with their levels."""
        return tuple(one.axis for one in self.factors)

    def cells(self) -> tuple[Cell, ...]:
        """Return the cells of the design, the base first."""
        return DESIGNS[self.design](self.axes)


def load_study(path: Path) -> StudyFile:
    """Read a study's file; names of files in it are relative to it.

    Raises:
        InputError: a field is wrong, or a factor or a level is not known; file and line are named.
    """
    document = read_document(path, kind="a study")
    fields = document.validated(_Fields)
    if len(set(fields.seeds)) < len(fields.seeds):
        raise document.error("names a seed twice", ["seeds"], "each seed once")
    if fields.start >= fields.seconds:
        expected = f"less than seconds, {fields.seconds:g}"
        raise document.error(f"is {fields.start:g}", ["start"], expected)
    if fields.train is not None:
        _check_training(document, fields, fields.train)
    for number, name in enumerate(fields.classes or ()):
        if name not in DETECTED_CLASSES:
            raise document.error(
                f"there is no class {name!r:.40}",
                ["classes", number],
                nearest(name, DETECTED_CLASSES),
            )
    found: dict[str, Path | None] = {}
    for field in ("twin", "rig", "model"):
        given = getattr(fields, field)
        if given is not None:
            expected = "a name beside the study's file"
            must_exist(document, (field,), path.parent / given, expected, folders=True)
        found[field] = None if given is None else path.parent / given
    twin = found["twin"]
    assert twin is not None
    made = StudyFile(
        file=path,
        twin=twin,
        rig=found["rig"],
        seeds=tuple(fields.seeds),
        seconds=fields.seconds,
        start_s=fields.start,
        every=fields.every,
        model=found["model"],
        train=fields.train,
        classes=None if fields.classes is None else tuple(dict.fromkeys(fields.classes)),
        design=fields.design,
        factors=_factors(document.part("factors")),
    )
    try:
        made.cells()
    except InputError as error:
        raise document.error(error.problem, ["factors"], error.expected or "fewer levels") from None
    return made


def _check_training(document: Document, fields: _Fields, train: Training) -> None:
    if fields.model is not None:
        raise document.error("is given beside model", ["train"], "one of the two")
    if len(set(train.seeds)) < len(train.seeds):
        raise document.error("names a seed twice", ["train", "seeds"], "each seed once")
    both = sorted(set(train.seeds) & set(fields.seeds))
    if both:
        raise document.error(
            f"has {both[0]}, which judges, too", ["train", "seeds"], "other seeds than those above"
        )


def _factors(document: Document) -> tuple[FactorAsked, ...]:
    """Return the factors of a file.

    Raises:
        InputError: one is not known, has no levels, one twice, or what is no level.
    """
    found = []
    for name, given in document.value.items():
        factor = FACTORS.get(name)
        if factor is None:
            raise document.error(
                "is no factor that is known here", [name], nearest(name, list(FACTORS))
            )
        written = isinstance(given, dict)
        row = Document(
            document.file,
            given if written else {"levels": given},
            document.part(name).root if written else None,
            (*document.prefix, name) if written else (),
        )
        try:
            fields = row.validated(_Factor)
        except InputError as error:
            if written:
                raise
            problem = error.problem if isinstance(given, list) else "is no list of levels"
            raise document.error(problem, [name], f"levels: {factor.expected}") from None
        axis = Axis(name, tuple(fields.levels))
        place = [name, "levels"] if written else [name]
        twice = axis.twice()
        if twice is not None:
            raise document.error(f"has the level {twice!r} twice", place, "each level once")
        if len(axis.levels) < 2:
            raise document.error("has one level", place, "a base and another level at least")
        found.append(
            FactorAsked(axis, tuple(fields.sensors or ()), fields.set_before_s, fields.memory_s)
        )
        for level in axis.levels:
            # Names of sensors are checked where the rig is known.
            if not factor.names_sensor and not factor.allows(level, ()):
                raise document.error(f"has the level {level!r:.40}", place, factor.expected)
    return tuple(found)


def check_rigs(study: StudyFile, spec: RigSpec) -> list[RigSpec]:
    """Return the rig of every cell.

    Args:
        study: whose cells.
        spec: the rig without faults.

    Raises:
        InputError: the rig has no sensor of a name, or cannot have a level, or two factors exclude
            each other.
    """
    names = [one.name for one in spec.sensors]
    document = read_document(study.file, kind="a study")
    for asked in study.factors:
        place = ["factors", asked.axis.name]
        levels = asked.axis.levels if asked.factor.names_sensor else ()
        for name in [*asked.sensors, *(str(one) for one in levels)]:
            if name not in names and not (name in levels and asked.factor.allows(name, names)):
                raise document.error(
                    f"there is no sensor {name!r:.40} in the rig", place, nearest(name, names)
                )
    rigs = []
    for cell in study.cells():
        try:
            rigs.append(rig_at(spec, study.factors, cell.levels))
        except ValueError as error:
            raise document.error(
                f"{cell.name(study.axes)}: {first_problem(error)}",
                ["factors"],
                "levels that the rig can have together",
            ) from None
    return rigs
