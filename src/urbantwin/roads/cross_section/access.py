"""Access: which classes of actors may use the lanes of a road."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

__all__ = ["Permission", "permission_of"]

#: Classes of roads for motor traffic only.
FAST_ROADS = frozenset({"motorway", "motorway_link", "trunk", "trunk_link"})
BARRED = frozenset({"no", "use_sidepath"})
OPEN = frozenset({"yes", "designated", "official", "permissive"})


@dataclass(frozen=True)
class Permission:
    """Classes of actors on a road's lanes.

    Attributes:
        motor: on lanes of general traffic.
        bus_lane: on lanes for buses.
    """

    motor: tuple[str, ...]
    bus_lane: tuple[str, ...]

    @property
    def cars(self) -> bool:
        """Whether cars may drive there."""
        return "car" in self.motor


def permission_of(tags: Mapping[str, str], *, walkers_on_lanes: bool) -> Permission:
    """Return who may use a way's lanes (OSM wiki, "Key:access").

    Args:
        tags: the way's tags.
        walkers_on_lanes: whether people walk on the carriageway because there is no sidewalk.
    """
    highway = tags.get("highway", "")
    motorroad = highway in FAST_ROADS or tags.get("motorroad") == "yes"
    bicycle = tags.get("bicycle", "no" if motorroad else "yes") not in BARRED
    foot = tags.get("foot", "no" if motorroad else "yes") not in BARRED
    access = next(
        (tags[key] for key in ("motor_vehicle", "vehicle", "access") if key in tags), "yes"
    )
    bus = access != "no" or not {tags.get("bus"), tags.get("psv")}.isdisjoint(OPEN)
    motor: list[str] = []
    if access != "no" and highway != "busway":
        motor = ["car"]
        motor += ["truck"] if tags.get("hgv") != "no" else []
    if bus or highway == "busway":
        motor.append("bus")
    if access != "no" and highway != "busway" and tags.get("motorcycle") != "no":
        motor.append("motorcycle")
    others = ["bicycle"] if bicycle else []
    walkers = ["pedestrian"] if walkers_on_lanes and foot else []
    # Where not even buses may drive, the road is left open: it would fall out of the network.
    motor = motor or ["car", "truck", "bus", "motorcycle"]
    return Permission((*motor, *others, *walkers), ("bus", *others))
