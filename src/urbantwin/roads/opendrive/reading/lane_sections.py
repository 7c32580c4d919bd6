"""Lane sections and their lanes: width, kind, users, speed, height, mark."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from lxml import etree

from urbantwin.roads.cross_section.roadside import ORIENTATIONS
from urbantwin.roads.model import LANE_KINDS, LaneSection, ModelRoad, Profile, SectionLane
from urbantwin.roads.opendrive.cubics import added, lowest
from urbantwin.roads.opendrive.reading.parsing import Spot, user_data
from urbantwin.roads.opendrive.vocabulary import (
    ACCESS,
    DRIVEN,
    KIND_OF_TYPE,
    METRES_PER_SECOND,
    usual_users,
)

__all__ = ["Street", "reach_of", "read_sections", "speed_of", "with_lane_links"]

#: Shorter lane sections are dropped, metres: tools leave some of 0.1 mm where they cut roads.
SLIVER_M = 1e-3
#: Rounding of the file: tolerated negative width of a lane, metres.
NEGATIVE_M = 0.01
#: Spacing of the stations at which negative widths are set to zero, metres.
CLIPPED_STEP_M = 0.5
#: Maximum number of lanes per side of a road.
MOST_LANES = 200
#: Default speed limit, m/s (50 km/h: Vienna Convention 1968, built-up areas).
USUAL_SPEED = 50 / 3.6
_MARKS = (
    *("none", "solid", "broken", "solid solid", "solid broken", "broken solid"),
    *("broken broken", "botts dots", "grass", "curb"),
)
_CLASS = {word: name for name, word in ACCESS.items()} | {"trucks": "truck"}


@dataclass(frozen=True)
class Street:
    """Properties of all lanes of a road.

    Attributes:
        rule: ``RHT`` or ``LHT``.
        speeds: start stations of the road's speed limits, and the limits, m/s.
    """

    rule: str
    speeds: Sequence[tuple[float, float]]

    def speed(self, s: float) -> float | None:
        """Return the road's own speed limit at a station, m/s; ``None`` if it has none."""
        limit = None
        for start, following in self.speeds:
            if start <= s + 1e-6 or limit is None:
                limit = following
        return limit


