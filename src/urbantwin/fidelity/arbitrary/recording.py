"""Recording of an example site, made by the same pipeline as the twin, as a control.

The site is ``examples/two-avenues``, which is part of the package: invented, without any real
place. Its frames show how far a street that is no twin is from the real frames: with the same map
reader, lane model, traffic, sensors and returns, at the wrong place.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin import __version__
from urbantwin.artefact import claimed, read_json, remove_dead
from urbantwin.dataset import record
from urbantwin.dataset.rig_of_manifest import rig_of_manifest
from urbantwin.errors import InputError
from urbantwin.fidelity.arbitrary.rig import level_frame, likely_rig, riding, standing
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers import Recording, open_recording
from urbantwin.geometry import Pose
from urbantwin.lidar import Rig, place_rig
from urbantwin.progress import Progress
from urbantwin.site import load_site
from urbantwin.site.rig import RigSpec
from urbantwin.traffic import run_traffic
from urbantwin.twin import Twin, build_twin

__all__ = ["MOST_FRAMES", "SITE", "arbitrary_recording", "kept"]

#: Maximum number of cached recordings; the oldest are deleted.
_MOST = 8
_MANIFEST = "dataset.json"


def kept(
    name: str,
    recipe: Mapping[str, Any],
    make: Callable[[Path], Path],
    scratch: Path,
    folder: Path | None = None,
) -> Path:
    """Return the dataset ``name``, from the cache or made by ``make``.

    It is cached atomically. If another process is making it at the same time, it is made again in
    ``scratch``.

    Args:
        name: name of the returned folder.
        recipe: all inputs that it depends on, besides our own code.
        make: makes the dataset inside the given folder and returns the dataset's folder.
        scratch: a folder, not existing yet, to make it in if ``folder`` is not writable.
        folder: the cache; the user's cache if not given.
    """
    text = json.dumps([__version__, _code(), name, recipe], sort_keys=True, default=str)
    key = hashlib.sha256(text.encode()).hexdigest()[:24]
    if folder is None:
        from platformdirs import user_cache_path

        folder = user_cache_path("urbantwin", appauthor=False) / "arbitrary"
    target = folder / key
    if (target / name / _MANIFEST).is_file():
        return target / name
    with ExitStack() as stack:
        try:
            made_in = stack.enter_context(claimed(target)).folder
        except InputError:  # read-only, or another process is making it
            scratch.mkdir()
            return make(scratch)
        dataset = make(made_in)
        for other in made_in.iterdir():
            if other != dataset:
                shutil.rmtree(other)
        dataset.rename(made_in / name)
        shutil.rmtree(target, ignore_errors=True)  # a leftover without a dataset
        made_in.rename(target)
    _forget(folder, target)
    return target / name


def _forget(folder: Path, newest: Path) -> None:
    remove_dead(folder)
    there = [one for one in folder.iterdir() if one.is_dir() and not one.name.startswith(".")]
    older = sorted((one for one in there if one != newest), key=lambda one: one.stat().st_mtime)
    for one in older[: max(len(older) - _MOST + 1, 0)]:
        shutil.rmtree(one, ignore_errors=True)


def _code() -> str:
    """Return the SHA-256 of the package's own files, as code also changes between versions."""
    digest = hashlib.sha256()

    def add(folder: Traversable) -> None:
        for entry in sorted(folder.iterdir(), key=lambda one: one.name):
            if entry.is_dir():
                add(entry)
            elif entry.name.endswith((".py", ".yaml", ".csv")):
                digest.update(entry.read_bytes())

    for floor in ("geometry", "site", "ground", "roads", "scene", "twin", "traffic", "lidar"):
        add(files("urbantwin").joinpath(floor))
    add(files("urbantwin").joinpath("dataset"))
    return digest.hexdigest()


#: Name of the example, and of its folder.
SITE = "two-avenues"
#: Maximum number of frames of the control.
MOST_FRAMES = 30
#: Maximum duration of the traffic, seconds: a rig of one frame per minute has fewer frames.
_LONGEST_S = 30.0
#: Traffic after the time of the last frame, whose rotation takes time, seconds.
_AFTER_S = 1.0


