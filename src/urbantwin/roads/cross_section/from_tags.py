"""Cross section of a road from the tags of its OSM way."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

from urbantwin.roads.cross_section.cycleway import Cycleway, Cycleways, cycleways
from urbantwin.roads.cross_section.defaults import Standard, standard_of
from urbantwin.roads.cross_section.lane_tags import (
    CLOSED,
    RESERVED,
    DirectionTags,
    count,
    direction_tags,
    lane_list,
    metres,
    one_way,
)
from urbantwin.roads.cross_section.layout import middle_of_road
from urbantwin.roads.cross_section.roadside import parking, roadside
from urbantwin.roads.cross_section.section import CarriagewayLane, CrossSection
from urbantwin.site.access import CYCLE_TRACK, Permission, permission_of

__all__ = ["cross_section", "reinterpreted"]

#: Range of widths of motor traffic lanes, metres; a road width that implies others is ignored.
NARROWEST_M, WIDEST_M = 2.0, 8.0
#: Default width of one lane for both directions, metres, and of one on which cars can pass each
#: other (``lanes=1.5``; RASt 06: 4.10 m for two cars at low speed).
ONE_LANE_M, LANE_AND_A_HALF_M = 3.5, 4.5
#: Minimum width of one lane for both directions, metres: a car with its mirrors fits.
ONE_LANE_LEAST_M = 2.2
#: Carriageway width from which two cars pass each other without waiting (RASt 06), metres.
PASSING_M = 4.75
#: Lane access tags of motor traffic, the most specific first.
_ACCESS = ("motor_vehicle:lanes", "vehicle:lanes", "access:lanes")
ARROWS = frozenset(
    "left slight_left sharp_left through right slight_right sharp_right reverse merge_to_left "
    "merge_to_right".split()
)
KM_H, MPH, KNOT = 1 / 3.6, 0.44704, 0.514444
#: Walking pace (Germany, StVO section 42 with sign 325.1: 4 to 7 km/h).
WALK = 7 * KM_H
#: Speed where there is no limit: the advisory speed (Germany: 130 km/h).
UNLIMITED = 130 * KM_H
#: Statutory limits in km/h: urban, rural, divided rural or trunk, motorway, living street. Source:
#: OSM wiki, "Default speed limits" (the countries' road traffic acts).
LAW: dict[str, tuple[float, float, float, float, float]] = {
    "AT": (50, 100, 100, 130, 7), "AU": (50, 100, 100, 110, 10), "BE": (50, 70, 90, 120, 20),
    "BR": (60, 80, 100, 110, 20), "CA": (50, 80, 90, 100, 20), "CH": (50, 80, 100, 120, 20),
    "CN": (50, 70, 100, 120, 20), "CZ": (50, 90, 110, 130, 20), "DE": (50, 100, 130, 130, 7),
    "DK": (50, 80, 80, 130, 15), "EE": (50, 90, 90, 110, 20), "ES": (50, 90, 90, 120, 20),
    "FI": (50, 80, 100, 120, 20), "FR": (50, 80, 110, 130, 20), "GR": (50, 90, 110, 130, 20),
    "HR": (50, 90, 110, 130, 20), "HU": (50, 90, 110, 130, 20), "IE": (50, 80, 100, 120, 20),
    "IN": (50, 70, 80, 100, 20), "IT": (50, 90, 110, 130, 20), "JP": (40, 60, 60, 100, 20),
    "KR": (50, 80, 90, 100, 20), "LT": (50, 90, 90, 130, 20), "LU": (50, 90, 90, 130, 20),
    "LV": (50, 90, 90, 110, 20), "NL": (50, 80, 100, 100, 15), "NO": (50, 80, 80, 100, 15),
    "NZ": (50, 100, 100, 100, 10), "PL": (50, 90, 100, 140, 20), "PT": (50, 90, 100, 120, 20),
    "RO": (50, 90, 100, 130, 20), "RS": (50, 80, 100, 130, 10), "RU": (60, 90, 90, 110, 20),
    "SE": (50, 70, 90, 110, 7), "SG": (50, 60, 70, 90, 20), "SI": (50, 90, 110, 130, 10),
    "SK": (50, 90, 90, 130, 20), "TR": (50, 90, 110, 120, 20), "TW": (50, 60, 80, 100, 20),
    "UA": (50, 90, 110, 130, 20), "ZA": (60, 100, 100, 120, 20),
}  # fmt: skip
LAW_MPH: dict[str, tuple[float, float, float, float, float]] = {
    "GB": (30, 60, 70, 70, 20), "US": (30, 55, 55, 65, 15),
}  # fmt: skip
ELSEWHERE = (50.0, 80.0, 100.0, 120.0, 20.0)
CONTEXTS = {
    "urban": 0, "rural": 1, "nsl_single": 1, "nsl": 1, "nsl_restricted": 0, "trunk": 2,
    "nsl_dual": 2, "express": 2, "expressway": 2, "motorroad": 2, "motorway": 3,
    "living_street": 4, "pedestrian_zone": 4,
}  # fmt: skip
NUMBER = re.compile(r"(\d+(?:\.\d+)?)\s*(km/h|kmh|kph|mph|knots)?")
ZONE = re.compile(r"zone:?\s*(\d+)|^(\d+)$")
#: Values of ``oneway`` that are fully supported.
_ONEWAY_VALUES = frozenset({"yes", "true", "1", "-1", "reverse", "no", "false", "0"})


def cross_section(
    tags: Mapping[str, str], *, driving_side: str, sidewalks: str, country: str = ""
) -> CrossSection:
    """Return the cross section that a way's tags describe, completed by defaults.

    No tag is an error: invalid values count as missing.

    Args:
        tags: the way's tags.
        driving_side: ``right`` or ``left``.
        sidewalks: ``both``, ``left``, ``right`` or ``no`` (see ``roads.sidewalk``).
        country: ISO 3166-1 alpha-2; empty if unknown.
    """
    standard = standard_of(country)
    oneway = one_way(tags)
    forward_tags, backward_tags, shared = direction_tags(tags, driving_side)
    cycles = cycleways(tags, oneway, driving_side, standard)
    permissions = {
        name: permission_of(tags, walkers_on_lanes=sidewalks == "no", direction=name)
        for name in ("forward", "backward")
    }
    forward, backward = (
        _lanes(tags, directed_tags, name, driving_side, permissions[name], standard, country)
        for name, directed_tags in (("forward", forward_tags), ("backward", backward_tags))
    )
    if shared and forward:
        turn = "left" if driving_side == "right" else "right"
        middle = replace(forward[0], kind="driving", turns=(turn,), both_ways=True, listed=False)
        middle = replace(middle, allowed=permissions["forward"].motor, width=0.0)
        forward = [middle] * shared + forward
    forward, backward = _with_cycleways(tags, oneway, forward, backward, cycles, country)
    one_lane = _is_one_lane(tags, forward, backward, standard)
    forward, backward = _with_widths(tags, forward, backward, standard, one_lane=one_lane)
    outward = 1 if driving_side == "left" else -1
    sides = {}
    for side in ("left", "right"):
        against = (side == driving_side) == (oneway != "backward")
        sides[side] = roadside(
            tags,
            side,
            sidewalk=sidewalks in (side, "both"),
            outer=oneway == "both" or against,
            standard=standard,
            speed=speed_limit(tags, "forward", country),
        )
    return CrossSection(
        driving_side,
        tags.get("highway", ""),
        tuple(forward),
        tuple(backward),
        sides["left"],
        sides["right"],
        middle_of_road(tags, forward, backward, outward),
        one_lane,
    )


def _is_one_lane(
    tags: Mapping[str, str],
    forward: list[CarriagewayLane],
    backward: list[CarriagewayLane],
    standard: Standard,
) -> bool:
    """Return whether both directions of motor traffic share one lane.

    Tags for it are ``lanes=1`` without ``oneway`` (OSM wiki, "Key:lanes") and
    ``oneway=alternating``, unless two cars can pass each other on the mapped width.
    """
    if one_way(tags) != "both" or any(
        [lane.kind == "bicycle" for lane in lanes[:2]] not in ([False], [False, True])
        for lanes in (forward, backward)
    ):
        return False
    if any(lane.both_ways for lane in (*forward, *backward)):
        return False
    parts = sum(count(tags.get(f"lanes:{name}")) or 0 for name in ("forward", "backward"))
    one_tagged = tags.get("lanes", "").strip() in ("1", "1.0") and parts < 2
    alternating = tags.get("oneway") == "alternating" and "lanes" not in tags
    beside = (lane for lane in (*forward, *backward) if lane.kind == "bicycle" and not lane.track)
    cycle_lanes_m = sum(lane.width for lane in beside)
    room = (_carriageway(tags) or 0.0) - cycle_lanes_m - _parked(tags, standard)
    return (one_tagged or alternating) and room < PASSING_M


def _lanes(
    tags: Mapping[str, str],
    found: DirectionTags | None,
    name: str,
    driving_side: str,
    permission: Permission,
    standard: Standard,
    country: str,
) -> list[CarriagewayLane]:
    """Return the lanes that the tags count, from the middle outwards; unmapped widths are 0."""
    if found is None:
        return []
    default_speed = speed_limit(tags, name, country)
    lanes = []
    for slot in range(found.slots):
        kind, allowed = _kind_and_users(found, slot, permission)
        kind = "bicycle" if tags.get("highway") == CYCLE_TRACK else kind
        speed = speed_of(found.value("maxspeed:lanes", slot), country) or default_speed
        turns = tuple(w for w in found.value("turn:lanes", slot).split(";") if w in ARROWS)
        width = metres(found.value("width:lanes", slot)) or 0.0
        if kind == "bicycle":
            width = width or standard.cycle_lane
        elif not NARROWEST_M <= width <= WIDEST_M:
            width = 0.0
        lanes.append(CarriagewayLane(kind, min(width, WIDEST_M), speed, allowed, turns))
    if driving_side == "left":
        lanes.reverse()
    open_to_cars = permission.cars and one_way(tags) in ("both", name)
    if any(lane.kind == "bus" for lane in lanes):
        closed = any(found.value(key, k) in CLOSED for key in _ACCESS for k in range(found.slots))
        if open_to_cars and not closed and not any("car" in lane.allowed for lane in lanes):
            # Cars are not excluded from the street, so they share the bus lane next to its middle.
            first = next(k for k, lane in enumerate(lanes) if lane.kind == "bus")
            lanes[first] = replace(lanes[first], kind="driving", allowed=permission.motor)
        return lanes
    for k in range(len(lanes) - found.buses, len(lanes)):
        lanes[k] = replace(lanes[k], kind="bus", allowed=permission.bus_lane)
    return lanes


def _kind_and_users(
    found: DirectionTags, slot: int, permission: Permission
) -> tuple[str, tuple[str, ...]]:
    """Return the kind of a lane and the classes of actors that may use it."""
    access = next((v for key in _ACCESS if (v := found.value(key, slot))), "")
    bus = {found.value("bus:lanes", slot), found.value("psv:lanes", slot)}
    bicycle = found.value("bicycle:lanes", slot)
    closed = access in CLOSED
    if bicycle in RESERVED and not bus & RESERVED and (closed or found.slots > found.motor):
        return "bicycle", ("bicycle",)
    if bus & RESERVED or (closed and "yes" in bus):
        return "bus", permission.bus_lane
    if closed:
        return ("bicycle", ("bicycle",)) if bicycle == "yes" else ("none", ())
    allowed = permission.motor
    for key, name in (("motorcycle:lanes", "motorcycle"), ("hgv:lanes", "truck")):
        if found.value(key, slot) == "no":
            allowed = tuple(actor for actor in allowed if actor != name)
    if bicycle == "no":
        allowed = tuple(actor for actor in allowed if actor != "bicycle")
    is_bus = "bus" in allowed and not permission.cars
    return ("bus" if is_bus else "driving"), allowed


def _with_cycleways(
    tags: Mapping[str, str],
    way: str,
    forward: list[CarriagewayLane],
    backward: list[CarriagewayLane],
    cycles: Cycleways,
    country: str,
) -> tuple[list[CarriagewayLane], list[CarriagewayLane]]:
    """Add cycleways to the lanes and close other lanes to cyclists."""

    def lane(cycleway: Cycleway, direction: str) -> CarriagewayLane:
        speed = speed_limit(tags, direction, country)
        return CarriagewayLane(
            "bicycle", cycleway.width, speed, ("bicycle",), track=cycleway.track, listed=False
        )

    result = []
    for name, lanes, outer in (
        ("forward", forward, cycles.forward),
        ("backward", backward, cycles.backward),
    ):
        with_cycleway = list(lanes)
        has_cycle_lane = any(item.kind == "bicycle" for item in lanes)
        if outer is not None and not (has_cycle_lane and not outer.track):
            with_cycleway.append(lane(outer, name))
        if cycles.inner is not None and way == name and not has_cycle_lane:
            with_cycleway.insert(0, lane(cycles.inner, name))
        if any(item.kind == "bicycle" for item in with_cycleway):
            with_cycleway = [_without_cyclists(item) for item in with_cycleway]
        result.append(with_cycleway)
    return result[0], result[1]


def _without_cyclists(lane: CarriagewayLane) -> CarriagewayLane:
    if lane.kind == "bicycle":
        return lane
    return replace(lane, allowed=tuple(actor for actor in lane.allowed if actor != "bicycle"))


def _with_widths(
    tags: Mapping[str, str],
    forward: list[CarriagewayLane],
    backward: list[CarriagewayLane],
    standard: Standard,
    *,
    one_lane: bool,
) -> tuple[list[CarriagewayLane], list[CarriagewayLane]]:
    """Fill in unmapped lane widths; a lane shared by both directions counts half for each."""
    if one_lane and (width := max(forward[0].width, backward[0].width)):
        # A width tag of each lane is that of the shared lane.
        forward, backward = (
            [replace(side[0], width=width / 2), *side[1:]] for side in (forward, backward)
        )
    lanes = [*forward, *backward]
    open_lanes = sum(not lane.width for lane in lanes)
    known_m = sum(lane.width for lane in lanes if not lane.track)
    highway = tags.get("highway", "")
    single = one_way(tags) == "both" and count(tags.get("lanes")) == 1
    half = (ONE_LANE_M if one_lane else LANE_AND_A_HALF_M) / 2
    least = ONE_LANE_LEAST_M / 2 if one_lane else NARROWEST_M
    fill_m = _width_per_lane(tags, known_m, open_lanes, standard, least) if open_lanes else None

    def filled(lane: CarriagewayLane) -> CarriagewayLane:
        if lane.width:
            return lane
        if fill_m is not None:
            return replace(lane, width=fill_m)
        default_m = standard.bus if lane.kind == "bus" else standard.lane(highway)
        return replace(lane, width=half if single or one_lane else default_m, assumed=True)

    return [filled(lane) for lane in forward], [filled(lane) for lane in backward]


def _width_per_lane(
    tags: Mapping[str, str], known: float, open_lanes: int, standard: Standard, least: float
) -> float | None:
    """Return the width per unmapped lane that ``width`` (curb to curb) leaves, metres."""
    carriageway_m = _carriageway(tags)
    if carriageway_m is None:
        return None
    for beside in (_parked(tags, standard), 0.0):
        lane_m = (carriageway_m - known - beside) / open_lanes
        if least <= lane_m <= WIDEST_M:
            return lane_m
    return None


def _parked(tags: Mapping[str, str], standard: Standard) -> float:
    """Return the width of a carriageway that parked cars occupy, metres."""
    strips = (parking(tags, side, standard) for side in ("left", "right"))
    on_road = ("lane", "yes", "half_on_kerb")
    return sum(strip.width for strip in strips if strip is not None and strip.position in on_road)


def _carriageway(tags: Mapping[str, str]) -> float | None:
    """Return the mapped width from curb to curb, metres."""
    narrow = metres(tags.get("width:carriageway"))
    return narrow or metres(tags.get("width")) or metres(tags.get("est_width"))


def speed_of(value: str, country: str = "") -> float | None:
    """Return a value of ``maxspeed`` in m/s.

    Args:
        value: such as ``50``, ``20 mph``, ``walk``, ``none``, ``DE:urban``, ``DE:zone30``.
        country: for values without a country: ISO 3166-1 alpha-2.

    Returns:
        m/s; ``None`` where the value states no number, as ``signals`` and ``variable`` do.
    """
    # The lowest of several values (``50;30``) is on the safe side.
    if ";" in value:
        speeds = [speed_of(part, country) for part in value.split(";")]
        return min((speed for speed in speeds if speed is not None), default=None)
    text = value.strip()
    plain = NUMBER.fullmatch(text.lower())
    if plain:
        unit = {"mph": MPH, "knots": KNOT}.get(plain[2] or "", KM_H)
        speed = float(plain[1]) * unit
        return speed if 0.2 < speed < 100.0 else None
    if text.lower() == "walk":
        return WALK
    if text.lower() in ("none", "no", "unlimited"):
        return UNLIMITED
    code, _, context = text.partition(":")
    if not context:
        code, context = country, text
    code = {"UK": "GB"}.get(code.upper()[:2], code.upper()[:2])
    zone = ZONE.search(context)
    if zone:
        speed = float(zone[1] or zone[2]) * (MPH if code in LAW_MPH else KM_H)
        return speed if 0.0 < speed < 100.0 else None
    context_key = CONTEXTS.get(context.removeprefix("zone:"))
    return None if context_key is None else _law(code)[context_key]


def speed_limit(tags: Mapping[str, str], direction: str, country: str) -> float:
    """Return the speed limit of one direction of a way, m/s.

    Args:
        tags: the way's tags.
        direction: ``forward`` or ``backward``.
        country: ISO 3166-1 alpha-2, for the statutory limit where none is mapped.
    """
    for key in (
        f"maxspeed:{direction}",
        "maxspeed",
        "zone:maxspeed",
        f"maxspeed:type:{direction}",
        "maxspeed:type",
        "source:maxspeed",
        "zone:traffic",
    ):
        speed = speed_of(tags[key], country) if key in tags else None
        if speed is not None:
            return speed
    return default_speed(tags.get("highway", ""), country)


def default_speed(highway: str, country: str) -> float:
    """Return the statutory urban speed limit of a class of road, m/s."""
    urban, _, trunk, motorway, living = _law(country)
    if highway == "motorway":
        return motorway
    if highway == "living_street":
        return living
    if highway in ("trunk", "motorway_link"):
        return min(trunk, 80 * KM_H)
    return urban


def _law(country: str) -> tuple[float, ...]:
    if country in LAW_MPH:
        return tuple(speed * MPH for speed in LAW_MPH[country])
    return tuple(speed * KM_H for speed in LAW.get(country, ELSEWHERE))


def reinterpreted(tags: Mapping[str, str], section: CrossSection) -> list[str]:
    """Return messages on the tags that a cross section ignores or reinterprets.

    Args:
        tags: the way's tags.
        section: its cross section.
    """
    return [*_direction(tags, section), *_counts(tags), *_lists(tags, section)]


def _direction(tags: Mapping[str, str], section: CrossSection) -> list[str]:
    messages = []
    oneway = tags.get("oneway", "no")
    if oneway == "reversible":
        messages.append("oneway=reversible: traffic runs as the way is drawn")
    elif oneway == "alternating" and not section.one_lane:
        messages.append("oneway=alternating: each direction has its lane, and nobody waits")
    elif oneway not in (*_ONEWAY_VALUES, "alternating"):
        messages.append(f"oneway={oneway:.20}: taken for no")
    if any(lane.both_ways for lane in section.forward):
        messages.append("a lane for both directions: a turning lane of the way's own direction")
    direction = one_way(tags)
    against = section.lanes(forward=direction == "backward")
    if direction == "both" or any("bicycle" in lane.allowed for lane in against):
        return messages
    opposite = {key: value for key, value in tags.items() if key.startswith("cycleway")}
    contraflow_tags = [
        f"{key}={value}" for key, value in opposite.items() if value.startswith("opposite")
    ]
    if tags.get("oneway:bicycle") in ("no", "-1"):
        contraflow_tags.insert(0, f"oneway:bicycle={tags['oneway:bicycle']}")
    if contraflow_tags:
        messages.append(f"{contraflow_tags[0]:.40}: bicycles ride with the traffic only")
    return messages


def _counts(tags: Mapping[str, str]) -> list[str]:
    """Return a message if the total number of lanes contradicts the mapped parts."""
    total = count(tags.get("lanes"))
    parts = [count(tags.get(f"lanes:{name}")) for name in ("forward", "backward")]
    tagged = [number for number in parts if number is not None]
    if total is None or not tagged:
        return []
    parts_total = sum(tagged) + (count(tags.get("lanes:both_ways")) or 0)
    is_complete = len(tagged) == 2 or one_way(tags) != "both"
    if "turn:lanes:both_ways" in tags and "lanes:both_ways" not in tags:
        parts_total += 1
    if parts_total == total or (parts_total < total and not is_complete):
        return []
    parts_text = " and ".join(
        f"lanes:{name}={number}"
        for name, number in zip(("forward", "backward"), parts, strict=True)
        if number is not None
    )
    return [f"lanes={total}, but {parts_text}: the parts are taken"]


def _lists(tags: Mapping[str, str], section: CrossSection) -> list[str]:
    """Return messages on lists of turns whose length differs from the number of lanes."""
    messages = []
    oneway = one_way(tags)
    for direction in ("forward", "backward") if oneway == "both" else (oneway,):
        lanes = section.lanes(forward=direction == "forward")
        listed = [lane for lane in lanes if lane.listed]
        counts = {len(listed), sum(lane.kind != "bicycle" for lane in listed)}
        for suffix in (direction, "") if oneway != "both" else (direction,):
            values = lane_list(tags, "turn:lanes", suffix)
            if values is not None and len(values) not in counts:
                key = f"turn:lanes:{suffix}" if suffix else "turn:lanes"
                messages.append(f"{key} of {len(values)} values for {len(listed)} lanes: not used")
    return messages