def read_sections(
    road: etree._Element, length: float, street: Street, spot: Spot
) -> tuple[LaneSection, ...]:
    """Return the lane sections of a ``<road>``; their links are not checked yet.

    Args:
        road: the ``<road>``.
        length: length of its reference line, metres.
        street: properties of all its lanes.
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
            # Of several sections at one station the last is used; those without lanes are sorted
            # before it.
            has_lanes = any(item.find(f"{side}/lane") is not None for side in ("left", "right"))
            items.append((start, has_lanes, item))
    if not items:
        raise spot.error("has no lanes", expected="<lanes> with <laneSection>")
    items.sort(key=lambda row: row[:2])
    starts = [start for start, _, _ in items]
    if starts[0] > 0.1:
        raise spot.error(
            f"has no lanes before s = {starts[0]:g}", expected="a lane section at s = 0"
        )
    starts[0] = 0.0
    offset = spot.profile(road.findall("lanes/laneOffset"))
    sections = [
        _section(item, start, end, offset, street, spot.within(f"lane section at s = {start:g}"))
        for (_, _, item), start, end in zip(items, starts, [*starts[1:], length], strict=True)
    ]
    return tuple(_without_slivers(sections, length, spot))


def with_lane_links(
    section: LaneSection, tag: str, link: Callable[[SectionLane, int | None], int | None]
) -> LaneSection:
    """Return a section whose lanes have new links.

    Args:
        section: the lane section.
        tag: ``predecessor`` or ``successor``.
        link: function from a lane and its link to its new link.
    """
    lanes = tuple(
        replace(lane, predecessor=link(lane, lane.predecessor))
        if tag == "predecessor"
        else replace(lane, successor=link(lane, lane.successor))
        for lane in section.lanes
    )
    return replace(section, lanes=lanes)


def _section(
    item: etree._Element, start: float, end: float, offset: Profile, street: Street, spot: Spot
) -> LaneSection:
    if item.get("singleSide") == "true":
        spot.remark("lane sections for one side only: lanes of the other side are missing there")
    items = _lanes_by_id(item, spot)
    bordered = any(lane.find("border") is not None for lane in items.values())
    length = end - start
    lanes: list[SectionLane] = []
    for sign in (1, -1):
        border = Profile.constant(0.0)
        for number in range(1, max((sign * k for k in items), default=0) + 1):
            identity = sign * number
            if identity not in items:
                spot.remark("ids of lanes with gaps: lanes of no width are put there")
                lanes.append(SectionLane(identity, "none", Profile.constant(0.0), True))
                continue
            place = spot.within(f"lane {identity}")
            width = _width(items[identity], sign, length, border, place)
            width = _not_negative(width, start, length, place)
            if bordered:
                border = added([(1.0, border), (1.0, width)], length)
            lanes.append(_lane(items[identity], identity, width, street, start, place))
    centre = item.find("center/lane")
    mark = ("none", "none") if centre is None else _mark(centre, spot)
    if bordered and not offset.is_zero:
        spot.remark("lane borders beside a lane offset: borders are taken from the offset")
    return LaneSection(start, tuple(sorted(lanes, key=lambda lane: -lane.id)), *mark)


def _lanes_by_id(item: etree._Element, spot: Spot) -> dict[int, etree._Element]:
    """Return the ``<lane>`` elements of a section by id; those with an invalid id are dropped."""
    lanes: dict[int, etree._Element] = {}
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
                if identity in lanes:
                    raise spot.error(f"has lane {identity} twice", expected="each id once")
                lanes[identity] = child
    return lanes


def _lane(
    item: etree._Element, identity: int, width: Profile, street: Street, start: float, spot: Spot
) -> SectionLane:
    notes = user_data(item)
    access = _access(item, spot)
    kind = _kind(item, notes, access, spot)
    mark, change = _mark(item, spot)
    parking = notes.get("parking", "") if kind == "parking" else ""
    return SectionLane(
        identity,
        kind,
        width,
        _is_forward(item, notes, identity, street.rule, spot),
        _speed(item, street, start, spot) if kind in DRIVEN else 0.0,
        usual_users(kind) if access is None else access,
        predecessor=_link(item, "predecessor", spot),
        successor=_link(item, "successor", spot),
        height=_height(item, kind, spot),
        mark=mark,
        change=change,
        parking=parking if parking in ORIENTATIONS else "",
    )


def _records(item: etree._Element, tag: str, spot: Spot) -> list[etree._Element]:
    """Return the records with a tag in a lane, sorted by station."""
    return sorted(item.findall(tag), key=lambda record: spot.number(record, "sOffset", 0.0))


def _width(item: etree._Element, sign: int, length: float, inner: Profile, spot: Spot) -> Profile:
    """Return the width of a lane from its widths, or from its border and that of the inner lane.

    Records beyond the section are left out.
    """
    if widths := item.findall("width"):
        width = spot.profile(widths, "sOffset")
    elif borders := item.findall("border"):
        border = spot.profile(borders, "sOffset")
        width = added([(float(sign), border), (-1.0, inner)], length)
    else:
        return Profile.constant(0.0)
    within = width.start < length - 1e-9
    within[0] = True
    return width if within.all() else Profile(width.start[within], width.abcd[within])


def _not_negative(width: Profile, start: float, length: float, spot: Spot) -> Profile:
    """Return a width with negative values set to zero."""
    if len(width.start) == 1 and not width.abcd[0, 1:].any():
        least, station = float(width.abcd[0, 0]), 0.0
    else:
        least, station = lowest(width, length)
    if least < -NEGATIVE_M:
        spot.drop(f"is {least:.3g} m wide at s = {start + station:.3f}")
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


def _access(item: etree._Element, spot: Spot) -> tuple[str, ...] | None:
    """Return the classes of actors that ``<access>`` admits; ``None`` without an ``<access>``.

    By the standard, allowed classes exclude all others, and denied classes leave all others.
    """
    rules = item.findall("access")
    if not rules:
        return None
    first = min(spot.number(rule, "sOffset", 0.0) for rule in rules)
    allowed: set[str] = set()
    denied: set[str] = set()
    lists_allowed = False
    for rule in rules:
        if spot.number(rule, "sOffset", 0.0) > first + 1e-6:
            spot.remark("access that changes within a lane section: the first is taken")
            continue
        words = [rule.get("restriction"), *(e.get("type") for e in rule.findall("restriction"))]
        classes = {_CLASS[word] for word in words if word in _CLASS}
        if rule.get("rule", "deny") == "allow":
            allowed |= classes
            lists_allowed |= any(word is not None and word != "none" for word in words)
        else:
            denied |= classes
    if lists_allowed and not allowed:
        spot.remark("lanes for users that we do not have (taxis, emergency vehicles, ...)")
        return None
    default_users = usual_users(KIND_OF_TYPE.get(item.get("type", ""), "none"))
    base = allowed if lists_allowed else set(default_users)
    return tuple(name for name in ACCESS if name in base - denied)


def _kind(
    item: etree._Element, notes: dict[str, str], access: tuple[str, ...] | None, spot: Spot
) -> str:
    """Return the kind of a lane in the lane model."""
    if notes.get("kind") in LANE_KINDS:
        return notes["kind"]
    word = item.get("type", "none")
    kind = KIND_OF_TYPE.get(word)
    if kind is None:
        spot.remark(f"lanes of the unknown type {word[:40]!r}: nothing drives there")
        return "none"
    if word in ("tram", "rail"):
        spot.remark("tracks of trams and railways: nothing drives there")
    if kind == "driving" and access in (("bus",), ("bicycle",)):
        return access[0]
    return kind


def _is_forward(
    item: etree._Element, notes: dict[str, str], identity: int, rule: str, spot: Spot
) -> bool:
    """Return whether traffic of a lane runs along the reference line.

    Sources in this order: RoadRunner's ``travelDir``, the lane's ``direction``, and the side of the
    reference line with the road's ``rule``.
    """
    vector = item.find("userData/vectorLane")
    travel = None if vector is None else vector.get("travelDir")
    if travel in ("forward", "backward"):
        return bool(travel == "forward")
    direction = item.get("direction", notes.get("direction"))
    if "both" in (direction, travel) or "bidirectional" in (item.get("type"), travel):
        spot.remark("lanes for both directions: they get the direction of their side")
    along = (identity < 0) == (rule == "RHT")
    return bool(along != (direction == "reversed"))


def _speed(item: etree._Element, street: Street, s: float, spot: Spot) -> float:
    """Return the speed limit of a lane, m/s: its own, else the road's, else 50 km/h."""
    speeds: list[tuple[float, float | None]] = []
    for record in item.findall("speed"):
        with spot.dropping():
            speeds.append((spot.number(record, "sOffset", 0.0), speed_of(record, spot)))
    if speeds:
        speeds.sort(key=lambda row: row[0])
        limit = speeds[0][1]
        if any(other != limit for _, other in speeds):
            spot.remark("speed limits that change within a lane section: the first is taken")
        if limit is not None:
            return limit
    limit = street.speed(s)
    if limit is None:
        spot.remark("lanes without a speed limit: 50 km/h is assumed")
        return USUAL_SPEED
    return limit


