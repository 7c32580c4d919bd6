"""Recorded tracks in the site frame, and what no track can be."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError

__all__ = ["RecordedRows", "RecordedSignals", "RecordedTrack", "Recording", "check_order"]

#: Nobody is faster, m/s, and no sensor places them worse, metres.
_FASTEST_MS, _WORST_M = 70.0, 3.0
#: On foot (the 100 m in ten seconds), and on a bicycle downhill.
_FASTEST_OF = {"pedestrian": 12.0, "bicycle": 30.0, "animal": 20.0}


@dataclass(frozen=True, eq=False)
class RecordedRows:
    """What a file says of N moments of actors, in the file's own frame; angles and units are ours.

    Attributes:
        file: the file.
        track: (N,) whose they are, as text.
        time_s: (N,) by the recording's clock.
        kind: (N,) the recording's name of the class.
        xyz: (N, 3) the actor's middle in plan, metres; its height is of the ground below it or of
            its middle, nan where nothing is said. Or longitude and latitude, degrees.
        yaw: (N,) counter-clockwise from x, rad; nan where nothing is said.
        size: (N, 3) length, width, height, metres; nan where nothing is said.
        place: where a row stands in the file, for errors.
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
    """One actor, at N moments.

    Attributes:
        name: as the recording calls it.
        actor_class: one of ``taxonomy.ACTOR_CLASSES``.
        time_s: (N,) ascending, seconds from the recording's start.
        xy: (N, 2) middle of its bounds, site frame, metres.
        yaw: (N,) heading, rad; nan where nothing is said.
        z: (N,) about how high it is, metres; nan where nothing is said.
        size: (3,) its length, width, height: medians of what was said, nan where nothing was.
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
    """What groups of signals showed.

    Attributes:
        shown: group -> (time, SUMO's letter of its state) where it changed, in order.
        places: group -> stop lines (x, y), site frame, metres.
    """

    shown: Mapping[str, tuple[tuple[float, str], ...]]
    places: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Recording:
    """Everything that was recorded, in the site frame.

    Attributes:
        file: of the tracks.
        tracks: in the order in which they begin.
        begins_s: the recording's clock at 0 s.
        duration_s: from the first to the last moment.
        left_out: class of the recording -> how many tracks of it are left out on purpose.
        signals: what the signals showed, if that was recorded.
        assumed: what the file does not say and was taken for granted.
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
    """Refuse a track whose time does not go on, or that leaps.

    Args:
        rows: of the file.
        mine: (M,) which rows are the track's, in the file's order.
        xy: (M, 2) where it is, metres.
        actor_class: which decides how fast it may be.

    Raises:
        InputError: the first such row is named.
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
    fastest = _FASTEST_OF.get(actor_class, _FASTEST_MS)
    if (leap := np.flatnonzero(moved > _WORST_M + fastest * passed)).size:
        row = int(mine[leap[0] + 1])
        raise rows.error(
            row,
            f"track {rows.track[row]} jumps {moved[leap[0]]:.1f} m in {passed[leap[0]]:.3g} s",
            f"no {actor_class} faster than {fastest:g} m/s; two actors with one name?",
        )
