"""Steps of a campaign: a twin per site, a motion per seed and scenario, a dataset per cell."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from urbantwin.artefact import kind_of, sha256_of
from urbantwin.errors import InputError
from urbantwin.experiments.campaign.file import CampaignFile
from urbantwin.experiments.campaign.settings import Setting
from urbantwin.experiments.course import KINDS, Step
from urbantwin.experiments.grid import Cell
from urbantwin.experiments.journal import step_key
from urbantwin.experiments.study.factors import first_problem
from urbantwin.geometry import SiteFrame
from urbantwin.lidar.sensor_options import check_models, columns_of
from urbantwin.site import RigSpec, load_rig_spec, load_site
from urbantwin.traffic.events import load_scenario
from urbantwin.twin import load_twin
from urbantwin.twin.provenance import made_from, rig_and_files

__all__ = ["Steps", "rig_at_rate", "steps_of"]

#: Longest name of a dataset, characters, as allowed in tar files (shards).
_MAX_LETTERS = 150


@dataclass(frozen=True)
class Steps:
    """The steps of a campaign.

    Attributes:
        file: the campaign.
        twins: folders of existing twins, by site name.
        all: steps by `Step.place`, each after those that it needs.
    """

    file: CampaignFile
    twins: Mapping[str, Path]
    all: Mapping[str, Step]

    def of(self, kind: str) -> list[Step]:
        """Return the steps of a kind."""
        return [step for step in self.all.values() if step.kind == kind]


@dataclass(frozen=True)
class _Site:
    """Data of a ``site.yaml``, or of a twin built from one, for the steps."""

    name: str
    twin: Path | None
    key: str
    frame: SiteFrame
    rig_file: Path
    rig: RigSpec | None
    seconds: float


@dataclass(frozen=True)
class _Recording:
    """Inputs of a dataset with a rig and a weather."""

    key: str
    rate_hz: float
    rays: int
    sensor_letters: int  # longest name, if each sensor has its own dataset


@dataclass
class _Rigs:
    """Rigs on sites, in any weather."""

    file: CampaignFile
    _specs: dict[tuple[str, str], tuple[RigSpec, Path]] = field(default_factory=dict)
    _recordings: dict[tuple[str, str, str], _Recording] = field(default_factory=dict)

    def recording(self, site: _Site, name: str, setting: Setting) -> _Recording:
        """Return the inputs of a recording with a rig in a weather.

        Raises:
            InputError: the rig is wrong, or does not allow the rate or the weather.
        """
        known = (site.name, name, setting.name)
        if known not in self._recordings:
            self._recordings[known] = self._read(site, name, setting)
        return self._recordings[known]

    def _read(self, site: _Site, name: str, setting: Setting) -> _Recording:
        spec, file = self._spec(site, name)
        try:
            spec = setting.applied_to(spec)
        except InputError as error:
            raise InputError(
                error.problem, file=self.file.file, place=f"weather.{setting.name}",
                expected=error.expected,
            ) from None  # fmt: skip
        except ValueError as error:
            raise InputError(
                f"the rig {name} cannot have {setting.name}: {first_problem(error)}",
                file=self.file.file, place="weather",
                expected="a setting that it can have, or the two in exclude",
            ) from None  # fmt: skip
        written, files = rig_and_files(spec.written(), file.parent)
        models = zip(check_models(spec), spec.sensors, strict=True)
        rays = sum(one.channels * columns_of(one, its, spec.rate_hz) for one, its in models)
        letters = 0 if spec.fused else max(len(one.name) for one in spec.sensors)
        return _Recording(step_key({"rig": written, "files": files}), spec.rate_hz, rays, letters)

    def _spec(self, site: _Site, name: str) -> tuple[RigSpec, Path]:
        """Return a rig as in its file, at the campaign's rate."""
        if (site.name, name) not in self._specs:
            given = self.file.rigs[name]
            file = site.rig_file if given is None else given
            own = site.rig if given is None else None
            spec = load_rig_spec(file, site.frame) if own is None else own
            try:
                spec = rig_at_rate(spec, self.file.rate_hz)
            except ValueError as error:
                raise InputError(
                    f"the rig {name} cannot have it: {first_problem(error)}",
                    file=self.file.file, place="rate_hz",
                    expected="a rate that every rig can have",
                ) from None  # fmt: skip
            check_models(spec, file=file)
            self._specs[site.name, name] = spec, file
        return self._specs[site.name, name]


