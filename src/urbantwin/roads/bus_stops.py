"""Buses of a map: roads of bus lines, and bus stops."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import SiteFrame, stations_of_points
from urbantwin.roads.network import BusStop, Lane, Road, RoadNetwork
from urbantwin.site.extract import Extract

__all__ = ["bus_poles", "bus_ways", "with_buses"]

#: Maximum distance of a stop's pole or platform from the kerb lane's centre, metres, and its
#: maximum offset beyond the lane on the wrong side, for rough mapping.
BESIDE_M, WRONG_SIDE_M = 14.0, 0.5
#: Length of a stop: a bus and room to pull up, and the distance of its front beyond the pole,
#: metres.
STOP_M, PAST_POLE_M = 18.0, 1.0
#: Minimum distance of a stop from the ends of its lane, metres.
END_M = 1.0
#: Stops on a lane closer than this are one, mapped as pole and platform, metres.
SAME_STOP_M = 30.0
#: Kinds of lanes without alighting passengers.
DRIVEN = ("driving", "bus", "bicycle")
BUS_ROUTES = ("bus", "trolleybus")


def with_buses(network: RoadNetwork, extract: Extract, frame: SiteFrame) -> RoadNetwork:
    """Return a network with the roads of mapped bus lines and with mapped bus stops.

    A stop is assigned to the kerb lane of the road beside its pole, on the boarding side. This
    determines its direction, with no other carriageway between. Stops without a road beside them
    are left out.

    Args:
        network: the lanes.
        extract: the map.
        frame: the site frame.
    """
    served_ways = bus_ways(extract)
    roads = tuple(road.id for road in network.roads if served_ways.intersection(road.ways))
    side = 1.0 if network.driving_side == "left" else -1.0
    kerbs = list(_kerb_lanes(network))
    lines = [shapely.LineString(lane.centre[:, :2]) for _, lane in kerbs]
    tree = shapely.STRtree(lines)
    driven = [lane for lane in network.lanes if lane.road and lane.kind in DRIVEN]
    ground = shapely.STRtree([lane.polygon for lane in driven])
    on_line = set(roads)
    places_of: dict[str, list[tuple[float, str]]] = {}
    for place, name in _poles(extract, frame):
        point = shapely.Point(place)
        candidates = []
        for k in tree.query(point.buffer(BESIDE_M)).tolist():
            road, lane = kerbs[k]
            along, offset_m = _station_and_offset(lines[k], lane.centre[:, :2], place)
            wrong = lane.width / 2 + WRONG_SIDE_M
            if offset_m * side >= -wrong and lines[k].distance(point) <= BESIDE_M:
                off_line = bool(on_line) and road.id not in on_line
                shortest = shapely.shortest_line(lines[k], point)
                crossed = ground.query(shortest, predicate="intersects").tolist()
                beyond = any(driven[j].road != road.id for j in crossed)
                candidates.append((beyond, off_line, lines[k].distance(point), lane.id, along))
        if candidates:
            *_, lane_id, along = min(candidates)
            places_of.setdefault(lane_id, []).append((along, name))
    stops = [
        stop
        for lane_id, places in sorted(places_of.items())
        for stop in _stops(network.lane_by_id[lane_id], sorted(places))
    ]
    return replace(network, bus_roads=roads, stops=tuple(stops))


def bus_poles(extract: Extract, frame: SiteFrame) -> NDArray[np.float64]:
    """Return the positions of bus stops (N, 2), site frame."""
    return np.array([place for place, _ in _poles(extract, frame)]).reshape(-1, 2)


def bus_ways(extract: Extract) -> frozenset[int]:
    """Return the ids of the ways of mapped bus lines."""
    return frozenset(
        member
        for relation in extract.relations.values()
        if relation.tags.get("type") == "route" and relation.tags.get("route") in BUS_ROUTES
        for kind, member, _ in relation.members
        if kind == "w"
    )


def _kerb_lanes(network: RoadNetwork) -> Iterator[tuple[Road, Lane]]:
    """Yield each road of the map with its outermost lane for buses, if long enough for a stop."""
    for road in network.roads:
        if not road.ways:
            continue
        lanes = [network.lane_by_id[name] for name in road.lanes]
        buses = [
            lane for lane in lanes if "bus" in lane.allowed and lane.kind in ("driving", "bus")
        ]
        if buses and buses[0].length > STOP_M + 2 * END_M:
            yield road, buses[0]


def _poles(extract: Extract, frame: SiteFrame) -> Iterator[tuple[NDArray[np.float64], str]]:
    """Yield the position (2,) and the name of each bus stop."""
    for node, tags in sorted(extract.node_tags.items()):
        if _is_stop(tags) and node in extract.nodes:
            yield frame.site_from_lonlat([extract.nodes[node]])[0], tags.get("name", "")
    for _, osm_way in sorted(extract.ways.items()):
        if _is_stop(osm_way.tags) and len(line := extract.way_line(osm_way, frame)):
            yield line.mean(axis=0), osm_way.tags.get("name", "")


def _is_stop(tags: Mapping[str, str]) -> bool:
    if tags.get("highway") == "bus_stop":
        return tags.get("public_transport") != "stop_position"
    platform = tags.get("public_transport") == "platform" or tags.get("highway") == "platform"
    return platform and (tags.get("bus") == "yes" or tags.get("trolleybus") == "yes")


def _station_and_offset(
    line: shapely.LineString, points: NDArray[np.float64], place: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the station of a place along a line, and its offset to the left, metres."""
    along = float(line.project(shapely.Point(place)))
    stations = stations_of_points(points)
    k = int(np.clip(np.searchsorted(stations, along) - 1, 0, len(points) - 2))
    ahead = points[k + 1] - points[k]
    gap = place - points[k]
    left = float(ahead[0] * gap[1] - ahead[1] * gap[0]) / max(float(np.linalg.norm(ahead)), 1e-9)
    return along, left


def _stops(lane: Lane, places: list[tuple[float, str]]) -> Iterator[BusStop]:
    while places:
        same_stop = [place for place in places if place[0] - places[0][0] < SAME_STOP_M]
        places = places[len(same_stop) :]
        along, name = next((place for place in same_stop if place[1]), same_stop[0])
        end = min(max(along + PAST_POLE_M, STOP_M + END_M), lane.length - END_M)
        yield BusStop(lane.id, name, round(end - STOP_M, 2), round(end, 2))
