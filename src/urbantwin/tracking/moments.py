"""Times and poses of the frames of detections."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.reading.manifest import read_manifest
from urbantwin.detections import Detections
from urbantwin.errors import InputError
from urbantwin.fidelity.readers import open_recording
from urbantwin.geometry import Pose
from urbantwin.progress import Progress, each, untold

__all__ = ["moments", "poses_of"]

#: Maximum motion of a stationary sensor: metres, and elements of its rotation matrix.
_STATIONARY_M, _STATIONARY_ROTATION = 1e-3, 1e-6


def moments(
    found: Detections, file: Path, *, rate: float | None = None, frames: Path | None = None
) -> NDArray[np.float64]:
    """Return the time of each frame (frames,), seconds, ascending.

    Args:
        found: the detections.
        file: their file, for errors.
        rate: frame rate, Hz; ``None``: from the detections or the recording.
        frames: the recording; UrbanTwin datasets contain the times of frames.

    Raises:
        InputError: times are unknown or do not ascend, or there are fewer than two frames.
    """
    count = len(found.frames)
    if count < 2:
        raise InputError(
            f"has {count} frame{'s' * (count != 1)}: too few to track objects",
            file=file,
            expected="frames that follow each other",
        )
    times = found.time_s
    if rate is not None:
        times = np.arange(count) / rate
    elif times is None and frames is not None:
        times = _times_of_dataset(found, frames)
    if times is None:
        raise InputError(
            "does not say when its frames were taken",
            file=file,
            expected="--rate, in frames per second",
        )
    back = np.flatnonzero(~(np.diff(times) > 0))
    if len(back):
        raise InputError(
            f"time does not go on: {times[back[0] + 1]:.10g} s after {times[back[0]]:.10g} s",
            file=file,
            place=f"frame {found.frames[back[0] + 1]}",
            expected="frames in the order of time, or --rate",
        )
    return np.asarray(times, np.float64)


def _times_of_dataset(found: Detections, frames: Path) -> NDArray[np.float64] | None:
    if not (frames / "dataset.json").is_file():
        return None
    time_of = {frame["name"]: frame["time_s"] for frame in read_manifest(frames).get("frames", [])}
    if not set(found.frames) <= set(time_of):
        return None
    return np.array([time_of[name] for name in found.frames], np.float64)


def poses_of(found: Detections, frames: Path, tell: Progress = untold) -> Sequence[Pose] | None:
    """Return the pose of each frame's points in the world; ``None`` for a stationary sensor.

    Raises:
        InputError: it is no recording, lacks a frame, or the pose of a frame is unknown.
    """
    recording = open_recording(frames)
    number = {name: k for k, name in enumerate(recording.names)}
    found_poses: list[Pose] = []
    for name in each(found.frames, tell, "where frames are"):
        if name not in number:
            raise InputError(
                f"has no frame {name:.60}", file=frames, expected="the frames detected"
            )
        pose = recording.read(number[name]).world_SE3_frame
        if pose is None:
            if not found_poses:
                return None
            raise InputError(f"does not say where frame {name:.60} is", file=frames)
        found_poses.append(pose)
    first = found_poses[0]
    moved = max(
        float(np.abs(pose_of_frame.translation - first.translation).max())
        for pose_of_frame in found_poses
    )
    turned = max(
        float(np.abs(pose_of_frame.rotation - first.rotation).max())
        for pose_of_frame in found_poses
    )
    return None if moved < _STATIONARY_M and turned < _STATIONARY_ROTATION else found_poses
