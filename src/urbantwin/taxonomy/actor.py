"""Classes of actors (what boxes are labelled with) and the semantic class of their points."""

from __future__ import annotations

from typing import Literal

__all__ = ["ACTOR_CLASSES", "ACTOR_SEMANTICS", "BOX_SEMANTICS", "COMPANIONS", "OBSTACLE"]
__all__ += ["ROAD_USERS", "BoxKind", "road_user"]

#: How large the boxes of labels are: one true size for a whole track, the bounds of the mesh at its
#: moment, or one size for a whole track as the annotators of a data set draw it.
BoxKind = Literal["track", "tight", "kitti", "tumtraf"]

#: Class of a box -> semantic class of its points. A two-wheeler includes its rider, as in
#: SemanticKITTI, where the vehicle counts as part of the bicyclist or motorcyclist, and where
#: vans are cars and trailers are trucks. A class keeps its place for good: random numbers are drawn
#: by it.
ACTOR_SEMANTICS: dict[str, str] = {
    "car": "car",
    "truck": "truck",
    "bus": "bus",
    "motorcycle": "motorcyclist",
    "bicycle": "bicyclist",
    "pedestrian": "pedestrian",
    "van": "car",
    "tram": "on-rails",
    "trailer": "truck",
    "animal": "other-object",
}

ACTOR_CLASSES: tuple[str, ...] = tuple(ACTOR_SEMANTICS)

#: Static object on a street: a cone, a barrier, a lost load. It is not part of the demand, but has
#: a box.
OBSTACLE = "obstacle"

#: The same as ``ACTOR_SEMANTICS`` for every class that boxes are labelled with.
BOX_SEMANTICS: dict[str, str] = {**ACTOR_SEMANTICS, OBSTACLE: "other-object"}

#: Classes that accompany others: they have no demand of their own.
COMPANIONS: tuple[str, ...] = ("trailer", "animal")

#: The classes that rules of access to lanes tell apart. Vans go where cars go.
ROAD_USERS: tuple[str, ...] = ("car", "truck", "bus", "motorcycle", "bicycle", "pedestrian")


def road_user(actor_class: str) -> str:
    """Return the class by which rules of access to lanes know a class of actors."""
    return actor_class if actor_class in ROAD_USERS else "car"
