"""Which classes of actors a detector tells apart, and which of them it takes together.

Training, detecting, tracking and judging use this one table. Data sets disagree on where a car
ends and a van begins (nuScenes and Argoverse 2 have no vans), and annotators draw a truck's cab and
its load apart (TUMTraf) or together: what one box is called in one place and another elsewhere is
one class here.
"""

from __future__ import annotations

__all__ = ["DETECTED_CLASSES", "LARGE", "MEMBERS", "detected_class"]

#: A detector's class -> the classes of actors (``taxonomy.ACTOR_CLASSES``) that it stands for.
MEMBERS: dict[str, tuple[str, ...]] = {
    "car": ("car", "van"),
    "truck": ("truck", "trailer"),
    "bus": ("bus",),
    "motorcycle": ("motorcycle",),
    "bicycle": ("bicycle",),
    "pedestrian": ("pedestrian",),
}

#: What detectors tell apart, in the order of their heads, tables and pictures.
DETECTED_CLASSES: tuple[str, ...] = tuple(MEMBERS)

#: Classes of actors that reports also count together: there are few of each on a street.
LARGE: tuple[str, ...] = ("truck", "bus", "trailer", "tram")

_CLASS_OF = {actor: name for name, members in MEMBERS.items() for actor in members}


def detected_class(actor_class: str) -> str | None:
    """Return a detector's class for a class of actors; None where detectors have none for it.

    Args:
        actor_class: one of ``taxonomy.ACTOR_CLASSES``, or ``obstacle`` or ``other``.
    """
    return _CLASS_OF.get(actor_class)