def speed_of(item: etree._Element, spot: Spot) -> float | None:
    """Return a ``<speed>`` in m/s; ``None`` for ``no limit``, ``undefined`` and none."""
    if item.get("max", "") in ("no limit", "undefined", ""):
        return None
    unit = item.get("unit", "")
    if unit not in METRES_PER_SECOND:
        raise spot.error(f"has a speed in {unit[:20]!r}", expected="m/s, km/h or mph")
    speed = spot.number(item, "max") * METRES_PER_SECOND[unit]
    if speed < 0:
        raise spot.error(f"has a speed limit of {item.get('max')}", expected="0 or more")
    return speed if speed > 0 else None


def _height(item: etree._Element, kind: str, spot: Spot) -> float:
    """Return the height of a lane above the carriageway, metres; for a curb, the maximum."""
    records = _records(item, "height", spot)
    if not records:
        return 0.0
    inner, outer = (spot.number(records[0], key, 0.0) for key in ("inner", "outer"))
    return max(inner, outer) if kind == "curb" else float(np.mean([inner, outer]))


def _mark(item: etree._Element, spot: Spot) -> tuple[str, str]:
    """Return the mark on the outer border of a lane, and the lane changes that it permits."""
    records = _records(item, "roadMark", spot)
    if not records:
        return "none", "none"
    kind = records[0].get("type", "none")
    kind = kind if kind in _MARKS else "solid"
    default_change = "both" if kind == "broken" else "none"
    change = records[0].get("laneChange", default_change)
    return kind, change if change in ("none", "both", "increase", "decrease") else default_change


def _link(item: etree._Element, tag: str, spot: Spot) -> int | None:
    links = item.findall(f"link/{tag}")
    if len(links) > 1:
        spot.remark("lanes that go on as several: the first is taken")
    with spot.dropping():
        return spot.whole(links[0], "id") or None if links else None
    return None


def reach_of(road: ModelRoad) -> tuple[float, float]:
    """Return the extent of lanes to the left and to the right of the reference line, metres."""
    reach = []
    for sign in (1, -1):
        widest = 0.0
        for section, end in zip(road.sections, road.section_ends, strict=True):
            s = np.linspace(section.s, end, 3)
            lanes = [lane for lane in section.lanes if lane.id * sign > 0]
            total = sign * road.offset.at(s)
            for lane in lanes:
                total = total + lane.width.at(s - section.s)
            widest = max(widest, float(total.max()))
        reach.append(widest)
    return reach[0], reach[1]


def _without_slivers(
    sections: Sequence[LaneSection], length: float, spot: Spot
) -> list[LaneSection]:
    """Return lane sections without those shorter than `SLIVER_M`, with lanes linked across them."""
    result = list(sections)
    k = 0
    while len(result) > 1 and k < len(result):
        end = result[k + 1].s if k + 1 < len(result) else length
        if end - result[k].s >= SLIVER_M:
            k += 1
            continue
        sliver = result.pop(k)
        within = spot.within(f"lane section at s = {sliver.s:g}")
        within.drop(f"is {max(end - sliver.s, 0.0) * 1e3:.3g} mm long")
        if k > 0:
            result[k - 1] = _linked_over(result[k - 1], "successor", sliver)
        if k < len(result):
            start = 0.0 if k == 0 else result[k].s
            result[k] = replace(_linked_over(result[k], "predecessor", sliver), s=start)
        k = max(k - 1, 0)
    return result


def _linked_over(section: LaneSection, tag: str, sliver: LaneSection) -> LaneSection:
    """Return a section whose links skip a sliver."""
    links_of = {lane.id: getattr(lane, tag) for lane in sliver.lanes}
    if not any(links_of.values()):
        return section  # without links of its own, lanes continue under their ids
    # A link to a lane that the sliver lacks is kept, and reported later.
    return with_lane_links(
        section, tag, lambda _, link: None if link is None else links_of.get(link, link)
    )
