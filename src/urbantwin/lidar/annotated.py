"""Actors and their boxes as the annotators of a data set have them."""

from __future__ import annotations

from collections.abc import Sequence

from urbantwin.lidar.actor_path import PosedActor

__all__ = ["LAST_TRACK", "annotated_actors", "annotated_size", "truck_of_load"]

#: Labels have 16 bits for a track.
LAST_TRACK = 0xFFFF
#: Tracks of loads count down from the last; who drives has tracks up to 30,000.
_FIRST_LOAD = LAST_TRACK - 30_000


def annotated_actors(annotators: str, actors: Sequence[PosedActor]) -> list[PosedActor]:
    """Return actors as a data set's annotators tell them apart.

    TUMTraf's have a truck's cab and its load in a box each (`traffic.assets.truck_parts`); a load
    has the track ``LAST_TRACK`` less that of its truck.

    Args:
        annotators: as ``Rig.boxes``.
        actors: as they drive.
    """
    if annotators != "tumtraf":
        return list(actors)
    from urbantwin.traffic.assets.truck_parts import truck_parts

    found = []
    for one in actors:
        parts = truck_parts(one.asset) if one.actor_class == "truck" else ()
        for part in parts:
            track = one.track if part.actor_class == "truck" else LAST_TRACK - one.track
            found.append(
                one._replace(
                    track=track,
                    actor_class=part.actor_class,
                    asset=part.name,
                    size=part.size,
                    ahead_m=part.ahead_m,
                )
            )
        if not parts:
            found.append(one)
    return found


def annotated_size(
    annotators: str, actor: PosedActor, seed: int
) -> tuple[float, float, float] | None:
    """Return the size of an actor's label, metres; ``None``: that of its mesh.

    Args:
        annotators: as ``Rig.boxes``.
        actor: one of `annotated_actors`.
        seed: of what is drawn.
    """
    if annotators == "track" or actor.size is None:
        return actor.size
    from urbantwin.traffic.assets.annotators import drawn_size

    return drawn_size(annotators, actor.actor_class, actor.size, actor.track, seed)


def truck_of_load(track: int) -> int | None:
    """Return the track of the truck whose load has a track; ``None``: it is no load's."""
    return LAST_TRACK - track if track >= _FIRST_LOAD else None
