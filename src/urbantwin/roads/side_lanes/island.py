"""Traffic islands: refuges in the middle of two-way streets at crossings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.roads.model import (
    CURB_HEIGHT_M,
    RAISED_KINDS,
    LaneModel,
    LaneSection,
    ModelRoad,
    Profile,
    RoadArea,
    SectionLane,
)
from urbantwin.roads.side_lanes.clearance import Clearance
from urbantwin.roads.side_lanes.lane_insertion import Insertion

__all__ = ["BEYOND_M", "is_island", "islands_on", "moved_aside", "stations_on", "with_island_areas"]

#: Width of a refuge, metres (RASt 06, 6.1.8.2: at least 2.00 m; US MUTCD 3I: 6 ft).
WIDTH_M = 2.0
#: Length of an island on both sides of the crossing, and of its tapers, metres.
REACH_M, TAPER_M = 12.0, 9.0
#: Minimum length of an island, its distance from the end of a road, and maximum distance of a
#: crossing beyond that end, with the island before it, metres.
SHORTEST_M, CLEAR_M, BEYOND_M = 10.0, 1.0, 8.0
#: Maximum distance of a point of the map from the middle of its street, metres.
OFF_M = 3.0


def is_island(tags: Mapping[str, str]) -> bool:
    """Return whether a node is a crossing with a refuge (OSM wiki, "Key:crossing:island")."""
    return (
        tags.get("crossing:island") == "yes"
        or tags.get("traffic_calming") == "island"
        or "island" in tags.get("crossing", "").split(";")
    )


def stations_on(road: ModelRoad, points: ArrayLike, *, beyond: float = 0.0) -> NDArray[np.float64]:
    """Return the stations of those points (N, 2) that lie on the middle of a road, metres.

    Args:
        road: the road.
        points: points in the site frame.
        beyond: tolerance before its start and after its end, metres.
    """
    xy = np.asarray(points, np.float64).reshape(-1, 2)
    if not len(xy):
        return np.zeros(0)
    low, high = np.reshape(road.curve.line.bounds, (2, 2))
    margin = OFF_M + beyond
    xy = xy[((xy > low - margin) & (xy < high + margin)).all(axis=1)]
    if not len(xy):
        return np.zeros(0)
    s, t = road.curve.locate(xy)
    on = (np.abs(t) < OFF_M) & (s > -beyond) & (s < road.length + beyond)
    return np.asarray(np.clip(s[on], 0.0, road.length))


def islands_on(
    road: ModelRoad, stations: Sequence[float] | NDArray[np.float64], room: Clearance
) -> list[Insertion]:
    """Return the islands of a street where its lanes have room to pass.

    Args:
        road: a street.
        stations: stations of its crossings with refuges, metres.
        room: free space beside the roads; added islands are subtracted from it.
    """
    lanes = [lane for section in road.sections for lane in section.lanes]
    driven = [lane for lane in lanes if lane.kind not in RAISED_KINDS]
    if len({lane.id > 0 for lane in driven}) != 2 or not road.offset.is_zero:
        return []
    islands: list[Insertion] = []
    free_from = CLEAR_M
    for s in sorted(float(station_m) for station_m in stations):
        first, last = max(s - REACH_M, free_from), min(s + REACH_M, road.length - CLEAR_M)
        if last - first < SHORTEST_M:
            continue
        half = WIDTH_M / 2
        if any(room.free(road, side, first, last, half) != [(first, last)] for side in (1, -1)):
            continue
        for side in (1, -1):
            room.grow(road, side, first, last, half)
        islands.append(
            Insertion(-1, "reference", "island", first, last, _lens(last - first), CURB_HEIGHT_M)
        )
        free_from = last + CLEAR_M
    return islands


def moved_aside(road: ModelRoad, islands: Sequence[Insertion]) -> ModelRoad:
    """Return a road whose lanes are moved equally to both sides of its islands."""
    starts, rows = [0.0], [np.zeros(4)]
    for item in islands:
        starts += [item.first + float(s) for s in item.width.start]
        rows += list(item.width.abcd / 2)
        starts.append(item.last)
        rows.append(np.zeros(4))
    return replace(road, offset=Profile(np.array(starts), np.array(rows)))


def _lens(length: float) -> Profile:
    taper = min(TAPER_M, length / 2 - 1.0)
    rows = [
        Profile.ramp(0.0, WIDTH_M, taper).abcd[0],
        np.array([WIDTH_M, 0.0, 0.0, 0.0]),
        Profile.ramp(WIDTH_M, 0.0, taper).abcd[0],
    ]
    return Profile(np.array([0.0, taper, length - taper]), np.array(rows))


def with_island_areas(model: LaneModel) -> LaneModel:
    """Return the model with each island lane also as an area, raised like the lane.

    Args:
        model: the lane model, with heights.
    """
    number = model.next_id
    areas: list[RoadArea] = []
    for road in model.roads:
        for section, end in zip(road.sections, road.section_ends, strict=True):
            for lane in section.lanes:
                if lane.kind == "island":
                    areas.append(_area(number + len(areas), road, section, lane, end))
    return replace(model, areas=(*model.areas, *areas)) if areas else model


def _area(
    number: int, road: ModelRoad, section: LaneSection, lane: SectionLane, end: float
) -> RoadArea:
    s = np.linspace(section.s, end, max(5, int(end - section.s) + 1))
    inner, outer = (road.border(section, lane, s, outer=side) for side in (False, True))
    right, left = (inner, outer) if lane.id > 0 else (outer, inner)
    # Both borders meet at the noses.
    ring = np.vstack([road.place(s, right), road.place(s[1:-1], left[1:-1])[::-1]])
    middle = float((section.s + end) / 2)
    x, y, heading = road.curve.pose(middle)
    gap = ring - [x, y, float(road.elevation.at(middle)[0])]
    c, sn = np.cos(heading), np.sin(heading)
    corners = np.column_stack(
        [gap[:, 0] * c + gap[:, 1] * sn, gap[:, 1] * c - gap[:, 0] * sn, gap[:, 2]]
    )
    return RoadArea(number, road.id, "trafficIsland", "island", middle, corners, lane.height)