def arbitrary_recording(
    twin: Recording,
    frames: int,
    scratch: Path,
    progress: Progress | None = None,
    *,
    cache: Path | None = None,
) -> Recording:
    """Return frames of the example site, recorded by the sensors of a twin's recording.

    Our datasets state their rig: models, poses relative to the site's centre, rate, effects,
    weather, and the carrier. For other clouds the sensor is guessed (`rig.likely_rig`). The first
    call for a rig takes seconds; the frames are then kept in the user's cache.

    Args:
        twin: the synthetic frames.
        frames: number of frames needed; at most ``MOST_FRAMES`` are recorded.
        scratch: a folder, not existing yet, to record in if the cache is not writable.
        progress: called with the fraction done and the current step.
        cache: a folder to use instead of the user's cache.

    Raises:
        UrbanTwinError: the recording cannot be made.
    """
    manifest = _manifest(twin)
    rig = rig_of_manifest(manifest)
    seed = _seed(manifest) if rig is not None else 0
    notes = [f"The arbitrary site is the example {SITE}, built, driven and recorded alike."]
    first = _first(twin)
    spec: dict[str, Any] = {}
    if rig is None:
        spec, told = likely_rig(first)
        notes.append(f"Its rig is not the twin's, which is not known: it is {told}.")
    count = min(max(frames, 1), MOST_FRAMES)
    told_rig = spec if rig is None else manifest["rig"]
    recipe = {"rig": told_rig, "frames": count, "seed": seed}

    def say(fraction: float, what: str) -> None:
        if progress is not None:
            progress(fraction, f"arbitrary site: {what}")

    def make(folder: Path) -> Path:
        return _made(folder, rig, spec, count, seed, say)

    folder = kept(SITE, recipe, make, scratch, cache)
    say(1.0, "there")
    recorded = open_recording(folder)
    read = _Moved(recorded, twin, first, rig)
    return Recording(folder, recorded.layout, recorded.names, read, tuple(notes))


@dataclass(frozen=True, eq=False)
class _Moved:
    """Reader of the site's frames in the frame of reference of the twin's frames."""

    recorded: Recording
    twin: Recording
    first: Frame
    rig: Rig | None

    def __call__(self, index: int) -> Frame:
        frame, rig = self.recorded.read(index), self.rig
        if rig is None:
            return frame.moved(_at(self.first))
        if rig.frame != "site":
            return frame
        if rig.ride is None:
            return frame.moved(level_frame(rig))
        return frame.moved(_at(self.twin.read(min(index, len(self.twin) - 1))))


def _at(frame: Frame) -> Pose:
    """Return the pose without rotation at the position of a frame's first sensor."""
    return Pose(np.eye(3), np.asarray(frame.sensor_places[0], np.float64))


def _manifest(twin: Recording) -> Mapping[str, Any]:
    with suppress(InputError):
        return read_json(twin.path / "dataset.json", kind="dataset")
    return {}


def _seed(manifest: Mapping[str, Any]) -> int:
    """Return the seed of a dataset's recording; 0 if its manifest has none."""
    seeds = manifest.get("seeds")
    seed = seeds.get("record") if isinstance(seeds, dict) else None
    return seed if isinstance(seed, int) and seed >= 0 else 0


def _first(twin: Recording) -> Frame:
    """Return the first readable frame."""
    for index in range(len(twin)):
        with suppress(InputError):
            return twin.read(index)
    return twin.read(0)


def _made(
    folder: Path, rig: Rig | None, spec: Mapping[str, Any], frames: int, seed: int, say: Progress
) -> Path:
    """Build the site in a folder, simulate its traffic, and return the recorded dataset."""
    rate_hz = float(spec["rate_hz"]) if rig is None else rig.rate_hz
    stop_s = min((frames - 1) / rate_hz, _LONGEST_S)
    twin = build_twin(load_site(_site()), folder / "twin", lambda f, what: say(0.4 * f, what))
    motion = run_traffic(
        twin,
        folder / "motion",
        seconds=np.ceil(stop_s + _AFTER_S),
        progress=lambda f, what: say(0.4 + 0.3 * f, what),
    )
    # A carrier that soon leaves the site has fewer frames.
    tries = [(one, part * stop_s) for part in (1, 0.3, 0) for one in _stood(rig, spec, twin)]
    for number, (one, until_s) in enumerate(tries, start=1):
        try:
            record(
                twin,
                motion,
                one,
                folder / "dataset",
                # More workers would each start Python anew, which takes as long as the frames.
                workers=1,
                seed=seed,
                stop_s=until_s,
                progress=lambda f, what: say(0.7 + 0.3 * f, what),
            )
        except InputError:
            if number == len(tries):
                raise
            continue
        break
    return folder / "dataset"


def _stood(rig: Rig | None, spec: Mapping[str, Any], twin: Twin) -> list[Rig]:
    """Return the rig at the site, followed by fallbacks if it cannot be mounted."""
    if rig is None:
        return [place_rig(RigSpec.model_validate(spec), twin.mesh)]
    here = replace(rig, frame="level") if rig.frame == "site" else rig
    if here.ride is None:
        return [standing(here, twin.mesh)]
    classes = dict.fromkeys([here.ride.actor_class or "car", "car"])
    return [one for name in classes for one in riding(here, name)]


def _site() -> Path:
    """Return the example's file, of an installed package or of a working copy."""
    here = Path(__file__).resolve()
    for folder in (here.parent, here.parents[4] / "examples"):
        if (folder / SITE / "site.yaml").is_file():
            return folder / SITE / "site.yaml"
    raise InputError("not found", file=f"{SITE}/site.yaml", expected="an installation with it")
