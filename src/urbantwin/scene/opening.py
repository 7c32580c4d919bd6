"""Openings in buildings, where passages and carriageways run through them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from shapely import Geometry

from urbantwin.scene.extrusion import Body, clean_polygons

__all__ = ["Opening", "open_bodies"]

#: A body whose underside is lower than this above its building's ground stands on the ground.
RAISED_M = 2.0


@dataclass(frozen=True)
class Opening:
    """What is taken out of a building: a footprint, from the ground up to a ceiling, metres.

    Attributes:
        footprint: where.
        ceiling: for bodies that stand on the ground; infinite where nothing may stay above.
        raised_ceiling: for bodies that are raised; 0 leaves them as they are.
    """

    footprint: Geometry
    ceiling: float
    raised_ceiling: float


def open_bodies(bodies: Sequence[Body], openings: Sequence[Opening]) -> list[Body]:
    """Return bodies with openings taken out: nothing solid remains below an opening's ceiling."""
    for opening in openings:
        opened: list[Body] = []
        for body in bodies:
            raised = body.low >= RAISED_M
            ceiling = opening.raised_ceiling if raised else opening.ceiling
            if body.low >= ceiling or not body.footprint.intersects(opening.footprint):
                opened.append(body)
                continue
            beside = body.footprint.difference(opening.footprint)
            opened += [replace(body, footprint=piece) for piece in clean_polygons(beside)]
            if max(body.eaves, body.low) - ceiling > 0.3 or (
                not body.roof and body.high - ceiling > 0.3
            ):
                above = body.footprint.intersection(opening.footprint)
                opened += [
                    replace(body, footprint=piece, low=ceiling)
                    for piece in clean_polygons(above, smallest_m2=0.0, thinnest_m=0.0)
                ]
        bodies = opened
    return list(bodies)
