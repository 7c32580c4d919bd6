"""Values of tags: lengths with units, counts, and lists with one value per lane."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from urbantwin.roads.cross_section.defaults import default_lanes
from urbantwin.site.access import permission_of

__all__ = [
    "CLOSED",
    "RESERVED",
    "DirectionTags",
    "count",
    "direction_tags",
    "lane_list",
    "metres",
    "one_way",
]

#: Metres per unit (OSM wiki, "Map features/Units"; metres if none is given).
UNITS = {"": 1.0, "m": 1.0, "cm": 0.01, "ft": 0.3048, "'": 0.3048, "in": 0.0254, '"': 0.0254}
LENGTH = re.compile(r"^\s*(\d+(?:[.,]\d+)?)\s*(m|cm|ft|in|'|\")?\s*$")
FEET_AND_INCHES = re.compile(r"^\s*(\d+)\s*'\s*(\d+(?:\.\d+)?)\s*\"?\s*$")
#: Maximum length in metres, and maximum count of lanes; larger values are mapping errors.
LONGEST_M, MOST = 100.0, 12
#: Tags with one value per lane, the more reliable first.
LISTS = (
    "turn:lanes",
    "bus:lanes",
    "psv:lanes",
    "bicycle:lanes",
    "vehicle:lanes",
    "motor_vehicle:lanes",
    "access:lanes",
    "width:lanes",
    "maxspeed:lanes",
    "motorcycle:lanes",
    "hgv:lanes",
    "change:lanes",
)
CLOSED = frozenset({"no", "private"})
RESERVED = frozenset({"designated", "official", "lane"})


@dataclass(frozen=True)
class DirectionTags:
    """Lanes of one direction according to the tags.

    Attributes:
        slots: number of lanes, including cycle lanes between motor lanes.
        motor: number of lanes for motor traffic.
        lists: tag -> one value per slot, left to right in the direction of travel.
        buses: number of kerbside bus lanes if no list identifies them.
    """

    slots: int
    motor: int
    lists: Mapping[str, Sequence[str]]
    buses: int = 0

    def value(self, key: str, slot: int) -> str:
        """Return a lane's value of a tag; empty if it has none."""
        return self.lists[key][slot] if key in self.lists else ""


def metres(text: str | None) -> float | None:
    """Return a length in metres; ``None`` if it is missing, zero or invalid."""
    if text is None:
        return None
    feet = FEET_AND_INCHES.match(text)
    if feet:
        value = float(feet[1]) * 0.3048 + float(feet[2]) * 0.0254
    else:
        plain = LENGTH.match(text)
        if not plain:
            return None
        value = float(plain[1].replace(",", ".")) * UNITS[plain[2] or ""]
    return value if 0.0 < value <= LONGEST_M else None


def count(text: str | None) -> int | None:
    """Return a number of lanes, the smallest of several (``2;3``); ``None`` if it is invalid."""
    if text is None:
        return None
    words = [word.strip() for word in text.split(";")]
    numbers = [int(float(w)) for w in words if re.fullmatch(r"\d{1,3}(\.\d{1,3})?", w)]
    return min(numbers) if numbers and len(numbers) == len(words) and min(numbers) <= MOST else None


def lane_list(tags: Mapping[str, str], key: str, direction: str = "") -> list[str] | None:
    """Return the values of a tag with one value per lane, left to right.

    Args:
        tags: a way's tags.
        key: the tag without its direction, such as ``turn:lanes``.
        direction: ``forward``, ``backward`` or empty.
    """
    text = tags.get(f"{key}:{direction}" if direction else key)
    return None if text is None else [value.strip() for value in text.split("|")]


def one_way(tags: Mapping[str, str]) -> str:
    """Return ``forward``, ``backward`` or ``both`` (OSM wiki, "Key:oneway").

    Reversible roads count as ``forward``: they carry one direction at a time.
    """
    value = tags.get("oneway", "")
    if value in ("yes", "true", "1", "reversible"):
        return "forward"
    if value in ("-1", "reverse"):
        return "backward"
    if value in ("no", "false", "0", "alternating"):
        return "both"
    implied = tags.get("junction") in ("roundabout", "circular")
    return "forward" if implied or tags.get("highway") in ("motorway", "motorway_link") else "both"


