"""Paths along lanes: from a place on a lane back and onwards through junctions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry.polyline import moved_left, stations_of_points
from urbantwin.roads import Lane, RoadNetwork

__all__ = ["Way", "lane_way"]

#: Spacing of a path's points, and length over which its corners are rounded, metres.
_POINT_SPACING_M, _ROUNDING_LENGTH_M = 0.5, 5.0


@dataclass(frozen=True, eq=False)
class Way:
    """A path in plan.

    Attributes:
        points: (N, 2) metres, site frame.
        lanes: ids of the lanes that it follows, in order; empty if none.
    """

    points: NDArray[np.float64]
    lanes: tuple[str, ...] = ()

    @cached_property
    def stations(self) -> NDArray[np.float64]:
        """Distance (N,) of each point from the first along the way, metres."""
        return stations_of_points(self.points)

    @property
    def length(self) -> float:
        """Length, metres."""
        return float(self.stations[-1])

    def at(self, station: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points (M, 2) at stations (M,), metres, extrapolated beyond the ends."""
        inside = np.clip(station, 0.0, self.length)
        xy = np.column_stack([np.interp(inside, self.stations, axis) for axis in self.points.T])
        first, last = self.points[1] - self.points[0], self.points[-1] - self.points[-2]
        xy += np.minimum(station, 0.0)[:, None] * first / max(np.linalg.norm(first), 1e-9)
        beyond = np.maximum(station - self.length, 0.0)[:, None]
        return np.asarray(xy + beyond * last / max(np.linalg.norm(last), 1e-9))

    def heading(self, station: float) -> float:
        """Return the heading at a station, rad."""
        ends = self.at(np.array([station - 0.5, station + 0.5]))
        return float(np.arctan2(*(ends[1] - ends[0])[::-1]))

    def station_of(self, xy: NDArray[np.float64]) -> float:
        """Return the station of the path's point nearest to a place (2,), metres."""
        return float(shapely.line_locate_point(shapely.LineString(self.points), shapely.Point(xy)))

    def moved(self, left_m: float) -> Way:
        """Return the path shifted to its left, metres."""
        return Way(moved_left(self.points, left_m), self.lanes)

    def reversed(self) -> Way:
        """Return the path from its end to its start."""
        return Way(self.points[::-1].copy(), self.lanes[::-1])

    def onwards(self, other: Way) -> Way:
        """Return this path followed by another."""
        return Way(np.vstack([self.points, other.points]), (*self.lanes, *other.lanes))


def lane_way(
    roads: RoadNetwork,
    lane: Lane,
    along_m: float,
    actor_class: str,
    *,
    back_m: float,
    ahead_m: float,
) -> tuple[Way, float]:
    """Return the straightest path through a place on a lane, and the place's station on it.

    Args:
        roads: the lanes.
        lane: lane of the place.
        along_m: the place, metres from the lane's start.
        actor_class: class that uses the path.
        back_m: length of the path before the place, if the lanes reach so far, metres.
        ahead_m: length of the path beyond the place, metres.
    """
    before = _predecessors_of(roads)
    chain, have = [lane], along_m
    while have < back_m:
        options = [
            previous for previous in before.get(chain[0].id, ()) if actor_class in previous.allowed
        ]
        neighbour = _straightest(options, chain[0], backwards=True, taken=chain)
        if neighbour is None:
            break
        chain.insert(0, neighbour)
        have += neighbour.length
    start_to_place = have
    ahead = lane.length - along_m
    while ahead < ahead_m:
        names = (name for name in chain[-1].successors if name in roads.lane_by_id)
        options = [
            following
            for name in names
            if actor_class in (following := roads.lane_by_id[name]).allowed
        ]
        neighbour = _straightest(options, chain[-1], backwards=False, taken=chain)
        if neighbour is None:
            break
        chain.append(neighbour)
        ahead += neighbour.length
    points = np.vstack([part.centre[:, :2] for part in chain])
    apart = np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-3
    points = points[np.concatenate([[True], apart])]
    whole = Way(points, tuple(part.id for part in chain))
    start = max(start_to_place - back_m, 0.0)
    end = min(start_to_place + ahead_m, whole.length)
    count = max(int((end - start) / _POINT_SPACING_M), 2)
    even = _rounded(whole.at(np.linspace(start, end, count + 1)))
    path = Way(even, whole.lanes)
    return path, path.station_of(whole.at(np.array([start_to_place]))[0])


def _predecessors_of(roads: RoadNetwork) -> Mapping[str, list[Lane]]:
    predecessors: dict[str, list[Lane]] = {}
    for lane in roads.lanes:
        for name in lane.successors:
            predecessors.setdefault(name, []).append(lane)
    return predecessors


def _straightest(
    options: list[Lane], lane: Lane, *, backwards: bool, taken: list[Lane]
) -> Lane | None:
    """Return the lane that continues most straightly; ``None`` if there is none."""
    fresh = [option for option in options if option not in taken]
    if not fresh:
        return None
    own = lane.centre[:, :2]
    heading = own[1] - own[0] if backwards else own[-1] - own[-2]

    def turn(one: Lane) -> tuple[float, str]:
        points = one.centre[:, :2]
        # The far end of a turning lane gives its direction.
        other = points[1] - points[0] if backwards else points[-1] - points[-2]
        size = max(float(np.linalg.norm(other) * np.linalg.norm(heading)), 1e-9)
        return round(-float(heading @ other) / size, 6), one.id

    return min(fresh, key=turn)


def _rounded(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (N, 2) with rounded corners; the ends stay."""
    half = int(_ROUNDING_LENGTH_M / _POINT_SPACING_M / 2)
    if len(points) <= 2 * half + 1:
        return points
    for _ in range(2):
        padded = np.vstack(
            [
                2 * points[0] - points[half:0:-1],
                points,
                2 * points[-1] - points[-2 : -half - 2 : -1],
            ]
        )
        window = np.ones(2 * half + 1) / (2 * half + 1)
        points = np.column_stack([np.convolve(axis, window, "valid") for axis in padded.T])
    return points
