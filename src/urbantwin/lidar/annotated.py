"""Actors and box sizes by the annotation rules of a real dataset."""

from __future__ import annotations

from collections.abc import Sequence

from urbantwin.lidar.actor_path import PosedActor

__all__ = ["LAST_TRACK", "annotated_actors", "annotated_size", "truck_of_load"]

#: Highest track id: labels store it in 16 bits.
LAST_TRACK = 0xFFFF
#: A truck's load has the id LAST_TRACK less the truck's; vehicles have ids up to 30,000.
_FIRST_LOAD = LAST_TRACK - 30_000


def annotated_actors(annotators: str, actors: Sequence[PosedActor]) -> list[PosedActor]:
    """Split actors into the objects that a dataset's annotators draw a box around.

    TUMTraf annotates a truck's cab and its load separately (`traffic.assets.truck_parts`); the load
    has the track id ``LAST_TRACK`` less that of its truck.

    Args:
        annotators: as ``Rig.boxes``.
        actors: actors of the motion.
    """
    if annotators != "tumtraf":
        return list(actors)
    from urbantwin.traffic.assets.truck_parts import truck_parts

    objects = []
    for actor in actors:
        parts = truck_parts(actor.asset) if actor.actor_class == "truck" else ()
        for part in parts:
            track = actor.track if part.actor_class == "truck" else LAST_TRACK - actor.track
            objects.append(
                actor._replace(
                    track=track,
                    actor_class=part.actor_class,
                    asset=part.name,
                    size=part.size,
                    ahead_m=part.ahead_m,
                )
            )
        if not parts:
            objects.append(actor)
    return objects


def annotated_size(
    annotators: str, actor: PosedActor, seed: int
) -> tuple[float, float, float] | None:
    """Return the size of an actor's label, metres; ``None``: the bounds of its mesh.

    Args:
        annotators: as ``Rig.boxes``.
        actor: an element of `annotated_actors`.
        seed: seed of the drawn sizes.
    """
    if annotators == "track" or actor.size is None:
        return actor.size
    from urbantwin.traffic.assets.annotators import drawn_size

    return drawn_size(annotators, actor.actor_class, actor.size, actor.track, seed)


def truck_of_load(track: int) -> int | None:
    """Return the track id of the truck that carries a load; ``None`` if the id is no load's."""
    return LAST_TRACK - track if track >= _FIRST_LOAD else None
