"""Replay: recorded tracks as a motion on a twin."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin import __version__
from urbantwin.artefact import replaced_folder, sha256_of
from urbantwin.errors import InputError
from urbantwin.progress import Progress, between, each, untold
from urbantwin.result_warning import ResultWarning, rows_of
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.assets import asset, asset_names, coated_name, sized_name
from urbantwin.traffic.assets.asset_name import COATED_CLASSES
from urbantwin.traffic.calibration.passages import SeenTrack
from urbantwin.traffic.fingerprint import meshes_sha256, table_sha256
from urbantwin.traffic.motion import MOTION_VERSION, Motion
from urbantwin.traffic.prescribed import PrescribedPath, TwinSurface, prescribed_table, usual_asset
from urbantwin.traffic.recorded.description import load_description
from urbantwin.traffic.recorded.read import files_of, read_recording
from urbantwin.traffic.recorded.track import RecordedTrack, Recording
from urbantwin.traffic.recorded.track_smoothing import SmoothTrack, smooth_track
from urbantwin.traffic.recorded_signals import recorded_signal_table
from urbantwin.twin import Twin

__all__ = ["replay"]

_MAX_DURATION_S = 86400.0
#: Sizes beyond these multiples of the smallest and largest mesh of the class are not trusted.
_MIN_SIZE_FACTOR, _MAX_SIZE_FACTOR = 0.7, 1.4
#: Length of a pedestrian in stride, metres, and usual walking speed, m/s.
_STRIDE_M, _WALKING_M_S = 0.7, 1.2
_SIDES = ("length", "width", "height")
#: Names of tracks without personal data, unlike a licence plate or a person's name.
_is_plain_number = re.compile(r"[0-9]{1,9}").fullmatch
_MAX_OFF_GROUND_SHARE = 0.02  # share of poses beside the ground above which there is a warning


def replay(  # noqa: PLR0913 - the options of the command
    twin: Twin,
    tracks: Path,
    out: Path,
    *,
    step_s: float | None = None,
    smooth: bool = True,
    keep_clock: bool = False,
    keep_names: bool = False,
    also: Callable[[Motion, Path], None] | None = None,
    progress: Progress = untold,
) -> Motion:
    """Write a motion of recorded tracks.

    Args:
        twin: the twin that they move on.
        tracks: a description of tracks (YAML), or a file of tracks.
        out: the folder to write.
        step_s: time between two steps, seconds; ``None``: the site's ``traffic.step_s``.
        smooth: smooth the paths.
        keep_clock: store the recording's clock at 0 s, which is a time of day.
        keep_names: store all names of the recording's tracks, not only numbers.
        also: called with the motion and its folder before the folder appears, to add files.
        progress: called with the fraction done and what is being done.

    Raises:
        InputError: the tracks, the step or ``out`` cannot be used.
    """
    step = float(twin.site["traffic"]["step_s"] if step_s is None else step_s)
    if not 0.001 <= step <= 10.0:
        raise InputError(f"a step of {step:g} s", place="step", expected="0.001 to 10 seconds")
    with replaced_folder(out, kind="motion", inputs=[twin.folder, *files_of(tracks)]) as folder:
        progress(0.0, "reading tracks")
        recording = read_recording(tracks, twin.frame)
        spec = load_description(tracks)[0]
        sized = spec.sizes == "recorded"
        motion = _replayed(twin, recording, step, smooth, sized, between(progress, 0.1, 0.9))
        recorded = {
            **({"begins_s": recording.begins_s} if keep_clock else {}),
            **motion.manifest["recorded"],
            "files": _named(files_of(tracks)),
            "licence": spec.licence,
            "attribution": spec.attribution,
        }
        if not keep_names:
            recorded["names"] = {
                number: name for number, name in recorded["names"].items() if _is_plain_number(name)
            }
        motion = replace(motion, manifest={**motion.manifest, "recorded": recorded})
        progress(0.9, "writing the motion")
        motion.write(folder)
        if also is not None:
            progress(0.95, "drawing the paths")
            also(motion, folder)
    progress(1.0, "done")
    return motion


def _replayed(
    twin: Twin, recording: Recording, step_s: float, smooth: bool, sized: bool, tell: Progress
) -> Motion:
    """Return the motion of a recording."""
    if recording.duration_s > _MAX_DURATION_S:
        raise InputError(
            f"lasts {recording.duration_s:.0f} s", file=recording.file, expected="up to a day"
        )
    steps = int(np.floor(recording.duration_s / step_s + 1e-6)) + 1
    tracks: list[RecordedTrack] = []
    paths: list[PrescribedPath] = []
    smoothed: list[SmoothTrack] = []
    strange: dict[str, Counter[str]] = defaultdict(Counter)
    for track in each(recording.tracks, between(tell, 0.0, 0.4), "smoothing their paths"):
        states = smooth_track(track, step_s, smooth=smooth)
        if states is None:
            continue
        name = (
            _asset_of(track, len(paths), strange)
            if sized
            else usual_asset(track.actor_class, len(paths))
        )
        tracks.append(track)
        smoothed.append(states)
        paths.append(
            PrescribedPath(
                track.actor_class,
                name,
                states.time_s,
                states.xy,
                states.yaw,
                _speed_of(track, states),
                states.z,
                states.absent,
            )
        )
    actors, outside = prescribed_table(
        paths, TwinSurface(twin), steps=steps, step_s=step_s, tell=between(tell, 0.4, 0.9)
    )
    if not actors.num_rows:
        raise InputError(
            "none of its tracks comes onto the ground of the twin",
            file=recording.file,
            expected="tracks within the twin's region; is their origin or CRS another?",
        )
    seen_tracks = [
        SeenTrack(track, states.time_s, states.xy, states.yaw, states.speed)
        for track, states in zip(tracks, smoothed, strict=True)
    ]
    signals, without_place = recorded_signal_table(
        recording.signals, twin, seen_tracks, steps * step_s
    )
    seen = Counter(actors.group_by(["track", "class"]).aggregate([])["class"].to_pylist())
    manifest: dict[str, Any] = {
        "kind": "motion",
        "version": MOTION_VERSION,
        "urbantwin": __version__,
        "twin_sha256": twin.sha256,
        "seed": 0,
        "step_s": step_s,
        "steps": steps,
        "duration_s": round(steps * step_s, 9),
        "classes": {name: {"seen": seen[name]} for name in ACTOR_CLASSES},
        "left_out": [
            {"class": name, "count": count, "why": "no class of actors"}
            for name, count in sorted(recording.left_out.items())
        ],
        "teleports": 0,
        "collisions": 0,
        "poses_outside_ground": outside,
        "recorded": _recorded(recording, tracks, smoothed, smooth=smooth),
    }
    warned = _warnings(recording, strange, outside, actors.num_rows, without_place)
    manifest["warnings"] = rows_of(warned)
    motion = Motion(manifest, actors, signals).with_meshes(between(tell, 0.9, 1.0))
    made = {"actors": table_sha256(motion.rows), "meshes": meshes_sha256(motion.meshes)}
    return replace(motion, manifest={**manifest, "made": made})


def _speed_of(track: RecordedTrack, one: SmoothTrack) -> NDArray[np.float64]:
    """Return the speed (N,), m/s; walking speed for a striding pedestrian with one sample."""
    strides = track.actor_class == "pedestrian" and track.size[0] >= _STRIDE_M
    if len(track.time_s) == 1 and strides:
        return np.full_like(one.speed, _WALKING_M_S)
    return one.speed


def _asset_of(track: RecordedTrack, number: int, strange: Mapping[str, Counter[str]]) -> str:
    """Return the asset of a track: that of its class nearest in size, scaled to the recorded size.

    Pedestrians keep their proportions and are scaled to the recorded height.
    """
    names = asset_names(track.actor_class)
    sizes = np.array([[getattr(asset(name), side) for side in _SIDES] for name in names])
    is_known = np.isfinite(track.size)
    if not is_known.any():
        return usual_asset(track.actor_class, number)
    low, high = sizes.min(axis=0) * _MIN_SIZE_FACTOR, sizes.max(axis=0) * _MAX_SIZE_FACTOR
    beside = is_known & ((track.size < low) | (track.size > high))
    if beside.any():
        size_text = " x ".join(f"{side:.2f}" for side in track.size[is_known])
        strange[track.actor_class][size_text] += 1
        return usual_asset(track.actor_class, number)
    away = np.abs(np.log(sizes[:, is_known] / track.size[is_known])).sum(axis=1)
    chosen = int(np.argmin(away))
    size = np.where(is_known, track.size, sizes[chosen])
    if track.actor_class == "pedestrian" and is_known[2]:
        # A figure's length depends on its stride: scaled to the recorded length, its trunk would be
        # flat.
        size = sizes[chosen] * (track.size[2] / sizes[chosen][2])
    name = names[chosen]
    if track.actor_class in COATED_CLASSES:
        name = coated_name(name, number, track.actor_class)
    return sized_name(name, *size.tolist())


def _recorded(
    recording: Recording,
    tracks: list[RecordedTrack],
    smoothed: list[SmoothTrack],
    *,
    smooth: bool,
) -> dict[str, Any]:
    """Return the manifest's entry about the recording."""
    moved: dict[str, list[np.ndarray[Any, Any]]] = defaultdict(list)
    for track, states in zip(tracks, smoothed, strict=True):
        moved[track.actor_class].append(states.moved_m)
    spans = {
        kind: [
            {"track": number, "from_s": round(begin, 6), "to_s": round(end, 6)}
            for number, states in enumerate(smoothed, 1)
            for begin, end in getattr(states, kind)
        ]
        for kind in ("filled", "absent")
    }
    return {
        "names": {str(number): track.name for number, track in enumerate(tracks, 1)},
        "smoothing": "robust cubic smoothing splines" if smooth else "none",
        "moved_m": {
            name: {
                "rms": round(float(np.sqrt(np.mean(np.concatenate(of_class) ** 2))), 4),
                "most": round(float(np.concatenate(of_class).max()), 4),
            }
            for name, of_class in sorted(moved.items())
        },
        **spans,
    }


