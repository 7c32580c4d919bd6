"""Sidewalks along buildings: they narrow, and end, where a building stands in their way."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import area_difference, area_intersection, area_union, areas_of
from urbantwin.roads.model import LaneModel, LaneSection, ModelRoad, Profile, SectionLane
from urbantwin.roads.network import RoadNetwork
from urbantwin.roads.side_lanes.clearance import cells_between, footprint

__all__ = ["before_buildings", "corners_before_buildings", "straight_pieces"]

#: Spacing of the cross sections that are looked at, metres.
STEP_M = 0.5
#: What is left free before a wall, metres: chords of curved walls and lanes differ by less.
FREE_M = 0.05
#: A sidewalk narrower than this has ended, metres.
NARROWEST_M = 0.3
#: How much a sidewalk's width changes from one metre to the next, metres: people walk along it.
TAPER = 0.5
#: Widths may be drawn with this much difference, so that fewer numbers say them, metres.
SIMPLER_M = 0.02
#: Kinds of lanes that are pushed back, from the wall inwards.
PUSHED = ("sidewalk", "curb")


def before_buildings(model: LaneModel, buildings: Sequence[shapely.Polygon]) -> LaneModel:
    """Return the model with its sidewalks as wide as the buildings beside them leave room.

    Outlines of junctions end at walls too, except where a road through the junction runs.

    Args:
        model: roads in plan, with their side lanes and curbs.
        buildings: where buildings stand on the ground, site frame.
    """
    walls = shapely.STRtree(buildings)
    through: dict[int, list[shapely.Geometry]] = defaultdict(list)
    roads = []
    for road in model.roads:
        if road.junction >= 0:
            through[road.junction].append(footprint(road))
        roads.append(_pushed_back(road, walls) if road.junction < 0 and road.level == 0 else road)
    junctions = tuple(
        replace(junction, outline=_cut(junction.outline, walls, through[junction.id]))
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
        buildings: where buildings stand on the ground, site frame.
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
    """Return the outline (M, 2) of the largest part that has no building on it."""
    if len(outline) < 3:
        return outline
    whole = areas_of(shapely.Polygon(outline))
    near = walls.geometries[np.sort(walls.query(whole, predicate="intersects"))]
    taken = area_difference(shapely.buffer(area_union(near), FREE_M), area_union(kept))
    if area_intersection(whole, taken).is_empty:
        return outline
    rest = [shapely.Polygon(part.exterior) for part in area_difference(whole, taken).geoms]
    largest = max(rest, key=lambda part: part.area, default=None)
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
    """Return a section with what is raised at its sides no wider than there is room."""
    s = np.linspace(section.s, end, max(2, int((end - section.s) / STEP_M) + 2))
    changed: dict[int, SectionLane] = {}
    for side in (1, -1):
        lanes = sorted((x for x in section.lanes if x.id * side > 0), key=lambda x: -abs(x.id))
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
    return replace(section, lanes=tuple(changed.get(x.id, x) for x in section.lanes))


def _room(
    road: ModelRoad,
    s: NDArray[np.float64],
    inner: NDArray[np.float64],
    outer: NDArray[np.float64],
    walls: shapely.STRtree,
) -> NDArray[np.float64]:
    """Return how wide (N,) there is room from an inner border outwards, at most to the outer one.

    Between two stations it is nowhere less than a straight line between theirs.
    """
    cells = cells_between(road, s, inner, outer)
    edges = shapely.linestrings(
        np.stack([road.curve.beside(s, inner)[k : len(s) - 1 + k] for k in (0, 1)], axis=1)
    )
    free = np.full(len(cells), np.inf)
    which, wall = walls.query(cells, predicate="intersects")
    if len(which):
        inside = shapely.intersection(cells[which], walls.geometries[wall])
        taken = ~shapely.is_empty(inside)
        gap = shapely.distance(edges[which[taken]], inside[taken]) - FREE_M
        np.minimum.at(free, which[taken], np.maximum(gap, 0.0))
    here = np.minimum(np.append(free, np.inf), np.concatenate([[np.inf], free]))
    return np.asarray(np.minimum(here, np.abs(outer - inner)))


def _tapered(width: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Return the largest widths that are no larger and change by no more than ``step``."""
    ramp = step * np.arange(len(width))
    ahead = np.minimum.accumulate(width - ramp) + ramp
    back = (np.minimum.accumulate(width[::-1] - ramp) + ramp)[::-1]
    return np.asarray(np.minimum(ahead, back))


def straight_pieces(
    s: NDArray[np.float64], width: NDArray[np.float64], tolerance: float
) -> Profile:
    """Return a profile of straight pieces along widths (N,) at ascending stations (N,), metres."""
    line = shapely.simplify(shapely.LineString(np.column_stack([s, width])), tolerance)
    knots, values = shapely.get_coordinates(line).T
    slope = np.diff(values) / np.maximum(np.diff(knots), 1e-9)
    rows = np.column_stack([values[:-1], slope, np.zeros((len(slope), 2))])
    return Profile(knots[:-1], rows)
