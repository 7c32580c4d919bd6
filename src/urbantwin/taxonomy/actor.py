"""Classes of actors (what boxes are labelled with) and the semantic class of their points."""

from __future__ import annotations

__all__ = ["ACTOR_CLASSES", "ACTOR_SEMANTICS"]

#: Class of a box -> semantic class of its points. A two-wheeler includes its rider, as in
#: SemanticKITTI, where the vehicle counts as part of the bicyclist or motorcyclist.
ACTOR_SEMANTICS: dict[str, str] = {
    "car": "car",
    "truck": "truck",
    "bus": "bus",
    "motorcycle": "motorcyclist",
    "bicycle": "bicyclist",
    "pedestrian": "pedestrian",
    "tram": "on-rails",
}

ACTOR_CLASSES: tuple[str, ...] = tuple(ACTOR_SEMANTICS)
