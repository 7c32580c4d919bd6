"""What nuScenes calls scenes, attributes and levels of visibility."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import count

__all__ = [
    "ATTRIBUTES",
    "CATEGORIES",
    "VISIBILITIES",
    "attribute_of",
    "scene_names",
    "visibility_of",
]

#: In the order of their indices in nuScenes-lidarseg; boxes have the first 24 but ``noise``.
CATEGORIES = (
    "noise",
    "animal",
    "human.pedestrian.adult",
    "human.pedestrian.child",
    "human.pedestrian.construction_worker",
    "human.pedestrian.personal_mobility",
    "human.pedestrian.police_officer",
    "human.pedestrian.stroller",
    "human.pedestrian.wheelchair",
    "movable_object.barrier",
    "movable_object.debris",
    "movable_object.pushable_pullable",
    "movable_object.trafficcone",
    "static_object.bicycle_rack",
    "vehicle.bicycle",
    "vehicle.bus.bendy",
    "vehicle.bus.rigid",
    "vehicle.car",
    "vehicle.construction",
    "vehicle.emergency.ambulance",
    "vehicle.emergency.police",
    "vehicle.motorcycle",
    "vehicle.trailer",
    "vehicle.truck",
    "flat.driveable_surface",
    "flat.other",
    "flat.sidewalk",
    "flat.terrain",
    "static.manmade",
    "static.other",
    "static.vegetation",
    "vehicle.ego",
)
ATTRIBUTES = (
    "vehicle.moving",
    "vehicle.stopped",
    "vehicle.parked",
    "cycle.with_rider",
    "cycle.without_rider",
    "pedestrian.sitting_lying_down",
    "pedestrian.standing",
    "pedestrian.moving",
)
#: Share of an object that is to be seen, per cent, by the token that the table has.
VISIBILITIES = {"1": "v0-40", "2": "v40-60", "3": "v60-80", "4": "v80-100"}
_BOUNDS = (0.4, 0.6, 0.8)
#: Slower than this, metres per second, somebody stands.
_STANDS_MPS = 0.2

#: Numbers of scenes that the devkit itself counts to each part (``nuscenes/utils/splits.py``):
#: tools that know no other splits then train and validate by ours.
_NUMBERS = {
    "train": ((41, 76), (224, 264), (347, 386), (410, 459), (639, 679)),
    "val": ((92, 110), (552, 565), (904, 917), (919, 931), (1059, 1073)),
    "test": ((77, 91), (481, 498), (606, 624), (1026, 1043)),
}


def scene_names(parts: Sequence[str | None]) -> list[str]:
    """Return the names of scenes of parts of the split, in their order.

    Those of ``train``, ``val`` and ``test`` have names that the devkit counts to these parts as
    long as it has some; all others have names that are in none of its parts.
    """
    known = {
        part: (f"scene-{number:04d}" for first, last in spans for number in range(first, last + 1))
        for part, spans in _NUMBERS.items()
    }
    others = (f"scene-urbantwin-{number:04d}" for number in count())
    return [next(known.get(part or "", iter(())), None) or next(others) for part in parts]


def visibility_of(occlusion: float) -> str:
    """Return the token of a level of visibility; who cannot be seen at all has the lowest."""
    seen = 0.0 if math.isnan(occlusion) else 1 - occlusion
    return str(1 + sum(seen > bound for bound in _BOUNDS))


def attribute_of(category: str, speed_mps: float, parked: bool) -> str | None:
    """Return the one attribute of an object; ``None`` for categories that have none."""
    moves = speed_mps > _STANDS_MPS
    if category in ("vehicle.bicycle", "vehicle.motorcycle"):
        return "cycle.without_rider" if parked else "cycle.with_rider"
    if category.startswith("vehicle."):
        return "vehicle.parked" if parked else "vehicle.moving" if moves else "vehicle.stopped"
    if category.startswith("human.pedestrian."):
        return "pedestrian.moving" if moves else "pedestrian.standing"
    return None
