"""Junctions: connecting roads that share the end of a street, or overlap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely

from urbantwin.roads.lanelet2.connecting_road import ConnectingRoad
from urbantwin.roads.lanelet2.street import Street
from urbantwin.roads.model import Connection, ModelJunction, ModelRoad, RoadLink

__all__ = ["junctions_of"]

#: Ways that lie over each other by more than this belong to one junction, square metres.
OVERLAP_M2 = 0.5
#: Least vertical distance of ways that pass over each other, metres.
CLEARANCE_M = 2.5


def junctions_of(
    streets: Sequence[Street], connecting_roads: Sequence[ConnectingRoad], first: int
) -> tuple[tuple[ModelRoad, ...], tuple[ModelJunction, ...]]:
    """Return all roads, linked to each other and to junctions, and the junctions.

    Args:
        streets: the streets.
        connecting_roads: the ways through junctions.
        first: id of the first junction.
    """
    number = _clusters(connecting_roads)
    identity = {k: first + n for n, k in enumerate(dict.fromkeys(number))}
    at: dict[tuple[int, bool], int] = {}
    rows: dict[int, list[Connection]] = {i: [] for i in identity.values()}
    roads = []
    for way, cluster in zip(connecting_roads, number, strict=True):
        junction = identity[cluster]
        for gate in (way.start, way.end):
            at[gate.street.road.id, gate.end] = junction
        road = replace(way.road, junction=junction)
        lane = road.sections[0].lanes[0].id
        rows[junction].append(
            Connection(
                way.start.street.road.id,
                road.id,
                "start",
                ((way.start.lane, lane),),
            )
        )
        roads.append(road)
    linked = [
        replace(
            street.road,
            predecessor=_link(at.get((street.road.id, False))),
            successor=_link(at.get((street.road.id, True))),
        )
        for street in streets
    ]
    junctions = tuple(ModelJunction(i, "", tuple(rows[i])) for i in sorted(rows))
    return (*linked, *roads), junctions


def _link(junction: int | None) -> RoadLink | None:
    return None if junction is None else RoadLink("junction", junction)


def _clusters(connecting_roads: Sequence[ConnectingRoad]) -> list[int]:
    """Return for each way the number of the first way of its junction."""
    parent = list(range(len(connecting_roads)))

    def root(k: int) -> int:
        while parent[k] != k:
            k = parent[k]
        return k

    def join(a: int, b: int) -> None:
        a, b = root(a), root(b)
        parent[max(a, b)] = min(a, b)

    first: dict[tuple[int, bool], int] = {}
    for k, way in enumerate(connecting_roads):
        for gate in (way.start, way.end):
            join(k, first.setdefault((gate.street.road.id, gate.end), k))
    areas = np.array([way.area for way in connecting_roads], object)
    tree = shapely.STRtree(areas)
    for a, b in zip(*tree.query(areas, predicate="intersects"), strict=True):
        if a < b and root(a) != root(b):
            common = shapely.intersection(areas[a], areas[b])
            if common.area > OVERLAP_M2 and _level(
                connecting_roads[a], connecting_roads[b], common
            ):
                join(int(a), int(b))
    return [root(k) for k in range(len(connecting_roads))]


def _level(a: ConnectingRoad, b: ConnectingRoad, common: shapely.Geometry) -> bool:
    point = np.array(common.representative_point().coords)[:, :2]
    heights = []
    for road in (a.road, b.road):
        s, t = road.curve.locate(point)
        heights.append(float(road.heights(np.clip(s, 0.0, road.length), t)[0]))
    return abs(heights[0] - heights[1]) < CLEARANCE_M
