"""``grid.yaml`` of a campaign: what is recorded with what, for how long, and how it is kept."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from urbantwin.artefact import kind_of, read_json
from urbantwin.campaigns.weather import Setting, settings_of
from urbantwin.dataset.reading.frame_files import STORED
from urbantwin.dataset.split import SplitAsked, shares_of
from urbantwin.errors import InputError
from urbantwin.grid import Axis, Cell, Level, factorial
from urbantwin.site.conditions import Strict
from urbantwin.site.yaml_document import Document, must_exist, nearest, read_document

__all__ = ["AXES", "NONE", "OWN", "CampaignFile", "Shards", "load_campaign"]

#: The axes in their order: of cells that follow each other, the last differ first.
AXES = ("site", "seed", "scenario", "rig", "weather")
#: The level of a scenario that is none, and of the rig that the site itself has.
NONE, OWN = "none", "own"
#: Names become parts of the names of folders.
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
_PLAIN = re.compile(r"[^A-Za-z0-9_.-]+")

Seed = Annotated[int, Field(ge=0, lt=2**31)]
_Named = list[str] | dict[str, str]


class _SeedRange(Strict):
    first: Seed = 1
    count: Annotated[int, Field(ge=1, le=100_000)]


class _Split(Strict):
    by: Literal["time", "scenario"] = "time"
    shares: list[float] = Field(default_factory=lambda: [70.0, 15.0, 15.0])
    gap_s: Annotated[float, Field(ge=0.0, le=86400.0)] | None = None
    seed: Seed = 0


class Shards(Strict):
    """How all frames are written once more, for training at scale.

    Attributes:
        format: ``webdataset`` or ``parquet``.
        megabytes: of a shard, at most, but for its last frame.
        seed: of the order of the frames.
    """

    format: Literal["webdataset", "parquet"]
    megabytes: Annotated[float, Field(gt=0.0, le=100_000.0)] = 500.0
    seed: Seed = 0


class _Fields(Strict):
    sites: Annotated[
        _Named, Field(min_length=1, description="files site.yaml, or folders of twins")
    ]
    seeds: Annotated[list[Seed], Field(min_length=1)] | _SeedRange = Field(
        default_factory=lambda: [1]
    )
    rigs: Annotated[_Named, Field(min_length=1)] = Field(default_factory=lambda: [OWN])
    weather: Annotated[list[str] | dict[str, Any], Field(min_length=1)] = Field(
        default_factory=lambda: ["clear"]
    )
    scenarios: Annotated[_Named, Field(min_length=1)] = Field(default_factory=lambda: [NONE])
    exclude: list[dict[str, Any]] = Field(default_factory=list)
    duration_s: Annotated[float, Field(ge=0.1, le=86400.0)] | None = None
    start_s: Annotated[float, Field(ge=0.0, le=86400.0)] = 0.0
    every: Annotated[int, Field(ge=1, le=10_000)] = 1
    rate_hz: Annotated[float, Field(gt=0.0, le=1000.0)] | None = None
    storage: str = "npy"
    split: _Split = Field(default_factory=_Split)
    shards: Shards | None = None


@dataclass(frozen=True)
class CampaignFile:
    """A campaign, its files found.

    Attributes:
        file: where it was read.
        sites: file or folder of each site, by name.
        seeds: of motions and of what sensors leave to chance.
        rigs: file of each rig, by name; ``None`` for the site's own.
        weather: settings of weather, light and faults.
        scenarios: file of each scenario, by name; ``None`` for traffic without events.
        exclude: cells that are left out: of each the levels of some axes.
        duration_s: length of the motions; ``None`` for that of each site.
        start_s: no frame before.
        every: only each N-th frame of a rig.
        rate_hz: frames per second of all rigs; ``None`` for those of each.
        storage: of points, see `dataset.record`.
        split: in time, of each dataset.
        by_scenario: shares and seed of a split of whole scenarios besides; ``None``: there is none.
        shards: how all frames are written once more; ``None``: they are not.
    """

    file: Path
    sites: Mapping[str, Path]
    seeds: tuple[int, ...]
    rigs: Mapping[str, Path | None]
    weather: tuple[Setting, ...]
    scenarios: Mapping[str, Path | None]
    exclude: tuple[Mapping[str, tuple[Level, ...]], ...]
    duration_s: float | None
    start_s: float
    every: int
    rate_hz: float | None
    storage: str
    split: SplitAsked
    by_scenario: tuple[tuple[float, float, float], int] | None
    shards: Shards | None

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The axes with their levels."""
        levels: Mapping[str, Sequence[Level]] = {
            "site": tuple(self.sites),
            "seed": self.seeds,
            "scenario": tuple(self.scenarios),
            "rig": tuple(self.rigs),
            "weather": tuple(one.name for one in self.weather),
        }
        return tuple(Axis(name, tuple(levels[name])) for name in AXES)

    def cells(self) -> list[Cell]:
        """Return the cells that are recorded, those of one motion after each other.

        Raises:
            InputError: there are too many, or none is left.
        """
        try:
            every = factorial(self.axes)
        except InputError as error:
            raise InputError(error.problem, file=self.file, expected=error.expected) from None
        kept = [one for one in every if not any(_meets(one, out) for out in self.exclude)]
        if not kept:
            raise InputError(
                "leaves no cell", file=self.file, place="exclude", expected="one cell at least"
            )
        return kept


def _meets(cell: Cell, levels: Mapping[str, tuple[Level, ...]]) -> bool:
    return all(cell.levels[axis] in wanted for axis, wanted in levels.items())


