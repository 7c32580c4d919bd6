"""Roofs: facets over a footprint along a ridge, round an apex, or over a straight skeleton."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from urbantwin.scene.roof.facet import SPECK_M2, Facet, Plane, half_plane, profiled
from urbantwin.scene.roof.skeleton import MOST_EDGES, gable_ends, skeleton_facets
from urbantwin.scene.roof.tags import roof_yaw

__all__ = ["roof_facets", "roof_span"]

#: A profile: (place across the roof 0..1, height 0..1).
Profile = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Axes:
    """Orientation and extent of a roof on its footprint.

    Attributes:
        down: unit vector (2,) perpendicular to the ridge, in the direction of the (main) slope.
        low, high: the footprint's extent along ``down``, metres.
        start, end: its extent along the ridge (``down`` turned left), metres.
    """

    down: NDArray[np.float64]
    low: float
    high: float
    start: float
    end: float

    @property
    def along(self) -> NDArray[np.float64]:
        """The ridge's unit vector."""
        return np.array([-self.down[1], self.down[0]])

    @property
    def span(self) -> float:
        """The width across the ridge, metres."""
        return self.high - self.low


def axes_of(footprint: Polygon, yaw: float) -> Axes:
    """Return the axes of a roof with its slope towards ``yaw``, rad counter-clockwise from east."""
    xy = shapely.get_coordinates(footprint)
    # Rounded, so that multiples of a right angle are exact and rectangles stay rectangles.
    down = np.array([round(math.cos(yaw), 12), round(math.sin(yaw), 12)])
    across, along = xy @ down, xy @ np.array([-down[1], down[0]])
    return Axes(
        down, float(across.min()), float(across.max()), float(along.min()), float(along.max())
    )


def ridged(footprint: Polygon, axes: Axes, profile: Profile) -> list[Facet]:
    """Return a profile's facets, heights 0..1; the profile ends at the side of the slope."""
    facets = []
    reach = 2 * float(footprint.length)
    near = shapely.get_coordinates(footprint.centroid)[0]
    x, y = axes.down.tolist()
    for (left, low), (right, high) in pairwise(profile):
        begin, end = axes.low + left * axes.span, axes.low + right * axes.span
        area = footprint
        if left > 0:
            area = shapely.intersection(area, half_plane(x, y, -begin, reach, near))
        if right < 1:
            area = shapely.intersection(area, half_plane(-x, -y, end, reach, near))
        slope = (high - low) / (end - begin)
        facets += _pieces(area, (slope * x, slope * y, low - slope * begin))
    return facets


def half_hipped(footprint: Polygon, axes: Axes, from_height: float) -> list[Facet]:
    """Return a gabled roof whose ends are hipped above a height (0..1), at the same pitch."""
    gabled = ridged(footprint, axes, ((0.0, 0.0), (0.5, 1.0), (1.0, 0.0)))
    # Steeper if the ridge is so short that the hips would intersect below it.
    slope = max(2 / axes.span, 2 * (1 - from_height) / (axes.end - axes.start))
    x, y = (axes.along * slope).tolist()
    hips: list[Plane] = [
        (x, y, from_height - slope * axes.start),
        (-x, -y, from_height + slope * axes.end),
    ]
    reach = 2 * float(footprint.length)
    near = shapely.get_coordinates(footprint.centroid)[0]
    facets = []
    planes = [facet.plane for facet in gabled] + hips
    areas = [facet.area for facet in gabled] + [footprint, footprint]
    for k, (plane, area) in enumerate(zip(planes, areas, strict=True)):
        left = area
        for n, other in enumerate(planes):
            a, b, c = np.subtract(other, plane).tolist()
            same = k < len(gabled) and n < len(gabled)
            if n == k or same or np.hypot(a, b) < 1e-12:
                continue
            left = shapely.intersection(left, half_plane(a, b, c, reach, near))
        facets += _pieces(left, plane)
    return facets


def _pieces(area: shapely.Geometry, plane: Plane) -> list[Facet]:
    return [
        Facet(part, plane)
        for part in shapely.get_parts(area)
        if isinstance(part, Polygon) and part.area > SPECK_M2
    ]


#: Minimum distance of an apex from the lines of the edges, metres: closer, a roof would be
#: vertical.
_LEAST_RUN_M = 0.3


def apex_of(footprint: Polygon) -> NDArray[np.float64] | None:
    """Return a point (2,) well within the lines of all edges, preferably the centroid."""
    if footprint.interiors:
        return None
    for point in (footprint.centroid, footprint.envelope.centroid):
        apex: NDArray[np.float64] = shapely.get_coordinates(point)[0]
        if _well_within(footprint, apex):
            return apex
    return None


def radial(
    footprint: Polygon, apex: NDArray[np.float64], profile: Sequence[tuple[float, float]]
) -> list[Facet]:
    """Return the facets from every edge up to the apex, heights 0..1.

    Args:
        footprint: every point of its outline is visible from the apex.
        apex: (2,).
        profile: (share of the distance from the outline to the apex, height).
    """
    xy = _ring(footprint)
    following = np.roll(xy, -1, axis=0)
    edge = following - xy
    inward = np.column_stack([-edge[:, 1], edge[:, 0]])
    slope = inward / ((apex - xy) * inward).sum(axis=1, keepdims=True)
    offset = -(slope * xy).sum(axis=1)
    facets = []
    for (way, low), (next_way, high) in pairwise(profile):
        near, far = (points + (apex - points) * way for points in (xy, following))
        inner = [points + (apex - points) * next_way for points in (xy, following)]
        scale = (high - low) / (next_way - way)
        for k in range(len(xy)):
            ring = [near[k], far[k], inner[1][k], inner[0][k]]
            plane = (
                float(slope[k, 0] * scale),
                float(slope[k, 1] * scale),
                float((offset[k] - way) * scale + low),
            )
            facets.append(Facet(Polygon(ring if next_way < 1 else ring[:3]), plane))
    return facets


def _ring(footprint: Polygon) -> NDArray[np.float64]:
    oriented = shapely.orient_polygons(footprint)
    return np.asarray(shapely.get_coordinates(oriented.exterior)[:-1])


def _well_within(footprint: Polygon, apex: NDArray[np.float64]) -> bool:
    a = _ring(footprint) - apex
    b = np.roll(a, -1, axis=0)
    twice_areas = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return bool((twice_areas > _LEAST_RUN_M * np.linalg.norm(b - a, axis=1)).all())


GABLE: Profile = ((0.0, 0.0), (0.5, 1.0), (1.0, 0.0))
LEVEL: Profile = ((0.0, 0.0), (1.0, 1.0))
#: Steep below, gentle above: share of the way in, share of the height.
TWO_PITCHES: Profile = ((0.0, 0.0), (0.35, 0.65), (1.0, 1.0))
#: Number of straight pieces of an arc on each side.
ARC = 6
#: Footprints that fill less of their smallest bounding rectangle than this have wings.
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

    Footprints with wings or courtyards get the roof of their straight skeleton. If the requested
    shape is not possible, the roof is hipped or gabled, and a note is counted.

    Args:
        shape: one of ``SHAPES``.
        footprint: site frame.
        tags: tags with the direction and orientation.
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
    """Return the straight-skeleton roof, heights 0..1, with gables if the shape has them."""
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
    """Return an outline with few enough corners for a roof of many facets."""
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
    """Mirror a profile from the eaves to the top into one from eaves to eaves."""
    left = [(way / 2, height) for way, height in profile]
    return tuple(left + [(1 - way, height) for way, height in left[-2::-1]])
