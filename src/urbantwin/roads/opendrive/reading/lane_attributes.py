"""Reading the attributes of lanes: kind, users, speed, height and mark."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from lxml import etree

from urbantwin.roads.cross_section.roadside import ORIENTATIONS
from urbantwin.roads.model import LANE_KINDS
from urbantwin.roads.opendrive.reading.parsing import Spot
from urbantwin.roads.opendrive.vocabulary import (
    ACCESS,
    KIND_OF_TYPE,
    METRES_PER_SECOND,
    usual_users,
)

__all__ = [
    "Street",
    "lane_direction",
    "lane_height",
    "lane_kind",
    "lane_mark",
    "lane_parking",
    "lane_speed",
    "lane_users",
]

#: Speed limit where a file tells none, m/s (50 km/h: Vienna Convention 1968, built-up areas).
USUAL_SPEED = 50 / 3.6
_MARKS = (
    *("none", "solid", "broken", "solid solid", "solid broken", "broken solid"),
    *("broken broken", "botts dots", "grass", "curb"),
)
_CLASS = {word: name for name, word in ACCESS.items()} | {"trucks": "truck"}


@dataclass(frozen=True)
class Street:
    """What holds for all lanes of a road.

    Attributes:
        rule: ``RHT`` or ``LHT``.
        speeds: stations from which on a speed limit of the road holds, and the limits, m/s.
    """

    rule: str
    speeds: Sequence[tuple[float, float]]

    def speed(self, s: float) -> float | None:
        """Return the road's own speed limit at a station, if it has one."""
        found = None
        for start, limit in self.speeds:
            if start <= s + 1e-6 or found is None:
                found = limit
        return found

    def users(self, kind: str, told: tuple[str, ...] | None) -> tuple[str, ...]:
        """Return the classes of actors that may use a lane."""
        return usual_users(kind) if told is None else told


def lane_users(item: etree._Element, spot: Spot) -> tuple[str, ...] | None:
    """Return who may use a lane by its ``<access>``, or ``None`` without one.

    Rules of the standard: what is allowed excludes all else; what is denied leaves all else.
    """
    rules = item.findall("access")
    if not rules:
        return None
    first = min(spot.number(rule, "sOffset", 0.0) for rule in rules)
    allowed: set[str] = set()
    denied: set[str] = set()
    known = False
    for rule in rules:
        if spot.number(rule, "sOffset", 0.0) > first + 1e-6:
            spot.remark("access that changes within a lane section: the first is taken")
            continue
        words = [rule.get("restriction"), *(e.get("type") for e in rule.findall("restriction"))]
        classes = {_CLASS[word] for word in words if word in _CLASS}
        if rule.get("rule", "deny") == "allow":
            allowed |= classes
            known |= any(word is not None and word != "none" for word in words)
        else:
            denied |= classes
    base = allowed if known else set(usual_users(KIND_OF_TYPE.get(item.get("type", ""), "none")))
    if known and not allowed:
        spot.remark("lanes for users that we do not have (taxis, emergency vehicles, ...)")
        return None
    return tuple(name for name in ACCESS if name in base - denied)


def lane_kind(item: etree._Element, users: tuple[str, ...] | None, spot: Spot) -> str:
    """Return the kind of a lane."""
    for note in item.findall("userData"):
        if note.get("code") == "kind" and note.get("value") in LANE_KINDS:
            return str(note.get("value"))
    word = item.get("type", "none")
    kind = KIND_OF_TYPE.get(word)
    if kind is None:
        spot.remark(f"lanes of the unknown type {word[:40]!r}: nothing drives there")
        return "none"
    if word in ("tram", "rail"):
        spot.remark("tracks of trams and railways: nothing drives there")
    if kind == "driving" and users in (("bus",), ("bicycle",)):
        return {"bus": "bus", "bicycle": "bicycle"}[users[0]]
    return kind


def _notes(item: etree._Element) -> dict[str | None, str | None]:
    """Return what programs noted of a lane beside the standard, by its code."""
    return {one.get("code"): one.get("value") for one in item.findall("userData")}


def lane_parking(item: etree._Element) -> str:
    """Return how vehicles park on a lane; empty where it does not tell."""
    notes = _notes(item)
    told = notes.get("parking") or ""
    return told if told in ORIENTATIONS else ""


def lane_direction(item: etree._Element, identity: int, rule: str, spot: Spot) -> bool:
    """Return whether traffic of a lane runs along the reference line.

    So say, in this order, RoadRunner's ``travelDir``, the lane's ``direction``, and the side of the
    reference line with the road's ``rule``.
    """
    vector = item.find("userData/vectorLane")
    travel = None if vector is None else vector.get("travelDir")
    if travel in ("forward", "backward"):
        return bool(travel == "forward")
    notes = _notes(item)
    direction = item.get("direction", notes.get("direction"))
    if "both" in (direction, travel) or "bidirectional" in (item.get("type"), travel):
        spot.remark("lanes for both directions: they get the direction of their side")
    along = (identity < 0) == (rule == "RHT")
    return bool(along != (direction == "reversed"))


def lane_speed(item: etree._Element, street: Street, s: float, spot: Spot) -> float:
    """Return the speed limit of a lane, m/s: its own, else the road's, else 50 km/h."""
    speeds: list[tuple[float, float | None]] = []
    for each in item.findall("speed"):
        with spot.dropping():
            speeds.append((spot.number(each, "sOffset", 0.0), speed_of(each, spot)))
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
    """Return a ``<speed>`` in m/s; ``None`` for ``no limit``, ``undefined`` and nothing."""
    if item.get("max", "") in ("no limit", "undefined", ""):
        return None
    unit = item.get("unit", "")
    if unit not in METRES_PER_SECOND:
        raise spot.error(f"has a speed in {unit[:20]!r}", expected="m/s, km/h or mph")
    speed = spot.number(item, "max") * METRES_PER_SECOND[unit]
    if speed < 0:
        raise spot.error(f"has a speed limit of {item.get('max')}", expected="0 or more")
    return speed if speed > 0 else None


def lane_height(item: etree._Element, kind: str, spot: Spot) -> float:
    """Return how far a lane stands above the carriageway, metres."""
    heights = sorted(item.findall("height"), key=lambda e: spot.number(e, "sOffset", 0.0))
    if not heights:
        return 0.0
    inner, outer = (spot.number(heights[0], key, 0.0) for key in ("inner", "outer"))
    # A curb rises from its inner to its outer border.
    return max(inner, outer) if kind == "curb" else float(np.mean([inner, outer]))


def lane_mark(item: etree._Element, spot: Spot) -> tuple[str, str]:
    """Return the mark on the outer border of a lane, and who may change lanes over it."""
    marks = sorted(item.findall("roadMark"), key=lambda e: spot.number(e, "sOffset", 0.0))
    if not marks:
        return "none", "none"
    kind = marks[0].get("type", "none")
    if kind not in _MARKS:
        kind = "solid"
    usual = "both" if kind == "broken" else "none"
    change = marks[0].get("laneChange", usual)
    return kind, change if change in ("none", "both", "increase", "decrease") else usual
