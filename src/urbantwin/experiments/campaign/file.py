"""``grid.yaml`` of a campaign: axes, duration, and storage."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from urbantwin.artefact import kind_of, read_json
from urbantwin.dataset.reading.frame_files import STORED
from urbantwin.dataset.split import SplitAsked, shares_of
from urbantwin.errors import InputError
from urbantwin.experiments.campaign.settings import Setting, settings_of
from urbantwin.experiments.fields import Duration, ExperimentFile, Seed, Seeds, Time, document_of
from urbantwin.experiments.grid import Axis, Cell, Level, factorial
from urbantwin.site.conditions import Strict
from urbantwin.site.rig_changes import RigChanges
from urbantwin.site.yaml_document import Document, must_exist, nearest, read_document, wrong

__all__ = ["AXES", "CampaignFile", "Shards"]

#: The axes in order; in the order of cells, the last axis varies fastest.
AXES = ("site", "seed", "scenario", "rig", "weather")
#: Level of a scenario without events, and of the site's own rig.
NONE, OWN = "none", "own"
#: Names become parts of the names of folders.
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
_PLAIN = re.compile(r"[^A-Za-z0-9_.-]+")

_Names = list[str] | dict[str, str]
if TYPE_CHECKING:
    Sites = dict[str, Path]
    Files = dict[str, Path | None]
    SeedRange = tuple[int, ...]
    Settings = tuple[Setting, ...]
else:  # as in the file

    class _Range(Strict):
        first: Seed = 1
        count: Annotated[int, Field(ge=1, le=100_000)]

    SeedRange = Seeds | _Range
    Sites = Files = Annotated[_Names, Field(min_length=1)]
    Settings = Annotated[list[str] | dict[str, Any], Field(min_length=1)]


class _Split(Strict):
    by: Literal["time", "scenario"] = "time"
    shares: list[float] = Field(default_factory=lambda: [70.0, 15.0, 15.0])
    gap_s: Time | None = None
    seed: Seed = 0


class Shards(Strict):
    """Output of all frames as shards, for training at scale.

    Attributes:
        format: ``webdataset`` or ``parquet``.
        megabytes: largest size of a shard, except for its last frame.
        seed: random seed of the order of frames.
    """

    format: Literal["webdataset", "parquet"]
    megabytes: Annotated[float, Field(gt=0.0, le=100_000.0)] = 500.0
    seed: Seed = 0


class CampaignFile(ExperimentFile):
    """A campaign.

    Attributes:
        sites: files or folders of sites, or twins, by name if named here.
        seeds: random seeds of motions and sensors.
        rigs: rig files; `OWN` for the site's own.
        weather: settings of weather, light and faults.
        scenarios: scenario files; `NONE` for traffic without events.
        exclude: excluded cells, each by levels of some axes.
        duration_s: duration of the motions, seconds; ``None`` for that of each site.
        start_s: earliest time of a frame, seconds of the motion.
        every: record only every N-th frame.
        rate_hz: frames per second of all rigs; ``None`` for their own rates.
        storage: storage format of points, see `dataset.record`.
        split: split of each dataset in time, or of whole scenarios.
        shards: additional output of all frames as shards; ``None`` for none.
    """

    described_as: ClassVar[str] = "a campaign"

    sites: Sites = Field(description="files site.yaml, or folders of twins")
    seeds: SeedRange = (1,)
    rigs: Files = Field(default={OWN: None})
    weather: Settings = (Setting("clear", RigChanges(weather="clear")),)
    scenarios: Files = Field(default={NONE: None})
    exclude: list[dict[str, Any]] = Field(default_factory=list)
    duration_s: Duration | None = None
    start_s: Time = 0.0
    every: Annotated[int, Field(ge=1, le=10_000)] = 1
    rate_hz: Annotated[float, Field(gt=0.0, le=1000.0)] | None = None
    storage: str = "npy"
    split: _Split = Field(default_factory=_Split)
    shards: Shards | None = None

    @field_validator("seeds")
    @classmethod
    def _counted(cls, seeds: Any) -> tuple[int, ...]:  # noqa: ANN401
        if not isinstance(seeds, list):
            if seeds.first + seeds.count > 2**31:
                raise wrong("goes beyond the largest seed", f"seeds of at most {2**31 - 1}")
            seeds = range(seeds.first, seeds.first + seeds.count)
        return tuple(seeds)

    @field_validator("sites", "rigs", "scenarios")
    @classmethod
    def _found(cls, names: Any, info: ValidationInfo) -> dict[str, Path | None]:  # noqa: ANN401
        return _files(document_of(info), str(info.field_name), names)

    @field_validator("weather")
    @classmethod
    def _settings(cls, given: Any, info: ValidationInfo) -> tuple[Setting, ...]:  # noqa: ANN401
        settings = settings_of(document_of(info), given)
        _check_names(document_of(info), "weather", [one.name for one in settings], given)
        return settings

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> Self:
        document, split = document_of(info), self.split
        if self.duration_s is not None and self.start_s >= self.duration_s:
            expected = f"less than duration_s, {self.duration_s:g}"
            raise document.error(f"is {self.start_s:g}", ["start_s"], expected)
        if self.storage not in STORED:
            expected = nearest(self.storage, list(STORED))
            raise document.error(f"is {self.storage!r:.40}", ["storage"], expected)
        try:
            shares_of(split.shares)
        except InputError as error:
            raise document.error(error.problem, ["split", "shares"], error.expected) from None
        idle, kind = ("gap_s", "time") if split.by == "scenario" else ("seed", "scenario")
        if idle in split.model_fields_set:
            raise document.error("does nothing here", ["split", idle], f"no {idle}, or by: {kind}")
        _check_excluded(document, self.exclude, self.axes)
        scenarios = {(cell.levels["site"], cell.levels["seed"]) for cell in self.cells()}
        if split.by == "scenario" and len(scenarios) < 2:
            expected = "several seeds, or by: time"
            raise document.error("divides a single site and seed", ["split", "by"], expected)
        return self

    @property
    def time_split(self) -> SplitAsked:
        """Split of each dataset; with a split by scenario, a dataset is in one part."""
        if self.split.by == "scenario":
            return SplitAsked((1.0, 0.0, 0.0))
        return SplitAsked(shares_of(self.split.shares), self.split.gap_s)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The axes with their levels."""
        levels: tuple[Iterable[Level], ...] = (
            self.sites, self.seeds, self.scenarios, self.rigs, [one.name for one in self.weather]
        )  # fmt: skip
        return tuple(Axis(name, tuple(its)) for name, its in zip(AXES, levels, strict=True))

    def cells(self) -> list[Cell]:
        """Return the cells to record, those of one motion consecutively.

        Raises:
            InputError: too many cells, or none.
        """
        try:
            cells = factorial(self.axes)
        except InputError as error:
            raise InputError(error.problem, file=self.file, expected=error.expected) from None
        excluded = [{axis: _listed(its) for axis, its in row.items()} for row in self.exclude]
        included = [
            cell
            for cell in cells
            if not any(
                all(cell.levels[axis] in levels for axis, levels in row.items()) for row in excluded
            )
        ]
        if not included:
            raise InputError(
                "leaves no cell", file=self.file, place="exclude", expected="one cell at least"
            )
        return included


