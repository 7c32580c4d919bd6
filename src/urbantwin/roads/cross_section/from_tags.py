"""The cross section of a road from its way's tags."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from urbantwin.roads.cross_section.cycleway import Cycleway, Cycleways, cycleways
from urbantwin.roads.cross_section.defaults import Standard, standard_of
from urbantwin.roads.cross_section.direction import (
    CLOSED,
    RESERVED,
    DirectionTags,
    direction_tags,
    one_way,
)
from urbantwin.roads.cross_section.lane_tags import count, metres
from urbantwin.roads.cross_section.placement import middle_of_road
from urbantwin.roads.cross_section.roadside import parking, roadside
from urbantwin.roads.cross_section.section import CarriagewayLane, CrossSection
from urbantwin.roads.cross_section.speed import speed_limit, speed_of
from urbantwin.site.access import CYCLE_TRACK, Permission, permission_of

__all__ = ["cross_section"]

#: Widths that lanes of motor traffic can have, metres; a width of the whole road that would give
#: others is taken for something else.
NARROWEST_M, WIDEST_M = 2.0, 8.0
#: A road with one lane for both directions where nobody mapped how wide it is, metres, and one on
#: which cars can pass each other (``lanes=1.5``; RASt 06: 4.10 m for two cars at low speed).
ONE_LANE_M, LANE_AND_A_HALF_M = 3.5, 4.5
#: The least width of one lane for both directions, metres: a car with its mirrors fits.
ONE_LANE_LEAST_M = 2.2
#: On a carriageway of this width or more two cars meet without waiting (RASt 06), metres.
PASSING_M = 4.75
#: Lists that say whether motor traffic may use a lane, the narrowest first.
_ACCESS = ("motor_vehicle:lanes", "vehicle:lanes", "access:lanes")
ARROWS = frozenset(
    "left slight_left sharp_left through right slight_right sharp_right reverse merge_to_left "
    "merge_to_right".split()
)


def cross_section(
    tags: Mapping[str, str], *, driving_side: str, sidewalks: str, country: str = ""
) -> CrossSection:
    """Return the cross section that a way's tags describe; defaults fill in the rest.

    Nothing in the tags is an error: a value that makes no sense counts as missing.

    Args:
        tags: the way's tags.
        driving_side: ``right`` or ``left``.
        sidewalks: ``both``, ``left``, ``right`` or ``no`` (see ``roads.sidewalk``).
        country: ISO 3166-1 alpha-2; empty if unknown.
    """
    standard = standard_of(country)
    way = one_way(tags)
    forward_tags, backward_tags, shared = direction_tags(tags, driving_side)
    cycles = cycleways(tags, way, driving_side, standard)
    permissions = {
        name: permission_of(tags, walkers_on_lanes=sidewalks == "no", direction=name)
        for name in ("forward", "backward")
    }
    forward, backward = (
        _lanes(tags, found, name, driving_side, permissions[name], standard, country)
        for name, found in (("forward", forward_tags), ("backward", backward_tags))
    )
    if shared and forward:
        turn = "left" if driving_side == "right" else "right"
        middle = replace(forward[0], kind="driving", turns=(turn,), both_ways=True, listed=False)
        middle = replace(middle, allowed=permissions["forward"].motor, width=0.0)
        forward = [middle] * shared + forward
    forward, backward = _with_cycleways(tags, way, forward, backward, cycles, country)
    one_lane = _is_one_lane(tags, forward, backward, standard)
    forward, backward = _with_widths(tags, forward, backward, standard, one_lane=one_lane)
    outward = 1 if driving_side == "left" else -1
    sides = {}
    for side in ("left", "right"):
        against = (side == driving_side) == (way != "backward")
        sides[side] = roadside(
            tags,
            side,
            sidewalk=sidewalks in (side, "both"),
            outer=way == "both" or against,
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

    So say ``lanes=1`` without ``oneway`` (OSM wiki, "Key:lanes") and ``oneway=alternating``, unless
    the carriageway is mapped so wide that two cars can pass each other.
    """
    if one_way(tags) != "both" or any(
        [lane.kind == "bicycle" for lane in lanes[:2]] not in ([False], [False, True])
        for lanes in (forward, backward)
    ):
        return False
    if any(lane.both_ways for lane in (*forward, *backward)):
        return False
    parts = sum(count(tags.get(f"lanes:{name}")) or 0 for name in ("forward", "backward"))
    said = tags.get("lanes", "").strip() in ("1", "1.0") and parts < 2
    alternating = tags.get("oneway") == "alternating" and "lanes" not in tags
    beside = (lane for lane in (*forward, *backward) if lane.kind == "bicycle" and not lane.track)
    taken = sum(lane.width for lane in beside)
    room = (_carriageway(tags) or 0.0) - taken - _parked(tags, standard)
    return (said or alternating) and room < PASSING_M


