"""Access: which classes of actors may use the lanes of a road (OSM wiki, "Key:access").

A restriction of a class overrides that of a wider one ("Land-based transportation"): ``access``
applies to all, ``vehicle`` to all vehicles including bicycles, ``motor_vehicle`` to motor vehicles,
``motorcar``, ``motorcycle``, ``hgv`` and ``psv`` to their classes, ``bus`` to buses only. A key
with a direction (``motor_vehicle:backward``) overrides the same key without one. Conditional
restrictions (``:conditional``) are resolved before (``conditional_tags``).

Simulated traffic is through traffic. So a street restricted to users with permission or business
(``private``, ``delivery``) is closed, as in routing programs; ``destination`` leaves it open, since
such streets have their own traffic.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

__all__ = [
    "CYCLE_TRACK",
    "KEYS",
    "Permission",
    "either_way",
    "is_driven",
    "is_walked",
    "opened",
    "permission_of",
]

#: Classes of roads for motor traffic only.
FAST_ROADS = frozenset({"motorway", "motorway_link", "trunk", "trunk_link"})
#: Class of a drawn way for bicycles only, with lanes like a street's; not an OpenStreetMap value.
CYCLE_TRACK = "cycle_track"
#: Values that restrict a street to users with permission or business there.
OF_SOME = frozenset({"private", "permit", "customers", "delivery"})
#: Values that close a street to through traffic.
CLOSED = OF_SOME | frozenset(
    "no agricultural forestry agricultural;forestry emergency military use_sidepath "
    "dismount".split()
)
#: Values that open a street to buses only.
FOR_BUSES = frozenset({"bus", "psv"})
#: Classes of motor vehicles, and the keys that apply to them, most specific first.
MOTOR = {
    "car": ("motorcar", "motor_vehicle", "vehicle", "access"),
    "truck": ("hgv", "goods", "motor_vehicle", "vehicle", "access"),
    "bus": ("bus", "psv", "motor_vehicle", "vehicle", "access"),
    "motorcycle": ("motorcycle", "motor_vehicle", "vehicle", "access"),
}
RIDING = ("bicycle", "vehicle", "access")
WALKING = ("foot", "access")
#: All access keys.
KEYS = tuple(dict.fromkeys(key for keys in (*MOTOR.values(), RIDING, WALKING) for key in keys))


DIRECTIONS = ("forward", "backward")


@dataclass(frozen=True)
class Permission:
    """Classes allowed on a road's lanes.

    Attributes:
        motor: classes on general lanes; without motor vehicles if closed to them.
        bus_lane: classes on bus lanes.
    """

    motor: tuple[str, ...]
    bus_lane: tuple[str, ...]

    @property
    def cars(self) -> bool:
        """Whether cars are allowed."""
        return "car" in self.motor

    @property
    def driven(self) -> bool:
        """Whether any motor vehicle is allowed."""
        return not MOTOR.keys().isdisjoint(self.motor)


def permission_of(
    tags: Mapping[str, str], *, walkers_on_lanes: bool, direction: str = ""
) -> Permission:
    """Return the classes allowed on a way's lanes.

    Args:
        tags: the way's tags.
        walkers_on_lanes: whether pedestrians use the carriageway for lack of a sidewalk.
        direction: ``forward``, ``backward``, or empty for both.
    """
    # Restrictions implied by a road class rank like explicit ones for all vehicles.
    implied = _implied(tags)

    def may(name: str, keys: tuple[str, ...]) -> bool:
        value = _value({**implied, **tags}, keys, direction)
        return name == "bus" if value in FOR_BUSES else value not in CLOSED

    motor = tuple(name for name, keys in MOTOR.items() if may(name, keys))
    others = ("bicycle",) if may("bicycle", RIDING) else ()
    walkers = ("pedestrian",) if walkers_on_lanes and may("pedestrian", WALKING) else ()
    return Permission((*motor, *others, *walkers), ("bus", *others))


def is_driven(tags: Mapping[str, str]) -> bool:
    """Return whether any motor vehicle may use a way, in any direction."""
    return any(
        permission_of(tags, walkers_on_lanes=False, direction=direction).driven
        for direction in DIRECTIONS
    )


def is_walked(tags: Mapping[str, str]) -> bool:
    """Return whether pedestrians may use a way; a cycleway only if tagged so."""
    return _value({**_implied(tags), **tags}, WALKING) not in CLOSED


def _implied(tags: Mapping[str, str]) -> dict[str, str]:
    """Return the access tags implied by a road class."""
    highway = tags.get("highway", "")
    if highway in FAST_ROADS or tags.get("motorroad") == "yes":
        return {"bicycle": "no", "foot": "no"}
    if highway == "busway":
        return {"motor_vehicle": "no", "bus": "yes"}
    if highway == CYCLE_TRACK:
        return {"motor_vehicle": "no", "bicycle": "designated", "foot": "no"}
    return {"foot": "no"} if highway == "cycleway" else {}


def _value(tags: Mapping[str, str], keys: tuple[str, ...], direction: str = "") -> str:
    """Return the value of the most specific tagged key; ``yes`` without any."""
    values = (tags.get(f"{key}:{direction}", tags.get(key)) for key in keys)
    return next((value for value in values if value), "yes")


def either_way(tags: Mapping[str, str]) -> dict[str, str]:
    """Return the access keys for use of a way in either direction."""
    found = {}
    for key in KEYS:
        ways = [tags.get(f"{key}:{direction}", tags.get(key)) for direction in DIRECTIONS]
        known = [value for value in ways if value]
        if opening := [value for value in known if value not in CLOSED]:
            found[key] = opening[0]
        elif len(known) == len(ways):
            found[key] = known[0]
    return found


def opened(tags: Mapping[str, str]) -> dict[str, str]:
    """Return a way's tags for users with permission or business there."""
    return {
        key: "yes" if key.split(":")[0] in KEYS and value in OF_SOME else value
        for key, value in tags.items()
    }
