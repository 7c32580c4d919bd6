"""Access: which classes of actors may use the lanes of a road (OSM wiki, "Key:access").

A restriction of a class overrides that of a wider one ("Land-based transportation"): ``access``
holds for everybody, ``vehicle`` for all who drive or ride, ``motor_vehicle`` for all with a motor,
``motorcar``, ``motorcycle``, ``hgv`` and ``psv`` for theirs, ``bus`` for buses alone. A key with a
direction (``motor_vehicle:backward``) overrides the same key without one. What holds only at times
(``:conditional``) is read before (``conditional_tags``).

Traffic here passes through. So a street is closed to it where only some may drive who have business
there (``private``, ``delivery``), as routing programs have it; ``destination`` leaves it open: such
streets have traffic of their own.
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
#: Class of a drawn way for bicycles alone, with lanes like a street's; no value of OpenStreetMap's.
CYCLE_TRACK = "cycle_track"
#: Values that close a street to all but those who have leave or business there.
OF_SOME = frozenset({"private", "permit", "customers", "delivery"})
#: Values that close a street to those who pass through.
CLOSED = OF_SOME | frozenset(
    "no agricultural forestry agricultural;forestry emergency military use_sidepath "
    "dismount".split()
)
#: Values that open a street to buses alone.
FOR_BUSES = frozenset({"bus", "psv"})
#: Classes of actors with a motor, and the keys that speak of them, the narrowest first.
MOTOR = {
    "car": ("motorcar", "motor_vehicle", "vehicle", "access"),
    "truck": ("hgv", "goods", "motor_vehicle", "vehicle", "access"),
    "bus": ("bus", "psv", "motor_vehicle", "vehicle", "access"),
    "motorcycle": ("motorcycle", "motor_vehicle", "vehicle", "access"),
}
RIDING = ("bicycle", "vehicle", "access")
WALKING = ("foot", "access")
#: Every key that says who may use a way.
KEYS = tuple(dict.fromkeys(key for keys in (*MOTOR.values(), RIDING, WALKING) for key in keys))


DIRECTIONS = ("forward", "backward")


@dataclass(frozen=True)
class Permission:
    """Classes of actors on a road's lanes.

    Attributes:
        motor: on lanes of general traffic; nobody with a motor where it is closed to them.
        bus_lane: on lanes for buses.
    """

    motor: tuple[str, ...]
    bus_lane: tuple[str, ...]

    @property
    def cars(self) -> bool:
        """Whether cars may drive there."""
        return "car" in self.motor

    @property
    def driven(self) -> bool:
        """Whether anybody with a motor may drive there."""
        return not MOTOR.keys().isdisjoint(self.motor)


def permission_of(
    tags: Mapping[str, str], *, walkers_on_lanes: bool, direction: str = ""
) -> Permission:
    """Return who may use a way's lanes.

    Args:
        tags: the way's tags.
        walkers_on_lanes: whether people walk on the carriageway because there is no sidewalk.
        direction: ``forward``, ``backward``, or empty for what holds for both.
    """
    # What a class of roads implies counts as much as a word on all vehicles.
    implied = _implied(tags)

    def may(name: str, keys: tuple[str, ...]) -> bool:
        value = _value({**implied, **tags}, keys, direction)
        return name == "bus" if value in FOR_BUSES else value not in CLOSED

    motor = tuple(name for name, keys in MOTOR.items() if may(name, keys))
    others = ("bicycle",) if may("bicycle", RIDING) else ()
    walkers = ("pedestrian",) if walkers_on_lanes and may("pedestrian", WALKING) else ()
    return Permission((*motor, *others, *walkers), ("bus", *others))


def is_driven(tags: Mapping[str, str]) -> bool:
    """Return whether anybody with a motor may drive on a way, in any direction."""
    return any(
        permission_of(tags, walkers_on_lanes=False, direction=direction).driven
        for direction in DIRECTIONS
    )


def is_walked(tags: Mapping[str, str]) -> bool:
    """Return whether people may walk along a way; along a cycleway only where it says so."""
    return _value({**_implied(tags), **tags}, WALKING) not in CLOSED


def _implied(tags: Mapping[str, str]) -> dict[str, str]:
    """Return what a class of roads says without being asked."""
    highway = tags.get("highway", "")
    if highway in FAST_ROADS or tags.get("motorroad") == "yes":
        return {"bicycle": "no", "foot": "no"}
    if highway == "busway":
        return {"motor_vehicle": "no", "bus": "yes"}
    if highway == CYCLE_TRACK:
        return {"motor_vehicle": "no", "bicycle": "designated", "foot": "no"}
    return {"foot": "no"} if highway == "cycleway" else {}


def _value(tags: Mapping[str, str], keys: tuple[str, ...], direction: str = "") -> str:
    """Return what the narrowest of some keys says; ``yes`` where none does."""
    values = (tags.get(f"{key}:{direction}", tags.get(key)) for key in keys)
    return next((value for value in values if value), "yes")


def either_way(tags: Mapping[str, str]) -> dict[str, str]:
    """Return the access keys of a road that those use who may use a way in either direction."""
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
    """Return a way's tags as they are for those who have leave or business there."""
    return {
        key: "yes" if key.split(":")[0] in KEYS and value in OF_SOME else value
        for key, value in tags.items()
    }
