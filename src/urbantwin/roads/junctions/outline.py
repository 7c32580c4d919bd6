"""The paved area of a junction of many nodes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import area_difference, area_union

__all__ = ["outline_of"]

#: Radius of curves at corners, metres (AASHTO Green Book, 9.6: 3 to 8 m in towns).
CORNER_M = 5.0
#: Half the width of what joins parts of a junction between which nobody drives, metres.
BRIDGE_M = 1.5


def outline_of(
    swept: Sequence[shapely.Geometry],
    mouths: Sequence[NDArray[np.float64]],
    outside: Sequence[shapely.Geometry],
    ends: Sequence[shapely.Geometry] = (),
) -> NDArray[np.float64]:
    """Return the outline (M, 2) of a junction.

    Args:
        swept: what its traffic drives over.
        mouths: the ends (2, 2) of the line across each arm where it ends.
        outside: the arms beyond their mouths, which are no part of it.
        ends: what arms have within it: theirs, also where another arm runs beyond its mouth.
    """
    lines = [shapely.LineString(mouth).buffer(0.3, cap_style="flat") for mouth in mouths]
    whole = _connected(area_union([*swept, *lines]))
    closed = whole.buffer(CORNER_M, quad_segs=8).buffer(-CORNER_M, quad_segs=8)
    closed = area_union([closed, whole])
    # Where streets lie nearer than they are wide, others' arms cover all of it.
    outer = area_difference(closed, area_union(list(outside)))
    closed = whole if outer.is_empty else outer
    closed = max(shapely.get_parts(closed), key=lambda part: float(part.area))
    closed = _connected(area_union([closed, *ends]))
    closed = max(shapely.get_parts(closed), key=lambda part: float(part.area))
    ring = shapely.simplify(closed.exterior, 0.1)
    return np.asarray(shapely.get_coordinates(shapely.orient_polygons(shapely.Polygon(ring)))[:-1])


def _connected(area: shapely.Geometry) -> shapely.Geometry:
    """Return an area whose parts are joined where they are nearest: an arm may have no way in."""
    while len(parts := sorted(shapely.get_parts(area), key=lambda part: -part.area)) > 1:
        rest = shapely.union_all(parts[1:])
        bridge = shapely.shortest_line(parts[0], rest).buffer(BRIDGE_M)
        area = area_union([area, bridge])
    return area
