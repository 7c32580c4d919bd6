"""Jaywalking: people who cross a street before they come to its crossing, in gaps that they accept.

SUMO's walkers cross at crossings alone. Some of those who come along a street to the crossing at
its end, and cross it there, do so before they come to it: straight to the footway opposite, where
nothing stands between, and along that to where the crossing ends. They are there when SUMO's
walker is, which had a red light, or a gap, to wait for. They set out in the first gap that is long
enough (Highway Capacity Manual 2010, equation 19-69): for the width of the carriageway at 1.07 m/s
(3.5 ft/s), and 3 s more. Who finds none goes to the crossing.
Gaps are looked for among what SUMO drove; who is later there than that waits as at a crossing
without a signal (`kerbs`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import shapely
import shapely.ops
from numpy.typing import NDArray

from urbantwin.roads import RoadNetwork
from urbantwin.roads.network import Lane
from urbantwin.traffic.assets import Asset
from urbantwin.traffic.demand.demand import Demand
from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.paths.placement import BETWEEN_CROSSINGS
from urbantwin.traffic.sumo.simulation import Jaywalk, Simulated

__all__ = ["with_jaywalkers"]

#: The walking speed that gaps are reckoned with, m/s, and what is added to them, seconds.
_GAP_MS, _START_S = 1.07, 3.0
#: So near nobody may have come before one sets out, seconds, and so near beside one, metres.
_BEFORE_S, _BESIDE_M = 0.5, 0.5
#: Nobody waits longer for a gap than this, seconds; gaps are tried so often, seconds.
_WAITS_S, _TRIES_S = 30.0, 0.5
#: They cross so far before the crossing, metres, and keep so far from where the street ends.
_AHEAD_M, _END_M = (10.0, 60.0), 5.0
#: A street across is no wider, nor narrower, metres; the footway opposite is parallel to within
#: this (cosine), and comes as near to where the crossing ends, metres.
_WIDE_M, _PARALLEL, _CORNER_M = (3.0, 30.0), 0.9, 20.0
#: People walk between these speeds, m/s, and hurry by this factor.
_PACE_MS, _HURRIES = (0.9, 1.8), 1.15
#: Room that one needs to each side, metres.
_ROOM_M = 0.4
_STREAM = 7_300_000

_Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Cut:
    """A way across.

    Attributes:
        across: (2, 2) from the footway to the one opposite.
        along: (K, 2) from there to where the crossing ends.
        carriageway_m: how far one goes on it.
        near: the footway that is left, and the one opposite.
    """

    across: _Floats
    along: _Floats
    carriageway_m: float
    near: tuple[Lane, Lane]


def with_jaywalkers(
    simulated: Simulated,
    demand: Demand,
    network: RoadNetwork,
    blocks: PlanBoxes,
    *,
    share: float,
    seed: int,
    step_s: float,
    asset: Callable[[str], Asset],
) -> Simulated:
    """Return what SUMO saw, with some of its walkers crossing before the crossing.

    Args:
        simulated: what SUMO saw, by step.
        demand: the trips that it refers to.
        network: the lanes.
        blocks: what stands in the way, in plan.
        share: of those who come along a street to its crossing how many cross before it, 0..1.
        seed: of the random choices; each walker has its own.
        step_s: time between steps.
        asset: an asset's dimensions by name.
    """
    if share <= 0 or not len(simulated.step):
        return simulated
    streets = _Streets(network, blocks)
    traffic = _Traffic(simulated, demand, asset)
    order = np.lexsort([simulated.step, simulated.trip])
    trips = simulated.trip[order]
    lanes = list(simulated.lanes)
    front, angle, speed = (
        getattr(simulated, name).copy() for name in ("front", "angle_deg", "speed")
    )
    lane, told = simulated.lane.copy(), []
    for number, trip in enumerate(demand.trips):
        if trip.actor_class != "pedestrian" or trip.beside:
            continue
        rows = order[slice(*np.searchsorted(trips, [number, number + 1]))]
        random = np.random.Generator(np.random.Philox(key=[seed, _STREAM + number]))
        for first, last in _crossed(simulated, rows, network):
            chance, where = random.random(2)
            begin = _begin(simulated.front[rows], first, float(where))
            if chance >= share or begin is None:
                continue
            mine = rows[begin : last + 1]
            street = lanes[simulated.lane[mine[0]]]
            cut = streets.cut(street, simulated.front[mine[0]], simulated.front[mine[-1]])
            if cut is None or np.any(np.diff(simulated.step[mine]) != 1):
                continue
            pace = float(np.clip(np.median(simulated.speed[rows[:first]]), 1.0, _PACE_MS[1]))
            at = _times(traffic, cut, int(simulated.step[mine[0]]), len(mine), pace, step_s)
            if at is None:
                continue
            xy = _placed(cut, at)
            front[mine] = xy
            moved = np.diff(xy, axis=0, prepend=simulated.front[rows[begin - 1]][None])
            went = np.hypot(*moved.T)
            speed[mine] = went / step_s
            ahead = np.where((went > 1e-3)[:, None], moved, cut.across[1] - cut.across[0])
            angle[mine] = np.degrees(np.arctan2(ahead[:, 0], ahead[:, 1]))
            name = BETWEEN_CROSSINGS + cut.near[0].id
            names = (cut.near[0].id, name, cut.near[1].id)
            lanes += [one for one in names if one not in lanes]
            lane[mine] = np.array([lanes.index(one) for one in names])[_sides(cut, at, xy)]
            starts = int(np.argmax(at > 0)) - 1
            told.append(
                Jaywalk(number, float((simulated.step[mine[starts]]) * step_s), starts * step_s,
                        *np.round(cut.across.mean(axis=0), 1).tolist())
            )  # fmt: skip
    return replace(
        simulated, front=front, angle_deg=angle, speed=speed, lane=lane, lanes=tuple(lanes),
        jaywalks=tuple(sorted(told, key=lambda one: (one.time_s, one.trip))),
    )  # fmt: skip


def _crossed(
    simulated: Simulated, rows: NDArray[np.int64], network: RoadNetwork
) -> Iterator[tuple[int, int]]:
    """Yield of each crossing that somebody comes to along a street, when, as numbers of its rows.

    The last row on the footway of the street, and the last one on the crossing.
    """
    lane = simulated.lane[rows]
    ends = np.flatnonzero(np.diff(lane, append=-1))
    kinds = []
    for row in ends.tolist():
        known = network.lane_by_id.get(simulated.lanes[lane[row]])
        kinds.append(known.kind if known is not None and not known.level else "")
    came = -1
    for row, kind in zip(ends.tolist(), kinds, strict=True):
        if kind == "crossing" and came >= 0:
            yield came, row
        if kind != "walkingarea":
            came = row if kind == "sidewalk" else -1


def _begin(xy: _Floats, first: int, where: float) -> int | None:
    """Return the row in which somebody would leave the footway that it is on until a row."""
    far = np.hypot(*(xy[: first + 1] - xy[first]).T)
    ahead = _AHEAD_M[0] + where * (_AHEAD_M[1] - _AHEAD_M[0])
    before = np.flatnonzero(far[::-1] >= ahead)
    if not len(before) or first - before[0] < 1:
        return None
    return int(first - before[0])


class _Streets:
    """Where one can cross."""

    def __init__(self, network: RoadNetwork, blocks: PlanBoxes) -> None:
        self._network = network
        self._footways = [
            one for one in network.lane_by_id.values() if one.kind == "sidewalk" and not one.level
        ]
        self._tree = shapely.STRtree([one.polygon for one in self._footways])
        self._blocks = shapely.STRtree(blocks.polygons)
        self._junctions = shapely.STRtree([one.polygon for one in network.junctions])

    def cut(self, name: str, start: _Floats, end: _Floats) -> _Cut | None:
        """Return the way across from somewhere on a footway to where a crossing ends; or none."""
        lane = self._network.lane_by_id.get(name)
        if lane is None or lane.kind != "sidewalk":
            return None
        line = shapely.LineString(lane.centre[:, :2])
        at = line.project(shapely.Point(start))
        if not _END_M <= at <= line.length - _END_M:
            return None
        across_to = self._across(lane, start, _direction(line, at))
        if across_to is None:
            return None
        ray, opposite = across_to
        other = shapely.LineString(opposite.centre[:, :2])
        there = other.project(ray.intersection(other))
        goal = other.project(shapely.Point(end))
        corner = np.array(other.interpolate(goal).coords[0])
        if (
            np.hypot(*(corner - end)) > _CORNER_M
            or (goal - there) * np.sign(_direction(other, there) @ (end - start)) < 0
        ):
            return None
        landing = np.array(other.interpolate(there).coords[0])
        across = shapely.LineString([start, landing])
        bare = shapely.difference(across, shapely.union(lane.polygon, opposite.polygon)).length
        wide = across.buffer(_ROOM_M)
        stands = self._blocks.query(wide, predicate="intersects")
        meets = self._junctions.query(wide, predicate="intersects")
        if not _WIDE_M[0] <= bare <= _WIDE_M[1] or len(stands) or len(meets):
            return None
        part = shapely.get_coordinates(shapely.ops.substring(other, there, goal))
        return _Cut(np.array([start, landing]), np.vstack([part, end]), bare, (lane, opposite))

    def _across(
        self, lane: Lane, start: _Floats, ahead: _Floats
    ) -> tuple[shapely.LineString, Lane] | None:
        """Return where one would go from a footway over its street, and the footway there."""
        road = next((one for one in self._network.roads if one.id == lane.road), None)
        driven = [
            self._network.lane_by_id[one]
            for one in (road.lanes if road else ())
            if self._network.lane_by_id[one].kind == "driving"
        ]
        if not driven:
            return None
        middle = shapely.LineString(driven[0].centre[:, :2])
        over = np.array(middle.interpolate(middle.project(shapely.Point(start))).coords[0])
        left = np.array([-ahead[1], ahead[0]])
        left *= 1.0 if (over - start) @ left > 0 else -1.0
        ray = shapely.LineString([start, start + left * (_WIDE_M[1] + 5.0)])
        opposite = self._opposite(lane, ray, ahead)
        return None if opposite is None else (ray, opposite)

    def _opposite(self, lane: Lane, ray: shapely.LineString, ahead: _Floats) -> Lane | None:
        """Return the footway on the other side of a street that is parallel and nearest."""
        found: list[tuple[float, Lane]] = []
        for number in self._tree.query(ray, predicate="intersects").tolist():
            other = self._footways[number]
            line = shapely.LineString(other.centre[:, :2])
            met = ray.intersection(line)
            if other.id == lane.id or met.geom_type != "Point":
                continue
            if abs(_direction(line, line.project(met)) @ ahead) > _PARALLEL:
                found.append((ray.project(met), other))
        return min(found, key=lambda one: (one[0], one[1].id))[1] if found else None


class _Traffic:
    """Who drives when where.

    Args:
        simulated: what SUMO saw, by step.
        demand: the trips that it refers to.
        asset: an asset's dimensions by name.
    """

    def __init__(self, simulated: Simulated, demand: Demand, asset: Callable[[str], Asset]) -> None:
        self._seen = simulated
        self._drives = np.array([one.actor_class != "pedestrian" for one in demand.trips])
        sizes = [(asset(one.asset).length, asset(one.asset).width) for one in demand.trips]
        self._size = np.array(sizes).reshape(-1, 2)

    def over(self, line: shapely.LineString, first: int, last: int) -> NDArray[np.bool_]:
        """Return in which steps from the first to the last somebody is on a line, or beside it."""
        found = np.zeros(last - first + 1, np.bool_)
        rows = np.arange(*np.searchsorted(self._seen.step, [first, last + 1]))
        rows = rows[self._drives[self._seen.trip[rows]]]
        far = np.hypot(*(self._seen.front[rows] - np.array(line.centroid.coords[0])).T)
        rows = rows[far < self._size[self._seen.trip[rows], 0] + line.length]
        angle = np.radians(self._seen.angle_deg[rows])
        length, width = self._size[self._seen.trip[rows]].T
        back = np.column_stack([np.sin(angle), np.cos(angle)]) * length[:, None]
        front = self._seen.front[rows]
        bodies = shapely.linestrings(np.stack([front, front - back], axis=1))
        met = shapely.distance(bodies, line) < width / 2 + _BESIDE_M
        found[self._seen.step[rows[met]] - first] = True
        return found


def _times(
    traffic: _Traffic, cut: _Cut, first: int, count: int, pace: float, step_s: float
) -> _Floats | None:
    """Return how far somebody is on its way across at each step (N,), metres; or none.

    Args:
        traffic: who drives.
        cut: the way.
        first: the step in which it is at its beginning.
        count: of steps until it is to be at the end.
        pace: how fast it walks, m/s.
        step_s: time between steps.
    """
    across = float(np.hypot(*(cut.across[1] - cut.across[0])))
    along = float(np.hypot(*np.diff(cut.along, axis=0).T).sum())
    time_s = (count - 1) * step_s
    hurries = (across + along) / (pace * _HURRIES)
    if hurries > time_s:
        return None
    gap = round((cut.carriageway_m / _GAP_MS + _START_S) / step_s)
    before = round(_BEFORE_S / step_s)
    most = round(min(time_s - hurries, _WAITS_S) / step_s)
    over = traffic.over(shapely.LineString(cut.across), first - before, first + most + gap)
    for waits in range(0, most + 1, max(round(_TRIES_S / step_s), 1)):
        if over[waits : waits + before + gap].any():
            continue
        since = np.maximum(np.arange(count) - waits, 0) * step_s
        # Whoever waited long hurries; whoever has time goes slower on the other side.
        left = time_s - waits * step_s
        goes = max(pace, (across + along) / left)
        rest = float(np.clip(along / max(left - across / goes, 1e-3), _PACE_MS[0], goes))
        far = np.where(
            since * goes <= across, since * goes, across + (since - across / goes) * rest
        )
        return np.minimum(far, across + along)
    return None


def _placed(cut: _Cut, at: _Floats) -> _Floats:
    """Return places (N, 2) so far on a way across."""
    way = np.vstack([cut.across, cut.along[1:]])
    far = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
    return np.column_stack([np.interp(at, far, way[:, axis]) for axis in (0, 1)])


def _sides(cut: _Cut, at: _Floats, xy: _Floats) -> NDArray[np.int64]:
    """Return whether somebody is on the footway that it leaves (0), on the street or beyond (2)."""
    across = float(np.hypot(*(cut.across[1] - cut.across[0])))
    side = np.where(at < across, 1, 2)
    side[(at < across / 2) & shapely.contains_xy(cut.near[0].polygon, *xy.T)] = 0
    side[(at >= across / 2) & shapely.contains_xy(cut.near[1].polygon, *xy.T)] = 2
    return side


def _direction(line: shapely.LineString, at: float) -> _Floats:
    """Return where a line leads, a unit vector."""
    ends = shapely.get_coordinates(line.interpolate([max(at - 0.5, 0.0), at + 0.5]))
    return np.asarray((ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0])))
