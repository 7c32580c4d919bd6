"""The steps of a campaign: a twin for each site, a motion for each seed, a dataset for each cell.

A step has a key: a hash of all that it follows from. What is done is known by name and key, so that
another level adds what is new alone, and a file that changed does again what depends on it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from urbantwin import __version__
from urbantwin.artefact import kind_of, sha256_of
from urbantwin.campaigns.grid_file import CampaignFile
from urbantwin.campaigns.weather import Setting
from urbantwin.dataset.manifest import recipe_key, versions_here
from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.grid import Cell
from urbantwin.lidar.sensor_options import check_models, columns_of
from urbantwin.site import RigSpec, Site, load_rig_spec, load_site
from urbantwin.studies.robustness.factors import first_problem
from urbantwin.traffic.events import load_scenario
from urbantwin.twin import load_twin
from urbantwin.twin.provenance import made_from, rig_and_files

__all__ = ["KINDS", "Step", "Steps", "rig_at_rate", "steps_of"]

#: Kinds of steps in the order in which one needs the other; each has a folder of its name and s.
KINDS = ("twin", "motion", "dataset")


#: Letters of a dataset's name: shards hold it, and a tar file has room for as many.
_LONGEST = 150


@dataclass(frozen=True)
class Step:
    """Something that is made once.

    Attributes:
        kind: one of `KINDS`.
        name: of its folder, in that of its kind.
        key: of what it follows from.
        needs: names of the steps before it, as `place` has them.
        cell: levels of the axes that it follows from.
        size: seconds of a motion, frames of a dataset; 1 for a twin.
        rays: that its sensors send out in a frame, of a dataset.
    """

    kind: str
    name: str
    key: str
    needs: tuple[str, ...]
    cell: Mapping[str, Any]
    size: float = 1.0
    rays: int = 0

    @property
    def place(self) -> str:
        """Its folder in the campaign's: ``motions/two-avenues-1-none``."""
        return f"{self.kind}s/{self.name}"

    @property
    def work(self) -> float:
        """How much there is to do: a twin, seconds of traffic, rays of all frames."""
        return self.size * self.rays if self.kind == "dataset" else self.size


@dataclass(frozen=True)
class Steps:
    """All steps of a campaign.

    Attributes:
        asked: the campaign.
        twins: folders of twins that were built before, by the name of their site.
        all: by `Step.place`, each after those that it needs.
    """

    asked: CampaignFile
    twins: Mapping[str, Path]
    all: Mapping[str, Step]

    def of(self, kind: str) -> list[Step]:
        """Return the steps of a kind."""
        return [one for one in self.all.values() if one.kind == kind]


@dataclass(frozen=True)
class _Place:
    """A site as far as its steps need it: a ``site.yaml``, or a twin that was built of one."""

    name: str
    twin: Path | None
    key: str
    frame: SiteFrame
    rig_file: Path
    rig: RigSpec | None
    seconds: float


@dataclass(frozen=True)
class _RigTold:
    """What a recording by a rig in a weather follows from, and what it leaves.

    Attributes:
        key: the hash of the rig with its files.
        rate_hz: its frames a second.
        rays: of a frame.
        longest_name: letters of its sensors' names, where each leaves a dataset of its own.
    """

    key: str
    rate_hz: float
    rays: int
    longest_name: int


