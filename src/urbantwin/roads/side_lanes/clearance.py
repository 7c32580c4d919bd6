"""Clearance beside roads: room for widening."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import area_difference, area_intersection, area_union, areas_of
from urbantwin.roads.model import LaneModel, LaneSection, ModelRoad, Profile, SectionLane
from urbantwin.roads.model.curve import aside
from urbantwin.roads.network import RoadNetwork

__all__ = [
    "Clearance",
    "before_buildings",
    "cells_between",
    "corners_before_buildings",
    "footprint",
    "straight_pieces",
]

#: Spacing of the cross sections that are tested, metres.
STEP_M = 2.0
#: Smaller overlaps are tolerated, square metres per metre of road.
GRAZE_M = 0.1
#: Spacing of the cross sections that are tested against buildings, metres.
FRONTAGE_STEP_M = 0.5
#: Clearance before a wall, metres: chords of curved walls and lanes differ by less.
FREE_M = 0.05
#: A narrower sidewalk ends, metres.
NARROWEST_M = 0.3
#: Maximum change of a sidewalk's width per metre along it.
TAPER = 0.5
#: Tolerance of simplified widths, metres.
SIMPLER_M = 0.02
#: Kinds of lanes that yield to walls, from the wall inwards.
PUSHED = ("sidewalk", "curb")


class Clearance:
    """Areas on the ground: roads, junctions and obstacles such as buildings."""

    def __init__(self, model: LaneModel, obstacles: Sequence[shapely.Polygon] = ()) -> None:
        """Collect the areas of all roads of a model.

        Args:
            model: the lane model.
            obstacles: areas that no road may grow into, site frame; existing overlaps with roads
                are ignored.
        """
        shapes: list[shapely.Geometry] = []
        self._owner: list[int] = []
        self._level: list[int | None] = []
        self.footprints = {r.id: footprint(r) for r in model.roads if r.junction < 0}
        for road in model.roads:
            if road.junction < 0:
                shapes.append(self.footprints[road.id])
                self._owner.append(road.id)
                self._level.append(road.level)
        for junction in model.junctions:
            if len(junction.outline) > 2:
                shapes.append(shapely.make_valid(shapely.Polygon(junction.outline)))
                self._owner.append(-1)
                self._level.append(junction.level)
        shapes += obstacles
        self._owner += [-1] * len(obstacles)
        self._level += [0] * len(obstacles)
        self._shapes = shapes
        self._tree = shapely.STRtree(shapes)
        self._grown: list[tuple[int, int, shapely.Geometry]] = []

    def free(
        self, road: ModelRoad, side: int, first: float, last: float, width: float
    ) -> list[tuple[float, float]]:
        """Return where a road can be widened on one side, as ranges of stations, metres.

        Args:
            road: the road.
            side: 1 to the left, -1 to the right.
            first: start station, metres.
            last: end station, metres.
            width: additional width, metres.
        """
        s = np.linspace(first, last, max(2, int((last - first) / STEP_M) + 2))
        edge = outer_border(road, side, s)
        cells = cells_between(road, s, edge, edge + side * width)
        blocked = np.zeros(len(cells), bool)
        cell, other = self._tree.query(cells, predicate="intersects")
        for k, j in zip(cell.tolist(), other.tolist(), strict=True):
            if self._owner[j] != road.id and self._level[j] == road.level:
                blocked[k] |= _overlaps(cells[k], self._shapes[j])
        for owner, level, shape in self._grown:
            if owner != road.id and level == road.level:
                for k in np.flatnonzero(shapely.intersects(cells, shape) & ~blocked):
                    blocked[k] |= _overlaps(cells[k], shape)
        runs = []
        start: float | None = None
        for k in range(len(cells)):
            if not blocked[k] and start is None:
                start = float(s[k])
            if blocked[k] and start is not None:
                runs.append((start, float(s[k])))
                start = None
        if start is not None:
            runs.append((start, last))
        return runs

    def grow(self, road: ModelRoad, side: int, first: float, last: float, width: float) -> None:
        """Reserve the area by which a road is widened."""
        s = np.linspace(first, last, max(2, int((last - first) / STEP_M) + 2))
        edge = outer_border(road, side, s)
        band = cells_between(road, s, edge, edge + side * width)
        self._grown.append((road.id, road.level, shapely.union_all(band)))


def outer_border(road: ModelRoad, side: int, s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the offset t (N,) of a road's border on one side at stations (N,), metres."""
    t = np.asarray(road.offset.at(s), np.float64)
    starts = np.array([section.s for section in road.sections])
    section_index = np.maximum(np.searchsorted(starts, s + 1e-9, side="right") - 1, 0)
    for k, section in enumerate(road.sections):
        lanes = [lane for lane in section.lanes if lane.id * side > 0]
        in_section = section_index == k
        if lanes and in_section.any():
            outermost = max(lanes, key=lambda lane: abs(lane.id))
            t[in_section] = road.border(section, outermost, s[in_section], outer=True)
    return t


