"""Lines between adjacent lanes that continue through a junction.

Where carriageways part or merge, and past a minor street, the lines between the lanes of the
through street continue (US MUTCD 3B.08; German RMS 1, 4.3: the broken line continues along the
major road).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np
import shapely

from urbantwin.geometry import wrapped
from urbantwin.roads.marking.lines import MOTOR, Line
from urbantwin.roads.model import LaneModel, ModelRoad, SectionLane
from urbantwin.roads.network import RoadNetwork

__all__ = ["guide_lines", "lines_through"]

#: Maximum turn of movements that go straight on, radians.
STRAIGHT = np.radians(25.0)
#: Maximum distance of diverging lanes beyond their width for a line between them, metres.
PARTED_M = 1.0
#: Clearance beside crossings, metres.
CLEAR_M = 0.5
STEP_M = 1.0
#: Minimum turn (radians) and length (metres) of turns with a guide line.
TURN, LENGTH_M = np.radians(50.0), 22.0
GUIDE_STEP_M = 0.5


def lines_through(network: RoadNetwork, model: LaneModel) -> Iterator[Line]:
    """Yield the lines between adjacent lanes through junctions without signals."""
    controlled = {junction for item in model.controllers for junction in item.junctions}
    connecting: dict[int, list[ModelRoad]] = defaultdict(list)
    for road in model.roads:
        if road.junction >= 0 and road.junction not in controlled:
            connecting[road.junction].append(road)
    walked = shapely.union_all(
        [lane.polygon.buffer(CLEAR_M) for lane in network.lanes if lane.kind == "crossing"]
    )
    for group in connecting.values():
        for road in group:
            for other in group:
                if _is_next_outwards(road, other) and not _is_crossed(model, road, group):
                    for line in _midway_line(road, other):
                        parts_left = shapely.get_parts(line.difference(walked))
                        yield from (
                            Line("broken", shapely.get_coordinates(part), road.level)
                            for part in parts_left
                        )


def _lane(road: ModelRoad) -> SectionLane:
    return road.sections[0].lanes[0]


def _ends(road: ModelRoad) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return road and lane at the start of a connecting road, and those at its end."""
    lane, ends = _lane(road), (road.predecessor, road.successor)
    roads = [-1 if end is None else end.id for end in ends]
    return (roads[0], lane.predecessor or 0), (roads[1], lane.successor or 0)


def _is_next_outwards(road: ModelRoad, other: ModelRoad) -> bool:
    """Return whether another connecting road links the next lanes outwards at both ends."""
    if not all(_lane(path).kind in MOTOR for path in (road, other)):
        return False
    for (street, lane), (other_street, next_lane) in zip(_ends(road), _ends(other), strict=True):
        if street != other_street or lane * next_lane <= 0 or abs(next_lane) != abs(lane) + 1:
            return False
    return max(_turn(road), _turn(other)) < float(STRAIGHT)


def _turn(road: ModelRoad) -> float:
    first, last = road.curve.at([0.0, road.length])[:, 2]
    return abs(float(wrapped(last - first)))


def _is_crossed(model: LaneModel, road: ModelRoad, ways: Sequence[ModelRoad]) -> bool:
    """Return whether a movement from a street with at least as many lanes crosses."""
    (start, _), (end, _) = _ends(road)
    return any(
        bool(other.curve.line.crosses(road.curve.line))
        and _lanes(model, _ends(other)[0]) >= _lanes(model, _ends(road)[0])
        for other in ways
        if _ends(other)[0][0] != start and _ends(other)[1][0] != end
    )


def _lanes(model: LaneModel, end: tuple[int, int]) -> int:
    """Return the number of motor traffic lanes of a road on one side of its middle."""
    road, lane = model.road_by_id[end[0]], end[1]
    widest = max(road.sections, key=lambda section: len(section.lanes)).lanes
    return sum(section_lane.kind in MOTOR and section_lane.id * lane > 0 for section_lane in widest)


def _midway_line(road: ModelRoad, other: ModelRoad) -> Iterator[shapely.LineString]:
    """Yield the line midway between two connecting roads if they are adjacent all along."""
    count = max(3, int(road.length / STEP_M) + 1)
    share = np.linspace(0.0, 1.0, count)
    own_xy, other_xy = (path.curve.at(share * path.length)[:, :2] for path in (road, other))
    lane_gap_m = (
        _lane(road).width.at(share * road.length) + _lane(other).width.at(share * other.length)
    ) / 2
    if (np.linalg.norm(other_xy - own_xy, axis=1) < lane_gap_m + PARTED_M).all():
        yield shapely.LineString((own_xy + other_xy) / 2)


def guide_lines(model: LaneModel) -> Iterator[Line]:
    """Yield the outer border of each long turn across oncoming traffic at signals."""
    controlled = {junction for item in model.controllers for junction in item.junctions}
    inner = 1.0 if model.driving_side == "right" else -1.0
    for road in model.roads:
        if road.junction not in controlled or road.length < LENGTH_M:
            continue
        section = road.sections[0]
        lane = section.lanes[0]
        s = np.linspace(0.0, road.length, int(road.length / GUIDE_STEP_M) + 2)
        heading = np.unwrap(road.curve.at(s)[:, 2])
        if lane.kind not in MOTOR or inner * (heading[-1] - heading[0]) < TURN:
            continue
        # A connecting road's single lane is to the left or right of its reference line: the border
        # away from the turn's centre is the one towards the kerb.
        t = road.middle(section, lane, s) - inner * lane.width.at(s) / 2
        yield Line("guide", road.place(s, t)[:, :2], road.level, lane.strip)
