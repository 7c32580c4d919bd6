"""Lanes that a user adds to a way or removes from it, expressed as tags."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from urbantwin.roads.cross_section.defaults import standard_of
from urbantwin.roads.cross_section.from_tags import cross_section
from urbantwin.roads.cross_section.lane_tags import DirectionTags, direction_tags, metres, one_way
from urbantwin.roads.cross_section.layout import MIDDLE
from urbantwin.roads.cross_section.section import CarriagewayLane, CrossSection

__all__ = ["ImpossibleLaneError", "Street", "with_lane", "without_lane"]

#: Tags for the width of the whole carriageway.
WHOLE = ("width", "width:carriageway", "est_width")
#: Kinds of lanes beside the lanes of motor traffic, with their tags.
BESIDE = {
    "bicycle": "cycleway",
    "parking": "parking",
    "shoulder": "shoulder",
    "sidewalk": "sidewalk",
}
#: Prefixes of tags that count bus lanes; lists may replace them.
BUS_COUNTS = ("lanes:bus", "lanes:psv", "busway")
#: Maximum number of lanes per direction.
MOST = 8
OTHER = {"left": "right", "right": "left"}
Tags = dict[str, str]


class ImpossibleLaneError(ValueError):
    """A lane cannot be added or removed; the message says why."""


@dataclass(frozen=True)
class Street:
    """Properties of a way that are not in its tags.

    Attributes:
        driving_side: ``right`` or ``left``.
        sidewalks: its sides with a sidewalk, see `roads.sidewalk.sidewalk_sides`.
        country: ISO 3166-1 alpha-2; empty if unknown.
    """

    driving_side: str
    sidewalks: str
    country: str = ""

    def section(self, tags: Mapping[str, str]) -> CrossSection:
        """Return the cross section that tags describe for this way."""
        return cross_section(
            tags, driving_side=self.driving_side, sidewalks=self.sidewalks, country=self.country
        )


def with_lane(
    tags: Mapping[str, str], side: str, kind: str, width_m: float | None, street: Street
) -> Tags:
    """Return the tags of a way with one more lane.

    A lane of motor traffic is added at the outer side of the others, inside a cycle lane. Lanes of
    motor traffic and cycle lanes widen the carriageway on that side; the other side keeps its
    position.

    Args:
        tags: the way's tags.
        side: ``left`` or ``right``, as seen along the way.
        kind: driving, bus, bicycle, parking, shoulder or sidewalk.
        width_m: its width, metres; ``None`` for the default.
        street: other properties of the way.

    Raises:
        ImpossibleLaneError: there already is such a lane, or the maximum number of lanes.
    """
    before = street.section(tags)
    if kind in ("driving", "bus"):
        after = _with_motor_lane(tags, side, kind, width_m, street)
    else:
        if _has_lane(before, side, kind, street):
            raise ImpossibleLaneError(f"it has a lane of kind {kind} on its {side} already")
        after = _sided(tags, kind, street)
        after[f"{BESIDE[kind]}:{side}"] = "yes" if kind in ("shoulder", "sidewalk") else "lane"
        if kind == "parking":
            after["parking:" + side + ":orientation"] = "parallel"
        if width_m is not None:
            after[f"{BESIDE[kind]}:{side}:width"] = f"{width_m:.10g}"
        after = _with_carriageway_width(after, _beside_m(street.section(after), side, kind))
    return _in_place(after, before, side, street)


def without_lane(tags: Mapping[str, str], side: str, kind: str, street: Street) -> Tags:
    """Return the tags of a way without the outermost lane of a kind on a side.

    Args:
        tags: the way's tags.
        side: ``left`` or ``right``, as seen along the way.
        kind: driving, bus, bicycle, parking, shoulder or sidewalk.
        street: other properties of the way.

    Raises:
        ImpossibleLaneError: there is no such lane, or it is the only lane of its direction.
    """
    before = street.section(tags)
    if kind in ("driving", "bus"):
        after = _without_motor_lane(tags, side, kind, before, street)
    else:
        if not _has_lane(before, side, kind, street):
            raise ImpossibleLaneError(f"it has no lane of kind {kind} on its {side}")
        after = _sided(tags, kind, street)
        after[f"{BESIDE[kind]}:{side}"] = "no"
        if kind == "bicycle" and _has_lane(street.section(after), side, kind, street):
            raise ImpossibleLaneError("its cycle lane is in its lists of lanes: tag these")
        after = _with_carriageway_width(after, -_beside_m(before, side, kind))
    return _in_place(after, before, side, street)


def _forward(tags: Mapping[str, str], side: str, street: Street) -> bool:
    """Return whether the lanes of a side run along the way."""
    oneway = one_way(tags)
    return side == street.driving_side if oneway == "both" else oneway == "forward"


def _lanes_of(section: CrossSection, side: str) -> tuple[CarriagewayLane, ...]:
    """Return the lanes whose outer border is on a side of the way, from the middle outwards."""
    if not section.backward:
        ahead = section.forward
        return ahead if side == section.driving_side else ahead[::-1]
    if not section.forward:
        return section.backward[::-1] if side == section.driving_side else section.backward
    return section.lanes(forward=side == section.driving_side)


def _has_lane(section: CrossSection, side: str, kind: str, street: Street) -> bool:
    beside = section.left if side == "left" else section.right
    if kind == "parking":
        return beside.parking is not None
    if kind == "shoulder":
        return beside.shoulder > 0
    if kind == "sidewalk":
        return street.sidewalks in (side, "both")
    lanes = _lanes_of(section, side)
    return bool(lanes) and lanes[-1].kind == "bicycle"


def _sided(tags: Mapping[str, str], kind: str, street: Street) -> Tags:
    """Return tags in which values for both sides are replaced by values per side."""
    key = BESIDE[kind]
    section = street.section(tags)
    after = {name: value for name, value in tags.items() if name not in (key, f"{key}:both")}
    if kind == "parking":
        former = ("parking:lane", "parking:condition")
        after = {name: value for name, value in after.items() if not name.startswith(former)}
    for side in ("left", "right"):
        if not _has_lane(section, side, kind, street):
            after[f"{key}:{side}"] = "no"
            continue
        lane = _lanes_of(section, side)[-1:]
        beside = section.left if side == "left" else section.right
        if kind == "bicycle" and lane and lane[0].listed:
            continue  # set by a list of lanes
        if kind == "bicycle":
            after[f"{key}:{side}"] = "track" if lane[0].track else "lane"
            width = lane[0].width
        elif kind == "parking" and beside.parking is not None:
            after[f"{key}:{side}"] = beside.parking.position
            after[f"{key}:{side}:orientation"] = beside.parking.orientation
            continue  # its width is tagged per side, or the default
        else:
            after[f"{key}:{side}"] = "yes"
            width = beside.shoulder if kind == "shoulder" else beside.sidewalk
        if width > 0:
            after[f"{key}:{side}:width"] = f"{width:.10g}"
    return after


def _with_motor_lane(
    tags: Mapping[str, str], side: str, kind: str, width_m: float | None, street: Street
) -> Tags:
    standard = standard_of(street.country)
    default_m = standard.bus if kind == "bus" else standard.lane(tags.get("highway", ""))
    width = default_m if width_m is None else width_m
    directed, after, name, at_end = _direction(tags, side, street)
    if directed.motor >= MOST:
        raise ImpossibleLaneError(f"it has {directed.motor} lanes on that side already")
    lists = dict(directed.lists)
    blank = [""] * directed.slots
    lists.setdefault("width:lanes", blank)
    if kind == "bus":
        lists.setdefault("bus:lanes", blank)
    new_values = {
        "width:lanes": f"{width:.10g}",
        "bus:lanes": "designated" if kind == "bus" else "",
    }
    for key, values in lists.items():
        row = [*values]
        row.insert(len(row) if at_end else 0, new_values.get(key, ""))
        after[f"{key}:{name}"] = "|".join(row)
    after[f"lanes:{name}"] = str(directed.motor + 1)
    _count(after, 1)
    return _with_carriageway_width(after, width)


def _without_motor_lane(
    tags: Mapping[str, str], side: str, kind: str, before: CrossSection, street: Street
) -> Tags:
    directed, after, name, at_end = _direction(tags, side, street)
    row = [lane for lane in _lanes_of(before, side) if lane.listed]
    matching = [k for k, lane in enumerate(row) if lane.kind == kind]
    if not matching:
        raise ImpossibleLaneError(f"it has no lane of kind {kind} on its {side}")
    motor = sum(lane.kind in ("driving", "bus") for lane in row)
    if motor < 2:
        raise ImpossibleLaneError("it is the only lane of its direction: tag the way (oneway)")
    # Lists run from left to right in the direction of travel; ``row`` runs outwards to the side.
    slot = matching[-1] if at_end else len(row) - 1 - matching[-1]
    lists = dict(directed.lists)
    for key, values in lists.items():
        remaining = [value for k, value in enumerate(values) if k != slot]
        after[f"{key}:{name}"] = "|".join(remaining)
    after[f"lanes:{name}"] = str(directed.motor - 1)
    _count(after, -1)
    return _with_carriageway_width(after, -row[matching[-1]].width)


def _with_carriageway_width(tags: Tags, more_m: float) -> Tags:
    """Return tags whose carriageway widths, if any, are changed by ``more_m`` metres."""
    widths = {key: width for key in WHOLE if (width := metres(tags.get(key))) is not None}
    return tags | {key: f"{max(width + more_m, 0.1):.10g}" for key, width in widths.items()}


def _beside_m(section: CrossSection, side: str, kind: str) -> float:
    """Return the carriageway width that a parking or cycle lane occupies, metres."""
    beside = section.left if side == "left" else section.right
    if (
        kind == "parking"
        and beside.parking is not None
        and beside.parking.position != "street_side"
    ):
        return beside.parking.width
    lanes = _lanes_of(section, side)
    if kind == "bicycle" and lanes and lanes[-1].kind == "bicycle" and not lanes[-1].track:
        return lanes[-1].width
    return 0.0


def _direction(
    tags: Mapping[str, str], side: str, street: Street
) -> tuple[DirectionTags, Tags, str, bool]:
    """Return the direction of a side's lanes, with tags separated by direction.

    Returns:
        The lanes of that direction; tags with separate lists and counts per direction; the
            direction's name; and whether the side is at the end of its lists.
    """
    forward = _forward(tags, side, street)
    ahead, back, shared = direction_tags(tags, street.driving_side)
    directions = {
        name: _with_bus_list(directed, street)
        for name, directed in (("forward", ahead), ("backward", back))
        if directed is not None
    }
    after = {key: value for key, value in tags.items() if not key.startswith(BUS_COUNTS)}
    for key in {key for directed in directions.values() for key in directed.lists}:
        after.pop(key, None)
    for name, directed in directions.items():
        after[f"lanes:{name}"] = str(directed.motor)
        after |= {f"{key}:{name}": "|".join(values) for key, values in directed.lists.items()}
    after["lanes"] = str(sum(directed.motor for directed in directions.values()) + shared)
    name = "forward" if forward else "backward"
    # On a way driven against its line, the right side along the traffic is the way's left side.
    return directions[name], after, name, (side == "right") == forward


def _with_bus_list(one: DirectionTags, street: Street) -> DirectionTags:
    """Return a direction with its counted kerbside bus lanes turned into a list."""
    if not one.buses:
        return one
    row = [""] * (one.slots - one.buses) + ["designated"] * one.buses
    row = row if street.driving_side == "right" else row[::-1]
    return replace(one, lists={"bus:lanes": row, **one.lists}, buses=0)


def _count(tags: Tags, more: int) -> None:
    tags["lanes"] = str(int(tags["lanes"]) + more)


def _in_place(after: Tags, before: CrossSection, side: str, street: Street) -> Tags:
    """Return tags that keep the other side's border in its position."""
    then = street.section(after)
    (widths_before, widths_after) = (
        [
            sum(lane.width for lane in lanes if not lane.track)
            for lanes in (section.forward, section.backward)
        ]
        for section in (before, then)
    )
    start, end = before.middle
    if widths_before == widths_after or start is None or end is None:
        return after
    shift_m = 0.0
    inner = OTHER[street.driving_side] if then.forward else street.driving_side
    if side == inner and not (then.forward and then.backward):
        # The middle of a one-way road is the inner border of its lanes.
        shift_m = (sum(widths_after) - sum(widths_before)) * (
            -then.outward if then.forward else then.outward
        )
    result = {key: value for key, value in after.items() if not key.startswith("placement")}
    result[MIDDLE] = f"{start + shift_m:.4f};{end + shift_m:.4f}"
    return result
