"""Cutting roads: a part between two stations, and a section border at a station."""

from __future__ import annotations

import dataclasses

from urbantwin.roads.model import LaneSection, ModelRoad

__all__ = ["part_of_road", "with_border", "without_links"]

#: Shorter parts are not kept, metres.
LEAST_M = 1e-3


def part_of_road(road: ModelRoad, first: float, last: float, identity: int) -> ModelRoad:
    """Return the part of a road between two stations, as a road of its own.

    An end that was cut is joined to nothing; one that was not stays joined as it was.

    Args:
        road: the road.
        first: station of the new start.
        last: station of the new end.
        identity: the new road's id.
    """
    whole = (first <= LEAST_M, last >= road.length - LEAST_M)
    first, last = (0.0 if whole[0] else first), (road.length if whole[1] else last)
    if all(whole):
        return road if road.id == identity else dataclasses.replace(road, id=identity)
    sections = [
        _part(section, max(first, section.s), first)
        for section, end in zip(road.sections, road.section_ends, strict=True)
        if min(last, end) - max(first, section.s) > LEAST_M
    ]
    if not whole[0]:
        sections[0] = without_links(sections[0], "predecessor")
    if not whole[1]:
        sections[-1] = without_links(sections[-1], "successor")
    profiles = {
        name: getattr(road, name).between(first, last)
        for name in ("offset", "elevation", "bank", "crown")
    }
    return dataclasses.replace(
        road,
        id=identity,
        curve=road.curve.between(first, last),
        sections=tuple(sections),
        predecessor=road.predecessor if whole[0] else None,
        successor=road.successor if whole[1] else None,
        **profiles,
    )


def with_border(road: ModelRoad, s: float) -> tuple[ModelRoad, int]:
    """Return a road with a section border at a station, and the index of the section behind it."""
    number = max(k for k, section in enumerate(road.sections) if section.s < s)
    before = road.sections[number]
    after = _part(before, s, 0.0)
    joined = (
        dataclasses.replace(
            before,
            lanes=tuple(dataclasses.replace(x, successor=x.id) for x in before.lanes),
        ),
        dataclasses.replace(
            after,
            lanes=tuple(dataclasses.replace(x, predecessor=x.id) for x in after.lanes),
        ),
    )
    sections = (*road.sections[:number], *joined, *road.sections[number + 1 :])
    return dataclasses.replace(road, sections=sections), number + 1


def _part(section: LaneSection, start: float, origin: float) -> LaneSection:
    """Return the rest of a section from a station on; its station counts from ``origin``."""
    gone = start - section.s
    lanes = section.lanes
    if gone > LEAST_M:
        lanes = tuple(
            dataclasses.replace(lane, width=lane.width.between(gone, float("inf")))
            for lane in lanes
        )
    return dataclasses.replace(section, s=start - origin, lanes=lanes)


def without_links(section: LaneSection, side: str) -> LaneSection:
    """Return a section whose lanes have no links at ``predecessor`` or ``successor``."""
    lanes = tuple(
        dataclasses.replace(lane, predecessor=None)
        if side == "predecessor"
        else dataclasses.replace(lane, successor=None)
        for lane in section.lanes
    )
    return dataclasses.replace(section, lanes=lanes)
