"""Recorded tracks in the site frame, and plausibility checks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError

__all__ = ["RecordedRows", "RecordedSignals", "RecordedTrack", "Recording", "check_order"]

#: Maximum speed of any actor, m/s, and worst position error, metres.
_MAX_SPEED_MS, _MAX_POSITION_ERROR_M = 70.0, 3.0
#: Maximum speed on foot (the 100 m in ten seconds), and on a bicycle downhill, m/s.
_MAX_SPEED_OF_CLASS = {"pedestrian": 12.0, "bicycle": 30.0, "animal": 20.0}


@dataclass(frozen=True, eq=False)
class RecordedRows:
    """N rows of a file in its own frame, with UrbanTwin's angles and units.

    Attributes:
        file: the file.
        track: (N,) track names.
        time_s: (N,) by the recording's clock.
        kind: (N,) the recording's name of the class.
        xyz: (N, 3) the actor's centre in plan, metres; height of the ground below it or of its
            centre, nan if unknown. Or longitude and latitude, degrees.
        yaw: (N,) counter-clockwise from x, rad; nan if unknown.
        size: (N, 3) length, width, height, metres; nan if unknown.
        place: returns a row's place in the file, for errors.
        geographic: whether x and y are longitude and latitude.
    """

    file: Path
    track: NDArray[np.object_]
    time_s: NDArray[np.float64]
    kind: NDArray[np.object_]
    xyz: NDArray[np.float64]
    yaw: NDArray[np.float64]
    size: NDArray[np.float64]
    place: Callable[[int], str]
    geographic: bool = False

    def error(self, row: int, problem: str, expected: str | None = None) -> InputError:
        """Return the error to raise for a row."""
        return InputError(problem, file=self.file, place=self.place(row), expected=expected)


@dataclass(frozen=True, eq=False)
class RecordedTrack:
    """One actor at N times.

    Attributes:
        name: its name in the recording.
        actor_class: one of ``taxonomy.ACTOR_CLASSES``.
        time_s: (N,) ascending, seconds from the recording's start.
        xy: (N, 2) centre of its bounds, site frame, metres.
        yaw: (N,) heading, rad; nan if unknown.
        z: (N,) approximate height, metres; nan if unknown.
        size: (3,) its length, width, height: medians, nan if unknown.
    """

    name: str
    actor_class: str
    time_s: NDArray[np.float64]
    xy: NDArray[np.float64]
    yaw: NDArray[np.float64]
    z: NDArray[np.float64]
    size: NDArray[np.float64]


@dataclass(frozen=True)
class RecordedSignals:
    """The states of signal groups.

    Attributes:
        shown: group -> (time, SUMO's letter of its state) at each change, in order.
        places: group -> stop lines (x, y), site frame, metres.
    """

    shown: Mapping[str, tuple[tuple[float, str], ...]]
    places: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording in the site frame.

    Attributes:
        file: file of the tracks.
        tracks: the tracks, by their begin.
        begins_s: the recording's clock at 0 s.
        duration_s: time from the first to the last sample.
        left_out: class of the recording -> number of tracks left out on purpose.
        signals: states of the signals; ``None`` if not recorded.
        assumed: assumptions about information that the file lacks.
    """

    file: Path
    tracks: tuple[RecordedTrack, ...]
    begins_s: float
    duration_s: float
    left_out: Mapping[str, int] = field(default_factory=dict)
    signals: RecordedSignals | None = None
    assumed: tuple[str, ...] = ()


def check_order(
    rows: RecordedRows, mine: NDArray[np.int64], xy: NDArray[np.float64], actor_class: str
) -> None:
    """Raise an error for a track whose times do not ascend, or that jumps.

    Args:
        rows: rows of the file.
        mine: (M,) rows of the track, in the file's order.
        xy: (M, 2) its positions, metres.
        actor_class: its class, which determines the maximum speed.

    Raises:
        InputError: the message names the first such row.
    """
    passed = np.diff(rows.time_s[mine])
    if (back := np.flatnonzero(passed <= 0)).size:
        row = int(mine[back[0] + 1])
        how = "goes back" if passed[back[0]] < 0 else "stands still"
        before = rows.time_s[mine[back[0]]]
        raise rows.error(
            row,
            f"time {how}: track {rows.track[row]} is at {rows.time_s[row]:.10g} s after "
            f"{before:.10g} s",
            "the moments of a track in order, each once",
        )
    moved = np.linalg.norm(np.diff(xy, axis=0), axis=1)
    fastest = _MAX_SPEED_OF_CLASS.get(actor_class, _MAX_SPEED_MS)
    if (leap := np.flatnonzero(moved > _MAX_POSITION_ERROR_M + fastest * passed)).size:
        row = int(mine[leap[0] + 1])
        raise rows.error(
            row,
            f"track {rows.track[row]} jumps {moved[leap[0]]:.1f} m in {passed[leap[0]]:.3g} s",
            f"no {actor_class} faster than {fastest:g} m/s; two actors with one name?",
        )
