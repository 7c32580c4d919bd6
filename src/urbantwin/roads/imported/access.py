"""Access and speed limits of lanes: the map's, else the usual ones."""

from __future__ import annotations

from urbantwin.roads.model import SectionLane

__all__ = ["VEHICLE_CLASSES", "allowed", "speed"]

#: SUMO's vehicle classes of each of our classes of actors, with those that drive where it does.
VEHICLE_CLASSES = {
    "car": "passenger private emergency authority army vip hov taxi custom1 custom2 evehicle",
    "truck": "truck trailer delivery",
    "bus": "bus coach",
    "motorcycle": "motorcycle moped",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
}
#: Who uses a lane where the map does not say, by the lane's kind.
USUAL = {
    "driving": ("car", "truck", "bus", "motorcycle", "bicycle"),
    "bus": ("bus", "bicycle"),
    "bicycle": ("bicycle",),
    "sidewalk": ("pedestrian",),
}
#: Where the map states no speed limit: the usual one in towns, and of bicycles, m/s.
TOWN_MS, BICYCLE_MS, WALKING_MS = 50 / 3.6, 25 / 3.6, 1.39
#: Largest speed limit of streets with bicycles on the carriageway, m/s.
FAST_MS = 75 / 3.6


def allowed(lane: SectionLane) -> tuple[str, ...]:
    """Return the classes of actors that use a lane: as the map says, else as usual."""
    if lane.allowed:
        return lane.allowed
    usual = USUAL.get(lane.kind, ())
    return tuple(x for x in usual if x != "bicycle" or lane.speed_limit <= FAST_MS)


def speed(lane: SectionLane) -> float:
    """Return a lane's speed limit: as the map says, else as usual."""
    usual = {"sidewalk": WALKING_MS, "bicycle": BICYCLE_MS}.get(lane.kind, TOWN_MS)
    return lane.speed_limit or usual
