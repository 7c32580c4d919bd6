"""Posts of roofs without walls: carports, canopies, petrol stations."""

from __future__ import annotations

import numpy as np
import shapely
from shapely import Geometry

from urbantwin.scene.body import Body
from urbantwin.scene.solids import Solid, box

__all__ = ["canopy_posts"]

POST_M = 0.25
INSET_M = 0.4
SPACING_M = 8.0


def canopy_posts(
    slab: Body, carriageway: Geometry, datum: float, foundation_m: float
) -> list[Solid]:
    """Return the posts that carry a slab, none of them on a carriageway.

    Args:
        slab: the roof, heights above ``datum``.
        carriageway: where no post may stand, site frame.
        datum: the building's lowest ground, metres.
        foundation_m: how far posts reach below it.
    """
    inner = slab.footprint.buffer(-INSET_M).simplify(0.3)
    if inner.is_empty:
        spots = shapely.get_coordinates(slab.footprint.representative_point())
    else:
        rings = shapely.get_rings(shapely.get_parts(inner))
        spaced = shapely.segmentize(rings, SPACING_M)
        spots = np.concatenate([shapely.get_coordinates(ring)[:-1] for ring in spaced])

    if not carriageway.is_empty:
        spots = spots[shapely.distance(carriageway, shapely.points(spots)) > POST_M]
    if not len(spots):
        return []
    low, high = datum - foundation_m, datum + slab.low + 0.05
    centre = np.column_stack([spots, np.full(len(spots), (low + high) / 2)])
    size = np.broadcast_to([POST_M, POST_M, high - low], centre.shape)
    return [box(centre, size)]
