"""Detours: people walk round what stands in their way, where SUMO leads them straight through.

SUMO's walkers know lanes and walking areas, not the walls, posts and benches on them. Whoever's
way leads through something goes along its outline instead, on the side that is shorter and on the
footway, and comes later by as much as that takes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.ops import substring

from urbantwin.roads import RoadNetwork
from urbantwin.traffic.demand.demand import Demand
from urbantwin.traffic.paths.retiming import GRID_M, LIMITS, Pace, retimed
from urbantwin.traffic.paths.solids import Solids
from urbantwin.traffic.sumo.simulation import Simulated

__all__ = ["round_blocks"]

#: A metre off the footway counts as so many more.
_OFF = 3.0
#: Nobody goes round that is longer than this, metres: there is a way through that the scene lacks.
_LONGEST_M = 25.0
#: Who goes round walks by so much faster than usual, and at least so fast, m/s.
_BRISK, _BRISK_MS = 1.2, 1.5


def round_blocks(
    simulated: Simulated, demand: Demand, network: RoadNetwork, solids: Solids, step_s: float
) -> Simulated:
    """Return what SUMO saw with everybody on foot on the ground going round what stands there.

    Args:
        simulated: what SUMO saw.
        demand: the trips that it refers to.
        network: the lanes.
        solids: what stands in the way.
        step_s: time between steps.
    """
    on_foot = np.array([trip.actor_class == "pedestrian" for trip in demand.trips], np.bool_)
    if not len(simulated.trip) or not len(solids.shapes) or not on_foot.any():
        return simulated
    ground = np.array(
        [
            name not in network.lane_by_id or network.lane_by_id[name].level == 0
            for name in simulated.lanes
        ]
    )[simulated.lane]
    rows = np.flatnonzero(on_foot[simulated.trip] & ground)
    rows = rows[np.lexsort([simulated.step[rows], simulated.trip[rows]])]
    trip, step = simulated.trip[rows], simulated.step[rows]
    front, speed = simulated.front.copy(), simulated.speed.copy()
    breaks = np.flatnonzero((np.diff(trip) != 0) | (np.diff(step) != 1)) + 1
    for mine in np.split(rows, breaks):
        if len(mine) < 2:
            continue
        way = _round(front[mine], solids, network.footway(0))
        if way is not None:
            front[mine], speed[mine] = _walked(way, speed[mine], step_s)
    return replace(simulated, front=front, speed=speed)


def _round(
    front: NDArray[np.float64],
    solids: Solids,
    footway: shapely.Geometry,
) -> NDArray[np.float64] | None:
    """Return a way (N, 2) that leads round the solids; ``None`` where it meets none."""
    way = front.copy()
    met = np.sort(solids.tree.query(shapely.LineString(front), predicate="intersects"))
    for solid in solids.shapes[met]:
        inside = shapely.contains_xy(solid, way[:, 0], way[:, 1])
        edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]])))
        for start, stop in edges.reshape(-1, 2).tolist():
            arc = _along(solid, way[max(start - 1, 0)], way[min(stop, len(way) - 1)], footway)
            if arc is None:
                continue
            run = way[max(start - 1, 0) : stop + 1]
            went = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(run, axis=0).T))])
            share = went[min(start, 1) :][: stop - start] / max(went[-1], 1e-6)
            way[start:stop] = shapely.get_coordinates(
                shapely.line_interpolate_point(arc, share, normalized=True)
            )
    return way if (way != front).any() else None


def _along(
    solid: shapely.Polygon,
    first: NDArray[np.float64],
    last: NDArray[np.float64],
    footway: shapely.Geometry,
) -> shapely.LineString | None:
    """Return the better way along a solid's outline between the places nearest to two points."""
    ends = shapely.points([first, last])
    rings = [solid.exterior, *solid.interiors]
    nearest = [int(np.argmin(shapely.distance(rings, end))) for end in ends]
    if nearest[0] != nearest[1]:
        return None
    ring = shapely.LineString(rings[nearest[0]].coords)
    here, there = (float(ring.project(end)) for end in ends)
    arcs = [substring(ring, here, there)]
    low, high = min(here, there), max(here, there)
    beyond = [substring(ring, high, ring.length), substring(ring, 0.0, low)]
    other = np.concatenate([shapely.get_coordinates(piece) for piece in beyond])
    if len(other) > 1:
        arcs.append(shapely.LineString(other if there < here else other[::-1]))
    cost = [arc.length + _OFF * shapely.difference(arc, footway).length for arc in arcs]
    best = arcs[int(np.argmin(cost))]
    if best.length > _LONGEST_M:
        return None
    return best if best.length > 0 else shapely.LineString([best.coords[0]] * 2)


def _walked(
    way: NDArray[np.float64], speed: NDArray[np.float64], step_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where one is on a way (N, 2) who does not run, and how fast, m/s."""
    at = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
    usual = float(np.median(speed[speed > 0.3])) if (speed > 0.3).any() else 0.0
    most = np.full(int(at[-1] / GRID_M) + 2, max(usual * _BRISK, _BRISK_MS))
    now = retimed(Pace(at, most, step_s), np.full(len(at), np.inf), LIMITS["pedestrian"])
    strictly = at + 1e-9 * np.arange(len(at))
    place = np.column_stack([np.interp(now, strictly, way[:, k]) for k in (0, 1)])
    return place, np.concatenate([speed[:1], np.diff(now) / step_s])
