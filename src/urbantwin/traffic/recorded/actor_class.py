"""Classes of actors by the names that recordings give them."""

from __future__ import annotations

from urbantwin.taxonomy import ACTOR_CLASSES

__all__ = ["IGNORED", "class_of"]

#: What a description maps a class to that is to be left out.
IGNORED = "ignore"

#: Words in the names of classes (KITTI, nuScenes, OpenLABEL and ASAM OpenX, inD and its sisters,
#: TUMTraf, SUMO) -> our classes, the first that is there. More special words stand first.
_WORDS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("dontcare", (IGNORED,)),
    ("misc", (IGNORED,)),
    ("animal", ("animal", IGNORED)),
    ("barrier", (IGNORED,)),
    ("cone", (IGNORED,)),
    ("obstacle", (IGNORED,)),
    ("debris", (IGNORED,)),
    ("pushable", (IGNORED,)),
    ("rack", (IGNORED,)),
    ("motorcycl", ("motorcycle",)),
    ("motorbike", ("motorcycle",)),
    ("moped", ("motorcycle",)),
    ("bicycl", ("bicycle",)),
    ("cyclist", ("bicycle",)),
    ("bike", ("bicycle",)),
    ("pedestrian", ("pedestrian",)),
    ("person", ("pedestrian",)),
    ("walker", ("pedestrian",)),
    ("tram", ("tram", IGNORED)),
    ("train", ("tram", IGNORED)),
    ("bus", ("bus",)),
    ("trailer", ("trailer", "truck")),
    ("truck", ("truck",)),
    ("lorry", ("truck",)),
    ("van", ("van", "car")),
    ("passenger", ("car",)),
    ("car", ("car",)),
)


def class_of(name: str) -> str | None:
    """Return our class of a recording's, ``ignore`` for what is no actor, ``None`` if unknown."""
    plain = name.lower().replace(" ", "").replace("_", "").replace("-", "")
    if plain in ACTOR_CLASSES:
        return plain
    for word, classes in _WORDS:
        if word in plain:
            return next((one for one in classes if one in (*ACTOR_CLASSES, IGNORED)), IGNORED)
    return None