def _files(document: Document, field: str, given: _Names) -> dict[str, Path | None]:
    """Return the file of each level by its name; ``None`` for the level without a file."""
    folders, no_file = field == "sites", {"rigs": OWN, "scenarios": NONE}.get(field)
    expected = {"sites": "a site.yaml or a twin's folder", "rigs": "a rig's file"}
    found: dict[str, Path | None] = {}
    rows = [(None, text) for text in given] if isinstance(given, list) else list(given.items())
    names = []
    for number, (name, text) in enumerate(rows):
        if text == no_file and name in (None, text):
            names.append(text)
            found[text] = None
            continue
        path = document.file.parent / text
        place = (field, number if name is None else name)
        must_exist(document, place, path, expected.get(field, "a scenario's file"), folders=folders)
        if folders and (path / "site.yaml").is_file() and kind_of(path) != "twin":
            path = path / "site.yaml"
        names.append(_name_of(path) if name is None else name)
        found[names[-1]] = path
    _check_names(document, field, names, given)
    return found


def _name_of(path: Path) -> str:
    """Return the name of an unnamed level: the site's own name, or that of the file."""
    name = path.stem
    if path.is_dir() and kind_of(path) == "twin":
        name = str(read_json(path / "twin.json", kind="twin").get("name", ""))
    elif path.is_dir() or name == "site":
        file = path / "site.yaml" if path.is_dir() else path
        name = str(read_document(file, kind="a site").value.get("name") or path.resolve().stem)
    return _PLAIN.sub("-", name).strip(".-")[:64] or "unnamed"


def _check_names(
    document: Document, field: str, names: Sequence[str], given: list[str] | Mapping[str, Any]
) -> None:
    """Check that names are unique and valid as parts of folder names."""
    for number, name in enumerate(names):
        place = [field, number if isinstance(given, list) else name]
        if not _NAME.fullmatch(name):
            raise document.error(
                f"{name!r:.80} is no name for a part of a folder's", place,
                "up to 64 letters, digits, _, . and -",
            )  # fmt: skip
        if name in names[:number]:
            raise document.error(
                f"two of them are called {name}", place,
                f"each once, or names of their own: {{{name}: FILE, ...}}",
            )  # fmt: skip


def _listed(levels: Any) -> list[Any]:  # noqa: ANN401
    return levels if isinstance(levels, list) else [levels]


def _check_excluded(
    document: Document, rows: Sequence[Mapping[str, Any]], axes: Sequence[Axis]
) -> None:
    """Refuse axes and levels in ``exclude:`` that are not in the grid."""
    axis_levels = {axis.name: axis.levels for axis in axes}
    for number, row in enumerate(rows):
        if not row:
            raise document.error("names no level", ["exclude", number], "axes and their levels")
        for axis, given in row.items():
            place: list[int | str] = ["exclude", number, axis]
            if axis not in axis_levels:
                raise document.error("is no axis", place, nearest(axis, AXES))
            if given == []:
                raise document.error("names no level", place, "a level, or a list of levels")
            for level in _listed(given):
                # ``true`` is 1 in Python, and no seed.
                if any(type(level) is type(one) and level == one for one in axis_levels[axis]):
                    continue
                names = [str(one) for one in axis_levels[axis]]
                expected = nearest(str(level), names[:20])
                if str(level) in names:
                    expected = f"{level}, a number"
                raise document.error(f"there is no {axis} {level!r:.40}", place, expected)
