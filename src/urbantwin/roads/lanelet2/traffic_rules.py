"""Traffic rules of Lanelet2's tags: kinds of lanes, users, speed limits and lane marks."""

from __future__ import annotations

import re
from collections.abc import Iterable

from urbantwin.taxonomy import ROAD_USERS

__all__ = ["PAINTED", "allowed_of", "default_speed", "kind_of", "mark_of", "speed_of"]

#: Subtype of a lanelet -> kind of lane; empty if there is none.
KINDS = {
    "": "driving", "road": "driving", "highway": "driving", "play_street": "driving",
    "exit": "driving", "bus_lane": "bus", "bus_bay": "bus", "bicycle_lane": "bicycle",
    "shared_walkway": "sidewalk", "walkway": "sidewalk", "pedestrian_lane": "sidewalk",
    "stairs": "", "emergency_lane": "shoulder", "road_shoulder": "shoulder",
    "parking": "parking", "parking_lane": "parking", "crosswalk": "crosswalk",
    "bicycle_crossing": "crosswalk", "rail": "", "tram": "",
}  # fmt: skip
#: Default users by kind of lane (LaneletAndAreaTagging.md, table of subtypes).
USERS = {
    "driving": ("car", "truck", "bus", "motorcycle", "bicycle"),
    "bus": ("bus",),
    "bicycle": ("bicycle",),
    "sidewalk": ("pedestrian",),
    "crosswalk": ("pedestrian",),
    "parking": ("car",),
    "shoulder": (),
    "": (),
}
#: Participant in tags -> classes of actors.
PARTICIPANTS = {
    "vehicle": ("car", "truck", "bus", "motorcycle"),
    "vehicle:car": ("car",),
    "vehicle:car:electric": ("car",),
    "vehicle:car:combustion": ("car",),
    "vehicle:taxi": (),
    "vehicle:emergency": (),
    "vehicle:bus": ("bus",),
    "vehicle:truck": ("truck",),
    "vehicle:motorcycle": ("motorcycle",),
    "bicycle": ("bicycle",),
    "pedestrian": ("pedestrian",),
}
#: Types of ways that are painted lines.
PAINTED = {"line_thin", "line_thick", "bike_marking", "pedestrian_marking"}
#: Types of ways that are raised barriers.
CURBS = {"curbstone", "road_border", "guard_rail", "wall", "fence", "jersey_barrier"}
#: Subtype of a painted line -> mark of OpenDRIVE, in the line's direction, left first.
PAINT = {
    "solid": "solid",
    "dashed": "broken",
    "solid_solid": "solid solid",
    "solid_dashed": "solid broken",
    "dashed_solid": "broken solid",
    "dashed_dashed": "broken broken",
}
#: Maximum speed limit, m/s.
FASTEST_MPS = 100.0
_SPEED = re.compile(r"([0-9]+(?:\.[0-9]+)?)\s*(km/h|kmh|kph|mph|m/s|mps)?", re.IGNORECASE)
_TO_MPS = {"": 1 / 3.6, "km/h": 1 / 3.6, "kmh": 1 / 3.6, "kph": 1 / 3.6, "mph": 0.44704}


def kind_of(tags: dict[str, str]) -> str:
    """Return the kind of lane, ``crosswalk``, or empty for other lanelets."""
    return KINDS.get(tags.get("subtype", ""), "")


def allowed_of(tags: dict[str, str]) -> tuple[str, ...]:
    """Return the classes of actors that may use a lanelet: as tagged, else by its subtype."""
    subtype = tags.get("subtype", "")
    users = set(USERS[kind_of(tags)])
    if subtype == "highway":
        users.discard("bicycle")
    elif subtype in ("shared_walkway", "bicycle_crossing"):
        users.add("bicycle")
    elif subtype == "play_street":
        users.add("pedestrian")
    tagged = {k.split(":", 1)[1]: v for k, v in tags.items() if k.startswith("participant:")}
    if any(v == "yes" for v in tagged.values()):
        users = set()
    # From general to specific: a specific tag overrides the general one.
    for name in sorted(tagged, key=lambda n: (n.count(":"), n)):
        classes = set(PARTICIPANTS.get(name, ()))
        users = users | classes if tagged[name] == "yes" else users - classes
    return tuple(name for name in ROAD_USERS if name in users)


def speed_of(texts: Iterable[str]) -> float | None:
    """Return the first readable speed, m/s: ``50``, ``50 km/h``, ``de274-60``, ``30mph``.

    A number without unit is in km/h; that of a German sign follows its code.
    """
    for text in texts:
        match = _SPEED.search(re.sub(r"^[a-z]{2}\s*[0-9]+(\.[0-9]+)?-", "", text.strip().lower()))
        if match:
            unit = (match[2] or "").lower()
            value = float(match[1]) * _TO_MPS.get(unit, 1.0)
            if 0 < value < FASTEST_MPS:
                return value
    return None


def default_speed(tags: dict[str, str]) -> float:
    """Return the default speed limit, m/s, by Germany's rules in Lanelet2."""
    subtype, urban = tags.get("subtype", ""), tags.get("location", "urban") != "nonurban"
    if subtype == "play_street":
        return 7 / 3.6
    if subtype in ("bicycle_lane",):
        return 25 / 3.6
    if subtype == "highway" and not urban:
        return 130 / 3.6
    return (50 if urban else 100) / 3.6


def mark_of(tags: dict[str, str], *, turned: bool) -> tuple[str, str]:
    """Return a line's mark and the lane changes permitted over it, in a direction.

    Changes are ``increase`` to the left (to the greater lane id), ``decrease`` to the right,
    ``both`` or ``none`` (ASAM OpenDRIVE 1.8, 11.9; LinestringTagging.md).

    Args:
        tags: tags of the way.
        turned: whether the direction is against the way's own.
    """
    kind, subtype = tags.get("type", ""), tags.get("subtype", "")
    if kind in CURBS:
        return "curb", "none"
    if kind not in PAINTED:
        return "none", _tagged(tags, "none", turned=turned)
    mark = PAINT.get(subtype, "solid")
    if turned and " " in mark:
        mark = " ".join(reversed(mark.split()))
    first, last = (mark.split() * 2)[:2]
    # Crossing is permitted from the side whose own line is broken.
    change = {(True, True): "both", (True, False): "decrease", (False, True): "increase"}.get(
        (first == "broken", last == "broken"), "none"
    )
    return mark, _tagged(tags, change, turned=turned)


def _tagged(tags: dict[str, str], change: str, *, turned: bool) -> str:
    if "lane_change" in tags:
        return "both" if tags["lane_change"] == "yes" else "none"
    sides = [tags.get("lane_change:left"), tags.get("lane_change:right")]
    if sides == [None, None]:
        return change
    to_left, to_right = (side == "yes" for side in (sides[::-1] if turned else sides))
    return {(True, True): "both", (True, False): "increase", (False, True): "decrease"}.get(
        (to_left, to_right), "none"
    )