def steps_of(file: CampaignFile) -> Steps:
    """Return the steps of a campaign.

    Raises:
        InputError: a site or a rig is wrong, a rig does not allow a weather, two cells have the
            same folder, or no frame is in the span.
    """
    cells = file.cells()
    named = {cell.levels["site"] for cell in cells}
    sites = {name: _site(name, path, file) for name, path in file.sites.items() if name in named}
    events = {}
    for name, path in file.scenarios.items():
        events[name] = "" if path is None else sha256_of(path)
        lengths_s = [
            sites[str(one.levels["site"])].seconds
            for one in cells
            if one.levels["scenario"] == name
        ]
        if path is not None and lengths_s:  # check what needs no twin
            load_scenario(path, None, min(lengths_s))
    settings = {one.name: one for one in file.weather}
    rigs = _Rigs(file)
    found: dict[str, Step] = {}

    def add(step: Step) -> None:
        other = found.setdefault(step.place, step)
        if other != step:
            cells = (", ".join(f"{k} {v}" for k, v in one.cell.items()) for one in (other, step))
            raise InputError(
                f"{' and '.join(cells)} would both be {step.place}",
                file=file.file, expected="other names of levels",
            )  # fmt: skip

    for name, site in sites.items():
        if site.twin is None:
            add(Step("twin", name, site.key, (), {"site": name}))
    for cell in cells:
        site = sites[str(cell.levels["site"])]
        motion = _motion(cell, site, events[str(cell.levels["scenario"])], file)
        add(motion)
        setting = settings[str(cell.levels["weather"])]
        add(_dataset(cell, motion, rigs.recording(site, str(cell.levels["rig"]), setting), file))
    listed = sorted(found.values(), key=lambda one: KINDS.index(one.kind))
    twins = {name: one.twin for name, one in sites.items() if one.twin is not None}
    return Steps(file, twins, {one.place: one for one in listed})


def _motion(cell: Cell, site: _Site, events: str, file: CampaignFile) -> Step:
    levels = {axis: cell.levels[axis] for axis in ("site", "seed", "scenario")}
    key = step_key(
        {
            "step": "motion",
            "twin": site.key,
            "seed": levels["seed"],
            "scenario": events,
            "seconds": file.duration_s,
        }
    )
    needs = () if site.twin is not None else (f"twins/{site.name}",)
    return Step("motion", "-".join(map(str, levels.values())), key, needs, levels, site.seconds)


def _dataset(cell: Cell, motion: Step, recording: _Recording, file: CampaignFile) -> Step:
    levels = {axis: cell.levels[axis] for axis in ("site", "seed", "rig", "weather", "scenario")}
    key = step_key(
        {
            "step": "dataset",
            "motion": motion.key,
            "rig": recording.key,
            "seed": levels["seed"],
            "start_s": file.start_s,
            "every": file.every,
            "storage": file.storage,
            "split": file.time_split.told(),
        }
    )
    frames = (motion.size - file.start_s) * recording.rate_hz / file.every
    if frames < 0:
        raise InputError(
            f"leaves no frame of the {motion.size:g} s of {levels['site']}",
            file=file.file, place="start_s", expected="less, or more duration_s",
        )  # fmt: skip
    name = "-".join(map(str, levels.values()))
    letters = len(name) + recording.sensor_letters
    if letters > _MAX_LETTERS:
        raise InputError(
            f"{name:.60}... would be a folder of {letters} letters", file=file.file,
            expected=f"shorter names of levels, {_MAX_LETTERS} letters together",
        )  # fmt: skip
    needs = (*motion.needs, motion.place)
    return Step("dataset", name, key, needs, levels, max(1.0, round(frames)), recording.rays)


def _site(name: str, path: Path, file: CampaignFile) -> _Site:
    """Return a site or a twin.

    Raises:
        InputError: it is wrong, or neither.
    """
    if path.is_dir() and kind_of(path) == "twin":
        twin = load_twin(path)
        seconds = file.duration_s or float(twin.site["traffic"]["duration_s"])
        key = sha256_of(path / "twin.json")
        return _Site(name, path, key, twin.frame, path / "rig.yaml", None, seconds)
    site = load_site(path)
    check_models(site.rig, file=site.rig_file)
    folders = [_digest(one) for one in site.files() if one.is_dir()]
    key = step_key({"step": "twin", "made_from": made_from(site), "folders": folders})
    seconds = file.duration_s or float(site.traffic.duration_s)
    frame = SiteFrame(site.latitude, site.longitude)
    return _Site(name, None, key, frame, site.rig_file, site.rig, seconds)


def _digest(folder: Path) -> str:
    """Return a hash of a folder that a site names, by the names and contents of its files."""
    digest = hashlib.sha256()
    for file in sorted(one for one in folder.rglob("*") if one.is_file()):
        digest.update(f"{file.relative_to(folder)} {sha256_of(file)}\n".encode())
    return digest.hexdigest()


def rig_at_rate(spec: RigSpec, rate_hz: float | None) -> RigSpec:
    """Return a rig with another frame rate; unchanged for ``None``.

    Raises:
        ValueError: the rig does not allow it.
    """
    if rate_hz is None:
        return spec
    return RigSpec.model_validate({**spec.written(), "rate_hz": rate_hz}, strict=True)