def footprint(road: ModelRoad) -> shapely.Geometry:
    """Return the area of all lanes of a road in plan."""
    s = np.linspace(0.0, road.length, max(2, int(road.length / STEP_M) + 2))
    pose = road.curve.at(s)
    left, right = (aside(pose, outer_border(road, side, s)) for side in (1, -1))
    return shapely.make_valid(shapely.Polygon(np.vstack([left, right[::-1]])))


def cells_between(
    road: ModelRoad, s: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64]
) -> NDArray[np.object_]:
    """Return the cells in plan (N - 1,) between two borders (N,) at stations (N,)."""
    pose = road.curve.at(s)
    inner, outer = aside(pose, a), aside(pose, b)
    rings = np.stack([inner[:-1], inner[1:], outer[1:], outer[:-1], inner[:-1]], axis=1)
    return np.asarray(shapely.make_valid(shapely.polygons(rings)))


def _overlaps(cell: shapely.Geometry, shape: shapely.Geometry) -> bool:
    return bool(shapely.intersection(cell, shape).area > GRAZE_M * STEP_M)


def before_buildings(model: LaneModel, buildings: Sequence[shapely.Polygon]) -> LaneModel:
    """Return the model with sidewalks no wider than buildings beside them permit.

    Outlines of junctions end at walls too, except on connecting roads.

    Args:
        model: roads in plan, with their side lanes and curbs.
        buildings: footprints of buildings on the ground, site frame.
    """
    walls = shapely.STRtree(buildings)
    connecting_of: dict[int, list[shapely.Geometry]] = defaultdict(list)
    roads = []
    for road in model.roads:
        if road.junction >= 0:
            connecting_of[road.junction].append(footprint(road))
        roads.append(_pushed_back(road, walls) if road.junction < 0 and road.level == 0 else road)
    junctions = tuple(
        replace(junction, outline=_cut(junction.outline, walls, connecting_of[junction.id]))
        if junction.level == 0
        else junction
        for junction in model.junctions
    )
    return replace(model, roads=tuple(roads), junctions=junctions)


def corners_before_buildings(
    network: RoadNetwork, buildings: Sequence[shapely.Polygon]
) -> RoadNetwork:
    """Return the network with walking areas that end at walls.

    Args:
        network: the lanes, as netconvert drew them.
        buildings: footprints of buildings on the ground, site frame.
    """
    walls = shapely.STRtree(buildings)
    lanes = tuple(
        replace(lane, outline=_cut(lane.outline, walls))
        if lane.kind == "walkingarea" and lane.level == 0
        else lane
        for lane in network.lanes
    )
    return replace(network, lanes=lanes)


def _cut(
    outline: NDArray[np.float64], walls: shapely.STRtree, kept: Iterable[shapely.Geometry] = ()
) -> NDArray[np.float64]:
    """Return the outline (M, 2) of the largest part without buildings."""
    if len(outline) < 3:
        return outline
    area = areas_of(shapely.Polygon(outline))
    close = walls.geometries[np.sort(walls.query(area, predicate="intersects"))]
    blocked = area_difference(shapely.buffer(area_union(close), FREE_M), area_union(kept))
    if area_intersection(area, blocked).is_empty:
        return outline
    free_parts = [shapely.Polygon(part.exterior) for part in area_difference(area, blocked).geoms]
    largest = max(free_parts, key=lambda part: part.area, default=None)
    return outline if largest is None else shapely.get_coordinates(largest)[:-1]


