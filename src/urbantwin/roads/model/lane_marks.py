"""Lane marks: the lines between lanes as they are usually painted."""

from __future__ import annotations

from dataclasses import replace

from urbantwin.roads.model.lane_section import RAISED_KINDS, LaneSection, SectionLane
from urbantwin.roads.model.road import ModelRoad

__all__ = ["with_lane_marks", "without_lines"]

_MOTOR = ("driving", "bus")


def with_lane_marks(section: LaneSection) -> LaneSection:
    """Return a lane section with lines on the borders of its lanes.

    Between lanes of motor traffic in one direction the line is broken and may be crossed; where
    kinds differ it is solid; beside what is raised there is a curb. The middle of a two-way street
    is broken with one lane each way and solid with more (US MUTCD 3B.01, German RMS 1).
    """
    lanes = tuple(_marked(section, lane) for lane in section.lanes)
    return replace(section, lanes=lanes, centre_mark=_centre(section), centre_change="none")


def without_lines(road: ModelRoad) -> ModelRoad:
    """Return a road without painted lines on and between its lanes; curbs stay."""
    sections = []
    for section in road.sections:
        lanes = tuple(
            lane if lane.mark == "curb" else replace(lane, mark="none") for lane in section.lanes
        )
        centre = section.centre_mark if section.centre_mark == "curb" else "none"
        sections.append(replace(section, lanes=lanes, centre_mark=centre))
    return replace(road, sections=tuple(sections))


def _centre(section: LaneSection) -> str:
    inner = [section.by_id[k] for k in (1, -1) if k in section.by_id]
    if len({lane.forward for lane in section.lanes if lane.kind in _MOTOR}) == 2:
        return "solid" if sum(lane.kind in _MOTOR for lane in section.lanes) > 2 else "broken"
    if any(lane.kind in RAISED_KINDS for lane in inner):
        return "none" if len(inner) == 1 else "curb"
    return "solid"


def _marked(section: LaneSection, lane: SectionLane) -> SectionLane:
    outer = section.by_id.get(lane.id + (1 if lane.id > 0 else -1))
    raised = lane.kind in RAISED_KINDS, outer is not None and outer.kind in RAISED_KINDS
    mark, change = "solid", "none"
    if outer is None:
        mark = "none" if raised[0] else "solid"
    elif any(raised):
        mark = "none" if all(raised) else "curb"
    elif lane.kind == outer.kind == "driving" and lane.forward == outer.forward:
        mark, change = "broken", "both"
    if (mark, change) == (lane.mark, lane.change):
        return lane
    return replace(lane, mark=mark, change=change)