def _warnings(
    recording: Recording,
    strange: Mapping[str, Counter[str]],
    outside: int,
    poses: int,
    without_place: list[str],
) -> list[ResultWarning]:
    """Return the warnings of a replayed motion."""
    warnings = [ResultWarning("tracks", assumption) for assumption in recording.assumed]
    for name, sizes in strange.items():
        (size, count), total = sizes.most_common(1)[0], sum(sizes.values())
        warnings.append(
            ResultWarning(
                f"tracks {name}",
                f"{total} have sizes that no {name} has ({count}: {size} m)",
                "the recording's sizes are templates or wrong",
                "the catalogue's sizes are used",
            )
        )
    if outside > _MAX_OFF_GROUND_SHARE * (outside + poses):
        warnings.append(
            ResultWarning(
                "tracks",
                f"{outside} of {outside + poses} poses lie beside the ground",
                "the recording reaches beyond the twin",
                "make the region larger",
            )
        )
    if without_place:
        warnings.append(
            ResultWarning(
                "signals",
                f"groups {', '.join(without_place)} are left out",
                "nothing says where their stop lines are",
                "give them under signals.places",
            )
        )
    return warnings


def _named(files: list[Path]) -> list[dict[str, str]]:
    return [{"name": path.name, "sha256": sha256_of(path)} for path in files]