def load_campaign(path: Path) -> CampaignFile:
    """Read a campaign's file; names of files in it are relative to it.

    Raises:
        InputError: a field is wrong, a file is not there, a level is there twice, or no cell is
            left; file and line are named.
    """
    document = read_document(path, kind="a campaign")
    fields = document.validated(_Fields)
    seeds = fields.seeds
    if isinstance(seeds, _SeedRange):
        if seeds.first + seeds.count > 2**31:
            raise document.error(
                "goes beyond the largest seed", ["seeds"], f"seeds of at most {2**31 - 1}"
            )
        seeds = list(range(seeds.first, seeds.first + seeds.count))
    if len(set(seeds)) < len(seeds):
        raise document.error("names a seed twice", ["seeds"], "each seed once")
    if fields.duration_s is not None and fields.start_s >= fields.duration_s:
        raise document.error(
            f"is {fields.start_s:g}", ["start_s"], f"less than duration_s, {fields.duration_s:g}"
        )
    if fields.storage not in STORED:
        raise document.error(
            f"is {fields.storage!r:.40}", ["storage"], nearest(fields.storage, list(STORED))
        )
    try:
        shares = shares_of(fields.split.shares)
    except InputError as error:
        raise document.error(error.problem, ["split", "shares"], error.expected) from None
    scenarios = fields.split.by == "scenario"
    idle, wanted = ("gap_s", "time") if scenarios else ("seed", "scenario")
    if idle in fields.split.model_fields_set:
        raise document.error("does nothing here", ["split", idle], f"no {idle}, or by: {wanted}")
    weather = settings_of(document, fields.weather)
    _check_names(document, "weather", [one.name for one in weather], fields.weather)
    made = CampaignFile(
        file=path,
        sites={
            name: one
            for name, one in _files(document, "sites", fields.sites, {}, folders=True).items()
            if one is not None
        },
        seeds=tuple(seeds),
        rigs=_files(document, "rigs", fields.rigs, {OWN: None}),
        weather=weather,
        scenarios=_files(document, "scenarios", fields.scenarios, {NONE: None}),
        exclude=(),
        duration_s=fields.duration_s,
        start_s=fields.start_s,
        every=fields.every,
        rate_hz=fields.rate_hz,
        storage=fields.storage,
        # Of a split by scenario the whole dataset is of one part.
        split=SplitAsked((1.0, 0.0, 0.0)) if scenarios else SplitAsked(shares, fields.split.gap_s),
        by_scenario=(shares, fields.split.seed) if scenarios else None,
        shards=fields.shards,
    )
    excluded = _excluded(document, fields.exclude, made.axes)
    made = CampaignFile(**{**vars(made), "exclude": excluded})
    cells = made.cells()
    if scenarios and len({(one.levels["site"], one.levels["seed"]) for one in cells}) < 2:
        raise document.error(
            "divides a single site and seed", ["split", "by"], "several seeds, or by: time"
        )
    return made


def _files(
    document: Document,
    field: str,
    given: list[str] | Mapping[str, str],
    others: Mapping[str, None],
    *,
    folders: bool = False,
) -> dict[str, Path | None]:
    """Return the file of each level by its name; ``others`` are levels without a file."""
    found: dict[str, Path | None] = {}
    rows = [(None, one) for one in given] if isinstance(given, list) else list(given.items())
    names = []
    for number, (name, text) in enumerate(rows):
        place = [field, number if name is None else name]
        if text in others and (name is None or name == text):
            names.append(text)
            found[text] = None
            continue
        path = document.file.parent / text
        kind = {"sites": "a site.yaml or a twin's folder", "rigs": "a rig's file"}.get(field)
        must_exist(document, tuple(place), path, kind or "a scenario's file", folders=folders)
        if folders and (path / "site.yaml").is_file() and kind_of(path) != "twin":
            path = path / "site.yaml"
        names.append(_name_of(path) if name is None else name)
        found[names[-1]] = path
    _check_names(document, field, names, given)
    return found


def _name_of(path: Path) -> str:
    """Return what a file is called where nobody names it: a site by its own name."""
    if path.is_dir() and kind_of(path) == "twin":
        said = str(read_json(path / "twin.json", kind="twin").get("name", ""))
    elif path.is_dir() or path.stem == "site":
        file = path / "site.yaml" if path.is_dir() else path
        said = str(read_document(file, kind="a site").value.get("name") or path.resolve().stem)
    else:
        said = path.stem
    return _PLAIN.sub("-", said).strip(".-")[:64] or "unnamed"


def _check_names(
    document: Document, field: str, names: Sequence[str], given: list[str] | Mapping[str, Any]
) -> None:
    """Refuse names that two levels have, or that no folder can have."""
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


def _excluded(
    document: Document, rows: Sequence[Mapping[str, Any]], axes: Sequence[Axis]
) -> tuple[dict[str, tuple[Level, ...]], ...]:
    known = {one.name: one.levels for one in axes}
    found = []
    for number, row in enumerate(rows):
        levels: dict[str, tuple[Level, ...]] = {}
        if not row:
            raise document.error("names no level", ["exclude", number], "axes and their levels")
        for axis, given in row.items():
            place: list[int | str] = ["exclude", number, str(axis)]
            if axis not in known:
                raise document.error("is no axis", place, nearest(str(axis), AXES))
            several = given if isinstance(given, list) else [given]
            if not several:
                raise document.error("names no level", place, "a level, or a list of levels")
            for level in several:
                # ``true`` is 1 in Python, and no seed.
                if not any(type(level) is type(one) and level == one for one in known[axis]):
                    names = [str(one) for one in known[axis]]
                    expected = nearest(str(level), names[:20])
                    if str(level) in names:
                        expected = f"{level}, a number"
                    raise document.error(f"there is no {axis} {level!r:.40}", place, expected)
            levels[axis] = tuple(several)
        found.append(levels)
    return tuple(found)
