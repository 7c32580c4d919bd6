"""Real frames of a fit: split by time, and read without their labels."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.reading.frame_files import FrameFiles
from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.histograms import full_scale
from urbantwin.fidelity.readers import Recording, open_recording
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.sampling import evenly
from urbantwin.io.points import read_fields

__all__ = ["MOST_FRAMES", "Looks", "Split", "looks_of", "open_unlabelled", "split_in_time"]

#: Share of the frames in the unused gap between the parts, as neighbours are similar.
_GAP = 0.05
#: Share of the frames before the gap that is used for validation.
_VALIDATION = 0.25
#: Minimum number of frames before the gap for a validation part.
_LEAST_TO_VALIDATE = 4


@dataclass(frozen=True)
class Split:
    """Numbers of the frames of each part, ascending; parts are consecutive in time.

    Attributes:
        training: frames that are fitted.
        validation: frames that decide whether a fit is kept; empty with too few frames.
        gap: unused frames.
        held_out: frames that are not read before the fit is written.
    """

    training: tuple[int, ...]
    validation: tuple[int, ...]
    gap: tuple[int, ...]
    held_out: tuple[int, ...]


def split_in_time(count: int, held_out: float = 0.3) -> Split:
    """Split frames by time: the last ones are held out, with a gap before them.

    Args:
        count: number of frames.
        held_out: share that is held out, above 0 and below 1; at least one frame.

    Raises:
        InputError: fewer than two frames, or an invalid share.
    """
    if not 0 < held_out < 1:
        raise InputError(
            f"the share held out is {held_out:g}", place="held-out", expected="above 0, below 1"
        )
    if count < 2:
        raise InputError(
            f"the recording holds {count} frame",
            expected="two at least: to fit to, and to judge the fit by",
        )
    last = min(count - 1, max(1, round(held_out * count)))
    before = count - last
    gap = min(math.ceil(_GAP * count), before - 1) if before > 3 else 0
    before -= gap
    proof = round(_VALIDATION * before) if before >= _LEAST_TO_VALIDATE else 0
    edges = (0, before - proof, before, before + gap, count)
    parts = [tuple(range(a, b)) for a, b in pairwise(edges)]
    return Split(*parts)


#: Maximum number of frames read per part; longer parts are sampled evenly.
MOST_FRAMES = 40


@dataclass(frozen=True, eq=False)
class Looks:
    """The concatenated points of some frames.

    Attributes:
        points: (N, 3) float64, metres, frame of the recording.
        intensity: (N,) 0..1; ``None`` if a frame has none.
        sensor: (N,) index of the rig's sensor.
        frame: (N,) index of the readable frame, from 0.
        clouds: these frames, without labels.
        problems: errors of the unreadable frames.
    """

    points: NDArray[np.float64]
    intensity: NDArray[np.float64] | None
    sensor: NDArray[np.int64]
    frame: NDArray[np.int64]
    clouds: tuple[Frame, ...]
    problems: tuple[str, ...] = field(default=())

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.clouds)


def open_unlabelled(
    path: Path, *, layout: str | None = None, columns: int | None = None
) -> Recording:
    """Open a recording; only points and rays of our datasets are read.

    Labels, and tables with the true sensor poses, are not opened.

    Raises:
        InputError: see ``readers.open_recording``.
    """
    recording = open_recording(path, layout, columns=columns)
    if recording.layout != "own":
        return recording
    folder = recording.path

    def read(index: int) -> Frame:
        name = recording.names[index]
        kept = FrameFiles(folder, name)
        given: dict[str, Any] = {}
        if (table := kept.known_rays) is not None:
            known = table.dtype.names or ()
            given = {x: table[x] for x in ("sensor", "ring") if x in known}
        fields = read_fields(kept.file, columns) if kept.is_plain else kept.fields
        return frame_of(kept.file, fields, name=name, given=given)

    if not all(FrameFiles(folder, name).file.is_file() for name in recording.names):
        return recording
    return replace(recording, read_frame=read)


def looks_of(
    recording: Recording,
    numbers: Sequence[int],
    sensors: int,
    *,
    scale: float | None = None,
    tell: Callable[[int, int], None] | None = None,
) -> tuple[Looks, float | None]:
    """Read the given frames only.

    Args:
        recording: the recording.
        numbers: numbers of the frames; above `MOST_FRAMES` they are sampled evenly.
        sensors: number of sensors of the rig.
        scale: full scale of intensity; estimated from the frames if not given.
        tell: called with the number of frames read and their total.

    Returns:
        The frames, and the full scale of their intensity, ``None`` without intensity.

    Raises:
        InputError: no frame is readable (the first one's error), or a point's sensor is unknown.
    """
    places = evenly(len(numbers), MOST_FRAMES)
    frames: list[Frame] = []
    problems: list[str] = []
    first: InputError | None = None
    for done, place in enumerate(places):
        if tell is not None:
            tell(done, len(places))
        try:
            frames.append(recording.read(numbers[place]))
        except InputError as error:
            first = first or error
            problems.append(str(error))
    if not frames:
        raise first or InputError("holds no frames", file=recording.path)
    count = [len(one.points) for one in frames]
    intensity = None
    if all(one.intensity is not None for one in frames):
        intensity = np.concatenate([np.asarray(one.intensity) for one in frames])
        scale = scale or full_scale(float(intensity.max()))
        intensity = np.clip(intensity / scale, 0.0, 1.0)
    return Looks(
        np.concatenate([one.points for one in frames]),
        intensity,
        np.concatenate([_sensor(one, sensors, recording.path) for one in frames]),
        np.repeat(np.arange(len(frames)), count),
        tuple(replace(one, boxes=None, instance=None, semantic=None) for one in frames),
        tuple(problems),
    ), scale


def _sensor(frame: Frame, sensors: int, path: Path) -> NDArray[np.int64]:
    if sensors == 1:
        return np.zeros(len(frame.points), np.int64)
    if frame.sensor is None or frame.sensor.max(initial=0) >= sensors:
        raise InputError(
            f"does not say which of the rig's {sensors} sensors a point is from",
            file=path,
            place=frame.name,
            expected="a field of sensors' numbers, or one sensor and its frames at a time",
        )
    return frame.sensor