@dataclass
class _Rigs:
    """Rigs on sites, in any weather: what a recording by each follows from."""

    asked: CampaignFile
    _known: dict[tuple[str, str], tuple[RigSpec, Path]] = field(default_factory=dict)
    _told: dict[tuple[str, str, str], _RigTold] = field(default_factory=dict)

    def on(self, site: _Place, name: str) -> tuple[RigSpec, Path]:
        """Return a rig as its file has it, at the campaign's rate.

        Raises:
            InputError: it is wrong.
        """
        found = self._known.get((site.name, name))
        if found is None:
            given = self.asked.rigs[name]
            file = site.rig_file if given is None else given
            if given is None and site.rig is not None:
                spec = site.rig
            else:
                spec = load_rig_spec(file, site.frame)
            try:
                spec = rig_at_rate(spec, self.asked.rate_hz)
            except ValueError as error:
                raise InputError(
                    f"the rig {name} cannot have it: {first_problem(error)}",
                    file=self.asked.file, place="rate_hz",
                    expected="a rate that every rig can have",
                ) from None  # fmt: skip
            check_models(spec, file=file)
            found = self._known[site.name, name] = spec, file
        return found

    def told(self, site: _Place, name: str, setting: Setting) -> _RigTold:
        """Return what a recording by a rig in a weather follows from.

        Raises:
            InputError: the rig cannot have the weather.
        """
        found = self._told.get((site.name, name, setting.name))
        if found is None:
            spec, file = self.on(site, name)
            try:
                its = setting.applied_to(spec)
            except InputError as error:
                raise InputError(
                    error.problem, file=self.asked.file, place=f"weather.{setting.name}",
                    expected=error.expected,
                ) from None  # fmt: skip
            except ValueError as error:
                raise InputError(
                    f"the rig {name} cannot have {setting.name}: {first_problem(error)}",
                    file=self.asked.file, place="weather",
                    expected="a setting that it can have, or the two in exclude",
                ) from None  # fmt: skip
            written, files = rig_and_files(its.written(), file.parent)
            sensors = zip(check_models(spec), spec.sensors, strict=True)
            rays = sum(
                one.channels * columns_of(one, asked, spec.rate_hz) for one, asked in sensors
            )
            key = recipe_key({"rig": written, "files": files, **_versions()})
            longest = 0 if spec.fused else max(len(one.name) for one in spec.sensors)
            found = _RigTold(key, spec.rate_hz, rays, longest)
            self._told[site.name, name, setting.name] = found
        return found


@cache
def _versions() -> dict[str, str]:
    """Return the hash of what makes steps: another version makes all of them again."""
    return {"made_by": recipe_key({"urbantwin": __version__, **versions_here()})}


def steps_of(asked: CampaignFile) -> Steps:
    """Return the steps of a campaign.

    Raises:
        InputError: a site or a rig is wrong, a rig cannot have a weather, two cells would have one
            folder, or no frame lies in the span.
    """
    cells = asked.cells()
    named = {cell.levels["site"] for cell in cells}
    places = {name: _site(name, path, asked) for name, path in asked.sites.items() if name in named}
    events = _events(asked, cells, places)
    settings = {one.name: one for one in asked.weather}
    rigs = _Rigs(asked)
    found: dict[str, Step] = {}
    for name, place in places.items():
        if place.twin is None:
            _add(found, Step("twin", name, place.key, (), {"site": name}), asked)
    for cell in cells:
        site = places[str(cell.levels["site"])]
        motion = _motion(cell, site, events, asked)
        _add(found, motion, asked)
        rig = rigs.told(site, str(cell.levels["rig"]), settings[str(cell.levels["weather"])])
        _add(found, _dataset(cell, motion, rig, asked), asked)
    order = {kind: number for number, kind in enumerate(KINDS)}
    listed = sorted(found.values(), key=lambda one: order[one.kind])
    twins = {name: one.twin for name, one in places.items() if one.twin is not None}
    return Steps(asked, twins, {one.place: one for one in listed})


def _events(
    asked: CampaignFile, cells: Sequence[Cell], places: Mapping[str, _Place]
) -> dict[str, str]:
    """Return the hash of each scenario's file.

    Raises:
        InputError: what no twin is needed for is wrong in one, or an event comes after the motion.
    """
    found = {}
    for name, path in asked.scenarios.items():
        found[name] = "" if path is None else sha256_of(path)
        lengths = [
            places[str(one.levels["site"])].seconds for one in cells
            if one.levels["scenario"] == name
        ]  # fmt: skip
        if path is not None and lengths:
            load_scenario(path, None, min(lengths))
    return found


