"""Curbs between the carriageway and a raised sidewalk, as lanes of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from urbantwin.roads.model import RAISED_KINDS, LaneModel, LaneSection, ModelRoad, Profile
from urbantwin.roads.side_lanes.lane_insertion import Insertion, Renumbering, relinked, with_lanes

__all__ = ["CURB_WIDTH_M", "with_curbs"]

#: Width of a curb stone, metres (EN 1340: 0.12 to 0.15 m are usual; AASHTO Green Book: 0.15 m).
CURB_WIDTH_M = 0.15
#: The narrowest sidewalk that gives up the width of a curb, metres.
NARROWEST_M = 0.6


def with_curbs(model: LaneModel) -> LaneModel:
    """Return the model with a curb along every sidewalk of a street; the sidewalk gives its width.

    Args:
        model: roads in plan, with their side lanes.
    """
    changed: dict[int, Renumbering] = {}
    roads = []
    for road in model.roads:
        items = [_curb(road, side) for side in (1, -1) if _has_sidewalk(road, side)]
        if road.junction >= 0 or not items:
            roads.append(road)
            continue
        curbed, changed[road.id] = with_lanes(road, items)
        roads.append(replace(curbed, sections=tuple(_narrowed(x) for x in curbed.sections)))
    return relinked(replace(model, roads=tuple(roads)), changed)


def _has_sidewalk(road: ModelRoad, side: int) -> bool:
    """Whether the innermost raised lane of a side is a wide enough sidewalk all along."""
    shared = any(lane.opposite for section in road.sections for lane in section.lanes)
    for section in road.sections:
        lanes = sorted((x for x in section.lanes if x.id * side > 0), key=lambda x: abs(x.id))
        raised = next((lane for lane in lanes if lane.kind in RAISED_KINDS), None)
        # Connecting roads start at a sidewalk that is the only lane of a side, unless both
        # directions share the lane on the other side: it stays in place.
        if raised is None or raised.kind != "sidewalk" or (abs(raised.id) == 1 and not shared):
            return False
        ends = [0.0, *raised.width.start]
        if np.min(raised.width.at(ends)) < NARROWEST_M:
            return False
    return True


def _curb(road: ModelRoad, side: int) -> Insertion:
    section = road.sections[0]
    height = next(x.height for x in section.lanes if x.id * side > 0 and x.kind == "sidewalk")
    width = Profile.constant(CURB_WIDTH_M)
    return Insertion(side, "before_raised", "curb", 0.0, road.length, width, height)


def _narrowed(section: LaneSection) -> LaneSection:
    lanes = {lane.id: lane for lane in section.lanes}
    for number, lane in section.by_id.items():
        inner = section.by_id.get(number - (1 if number > 0 else -1))
        if lane.kind == "sidewalk" and inner is not None and inner.kind == "curb":
            abcd = lane.width.abcd - [CURB_WIDTH_M, 0.0, 0.0, 0.0]
            lanes[number] = replace(lane, width=Profile(lane.width.start, abcd))
    return replace(section, lanes=tuple(lanes.values()))
