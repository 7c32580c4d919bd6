"""Classes that detectors distinguish, and the actor classes that each of them covers.

Training, detection, tracking and evaluation use this one table. Datasets disagree on the border
between car and van (nuScenes and Argoverse 2 have no vans), and annotators draw a truck's cab and
load separately (TUMTraf) or together: such classes are merged here.
"""

from __future__ import annotations

__all__ = ["DETECTED_CLASSES", "LARGE", "MEMBERS", "detected_class"]

#: Detector class -> the classes of ``taxonomy.ACTOR_CLASSES`` that it covers.
MEMBERS: dict[str, tuple[str, ...]] = {
    "car": ("car", "van"),
    "truck": ("truck", "trailer"),
    "bus": ("bus",),
    "motorcycle": ("motorcycle",),
    "bicycle": ("bicycle",),
    "pedestrian": ("pedestrian",),
}

#: Detector classes in the order of network heads, tables and pictures.
DETECTED_CLASSES: tuple[str, ...] = tuple(MEMBERS)

#: Actor classes that reports also count together: each is rare on a street.
LARGE: tuple[str, ...] = ("truck", "bus", "trailer", "tram")

_CLASS_OF = {actor: name for name, members in MEMBERS.items() for actor in members}


def detected_class(actor_class: str) -> str | None:
    """Return the detector class of an actor class; None if there is none.

    Args:
        actor_class: one of ``taxonomy.ACTOR_CLASSES``, or ``obstacle`` or ``other``.
    """
    return _CLASS_OF.get(actor_class)
