"""Building a roof's facets from its shape and its footprint."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

import numpy as np
import shapely
from shapely import Polygon

from urbantwin.scene.roof.facet import Facet, profiled
from urbantwin.scene.roof.radial import apex_of, radial
from urbantwin.scene.roof.ridge import Axes, Profile, axes_of, half_hipped, ridged
from urbantwin.scene.roof.skeleton import MOST_EDGES, gable_ends, skeleton_facets
from urbantwin.scene.roof.tags import roof_yaw

__all__ = ["roof_facets", "roof_span"]

GABLE: Profile = ((0.0, 0.0), (0.5, 1.0), (1.0, 0.0))
LEVEL: Profile = ((0.0, 0.0), (1.0, 1.0))
#: Steep below, gentle above: share of the way in, share of the height.
TWO_PITCHES: Profile = ((0.0, 0.0), (0.35, 0.65), (1.0, 1.0))
#: Arcs are drawn with this many straight pieces on each side.
ARC = 6
#: Footprints that fill less of their tightest rectangle than this are wings, not one block.
BLOCK = 0.8
#: Domes over outlines with more corners are simplified.
MOST_CORNERS = 73
SKELETAL = ("hipped", "mansard", "side_hipped")
RADIAL = ("pyramidal", "cone", "dome", "onion")
RIDGED = ("gabled", "half-hipped", "gambrel", "round")


def roof_span(shape: str, footprint: Polygon, tags: Mapping[str, str]) -> float:
    """Return the width that a roof spans, metres: across its ridge, or twice the way to its top."""
    if _has_wings(footprint) and shape in (*SKELETAL, *RIDGED, *RADIAL):
        return 2 * float(shapely.maximum_inscribed_circle(footprint, 0.25).length)
    if shape in (*SKELETAL, *RADIAL):
        return _narrow(footprint)
    return axes_of(footprint, roof_yaw(tags, footprint)[0]).span


def roof_facets(
    shape: str, footprint: Polygon, tags: Mapping[str, str], rise_m: float, notes: Counter[str]
) -> list[Facet]:
    """Return a roof's facets, heights in metres above the eaves, the highest at ``rise_m``.

    Footprints with wings or courtyards get the roof over their straight skeleton; where the
    asked shape cannot be built, a hipped or a gabled one is, and a note is counted.

    Args:
        shape: one of ``SHAPES``.
        footprint: site frame.
        tags: for direction and orientation.
        rise_m: height of the roof.
        notes: counter of assumptions.

    Returns:
        Facets that cover the footprint; none for a flat roof.
    """
    if shape == "flat" or rise_m < 0.05:
        return []
    try:
        unit = _unit_facets(shape, footprint, tags, rise_m, notes)
    except shapely.GEOSException:  # an outline that cannot be cut
        notes[f"{shape} roof built level over a difficult outline"] += 1
        return []
    return [facet.placed(rise_m, 0.0) for facet in unit]


def _unit_facets(
    shape: str, footprint: Polygon, tags: Mapping[str, str], rise_m: float, notes: Counter[str]
) -> list[Facet]:
    if shape in RADIAL:
        outline = _with_fewer_corners(footprint)
        apex = apex_of(outline)
        if apex is not None:
            profile = {"dome": _arc(_narrow(footprint) / 2, rise_m), "onion": _onion()}
            return radial(outline, apex, profile.get(shape, LEVEL))
        notes[f"{shape} roof over wings or a courtyard built as hipped"] += 1
        shape = "hipped"
    yaw, mapped = roof_yaw(tags, footprint)
    if shape in ("skillion", "butterfly", "saltbox") and not mapped:
        notes[f"direction of a {shape} roof assumed"] += 1
    winged = _has_wings(footprint) and not (mapped and not footprint.interiors)
    if shape in SKELETAL or (winged and shape in RIDGED):
        facets = _skeletal(shape, footprint)
        if facets:
            bend = {"mansard": TWO_PITCHES, "gambrel": TWO_PITCHES}
            if shape == "round":
                bend["round"] = _arc(_narrow(footprint) / 2, rise_m)
            return profiled(facets, bend.get(shape, LEVEL))
        notes[f"{shape} roof built with one ridge over a difficult outline"] += 1
        shape = "gabled"
    return _along_ridge(shape, footprint, axes_of(footprint, yaw), rise_m)


def _along_ridge(shape: str, footprint: Polygon, axes: Axes, rise_m: float) -> list[Facet]:
    if shape == "half-hipped":
        return half_hipped(footprint, axes, 0.5)
    profiles: dict[str, Profile] = {
        "skillion": ((0.0, 1.0), (1.0, 0.0)),
        "saltbox": ((0.0, 0.0), (1 / 3, 1.0), (1.0, 0.0)),
        "butterfly": ((0.0, 1.0), (0.5, 0.0), (1.0, 1.0)),
        "gambrel": _both_sides(TWO_PITCHES),
    }
    if shape == "round":
        return ridged(footprint, axes, _both_sides(_arc(axes.span / 2, rise_m)))
    return ridged(footprint, axes, profiles.get(shape, GABLE))


def _skeletal(shape: str, footprint: Polygon) -> list[Facet] | None:
    """Return the roof over the straight skeleton, heights 0..1, gables where the shape has them."""
    outline = _simple(footprint)
    if outline is None:
        return None
    facets = skeleton_facets(outline)
    if facets is None:
        return None
    if shape not in ("hipped", "mansard"):
        ends = gable_ends(outline, facets)
        raised = dict.fromkeys(ends, np.inf)
        if shape == "half-hipped":
            raised = {k: 0.5 * top for k, top in ends.items()}
        elif shape == "side_hipped":
            raised = dict.fromkeys(sorted(ends)[:1], np.inf)
        facets = skeleton_facets(outline, raised) or facets
    top = max(facet.top() for facet in facets)
    return [facet.placed(1 / top, 0.0) for facet in facets]


def _simple(footprint: Polygon) -> Polygon | None:
    """Return the outline without collinear corners and with few enough edges, or ``None``."""
    for tolerance in (0.02, 0.1, 0.3, 0.6, 1.0):
        outline = footprint.simplify(tolerance)
        if not isinstance(outline, Polygon) or not outline.is_valid or outline.is_empty:
            return None
        outline = shapely.normalize(outline)
        # A ring starts at its lowest corner, which may be collinear: start it at another.
        rings = [np.asarray(shapely.get_coordinates(r)[:-1]) for r in shapely.get_rings(outline)]
        rings = [ring[~_collinear(ring, tolerance)] for ring in rings]
        if any(len(ring) < 3 for ring in rings):
            return None
        if sum(map(len, rings)) <= MOST_EDGES:
            outline = Polygon(rings[0], rings[1:])
            return shapely.orient_polygons(outline) if outline.is_valid else None
    return None


def _with_fewer_corners(footprint: Polygon) -> Polygon:
    """Return an outline that a roof of many facets can stand on in reasonable time."""
    for tolerance in (0.0, 0.05, 0.2, 0.5):
        outline = footprint.simplify(tolerance) if tolerance else footprint
        if len(shapely.get_coordinates(outline)) <= MOST_CORNERS:
            break
    return outline if isinstance(outline, Polygon) and outline.is_valid else footprint


def _collinear(ring: np.ndarray, tolerance: float) -> np.ndarray:
    before, after = np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0)
    chord = after - before
    length = np.maximum(np.hypot(*chord.T), 1e-9)
    gap = ring - before
    return np.asarray(np.abs(chord[:, 0] * gap[:, 1] - chord[:, 1] * gap[:, 0]) / length < 1e-3)


def _has_wings(footprint: Polygon) -> bool:
    if footprint.interiors:
        return True
    return bool(footprint.area < BLOCK * shapely.oriented_envelope(footprint).area) and bool(
        footprint.area < 0.93 * footprint.convex_hull.area
    )


def _narrow(footprint: Polygon) -> float:
    """Return the shorter side of the tightest rectangle, metres."""
    corners = shapely.get_coordinates(shapely.oriented_envelope(footprint))
    return float(np.hypot(*np.diff(corners[:3], axis=0).T).min())


def _arc(radius_m: float, rise_m: float) -> Profile:
    """Return the arc from the eaves to the top: of a circle, or of an upright ellipse.

    A roof no higher than half its span is a segment of a circle.
    """
    if rise_m >= radius_m:
        turn = np.linspace(0.0, math.pi / 2, ARC + 1)
        way, height = 1 - np.cos(turn), np.sin(turn)
    else:
        circle = (radius_m**2 + rise_m**2) / (2 * rise_m)
        half = math.asin(radius_m / circle)
        turn = np.linspace(-half, 0.0, ARC + 1)
        way = 1 + circle * np.sin(turn) / radius_m
        height = (circle * np.cos(turn) - (circle - rise_m)) / rise_m
    way[[0, -1]], height[[0, -1]] = (0.0, 1.0), (0.0, 1.0)
    return tuple(zip(way.tolist(), height.tolist(), strict=True))


def _onion() -> Profile:
    """Return an onion's profile without its bulge, which overhangs."""
    return ((0.0, 0.0), (0.1, 0.3), (0.35, 0.5), (0.65, 0.66), (0.88, 0.82), (1.0, 1.0))


def _both_sides(profile: Profile) -> Profile:
    """Return a profile from the eaves to the top as one from eaves to eaves."""
    left = [(way / 2, height) for way, height in profile]
    return tuple(left + [(1 - way, height) for way, height in left[-2::-1]])
