"""The sides of a comparison: real, synthetic and arbitrary frames; reading, checks, foreground."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.background_subtraction import LEAST_FRAMES, Background
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.histograms import full_scale
from urbantwin.fidelity.object_statistics import ObjectStatistics
from urbantwin.fidelity.readers import Recording, open_recording
from urbantwin.fidelity.sampling import evenly
from urbantwin.processes import threads

__all__ = ["ANCHOR", "LABELS", "MODEL", "Side", "model_background", "open_side", "survey"]

#: How foreground is separated from background.
LABELS, MODEL = "labels", "background model"
#: Side of other real frames of the place, for real against real.
ANCHOR = "anchor"
#: Maximum number of frames of a background model; more are sampled evenly.
_MODEL_FRAMES = 60


@dataclass(eq=False)
class Side:
    """One side of a comparison.

    Attributes:
        name: "real", "synthetic", "arbitrary" or "anchor".
        recording: its frames.
        count: number of frames used.
        scale: full scale of its intensity; None if a frame has no intensity.
        problems: number of each unreadable frame -> reason.
        labelled: every readable frame has labels.
        stands: the sensor is fixed, as far as the poses of the frames show.
        objects: statistics of the labelled objects.
        points: number of points of all frames.
        background: background model, if one was made.
    """

    name: str
    recording: Recording
    count: int
    scale: float | None = None
    problems: dict[int, str] = field(default_factory=dict)
    labelled: bool = False
    stands: bool = True
    objects: ObjectStatistics = field(default_factory=ObjectStatistics)
    points: int = 0
    background: Background | None = None

    def read(self, index: int) -> Frame | None:
        """Return a frame; None if it is unreadable or beyond the used ones."""
        if index >= self.count or index in self.problems:
            return None
        return self.recording.read(index)

    def foreground(self, frame: Frame, how: str | None) -> NDArray[np.bool_] | None:
        """Return the mask (N,) of a frame's points on actors; None if unknown."""
        if how == LABELS:
            return frame.foreground()
        if how == MODEL and self.background is not None:
            return self.background.foreground(frame)
        return None


@dataclass(frozen=True, eq=False)
class _Seen:
    """Summary of a frame that was read once."""

    points: int
    largest: float | None  # intensity
    labelled: bool
    objects: ObjectStatistics
    place: NDArray[np.float64] | None

    @classmethod
    def of(cls, frame: Frame) -> _Seen:
        pose, intensity = frame.world_SE3_frame, frame.intensity
        return cls(
            points=len(frame.points),
            largest=None if intensity is None else float(intensity.max()),
            labelled=frame.boxes is not None or frame.instance is not None,
            objects=ObjectStatistics.of([frame]),
            place=None if pose is None else pose.translation,
        )


def open_side(name: str, path: Path, columns: int | None, layout: str | None = None) -> Recording:
    """Open the recording of a side; errors name the side.

    Raises:
        InputError: the recording is missing, or holds no frames of a known layout.
    """
    recording = open_recording(path, layout, columns=columns)
    if not len(recording):
        raise InputError("holds no frames", file=path, place=name, expected="at least one")
    return recording


def survey(side: Side, tell: Callable[[], None]) -> None:
    """Read every frame of a side once, to find unreadable frames before the long work begins.

    Sets all attributes except ``count`` and ``background``.

    Args:
        side: the side to complete.
        tell: called after each frame.

    Raises:
        InputError: no frame can be read; the error of the first one.
    """
    largest: float | None = 0.0
    labelled = 0
    first: InputError | None = None
    poses = []

    def look(index: int) -> _Seen | InputError:
        try:
            return _Seen.of(side.recording.read(index))
        except InputError as error:
            return error

    with ThreadPoolExecutor(threads()) as pool:
        for index, seen in enumerate(pool.map(look, range(side.count))):
            tell()
            if isinstance(seen, InputError):
                first = first or seen
                side.problems[index] = str(seen)
                continue
            if largest is None or seen.largest is None:
                largest = None
            else:
                largest = max(largest, seen.largest)
            labelled += seen.labelled
            side.objects.join(seen.objects)
            side.points += seen.points
            poses += [] if seen.place is None else [seen.place]
    if first is not None and len(side.problems) == side.count:
        raise first
    side.scale = None if largest is None else full_scale(largest)
    side.labelled = labelled == side.count - len(side.problems)
    side.stands = not poses or bool(np.ptp(np.array(poses), axis=0).max() < 0.1)


def model_background(side: Side) -> bool:
    """Make a side's background model; return False with too few frames or a moving sensor."""
    usable = [index for index in range(side.count) if index not in side.problems]
    if len(usable) < LEAST_FRAMES or not side.stands:
        return False
    spread = evenly(len(usable), _MODEL_FRAMES)
    side.background = Background(side.recording.read(usable[i]) for i in spread)
    return True
