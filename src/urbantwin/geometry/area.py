"""Robust set operations on areas in plan, which return only areas.

Many borders of lanes, junctions and footprints nearly coincide. Exact floating-point set operations
sometimes fail on them (GEOS: "side location conflict"); snapped to a grid of a millimetre they do
not.
"""

from __future__ import annotations

from collections.abc import Iterable

import shapely

__all__ = [
    "area_difference",
    "area_intersection",
    "area_union",
    "areas_of",
    "closed",
    "grown",
    "opened",
]

#: The grid that borders are snapped to, metres.
SNAP_M = 1e-3
#: Specks smaller than this, square metres, are left out.
SPECK_M2 = 0.01


def areas_of(shape: shapely.Geometry) -> shapely.MultiPolygon:
    """Return the polygons of any geometry, repaired, without lines, points and specks."""
    if not shapely.is_valid(shape):
        shape = shapely.make_valid(shape)
    parts = shapely.get_parts(shapely.get_parts(shape))
    kept = [p for p in parts if p.geom_type == "Polygon" and p.area > SPECK_M2]
    return shapely.multipolygons(kept) if kept else shapely.MultiPolygon()


def area_union(shapes: Iterable[shapely.Geometry]) -> shapely.MultiPolygon:
    """Return the union of areas."""
    return areas_of(shapely.union_all([areas_of(shape) for shape in shapes], grid_size=SNAP_M))


def area_intersection(shape: shapely.Geometry, other: shapely.Geometry) -> shapely.MultiPolygon:
    """Return the intersection of two areas."""
    both = shapely.intersection(areas_of(shape), areas_of(other), grid_size=SNAP_M)
    return areas_of(both)


def area_difference(shape: shapely.Geometry, other: shapely.Geometry) -> shapely.MultiPolygon:
    """Return the first area without the other."""
    rest = shapely.difference(areas_of(shape), areas_of(other), grid_size=SNAP_M)
    return areas_of(rest)


def grown(shape: shapely.Geometry, distance: float) -> shapely.MultiPolygon:
    """Return an area grown (or, with a negative distance, shrunk) by metres, with sharp corners."""
    return areas_of(shapely.buffer(areas_of(shape), distance, join_style="mitre", mitre_limit=2))


def closed(shape: shapely.Geometry, width: float) -> shapely.MultiPolygon:
    """Return an area with its slits and notches filled that are narrower than ``width`` metres."""
    return area_union([shape, grown(grown(shape, width / 2), -width / 2)])


def opened(shape: shapely.Geometry, width: float) -> shapely.MultiPolygon:
    """Return an area without its parts that are narrower than ``width`` metres."""
    return area_intersection(shape, grown(grown(shape, -width / 2), width / 2))
