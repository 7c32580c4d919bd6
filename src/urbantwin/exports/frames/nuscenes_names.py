"""nuScenes' names of scenes, categories, attributes and visibility levels."""

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

#: In the order of their indices in nuScenes-lidarseg; boxes have the first 24 except ``noise``.
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
#: Visible fraction of an object, percent, by the token in the table.
VISIBILITIES = {"1": "v0-40", "2": "v40-60", "3": "v60-80", "4": "v80-100"}
_BOUNDS = (0.4, 0.6, 0.8)
#: Speed below which an object counts as stopped, metres per second.
_STANDS_MPS = 0.2

#: Scene numbers of each part in the devkit (``nuscenes/utils/splits.py``), so that tools without
#: other splits use ours.
_NUMBERS = {
    "train": ((41, 76), (224, 264), (347, 386), (410, 459), (639, 679)),
    "val": ((92, 110), (552, 565), (904, 917), (919, 931), (1059, 1073)),
    "test": ((77, 91), (481, 498), (606, 624), (1026, 1043)),
}


def scene_names(parts: Sequence[str | None]) -> list[str]:
    """Return names for scenes, given their parts of the split.

    Scenes of ``train``, ``val`` and ``test`` get names of these parts in the devkit while
    available; all others get names that are in none of its parts.
    """
    known = {
        part: (f"scene-{number:04d}" for first, last in spans for number in range(first, last + 1))
        for part, spans in _NUMBERS.items()
    }
    others = (f"scene-urbantwin-{number:04d}" for number in count())
    return [next(known.get(part or "", iter(())), None) or next(others) for part in parts]


def visibility_of(occlusion: float) -> str:
    """Return the token of a visibility level; invisible objects get the lowest."""
    seen = 0.0 if math.isnan(occlusion) else 1 - occlusion
    return str(1 + sum(seen > bound for bound in _BOUNDS))


def attribute_of(category: str, speed_mps: float, parked: bool) -> str | None:
    """Return the single attribute of an object; ``None`` for categories without one."""
    moves = speed_mps > _STANDS_MPS
    if category in ("vehicle.bicycle", "vehicle.motorcycle"):
        return "cycle.without_rider" if parked else "cycle.with_rider"
    if category.startswith("vehicle."):
        return "vehicle.parked" if parked else "vehicle.moving" if moves else "vehicle.stopped"
    if category.startswith("human.pedestrian."):
        return "pedestrian.moving" if moves else "pedestrian.standing"
    return None
