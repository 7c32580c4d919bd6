"""Motor traffic past the sensors: planned, and measured in the finished motion."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence, Set
from itertools import pairwise
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import shapely
from numpy.typing import NDArray

from urbantwin.roads import Lane
from urbantwin.roads.assignment.movement_flows import IN_CARS
from urbantwin.site import RigSpec
from urbantwin.traffic.demand.demand import Demand
from urbantwin.traffic.motion_rows import ActorRows
from urbantwin.twin import Twin

__all__ = ["USEFUL_M", "traffic_past_sensors"]

#: Range within which sensors get enough points of a vehicle for good labels, metres; the same as in
#: the evaluation of notebook/places.md.
USEFUL_M = 50.0
#: Maximum height of a street above the ground to be at its level, metres: less than a bridge.
LEVEL_M = 2.5
#: Spacing of points along a lane, metres.
STEP_M = 2.0


def traffic_past_sensors(
    twin: Twin, demand: Demand, actors: ActorRows, *, planned_s: float, steps: int
) -> dict[str, Any]:
    """Return the planned and driven motor traffic past the sensors.

    The streets that count lie within ``USEFUL_M`` of a sensor and on its level: for a sensor on the
    ground, those on a bridge do not count. Driven is the planned traffic, times the distance that
    motor vehicles of the motion travel there, over the distance planned there (flow is distance
    travelled per time and length of road: L. C. Edie, "Discussion of traffic stream measurements
    and definitions", 1963). Vehicles that are left out of the motion do not count as driven.

    Args:
        twin: the twin, with its rig.
        demand: the trips.
        actors: all rows of the motion.
        planned_s: period within which trips that do not circulate depart.
        steps: number of steps of the motion.

    Returns:
        ``within_m``; ``lanes_m``: length of lanes for motor vehicles there;
            ``lanes_without_demand_m``: of those, without planned vehicles; ``asked_per_hour`` and
            ``driven_per_hour``; ``vehicles``: motor vehicles of the motion that are ever there.
    """
    rig = twin.rig_spec() if "rig.yaml" in twin.manifest.get("files", {}) else None
    label_range_m = None if rig is None else rig.label_range_m
    reach_m = USEFUL_M if label_range_m is None else min(USEFUL_M, label_range_m)
    places, levels = _sensors(twin, rig)
    within: dict[str, float] = defaultdict(float)
    lanes_of: dict[str, int] = defaultdict(int)
    watched: list[str] = []
    for lane in twin.roads.lanes:
        if lane.road and lane.road not in demand.outer and IN_CARS.keys() & set(lane.allowed):
            lanes_of[lane.road] += 1
            metres = _metres_within(lane, twin, places, levels, reach_m)
            if metres > 0.0:
                watched.append(lane.id)
                within[lane.road] += metres
    over, into = _planned(demand, within.keys(), planned_s)
    planned_m = sum(over.get(road, 0.0) * within[road] / lanes_of[road] for road in sorted(within))
    driven_m, vehicles = _driven(actors, watched, places, reach_m, steps)
    empty = sum(metres for road, metres in within.items() if over.get(road, 0.0) < 1.0)
    return {
        "within_m": round(reach_m, 1),
        "lanes_m": round(sum(within.values()), 1),
        "lanes_without_demand_m": round(empty, 1),
        "asked_per_hour": round(into, 1),
        "driven_per_hour": round(into * driven_m / planned_m if planned_m else 0.0, 1),
        "vehicles": vehicles,
    }


def _sensors(twin: Twin, rig: RigSpec | None) -> tuple[NDArray[np.float64], list[int]]:
    """Return the sensors' positions on the site (N, 2), and the level of the street below each.

    Without stationary sensors (no rig, or a mounted one), the anchor is used.
    """
    sensors = [sensor for sensor in (rig.sensors if rig else ()) if sensor.east_m is not None]
    places = np.array([[sensor.east_m, sensor.north_m] for sensor in sensors], np.float64).reshape(
        -1, 2
    )
    if not len(places):
        return np.zeros((1, 2)), [0]
    levels = [0] * len(places)
    for lane in twin.roads.lanes:
        if lane.level == 0:
            continue
        for k in np.flatnonzero(shapely.intersects_xy(lane.polygon, places)).tolist():
            nearest_point = np.linalg.norm(lane.centre[:, :2] - places[k], axis=1).argmin()
            up_m = sensors[k].up_m  # otherwise it is given above the uppermost surface
            if up_m is None or up_m > lane.centre[nearest_point, 2]:
                levels[k] = max(levels[k], lane.level)
    return places, levels


def _metres_within(
    lane: Lane,
    twin: Twin,
    places: NDArray[np.float64],
    levels: Sequence[int],
    reach_m: float,
) -> float:
    """Return the length of a lane within reach of a sensor on the same level, metres."""
    own = places[np.array(levels) == lane.level]
    if not len(own) or len(lane.centre) < 2:
        return 0.0
    line = shapely.segmentize(shapely.LineString(lane.centre), STEP_M)
    points = shapely.get_coordinates(line, include_z=True)
    middle = (points[1:] + points[:-1]) / 2
    away = np.linalg.norm(middle[:, None, :2] - own[None], axis=2).min(axis=1)
    counts = away <= reach_m
    if lane.level == 0 and counts.any():
        above = middle[counts, 2] - twin.elevation.raw_at(middle[counts, :2])
        counts[counts] = np.abs(above) <= LEVEL_M
    return float(np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1)[counts].sum())


def _planned(
    demand: Demand, watched: Set[str], planned_s: float
) -> tuple[Mapping[str, float], float]:
    """Return motor vehicles per hour over each edge, and those that enter some edges."""
    over: dict[str, float] = defaultdict(float)
    into = 0.0
    arcs = demand.planned
    if not demand.circulates:
        counted: dict[tuple[str, str], float] = defaultdict(float)
        for trip in demand.trips:
            if trip.actor_class in IN_CARS and trip.edges:
                for arc in pairwise(("", *trip.edges)):
                    counted[arc] += 3600.0 / planned_s
        arcs = counted
    for (before, edge), rate in arcs.items():
        over[edge] += rate
        into += rate * (edge in watched and before not in watched)
    return over, into


def _driven(
    actors: ActorRows,
    watched: Sequence[str],
    places: NDArray[np.float64],
    reach_m: float,
    steps: int,
) -> tuple[float, int]:
    """Return the distance of motor vehicles on lanes in reach, metres per hour, and their count."""
    lanes, classes = pa.array(watched, pa.string()), pa.array(list(IN_CARS))
    speeds = 0.0
    tracks: set[int] = set()
    for part in actors.parts(["track", "class", "x", "y", "speed", "lane"]):
        rows = part.filter(pc.and_(pc.is_in(part["class"], classes), pc.is_in(part["lane"], lanes)))
        xy = np.column_stack([rows["x"].to_numpy(), rows["y"].to_numpy()])
        distance_m = np.linalg.norm(xy[:, None] - places[None], axis=2).min(axis=1, initial=np.inf)
        in_reach = distance_m <= reach_m
        speeds += float(rows["speed"].to_numpy()[in_reach].sum())
        tracks.update(rows["track"].to_numpy()[in_reach].tolist())
    return speeds * 3600.0 / steps, len(tracks)