def _lanes(
    tags: Mapping[str, str],
    found: DirectionTags | None,
    name: str,
    driving_side: str,
    permission: Permission,
    standard: Standard,
    country: str,
) -> list[CarriagewayLane]:
    """Return the lanes that the tags count, from the middle outwards; open widths are 0."""
    if found is None:
        return []
    usual = speed_limit(tags, name, country)
    lanes = []
    for slot in range(found.slots):
        kind, allowed = _use(found, slot, permission)
        kind = "bicycle" if tags.get("highway") == CYCLE_TRACK else kind
        speed = speed_of(found.value("maxspeed:lanes", slot), country) or usual
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
            # Nothing closes the street to cars: they share the bus lane next to its middle.
            first = next(k for k, lane in enumerate(lanes) if lane.kind == "bus")
            lanes[first] = replace(lanes[first], kind="driving", allowed=permission.motor)
        return lanes
    for k in range(len(lanes) - found.buses, len(lanes)):
        lanes[k] = replace(lanes[k], kind="bus", allowed=permission.bus_lane)
    return lanes


def _use(found: DirectionTags, slot: int, permission: Permission) -> tuple[str, tuple[str, ...]]:
    """Return the kind of a lane and who may use it."""
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
    """Add cycleways to the lanes; cyclists keep to them."""

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
        found = list(lanes)
        own = any(item.kind == "bicycle" for item in lanes)
        if outer is not None and not (own and not outer.track):
            found.append(lane(outer, name))
        if cycles.inner is not None and way == name and not own:
            found.insert(0, lane(cycles.inner, name))
        if any(item.kind == "bicycle" for item in found):
            found = [_without_cyclists(item) for item in found]
        result.append(found)
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
    """Fill in widths of lanes without a tag of their own; of one lane for both, half for each."""
    if one_lane and (whole := max(forward[0].width, backward[0].width)):
        # A width of each lane is that of the one that there is.
        forward, backward = (
            [replace(side[0], width=whole / 2), *side[1:]] for side in (forward, backward)
        )
    lanes = [*forward, *backward]
    open_lanes = sum(not lane.width for lane in lanes)
    known = sum(lane.width for lane in lanes if not lane.track)
    highway = tags.get("highway", "")
    single = one_way(tags) == "both" and count(tags.get("lanes")) == 1
    half = (ONE_LANE_M if one_lane else LANE_AND_A_HALF_M) / 2
    least = ONE_LANE_LEAST_M / 2 if one_lane else NARROWEST_M
    each = _share(tags, known, open_lanes, standard, least) if open_lanes else None

    def filled(lane: CarriagewayLane) -> CarriagewayLane:
        if lane.width:
            return lane
        if each is not None:
            return replace(lane, width=each)
        usual = standard.bus if lane.kind == "bus" else standard.lane(highway)
        return replace(lane, width=half if single or one_lane else usual, assumed=True)

    return [filled(lane) for lane in forward], [filled(lane) for lane in backward]


def _share(
    tags: Mapping[str, str], known: float, open_lanes: int, standard: Standard, least: float
) -> float | None:
    """Return the width of a lane that ``width``, from curb to curb, leaves to each."""
    whole = _carriageway(tags)
    if whole is None:
        return None
    for beside in (_parked(tags, standard), 0.0):
        each = (whole - known - beside) / open_lanes
        if least <= each <= WIDEST_M:
            return each
    return None


def _parked(tags: Mapping[str, str], standard: Standard) -> float:
    """Return how much of a carriageway parked cars take, metres."""
    found = (parking(tags, side, standard) for side in ("left", "right"))
    on_road = ("lane", "yes", "half_on_kerb")
    return sum(one.width for one in found if one is not None and one.position in on_road)


def _carriageway(tags: Mapping[str, str]) -> float | None:
    """Return the mapped width from curb to curb, metres."""
    narrow = metres(tags.get("width:carriageway"))
    return narrow or metres(tags.get("width")) or metres(tags.get("est_width"))
