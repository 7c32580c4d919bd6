"""Piers and jetties over water."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
import shapely
from shapely import Geometry, LineString, Polygon

from urbantwin.geometry import LabelledMesh
from urbantwin.scene.placement import not_imported, on_ground
from urbantwin.scene.slab import plain_polygons, slab
from urbantwin.scene.solids import Assembly, GroundHeight, columns
from urbantwin.scene.tag_values import length_m_of
from urbantwin.site.extract import OsmFeature

__all__ = ["pier_mesh"]

WIDTH_M, THICK_M, ABOVE_M = 2.0, 0.3, 0.9
POST_STEP_M, POST_M, DEEP_M = 5.0, 0.12, 1.5
INSET_M = 0.3


def pier_mesh(
    features: Sequence[OsmFeature],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
    without: Geometry | None = None,
) -> tuple[LabelledMesh, dict[str, int]]:
    """Build piers: a level deck 0.9 m above the water on posts.

    Args:
        features: the map's features, site frame.
        region: piers are cut at its border.
        ground_height: heights of the ground and the water.
        carriageway: area without piers.
        without: area in which imported geometry contains the piers.

    Returns:
        The mesh, ``part`` 1, 2, ... per pier, and counts of objects built.
    """
    notes: Counter[str] = Counter()
    assembly = Assembly()
    mine = [f for f in features if f.tags.get("man_made") in ("pier", "jetty")]
    for feature in not_imported(mine, without):
        shape = feature.geometry
        if feature.tags.get("layer", "0").startswith("-"):
            continue
        if isinstance(shape, LineString):
            width = min(length_m_of(feature.tags.get("width")) or WIDTH_M, 20.0)
            shape = shape.buffer(width / 2, cap_style="flat", join_style="mitre")
        if not shape.geom_type.endswith("Polygon"):
            continue
        area = shapely.intersection(shapely.difference(shape, carriageway), region)
        part = 0
        for deck in plain_polygons(area.simplify(0.05), smallest_m2=1.0):
            part = part or assembly.new_part()
            corners = shapely.get_coordinates(shapely.segmentize(deck.exterior, POST_STEP_M))[:-1]
            low = on_ground(corners, ground_height(corners))[:, 2]
            top = float(low.min()) + ABOVE_M
            body = slab(deck, top - THICK_M, top)
            assembly.add(body, "other-structure", "wood", part)
            inner = deck.buffer(-INSET_M)
            ring = inner.exterior if isinstance(inner, Polygon) and not inner.is_empty else None
            if ring is None:
                continue
            spots = shapely.get_coordinates(shapely.segmentize(ring.simplify(0.2), POST_STEP_M))[
                :-1
            ]
            feet = np.column_stack([spots, np.full(len(spots), float(low.min()) - DEEP_M)])
            posts = columns(feet, ABOVE_M + DEEP_M - THICK_M + 0.02, POST_M, POST_M, 6)
            assembly.add(posts, "other-structure", "wood", part)
        notes["piers"] += bool(part)
    return assembly.mesh(), dict(sorted((k, n) for k, n in notes.items() if n))