def _pushed_back(road: ModelRoad, walls: shapely.STRtree) -> ModelRoad:
    """Return a road whose sidewalks end before walls."""
    sections = tuple(
        _fitted(road, section, end, walls)
        for section, end in zip(road.sections, road.section_ends, strict=True)
    )
    same = all(a is b for a, b in zip(sections, road.sections, strict=True))
    return road if same else replace(road, sections=sections)


def _fitted(
    road: ModelRoad, section: LaneSection, end: float, walls: shapely.STRtree
) -> LaneSection:
    """Return a section with its raised side lanes limited to the available room."""
    s = np.linspace(section.s, end, max(2, int((end - section.s) / FRONTAGE_STEP_M) + 2))
    changed: dict[int, SectionLane] = {}
    for side in (1, -1):
        lanes = sorted(
            (lane for lane in section.lanes if lane.id * side > 0), key=lambda lane: -abs(lane.id)
        )
        pushed: list[SectionLane] = []
        for lane in lanes:
            if lane.kind not in PUSHED:
                break
            pushed.insert(0, lane)
        if not pushed:
            continue
        inner = road.border(section, pushed[0], s, outer=False)
        outer = road.border(section, pushed[-1], s, outer=True)
        room = _room(road, s, inner, outer, walls)
        if (room >= np.abs(outer - inner) - 1e-6).all():
            continue
        for lane in pushed:
            usual = lane.width.at(s - section.s)
            width = np.clip(room, 0.0, usual)
            if lane.kind == "sidewalk":
                width = _tapered(width, float(s[1] - s[0]) * TAPER)
                width[width < np.minimum(NARROWEST_M, usual)] = 0.0
            room = room - width
            changed[lane.id] = replace(lane, width=straight_pieces(s - section.s, width, SIMPLER_M))
    if not changed:
        return section
    return replace(section, lanes=tuple(changed.get(lane.id, lane) for lane in section.lanes))


def _room(
    road: ModelRoad,
    s: NDArray[np.float64],
    inner: NDArray[np.float64],
    outer: NDArray[np.float64],
    walls: shapely.STRtree,
) -> NDArray[np.float64]:
    """Return the available width (N,) from an inner border outwards, at most to the outer one.

    Between two stations it is at least the linear interpolation.
    """
    cells = cells_between(road, s, inner, outer)
    edges = shapely.linestrings(
        np.stack([road.curve.beside(s, inner)[k : len(s) - 1 + k] for k in (0, 1)], axis=1)
    )
    free = np.full(len(cells), np.inf)
    cell, wall = walls.query(cells, predicate="intersects")
    if len(cell):
        inside = shapely.intersection(cells[cell], walls.geometries[wall])
        overlaps = ~shapely.is_empty(inside)
        gap = shapely.distance(edges[cell[overlaps]], inside[overlaps]) - FREE_M
        np.minimum.at(free, cell[overlaps], np.maximum(gap, 0.0))
    width = np.minimum(np.append(free, np.inf), np.concatenate([[np.inf], free]))
    return np.asarray(np.minimum(width, np.abs(outer - inner)))


def _tapered(width: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Return the largest widths below given ones with at most ``step`` change between samples."""
    ramp = step * np.arange(len(width))
    ahead = np.minimum.accumulate(width - ramp) + ramp
    back = (np.minimum.accumulate(width[::-1] - ramp) + ramp)[::-1]
    return np.asarray(np.minimum(ahead, back))


def straight_pieces(
    s: NDArray[np.float64], width: NDArray[np.float64], tolerance: float
) -> Profile:
    """Return a piecewise linear profile through widths (N,) at ascending stations (N,), metres."""
    line = shapely.simplify(shapely.LineString(np.column_stack([s, width])), tolerance)
    knots, values = shapely.get_coordinates(line).T
    slope = np.diff(values) / np.maximum(np.diff(knots), 1e-9)
    rows = np.column_stack([values[:-1], slope, np.zeros((len(slope), 2))])
    return Profile(knots[:-1], rows)
