"""Objects on the road surface: stop lines, crosswalks and traffic islands."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.lanelet2.document import Document, Relation
from urbantwin.roads.lanelet2.lanelet import Lanelet
from urbantwin.roads.lanelet2.projection import Places
from urbantwin.roads.model import ModelRoad, RoadArea

__all__ = ["BuiltMap", "Host", "areas_of", "hosts_of", "island_ways", "stop_lines"]

#: Width of a stop line along the road, metres (German RMS 1; US MUTCD 3B.16: 0.3 to 0.6 m).
STOP_LINE_M = 0.4
#: Reach of a street beyond its ends for crosswalks and stop lines, metres.
REACH_M = 15.0
#: Maximum distance of an object from its road, metres.
NEAR_M = 3.0
ISLAND_M = 0.15


@dataclass(frozen=True)
class Host:
    """A street, extended straight at its ends."""

    road: ModelRoad
    area: shapely.Geometry
    line: shapely.LineString

    def local(self, xyz: NDArray[np.float64], s: float) -> NDArray[np.float64]:
        """Return points (N, 3) as ahead, left, up of the reference line at a station.

        Heights are those of the road's surface below the points.
        """
        x, y, heading = self.road.curve.at(s)[0]
        c, sn = math.cos(heading), math.sin(heading)
        gap = xyz[:, :2] - [x, y]
        stations, t = self.road.curve.locate(xyz[:, :2])
        z = self.road.heights(np.clip(stations, 0.0, self.road.length), t)
        up = z - float(self.road.elevation.at(s)[0])
        return np.column_stack([gap @ [c, sn], gap @ [-sn, c], up])

    def station(self, xy: NDArray[np.float64]) -> float:
        """Return the station of a point, clipped to the road, metres."""
        return float(np.clip(self.road.curve.locate(xy[None, :2])[0][0], 0.0, self.road.length))


def hosts_of(roads: Iterable[ModelRoad]) -> dict[int, Host]:
    """Return all streets as hosts of objects, by id."""
    hosts = {}
    for road in roads:
        if road.junction >= 0:
            continue
        s = np.linspace(0.0, road.length, max(4, int(road.length) + 1))
        edges = []
        for k in (0, -1):
            parts = []
            for section, end in zip(road.sections, road.section_ends, strict=True):
                in_section = s[(s >= section.s) & (s <= end)]
                lane = section.lanes[k]
                outer = lane.id > 0 if k == 0 else lane.id < 0
                parts.append(
                    road.curve.beside(
                        in_section, road.border(section, lane, in_section, outer=outer)
                    )
                )
            edges.append(np.vstack(parts))
        axis = (edges[0] + edges[1]) / 2
        line = np.vstack([_extended_end(axis[0], axis[1]), axis, _extended_end(axis[-1], axis[-2])])
        ring = np.vstack([edges[0], edges[1][::-1]])
        hosts[road.id] = Host(
            road, shapely.make_valid(shapely.Polygon(ring)), shapely.LineString(line)
        )
    return hosts


def _extended_end(end: NDArray[np.float64], before: NDArray[np.float64]) -> NDArray[np.float64]:
    step = end - before
    return np.asarray(end + REACH_M * step / max(float(np.linalg.norm(step)), 1e-9))


def stop_lines(document: Document) -> dict[int, tuple[int, ...]]:
    """Return way of a stop line -> regulatory elements that refer to it."""
    owners_of: dict[int, list[int]] = {
        way_id: [] for way_id, item in document.ways.items() if item.tags.get("type") == "stop_line"
    }
    for identity, relation in document.relations.items():
        if relation.tags.get("type") == "regulatory_element":
            for way_id in relation.of_role("ref_line"):
                owners_of.setdefault(way_id, []).append(identity)
    return {way_id: tuple(owners) for way_id, owners in sorted(owners_of.items())}


def island_ways(document: Document) -> dict[int, Relation]:
    """Return the areas that are traffic islands."""
    return {
        identity: relation
        for identity, relation in sorted(document.relations.items())
        if relation.tags.get("type") == "multipolygon"
        and relation.tags.get("subtype") == "traffic_island"
    }


@dataclass(frozen=True, eq=False)
class BuiltMap:
    """A map with the streets built from it.

    Attributes:
        document: the map.
        places: positions of its nodes.
        lanelets: its lanelets.
        approaches: lanelet -> streets and lanes that lead to it.
        hosts: the streets.
    """

    document: Document
    places: Places
    lanelets: Mapping[int, Lanelet]
    approaches: Mapping[int, Sequence[tuple[int, int]]]
    hosts: Mapping[int, Host]

    @cached_property
    def governed(self) -> dict[int, list[int]]:
        """Regulatory element -> lanelets that it applies to."""
        lanelets_of: dict[int, list[int]] = {}
        for lanelet in self.lanelets.values():
            for regulation in lanelet.regulations:
                lanelets_of.setdefault(regulation, []).append(lanelet.id)
        return lanelets_of


def areas_of(built: BuiltMap, first: int, notes: dict[str, object]) -> tuple[RoadArea, ...]:
    """Return stop lines, crosswalks and islands, each on its street.

    Args:
        built: the map and its streets.
        first: the first free id.
        notes: receives the counts of objects without a street.
    """
    document, places, hosts = built.document, built.places, built.hosts
    fixtures: list[RoadArea] = []
    lost = {"stop_lines": 0, "crosswalks": 0, "traffic_islands": 0}

    def put(kind: str, name: str, host: Host, ring: NDArray[np.float64], height: float) -> None:
        polygon = shapely.orient_polygons(shapely.Polygon(ring))
        corners = shapely.get_coordinates(polygon)[:-1]
        s = host.station(corners.mean(axis=0))
        local = host.local(np.column_stack([corners, np.zeros(len(corners))]), s)
        fixtures.append(RoadArea(first + len(fixtures), host.road.id, kind, name, s, local, height))

    for way_id, owners in stop_lines(document).items():
        nodes = document.ways[way_id].nodes
        line = np.array([places[n][:2] for n in nodes])
        ids = [i for owner in owners for i in built.governed.get(owner, [])]
        governed_hosts = [hosts[road] for i in ids for road, _ in built.approaches.get(i, ())]
        host = _nearest(line, governed_hosts or list(hosts.values()), across=True)
        if host is None or len(set(nodes)) < 2:
            lost["stop_lines"] += 1
            continue
        ring = shapely.LineString(line).buffer(
            STOP_LINE_M / 2, cap_style="flat", join_style="mitre"
        )
        put("roadMark", "StopLine", host, shapely.get_coordinates(ring)[:-1], 0.0)
    for lanelet in built.lanelets.values():
        if lanelet.kind != "crosswalk":
            continue
        axis = shapely.get_coordinates(lanelet.centre)[[0, -1]]
        host = _nearest(axis, list(hosts.values()), across=True)
        if host is None:
            lost["crosswalks"] += 1
            continue
        ring = np.vstack([lanelet.left[:, :2], lanelet.right[::-1, :2]])
        put("crosswalk", "crosswalk", host, ring, 0.0)
    for relation in island_ways(document).values():
        lines = [
            shapely.LineString([places[n][:2] for n in document.ways[way_id].nodes])
            for way_id in relation.of_role("outer")
            if len(document.ways[way_id].nodes) > 1
        ]
        for polygon in shapely.get_parts(shapely.polygonize([shapely.union_all(lines)])):
            corners = shapely.get_coordinates(polygon)[:-1]
            host = _nearest(corners, list(hosts.values()), across=False)
            if host is None:
                lost["traffic_islands"] += 1
                continue
            put("trafficIsland", "island", host, corners, ISLAND_M)
    notes.update({f"{name}_without_a_street": n for name, n in lost.items() if n})
    return tuple(fixtures)


def _nearest(points: NDArray[np.float64], hosts: Sequence[Host], *, across: bool) -> Host | None:
    """Return the street that a line crosses most perpendicularly, or the nearest one."""
    line = shapely.LineString(points)
    chord = points[-1] - points[0]
    best: tuple[float, int] | None = None
    for k, host in enumerate(hosts):
        distance_m = float(host.line.distance(line))
        if distance_m > NEAR_M and float(host.area.distance(line)) > NEAR_M:
            continue
        beyond = float(host.area.distance(line))
        cost = min(distance_m, NEAR_M) + 0.5 * beyond
        if across:
            station_m = host.station(points.mean(axis=0))
            heading = float(host.road.curve.at(station_m)[0, 2])
            cost += 8.0 * (1.0 - abs(math.sin(math.atan2(chord[1], chord[0]) - heading)))
        if best is None or cost < best[0] - 1e-9:
            best = cost, k
    return None if best is None else hosts[best[1]]
