"""Queries of a motion's actors by time and place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.traffic.assets import asset
from urbantwin.traffic.events.measures import Passage, corners_of
from urbantwin.traffic.motion import Motion
from urbantwin.traffic.prescribed import PrescribedPath

__all__ = ["Surroundings", "passage_of_path"]

#: Boxes whose centres are farther apart than this are ignored, metres.
_MAX_CENTRE_DISTANCE_M = 25.0


@dataclass(frozen=True)
class Nearest:
    """The nearest actor: track, gap between the boxes in metres, and time."""

    track: int
    gap_m: float
    at_s: float


class _Others(NamedTuple):
    """Boxes (N,) near a passage at its times.

    Attributes:
        number: (N,) index of the time.
        track: (N,) track id.
        xy: (N, 2) centre, metres.
        yaw: (N,) rad.
        length: (N,) metres.
        width: (N,) metres.
    """

    number: NDArray[np.int64]
    track: NDArray[np.int64]
    xy: NDArray[np.float64]
    yaw: NDArray[np.float64]
    length: NDArray[np.float64]
    width: NDArray[np.float64]

    def and_others(self, more: _Others) -> _Others:
        return _Others._make(np.concatenate(both) for both in zip(self, more, strict=True))

    def at(self, rows: NDArray[np.bool_]) -> _Others:
        return _Others._make(column[rows] for column in self)


def _nearest(passage: Passage, others: _Others) -> Nearest | None:
    """Return the box nearest to a passage; of equally near ones the first in time."""
    if not len(others.number):
        return None
    # A gap is at least the distance of the centres less both outer radii, and at most that less
    # both inner radii: few boxes need the exact distance.
    apart = np.linalg.norm(others.xy - passage.xy[others.number], axis=1)
    outer = (np.hypot(others.length, others.width) + np.hypot(passage.length, passage.width)) / 2
    inner = (np.minimum(others.length, others.width) + min(passage.length, passage.width)) / 2
    nearby = others.at(apart - outer <= max(float((apart - inner).min()), 0.0) + 1e-6)
    boxes = shapely.polygons(corners_of(nearby.xy, nearby.yaw, nearby.length, nearby.width))
    gap = shapely.distance(passage.of_rows(nearby.number).boxes(), boxes)
    best = int(np.lexsort([nearby.track, nearby.number, gap])[0])
    at_s = float(passage.time_s[nearby.number[best]])
    return Nearest(int(nearby.track[best]), float(gap[best]), at_s)


class Surroundings:
    """The actors of a motion.

    Args:
        motion: the motion.
    """

    def __init__(self, motion: Motion) -> None:
        table = motion.actors
        self.motion = motion
        self.time_s = np.asarray(table["time_s"].to_numpy(), np.float64)
        self._steps, begins = np.unique(self.time_s, return_index=True)
        self._begins = np.append(begins, len(self.time_s))
        if not len(self._steps):  # no actors at all
            self._steps, self._begins = np.array([np.inf]), np.zeros(2, np.int64)
        self.track = np.asarray(table["track"].to_numpy(), np.int64)
        self.xy = np.column_stack([table[name].to_numpy() for name in ("x", "y")])
        self.yaw = np.asarray(table["yaw"].to_numpy(), np.float64)
        self.speed = np.asarray(table["speed"].to_numpy(), np.float64)
        self.length = np.asarray(table["length"].to_numpy(), np.float64)
        self.width = np.asarray(table["width"].to_numpy(), np.float64)
        self.kind = np.asarray(table["class"].to_numpy(zero_copy_only=False), str)
        standing = motion.parked
        self._parked = {
            name: np.asarray(standing[name].to_numpy(), np.float64)
            for name in ("track", "x", "y", "yaw", "length", "width")
        }
        self._order = np.lexsort([self.time_s, self.track])
        self._tracks = self.track[self._order]

    def rows_of(self, track: int) -> NDArray[np.intp]:
        """Return the rows of a track in the order of time."""
        first, last = np.searchsorted(self._tracks, [track, track + 1])
        return self._order[first:last]

    def passage(self, track: int) -> Passage:
        """Return the passage of a track."""
        rows = self.rows_of(track)
        ahead = np.column_stack([np.cos(self.yaw[rows]), np.sin(self.yaw[rows])])
        return Passage(
            self.time_s[rows],
            self.xy[rows],
            self.yaw[rows],
            ahead * self.speed[rows][:, None],
            float(self.length[rows].max(initial=0.0)),
            float(self.width[rows].max(initial=0.0)),
        )

    def nearest(self, passage: Passage, ignoring: frozenset[int] = frozenset()) -> Nearest | None:
        """Return the nearest actor to a passage whose times are steps of the motion."""
        if not len(passage.time_s):
            return None
        step = np.searchsorted(self._steps, passage.time_s - 1e-6).clip(0, len(self._steps) - 1)
        first, last = self._begins[step], self._begins[step + 1]
        count = np.where(np.abs(self._steps[step] - passage.time_s) < 1e-6, last - first, 0)
        number = np.repeat(np.arange(len(step)), count)
        row = np.arange(len(number)) + np.repeat(first - (np.cumsum(count) - count), count)
        is_near = np.hypot(*(self.xy[row] - passage.xy[number]).T) < _MAX_CENTRE_DISTANCE_M
        is_near &= ~np.isin(self.track[row], list(ignoring))
        row, number = row[is_near], number[is_near]
        moving = _Others(
            number,
            self.track[row],
            *(self.xy[row], self.yaw[row], self.length[row], self.width[row]),
        )
        return _nearest(passage, moving.and_others(self._parked_near(passage)))

    def _parked_near(self, passage: Passage) -> _Others:
        """Return the parked vehicles near a passage, at the times of nearness."""
        parked = self._parked
        xy = np.column_stack([parked["x"], parked["y"]])
        away = np.linalg.norm(xy[:, None] - passage.xy, axis=2)
        which, number = np.nonzero(away < _MAX_CENTRE_DISTANCE_M)
        sides = (parked[name][which] for name in ("yaw", "length", "width"))
        return _Others(number, parked["track"][which].astype(np.int64), xy[which], *sides)

    def passing(
        self,
        xy: NDArray[np.float64],
        at_s: float,
        within_s: float,
        *,
        classes: tuple[str, ...],
        yaw: float | None,
        until_s: float,
        near_m: float = 2.0,
        least_ms: float = 2.0,
    ) -> list[tuple[int, float]]:
        """Return the tracks that pass a place, with their times, the nearest to a time first.

        Args:
            xy: (2,) the place.
            at_s: the time.
            within_s: tolerance of the time.
            classes: classes of actors to consider.
            yaw: heading, within 60 degrees, rad; ``None``: any.
            until_s: latest time.
            near_m: largest distance of its centre from the place.
            least_ms: least speed, m/s.
        """
        away = np.hypot(*(self.xy - xy).T)
        right = np.cos(self.yaw - (self.yaw if yaw is None else yaw)) > 0.5
        passes = (away < near_m) & (self.speed > least_ms) & right & np.isin(self.kind, classes)
        passes &= (np.abs(self.time_s - at_s) <= within_s) & (self.time_s <= until_s)
        passages = []
        for track in np.unique(self.track[passes]):
            rows = self.rows_of(int(track))
            nearest = rows[int(np.argmin(away[rows]))]
            passages.append((abs(float(self.time_s[nearest]) - at_s), int(track), nearest))
        return [(track, float(self.time_s[row])) for _, track, row in sorted(passages)]


def passage_of_path(path: PrescribedPath, motion: Motion) -> Passage:
    """Return the passage of a prescribed actor at the steps of a motion."""
    times = motion.times()
    times = times[(times >= path.time_s[0] - 1e-6) & (times <= path.time_s[-1] + 1e-6)]
    heading = path.heading()
    columns = (*path.xy.T, heading, path.pace(heading))
    x, y, yaw, speed = (np.interp(times, path.time_s, column) for column in columns)
    mesh = asset(path.asset)
    ahead = np.column_stack([np.cos(yaw), np.sin(yaw)]) * speed[:, None]
    return Passage(times, np.column_stack([x, y]), yaw, ahead, mesh.length, mesh.width)
