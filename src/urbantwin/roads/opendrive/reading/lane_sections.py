"""Reading lane sections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from lxml import etree

from urbantwin.roads.model import LaneSection, Profile, SectionLane
from urbantwin.roads.opendrive.cubics import added, lowest
from urbantwin.roads.opendrive.reading.lane_attributes import (
    Street,
    lane_direction,
    lane_height,
    lane_kind,
    lane_mark,
    lane_parking,
    lane_speed,
    lane_users,
)
from urbantwin.roads.opendrive.reading.parsing import Spot
from urbantwin.roads.opendrive.vocabulary import DRIVEN

__all__ = ["reach_of", "read_sections"]

#: Lane sections shorter than this are left out, metres: tools leave some of a tenth of a
#: millimetre where they cut roads.
SLIVER_M = 1e-3
#: A lane may be this much narrower than nothing: rounding of the file, metres.
NEGATIVE_M = 0.01
#: Widths below nothing are drawn as none, at stations this far apart, metres.
CLIPPED_STEP_M = 0.5
#: The most lanes on a side of a road.
MOST_LANES = 200


def read_sections(
    road: etree._Element, length: float, street: Street, spot: Spot
) -> tuple[LaneSection, ...]:
    """Return the lane sections of a road; links are as written, to be checked.

    Args:
        road: the ``<road>``.
        length: length of its reference line.
        street: what holds for all its lanes.
        spot: the road, for errors.

    Raises:
        InputError: there are no sections, or the first one begins too late.
    """
    items = []
    for item in road.findall("lanes/laneSection"):
        with spot.dropping():
            start = spot.number(item, "s")
            if start > length + 0.1:
                raise spot.error(
                    f"has a lane section at s = {start:g}, beyond its end at {length:.3f}"
                )
            # Of several at one station the last is used; sections without lanes come before it.
            items.append((start, _has_lanes(item), item))
    if not items:
        raise spot.error("has no lanes", expected="<lanes> with <laneSection>")
    items.sort(key=lambda row: row[:2])
    starts = [start for start, _, _ in items]
    if starts[0] > 0.1:
        raise spot.error(
            f"has no lanes before s = {starts[0]:g}", expected="a lane section at s = 0"
        )
    starts[0] = 0.0
    ends = [*starts[1:], length]
    offset = spot.profile(road.findall("lanes/laneOffset"))
    sections = [
        _section(item, start, end, offset, street, spot.within(f"lane section at s = {start:g}"))
        for (_, _, item), start, end in zip(items, starts, ends, strict=True)
    ]
    return tuple(_without_slivers(sections, length, spot))


def _has_lanes(item: etree._Element) -> bool:
    return item.find("left/lane") is not None or item.find("right/lane") is not None


def _section(
    item: etree._Element, start: float, end: float, offset: Profile, street: Street, spot: Spot
) -> LaneSection:
    if item.get("singleSide") == "true":
        spot.remark("lane sections for one side only: lanes of the other side are missing there")
    found: dict[int, etree._Element] = {}
    for side, sign in (("left", 1), ("right", -1)):
        for child in item.findall(f"{side}/lane"):
            with spot.dropping():
                identity = spot.whole(child, "id")
                if identity * sign <= 0:
                    raise spot.error(
                        f"has lane {identity} on the {side}",
                        expected="positive ids on the left, negative ones on the right",
                    )
                if abs(identity) > MOST_LANES:
                    raise spot.error(f"has lane {identity}", expected="fewer than 200 on a side")
                if identity in found:
                    raise spot.error(f"has lane {identity} twice", expected="each id once")
                found[identity] = child
    bordered = any(lane.find("border") is not None for lane in found.values())
    lanes: list[SectionLane] = []
    for sign in (1, -1):
        ids = sorted((k for k in found if k * sign > 0), key=abs)
        border = Profile.constant(0.0)
        for number in range(1, abs(ids[-1]) + 1 if ids else 1):
            identity = sign * number
            if identity not in found:
                spot.remark("ids of lanes with gaps: lanes of no width are put there")
                none = SectionLane(identity, "none", Profile.constant(0.0), True)
                lanes.append(none)
                continue
            lane_spot = spot.within(f"lane {identity}")
            width = _width(found[identity], sign, end - start, border, lane_spot)
            width = _not_negative(width, start, end - start, lane_spot)
            if bordered:
                border = added([(1.0, border), (1.0, width)], end - start)
            lanes.append(_lane(found[identity], identity, width, street, start, lane_spot))
    centre = item.find("center/lane")
    mark = ("none", "none") if centre is None else lane_mark(centre, spot)
    if bordered and not offset.is_zero:
        spot.remark("lane borders beside a lane offset: borders are taken from the offset")
    return LaneSection(start, tuple(sorted(lanes, key=lambda lane: -lane.id)), *mark)


def _width(item: etree._Element, sign: int, length: float, inner: Profile, spot: Spot) -> Profile:
    """Return the width of a lane; ``inner`` is how far the lanes within it reach."""
    widths = item.findall("width")
    if widths:
        return _trimmed(spot.profile(widths, "sOffset"), length)
    borders = item.findall("border")
    if borders:
        border = spot.profile(borders, "sOffset")
        return _trimmed(added([(float(sign), border), (-1.0, inner)], length), length)
    return Profile.constant(0.0)


def _trimmed(width: Profile, length: float) -> Profile:
    """Drop records that begin beyond the section, which nothing reads."""
    keep = width.start < length - 1e-9
    keep[0] = True
    if keep.all():
        return width
    return Profile(width.start[keep], width.abcd[keep])


def _not_negative(width: Profile, start: float, length: float, spot: Spot) -> Profile:
    """Return a width without the stretches where the file has it below zero."""
    if len(width.start) == 1 and not width.abcd[0, 1:].any():
        least, at = float(width.abcd[0, 0]), 0.0
    else:
        least, at = lowest(width, length)
    if least < -NEGATIVE_M:
        spot.drop(f"is {least:.3g} m wide at s = {start + at:.3f}")
        if length <= SLIVER_M:
            return Profile.constant(0.0)
        grid = np.linspace(0.0, length, 2 + int(length / CLIPPED_STEP_M))
        metres = np.maximum(width.at(grid), 0.0)
        rows = np.zeros((len(grid) - 1, 4))
        rows[:, 0], rows[:, 1] = metres[:-1], np.diff(metres) / np.diff(grid)
        return Profile(grid[:-1], rows)
    if least < -1e-6:
        spot.remark("lanes up to 1 cm narrower than nothing")
    return width


def _lane(
    item: etree._Element,
    identity: int,
    width: Profile,
    street: Street,
    start: float,
    spot: Spot,
) -> SectionLane:
    users = lane_users(item, spot)
    kind = lane_kind(item, users, spot)
    mark, change = lane_mark(item, spot)
    driven = kind in DRIVEN
    return SectionLane(
        identity,
        kind,
        width,
        lane_direction(item, identity, street.rule, spot),
        lane_speed(item, street, start, spot) if driven else 0.0,
        street.users(kind, users),
        predecessor=_link(item, "predecessor", spot),
        successor=_link(item, "successor", spot),
        height=lane_height(item, kind, spot),
        mark=mark,
        change=change,
        parking=lane_parking(item) if kind == "parking" else "",
    )


def _link(item: etree._Element, tag: str, spot: Spot) -> int | None:
    links: Sequence[etree._Element] = item.findall(f"link/{tag}")
    if not links:
        return None
    if len(links) > 1:
        spot.remark("lanes that go on as several: the first is taken")
    with spot.dropping():
        return spot.whole(links[0], "id") or None
    return None


def reach_of(
    sections: Sequence[LaneSection], offset: Profile, length: float
) -> tuple[float, float]:
    """Return how far lanes reach to the left and to the right of the reference line, metres."""
    left = right = 0.0
    ends = [*(section.s for section in sections[1:]), length]
    for section, end in zip(sections, ends, strict=True):
        s = np.linspace(section.s, end, 3)
        for sign in (1, -1):
            total = sign * offset.at(s)
            for lane in section.lanes:
                if lane.id * sign > 0:
                    total = total + lane.width.at(s - section.s)
            if sign > 0:
                left = max(left, float(total.max()))
            else:
                right = max(right, float(total.max()))
    return left, right


def _without_slivers(
    sections: Sequence[LaneSection], length: float, spot: Spot
) -> list[LaneSection]:
    """Return lane sections without the shortest ones; lanes go on over them.

    Args:
        sections: lane sections in order, links as written.
        length: length of the road.
        spot: the road, for what is dropped.
    """
    kept = list(sections)
    k = 0
    while len(kept) > 1 and k < len(kept):
        end = kept[k + 1].s if k + 1 < len(kept) else length
        if end - kept[k].s >= SLIVER_M:
            k += 1
            continue
        sliver = kept.pop(k)
        within = spot.within(f"lane section at s = {sliver.s:g}")
        within.drop(f"is {max(end - sliver.s, 0.0) * 1e3:.3g} mm long")
        if k > 0:
            kept[k - 1] = _relinked(kept[k - 1], "successor", sliver)
        if k < len(kept):
            start = 0.0 if k == 0 else kept[k].s
            kept[k] = replace(_relinked(kept[k], "predecessor", sliver), s=start)
        k = max(k - 1, 0)
    return kept


def _relinked(section: LaneSection, tag: str, sliver: LaneSection) -> LaneSection:
    """Return a section whose links lead to what the lanes of a sliver lead to."""
    through = {lane.id: getattr(lane, tag) for lane in sliver.lanes}
    if not any(through.values()):
        through = {}  # without links of its own, lanes go on under their ids
    lanes = tuple(
        replace(
            lane,
            predecessor=_beyond(lane.predecessor, through)
            if tag == "predecessor"
            else lane.predecessor,
            successor=_beyond(lane.successor, through) if tag == "successor" else lane.successor,
        )
        for lane in section.lanes
    )
    return replace(section, lanes=lanes)


def _beyond(lane: int | None, through: dict[int, int | None]) -> int | None:
    # A lane that the sliver does not have stays, and is reported later.
    return lane if lane is None else through.get(lane, lane)
