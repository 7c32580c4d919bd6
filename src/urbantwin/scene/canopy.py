"""Posts of roofs without walls (carports, canopies, petrol stations) and columns of arcades."""

from __future__ import annotations

import numpy as np
import shapely
from shapely import Geometry, LineString, Polygon

from urbantwin.scene.extrusion import Body
from urbantwin.scene.solids import Solid, box

__all__ = ["arcade_columns", "canopy_posts"]

POST_M = 0.25
INSET_M = 0.4
SPACING_M = 8.0
#: Columns of arcades: side, distance, and how far they stand within the outline, metres.
COLUMN_M, BAY_M, EDGE_M = 0.45, 4.0, 0.3
#: Shorter openings than this, metres, are an arcade's ends.
OPEN_SIDE_M = 6.0


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


def arcade_columns(plan: Geometry, corridor: Polygon, low: float, high: float) -> list[Solid]:
    """Return the columns along the open side of an arcade.

    Args:
        plan: the building's footprint.
        corridor: the ground that the arcade takes.
        low: height of the columns' feet, metres.
        high: height of the ceiling.
    """
    inside = shapely.buffer(plan, -EDGE_M, join_style="mitre")
    sides = shapely.line_merge(shapely.intersection(inside.boundary, corridor.buffer(EDGE_M)))
    spots = [
        shapely.get_coordinates(shapely.segmentize(side, BAY_M))
        for side in shapely.get_parts(sides)
        if isinstance(side, LineString) and side.length >= OPEN_SIDE_M
    ]
    if not spots or high <= low:
        return []
    xy = np.concatenate(spots)
    centre = np.column_stack([xy, np.full(len(xy), (low + high) / 2)])
    return [box(centre, np.broadcast_to([COLUMN_M, COLUMN_M, high - low], centre.shape))]
