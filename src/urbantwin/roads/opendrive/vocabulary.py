"""Terms of OpenDRIVE and of the lane model: kinds of lanes, classes of actors, units."""

from __future__ import annotations

from urbantwin.taxonomy import ROAD_USERS

__all__ = [
    "ACCESS",
    "DRIVEN",
    "KIND_OF_TYPE",
    "LANE_TYPES",
    "METRES_PER_SECOND",
    "ROAD_TYPES",
    "usual_users",
]

#: Kinds of lanes with traffic.
DRIVEN = ("driving", "bus", "bicycle")
_TYPES = {
    "driving": "driving",
    "bus": "bus",
    "bicycle": "biking",
    "parking": "parking",
    "shoulder": "shoulder",
    "sidewalk": "sidewalk",
    "curb": "curb",
    "median": "median",
    # OpenDRIVE has no islands; a median is also raised between lanes.
    "island": "median",
    "none": "none",
}
#: Kind of lane -> type by version. 1.4H has neither bus lanes nor curbs: its border is the hard
#: edge of the carriageway. Kinds without a type of their own are written as ``userData``.
LANE_TYPES = {"1.8": _TYPES, "1.4": {**_TYPES, "bus": "driving", "curb": "border"}}
#: Type of lane in any version (1.1 to 1.8) -> kind; ``none`` for lanes without road vehicles.
KIND_OF_TYPE = {
    **{kind: kind for kind in ("driving", "bus", "parking", "shoulder", "sidewalk", "curb")},
    **{kind: kind for kind in ("median", "none")},
    **dict.fromkeys(
        (
            *("entry", "exit", "onRamp", "offRamp", "connectingRamp", "mwyEntry", "mwyExit"),
            *("slipLane", "bidirectional", "shared", "taxi", "HOV"),
        ),
        "driving",
    ),
    "biking": "bicycle",
    "walking": "sidewalk",
    **dict.fromkeys(("stop", "border", "restricted", "roadWorks"), "shoulder"),
    **dict.fromkeys(("tram", "rail", "special1", "special2", "special3"), "none"),
}
#: Class of street as in OpenStreetMap -> type of road; all others are ``town``.
ROAD_TYPES = {
    "": "unknown",
    "motorway": "motorway",
    "motorway_link": "motorway",
    "living_street": "lowSpeed",
    "pedestrian": "pedestrian",
    "footway": "pedestrian",
    "cycleway": "bicycle",
}
#: Class of actors -> its name in ``<access>``.
ACCESS = {
    "car": "passengerCar",
    "truck": "truck",
    "bus": "bus",
    "motorcycle": "motorcycle",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
}
#: Unit of speed -> m/s. Files before 1.4 give none and use m/s.
METRES_PER_SECOND = {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704, "": 1.0}


def usual_users(kind: str) -> tuple[str, ...]:
    """Return the classes of actors that use a kind of lane by default."""
    if kind == "driving":
        return tuple(name for name in ROAD_USERS if name != "pedestrian")
    return {"bus": ("bus",), "bicycle": ("bicycle",), "sidewalk": ("pedestrian",)}.get(kind, ())