def direction_tags(
    tags: Mapping[str, str], driving_side: str
) -> tuple[DirectionTags | None, DirectionTags | None, int]:
    """Return the forward lanes, the backward lanes and the number of lanes shared by both."""
    oneway = one_way(tags)
    if oneway == "both":
        return _two_way(tags, driving_side)
    total = count(tags.get("lanes"))
    against = "backward" if oneway == "forward" else "forward"
    contraflow = _contraflow_buses(tags, against)
    wanted = count(tags.get(f"lanes:{oneway}"))
    if wanted is None and total is not None:
        wanted = max(1, total - contraflow)
    lists = _lists(tags, oneway) or _lists(tags, "")
    main = _fitted(tags, oneway, wanted, lists, ("left", "right"))
    main = _with_lanes_for_cars(main, tags, oneway, driving_side)
    other = DirectionTags(contraflow, contraflow, {}, contraflow) if contraflow else None
    return (main, other, 0) if oneway == "forward" else (other, main, 0)


def _two_way(
    tags: Mapping[str, str], driving_side: str
) -> tuple[DirectionTags, DirectionTags, int]:
    total = count(tags.get("lanes"))
    shared = count(tags.get("lanes:both_ways")) or int(_has_turning_lane(tags))
    lists = {name: _lists(tags, name) for name in ("forward", "backward")}
    wanted = {name: count(tags.get(f"lanes:{name}")) for name in lists}
    for name, values in lists.items():
        if wanted[name] is None and values:
            slots = len(next(iter(values.values())))
            wanted[name] = max(1, slots - len(_cycle_slots(values, slots)))
    if total is not None:
        directed_count = total - shared
        for name, other in (("forward", "backward"), ("backward", "forward")):
            other_count = wanted[other]
            if wanted[name] is None and other_count is not None:
                wanted[name] = max(1, directed_count - other_count)
        if wanted["forward"] is None:
            # Of an odd number of lanes, the forward direction has one more.
            wanted["forward"] = max(1, (directed_count + 1) // 2)
            wanted["backward"] = max(1, directed_count // 2)
    _share_whole_lists(tags, lists, wanted, driving_side)
    other_side = "left" if driving_side == "right" else "right"
    sides = {"forward": (driving_side,), "backward": (other_side,)}
    forward, backward = (
        _with_lanes_for_cars(_fitted(tags, n, wanted[n], lists[n], sides[n]), tags, n, driving_side)
        for n in lists
    )
    return forward, backward, shared


def _has_turning_lane(tags: Mapping[str, str]) -> bool:
    """Return whether tags other than the count imply a middle lane for both directions."""
    return "turn:lanes:both_ways" in tags or tags.get("centre_turn_lane") == "yes"


def _with_lanes_for_cars(
    found: DirectionTags, tags: Mapping[str, str], name: str, driving_side: str
) -> DirectionTags:
    """Return a direction with bus lanes added where they would leave no lane for cars.

    A street that is open to cars has a lane for them: its ``lanes`` does not count bus lanes.
    """
    listed = {"bus:lanes", "psv:lanes"} & found.lists.keys()
    cars = permission_of(tags, walkers_on_lanes=False, direction=name).cars
    if found.buses < found.motor or listed or not cars:
        return found
    more = [""] * found.buses
    lists = {
        key: [*row, *more] if driving_side == "right" else [*more, *row]
        for key, row in found.lists.items()
    }
    return DirectionTags(found.slots + found.buses, found.motor + found.buses, lists, found.buses)


def _lists(tags: Mapping[str, str], direction: str) -> dict[str, list[str]]:
    """Return the lists of a direction that have the most common length."""
    lists = {key: values for key in LISTS if (values := lane_list(tags, key, direction))}
    if not lists:
        return {}
    lengths = Counter(len(values) for values in lists.values())
    first = len(next(iter(lists.values())))
    length = max(lengths, key=lambda n: (lengths[n], n == first))
    return {key: values for key, values in lists.items() if len(values) == length}


def _share_whole_lists(
    tags: Mapping[str, str],
    lists: dict[str, dict[str, list[str]]],
    wanted: Mapping[str, int | None],
    driving_side: str,
) -> None:
    """Split lists without a direction between both directions.

    Such a list counts all lanes of the road from the left, seen along the way. A list with as many
    values as forward lanes applies to these only.
    """
    undirected = _lists(tags, "")
    forward, backward = wanted["forward"], wanted["backward"]
    for key, values in undirected.items():
        ahead = forward if forward is not None else len(values)
        if len(values) == ahead:
            lists["forward"].setdefault(key, values)
        elif backward is not None and len(values) == ahead + backward:
            first, last = (backward, ahead) if driving_side == "right" else (ahead, backward)
            left, right = values[:first], values[first : first + last]
            along, against = (right, left) if driving_side == "right" else (left, right)
            lists["forward"].setdefault(key, along)
            if key != "turn:lanes":
                lists["backward"].setdefault(key, against[::-1])


def _fitted(
    tags: Mapping[str, str],
    name: str,
    wanted: int | None,
    lists: Mapping[str, list[str]],
    sides: tuple[str, ...],
) -> DirectionTags:
    """Return the lanes of a direction; lists of other lengths are dropped.

    ``sides`` are the sides of the road with its kerbs: both for a one-way road.
    """
    is_oneway = len(sides) == 2
    slots = len(next(iter(lists.values()))) if lists else 0
    cycles = len(_cycle_slots(lists, slots)) if slots else 0
    if wanted is None:
        wanted = slots - cycles or default_lanes(tags.get("highway", ""), one_way=is_oneway)
    buses = _bus_lanes(tags, name, sides)
    if lists and slots == wanted + cycles:
        return DirectionTags(slots, wanted, lists, min(buses, wanted))
    if lists and slots == wanted:
        return DirectionTags(slots, slots - cycles, lists, min(buses, wanted))
    used = {key: values for key, values in lists.items() if len(values) == wanted}
    return DirectionTags(wanted, wanted, used, min(buses, wanted))


def _cycle_slots(lists: Mapping[str, Sequence[str]], slots: int) -> list[int]:
    """Return the indices of the lanes in lists that are for bicycles only."""
    cycle_slots = []
    for k in range(slots):
        values = {key: row[k] for key, row in lists.items() if k < len(row)}
        closed = any(
            values.get(key) in CLOSED
            for key in ("vehicle:lanes", "motor_vehicle:lanes", "access:lanes")
        )
        buses = any(values.get(key) in RESERVED for key in ("bus:lanes", "psv:lanes"))
        is_explicit = any(key in values for key in ("vehicle:lanes", "motor_vehicle:lanes"))
        if values.get("bicycle:lanes") in RESERVED and not buses and (closed or not is_explicit):
            cycle_slots.append(k)
    return cycle_slots


def _bus_lanes(tags: Mapping[str, str], name: str, sides: tuple[str, ...]) -> int:
    """Return the number of bus lanes of a direction from counts and ``busway``."""
    for key in ("lanes:bus", "lanes:psv"):
        number = count(tags.get(f"{key}:{name}"))
        if number is not None:
            return number
        number = count(tags.get(key))
        if number is not None:
            return number if len(sides) == 2 else number // 2
    values = [tags.get("busway"), tags.get("busway:both")]
    values += [tags.get(f"busway:{side}") for side in sides]
    return int("lane" in values)


def _contraflow_buses(tags: Mapping[str, str], against: str) -> int:
    """Return the number of bus lanes against a one-way road."""
    for key in ("lanes:bus", "lanes:psv"):
        number = count(tags.get(f"{key}:{against}"))
        if number:
            return number
    values = {tags.get(key) for key in ("busway", "busway:left", "busway:right")}
    opens = "no" in (tags.get("oneway:bus"), tags.get("oneway:psv"))
    listed = count(tags.get(f"lanes:{against}"))
    if opens and listed:
        return listed
    return int("opposite_lane" in values)