def _add(found: dict[str, Step], step: Step, asked: CampaignFile) -> None:
    other = found.setdefault(step.place, step)
    if other != step:
        raise InputError(
            f"{_told(other)} and {_told(step)} would both be {step.place}",
            file=asked.file,
            expected="other names of levels",
        )


def _told(step: Step) -> str:
    return ", ".join(f"{axis} {level}" for axis, level in step.cell.items())


def _motion(cell: Cell, site: _Place, events: Mapping[str, str], asked: CampaignFile) -> Step:
    levels = {axis: cell.levels[axis] for axis in ("site", "seed", "scenario")}
    key = recipe_key(
        {
            "step": "motion",
            **_versions(),
            "twin": site.key,
            "seed": levels["seed"],
            "scenario": events[str(levels["scenario"])],
            "seconds": asked.duration_s,
        }
    )
    needs = () if site.twin is not None else (f"twins/{site.name}",)
    name = "-".join(str(one) for one in levels.values())
    return Step("motion", name, key, needs, levels, size=site.seconds)


def _dataset(cell: Cell, motion: Step, rig: _RigTold, asked: CampaignFile) -> Step:
    levels = {axis: cell.levels[axis] for axis in ("site", "seed", "rig", "weather", "scenario")}
    key = recipe_key(
        {
            "step": "dataset",
            "motion": motion.key,
            "rig": rig.key,
            "seed": levels["seed"],
            "start_s": asked.start_s,
            "every": asked.every,
            "storage": asked.storage,
            "split": asked.split.told(),
        }
    )
    frames = (motion.size - asked.start_s) * rig.rate_hz / asked.every
    if frames < 0:
        raise InputError(
            f"leaves no frame of the {motion.size:g} s of {levels['site']}",
            file=asked.file, place="start_s", expected="less, or more duration_s",
        )  # fmt: skip
    name = "-".join(str(one) for one in levels.values())
    letters = len(name) + rig.longest_name
    if letters > _LONGEST:
        raise InputError(
            f"{name:.60}... would be a folder of {letters} letters",
            file=asked.file, expected=f"shorter names of levels, {_LONGEST} letters together",
        )  # fmt: skip
    needs = (*motion.needs, motion.place)
    return Step("dataset", name, key, needs, levels, max(1.0, round(frames)), rig.rays)


def _site(name: str, path: Path, asked: CampaignFile) -> _Place:
    """Return a site or a twin.

    Raises:
        InputError: it is wrong, or neither.
    """
    if path.is_dir() and kind_of(path) == "twin":
        twin = load_twin(path)
        seconds = asked.duration_s or float(twin.site["traffic"]["duration_s"])
        key = sha256_of(path / "twin.json")
        return _Place(name, path, key, twin.frame, path / "rig.yaml", None, seconds)
    site = load_site(path)
    check_models(site.rig, file=site.rig_file)
    key = recipe_key(
        {
            "step": "twin",
            **_versions(),
            "made_from": made_from(site),
            "folders": _digests(site),
        }
    )
    seconds = asked.duration_s or float(site.traffic.duration_s)
    frame = SiteFrame(site.latitude, site.longitude)
    return _Place(name, None, key, frame, site.rig_file, site.rig, seconds)


def _digests(site: Site) -> list[str]:
    """Return a hash of each folder that a site names: that of files is told of by their names."""
    found = []
    for folder in (one for one in site.files() if one.is_dir()):
        digest = hashlib.sha256()
        for file in sorted(one for one in folder.rglob("*") if one.is_file()):
            digest.update(f"{file.relative_to(folder)} {sha256_of(file)}\n".encode())
        found.append(digest.hexdigest())
    return found


def rig_at_rate(spec: RigSpec, rate_hz: float | None) -> RigSpec:
    """Return a rig with so many frames a second; as it is for ``None``.

    Raises:
        ValueError: it cannot have them.
    """
    if rate_hz is None:
        return spec
    return RigSpec.model_validate({**spec.written(), "rate_hz": rate_hz}, strict=True)
