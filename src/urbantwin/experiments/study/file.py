"""``grid.yaml`` of a study: factors, seeds, and the detector."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from urbantwin.detections import DETECTED_CLASSES
from urbantwin.errors import InputError
from urbantwin.experiments.fields import ExperimentFile, NamedFile, Seed, Seeds, Time, document_of
from urbantwin.experiments.grid import Axis, Cell, factorial, one_at_a_time
from urbantwin.experiments.study.factors import FACTORS, FactorAsked, first_problem, rig_at
from urbantwin.site import RigSpec
from urbantwin.site.conditions import Strict
from urbantwin.site.yaml_document import Document, nearest, read_document

__all__ = ["DESIGNS", "StudyFile", "Training", "check_rigs"]

DESIGNS = {"one at a time": one_at_a_time, "factorial": factorial}

_Level = Annotated[int | float | str, Field(union_mode="left_to_right")]
if TYPE_CHECKING:
    Factors = tuple[FactorAsked, ...]
else:  # as in the file
    Factors = Annotated[
        dict[str, Any], Field(min_length=1, description="a factor and its levels at least")
    ]


class _Factor(Strict):
    levels: Annotated[list[_Level], Field(min_length=1, max_length=100)]
    sensors: Annotated[list[str], Field(min_length=1)] | None = None
    set_before_s: Annotated[float, Field(ge=0.0, le=1e7)] = 3600.0
    memory_s: Annotated[float, Field(ge=0.1, le=1e6)] = 60.0


class Training(Strict):
    """A detector trained for the study, on recordings without faults.

    Attributes:
        steps: number of training steps.
        seeds: seeds of the training motions, none of which is used for evaluation.
        seed: random seed of weights and samples.
        reach: range of the detector along x and y, metres.
        cell: edge of a pillar, metres.
        batch: windows of frames per step.
        width: multiple of the channels of its network.
    """

    steps: Annotated[int, Field(ge=1, le=10_000_000)]
    seeds: Seeds = Field(description="seeds of motions to learn from")
    seed: Seed = 0
    reach: Annotated[float, Field(ge=5.0, le=500.0)] = 60.0
    cell: Annotated[float, Field(ge=0.05, le=2.0)] = 0.4
    batch: Annotated[int, Field(ge=1, le=256)] = 4
    width: Annotated[float, Field(ge=0.25, le=16.0)] = 1.0


class StudyFile(ExperimentFile):
    """A robustness study.

    Attributes:
        twin: the twin's folder.
        rig: the rig's file; ``None`` for the twin's own.
        seeds: seeds of the motions; each is replayed under every cell.
        seconds: length of the motions, seconds.
        start: earliest time of a frame, seconds of the motion.
        every: record only every N-th frame.
        model: folder of a detector; ``None`` to train one, or for no detection.
        train: training of the detector; ``None`` for none.
        classes: evaluated classes; all present ones if ``None``.
        design: one of `DESIGNS`.
        factors: at least one factor with its levels.
    """

    described_as: ClassVar[str] = "a study"

    twin: NamedFile = Field(description="a twin's folder")
    rig: NamedFile | None = None
    seeds: Annotated[Seeds, Field(max_length=1000)] = Field(description="seeds of the motions")
    seconds: Annotated[float, Field(ge=1.0, le=86400.0)] = 20.0
    start: Time = 0.0
    every: Annotated[int, Field(ge=1, le=10_000)] = 1
    model: NamedFile | None = None
    train: Training | None = None
    classes: Annotated[list[str], Field(min_length=1)] | None = None
    design: Literal["one at a time", "factorial"] = "one at a time"
    factors: Factors

    @field_validator("classes")
    @classmethod
    def _detected(cls, classes: list[str] | None, info: ValidationInfo) -> list[str] | None:
        for number, name in enumerate(classes or ()):
            if name not in DETECTED_CLASSES:
                raise document_of(info).error(
                    f"there is no class {name!r:.40}",
                    ["classes", number],
                    nearest(name, DETECTED_CLASSES),
                )
        return None if classes is None else list(dict.fromkeys(classes))

    @field_validator("factors")
    @classmethod
    def _known(cls, given: Any, info: ValidationInfo) -> tuple[FactorAsked, ...]:  # noqa: ANN401
        document = document_of(info).part("factors")
        return tuple(_factor(document, name, levels) for name, levels in given.items())

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> Self:
        document = document_of(info)
        if self.start >= self.seconds:
            expected = f"less than seconds, {self.seconds:g}"
            raise document.error(f"is {self.start:g}", ["start"], expected)
        if self.train is not None:
            if self.model is not None:
                raise document.error("is given beside model", ["train"], "one of the two")
            both = sorted(set(self.train.seeds) & set(self.seeds))
            if both:
                raise document.error(
                    f"has {both[0]}, which judges, too",
                    ["train", "seeds"],
                    "other seeds than those above",
                )
        try:
            self.cells()
        except InputError as error:
            raise document.error(error.problem, ["factors"], error.expected) from None
        return self

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The factors with their levels."""
        return tuple(factor.axis for factor in self.factors)

    def cells(self) -> tuple[Cell, ...]:
        """Return the cells of the design, the base first."""
        return DESIGNS[self.design](self.axes)


def _factor(document: Document, name: str, given: object) -> FactorAsked:
    """Return a factor of a file.

    Raises:
        InputError: it is unknown, or its levels are missing, repeated or wrong.
    """
    factor = FACTORS.get(name)
    if factor is None:
        expected = nearest(name, list(FACTORS))
        raise document.error("is no factor that is known here", [name], expected)
    place = [name]
    if isinstance(given, dict):
        place = [name, "levels"]
        fields = document.part(name).validated(_Factor)
    else:
        try:
            fields = Document(document.file, {"levels": given}).validated(_Factor)
        except InputError as error:
            problem = error.problem if isinstance(given, list) else "is no list of levels"
            raise document.error(problem, [name], f"levels: {factor.expected}") from None
    axis = Axis(name, tuple(fields.levels))
    repeated = axis.repeated()
    if repeated is not None:
        raise document.error(f"has the level {repeated!r} twice", place, "each level once")
    if len(axis.levels) < 2:
        raise document.error("has one level", place, "a base and another level at least")
    for level in axis.levels:
        # Names of sensors are checked once the rig is known.
        if not factor.names_sensor and not factor.allows(level, ()):
            raise document.error(f"has the level {level!r:.40}", place, factor.expected)
    return FactorAsked(axis, tuple(fields.sensors or ()), fields.set_before_s, fields.memory_s)


def check_rigs(study: StudyFile, spec: RigSpec) -> list[RigSpec]:
    """Return the rig of every cell.

    Args:
        study: the study.
        spec: the rig without faults.

    Raises:
        InputError: a sensor is unknown, the rig does not allow a level, or two factors exclude each
            other.
    """
    names = [sensor.name for sensor in spec.sensors]
    document = read_document(study.file, kind="a study")
    for asked in study.factors:
        place = ["factors", asked.axis.name]
        levels = asked.axis.levels if asked.factor.names_sensor else ()
        for name in [*asked.sensors, *map(str, levels)]:
            if name not in names and not (name in levels and asked.factor.allows(name, names)):
                raise document.error(
                    f"there is no sensor {name!r:.40} in the rig", place, nearest(name, names)
                )
    rigs = []
    for cell in study.cells():
        try:
            rigs.append(rig_at(spec, study.factors, cell.levels))
        except ValueError as error:
            problem = f"{cell.name(study.axes)}: {first_problem(error)}"
            expected = "levels that the rig can have together"
            raise document.error(problem, ["factors"], expected) from None
    return rigs
