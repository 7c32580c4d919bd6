"""Extension of entry roads that begin shortly before a stop line."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from urbantwin.roads import RoadNetwork
from urbantwin.traffic.demand.demand import Demand
from urbantwin.traffic.sumo.simulation import Simulated

__all__ = ["net_with_run_ups", "without_run_ups"]

#: Length to which entry roads are extended, metres, if they are shorter than the second: room to
#: slow down from 50 km/h, and for a queue of twenty.
_RUN_UP_M, _SHORT_ROAD_M = 150.0, 60.0
#: Difference in length between the lanes of a curved road, metres.
_CURVE_DIFFERENCE_M = 20.0
#: A vehicle is in the motion once its front has passed the map's border by this, metres.
_FRONT_M = 4.0


def net_with_run_ups(net: Path, demand: Demand, out: Path) -> Path:
    """Write a network whose short entry roads begin farther out, and return its path.

    Maps of lanes (Lanelet2, OpenDRIVE) often begin a few car lengths before the stop line. Vehicles
    that depart there have no room to slow down, and queues cannot form. The roads are extended
    straight, away from the map.

    Args:
        net: SUMO's network.
        demand: the trips.
        out: the file to write; not written if no road is short.
    """
    first = {trip.edges[0] for trip in demand.trips if trip.actor_class != "pedestrian"}
    walked = {
        edge
        for trip in demand.trips
        if trip.actor_class == "pedestrian" or trip.halts
        for edge in trip.edges
    }
    document = etree.parse(net)
    if not _lengthen_short(document.getroot(), first - walked):
        return net
    document.write(str(out), encoding="UTF-8", xml_declaration=True)
    return out


def without_run_ups(simulated: Simulated, net: Path, roads: RoadNetwork) -> Simulated:
    """Return SUMO's output without the rows beyond the map.

    Args:
        simulated: output on a network with or without extended roads.
        net: the network.
        roads: the lanes of the map.
    """
    beyond_map = np.zeros(len(simulated.step), np.bool_)
    lanes = {name: number for number, name in enumerate(simulated.lanes)}
    for item in etree.parse(net).getroot().iterfind("edge/lane"):
        lane = roads.lane_by_id.get(item.get("id", ""))
        if lane is None or not lane.road or lane.id not in lanes:
            continue
        points = lane.centre[:, :2]
        long_m = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        if (
            float(item.get("length", "0"))
            < long_m + _RUN_UP_M - _SHORT_ROAD_M - _CURVE_DIFFERENCE_M
        ):
            continue
        ahead = (points[1] - points[0]) / np.linalg.norm(points[1] - points[0])
        on_lane = np.flatnonzero(simulated.lane == lanes[lane.id])
        beyond_map[on_lane[(simulated.front[on_lane] - points[0]) @ ahead < _FRONT_M]] = True
    return simulated.only(~beyond_map) if beyond_map.any() else simulated


def _lengthen_short(root: etree._Element, edges: Collection[str]) -> int:
    """Lengthen the short ones of some edges; return their number."""
    count = 0
    for edge in root.iterfind("edge"):
        lanes = edge.findall("lane")
        long_m = max((float(lane.get("length", "0")) for lane in lanes), default=0.0)
        if edge.get("id") not in edges or not 0 < long_m < _SHORT_ROAD_M:
            continue
        count += 1
        for lane in lanes:
            points = [tuple(map(float, x.split(","))) for x in lane.get("shape", "").split()]
            more = _RUN_UP_M - long_m
            shape = [_point_behind(np.array(points), more), *points]
            lane.set("shape", " ".join(",".join(f"{x:.3f}" for x in point) for point in shape))
            lane.set("length", f"{float(lane.get('length', '0')) + more:.3f}")
    return count


def _point_behind(points: NDArray[np.float64], away_m: float) -> tuple[float, ...]:
    """Return the point straight behind the beginning of a line, metres away in plan."""
    ahead = points[1, :2] - points[0, :2]
    place = points[0].copy()
    place[:2] -= away_m * ahead / np.linalg.norm(ahead)
    return tuple(place.tolist())
