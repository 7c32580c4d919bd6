"""Straight-skeleton roofs: over any outline, all faces rise from the eaves at one pitch.

The roof over a straight skeleton is the lower envelope of slabs, with one plane per edge of the
outline. At convex corners a slab ends at the perpendicular. At reflex corners it ends at the track
of a "motorcycle", which starts at the corner and runs along the bisector to the outline or an older
track. Sources: S.-W. Cheng and A. Vigneron, "Motorcycle graphs and straight skeletons",
Algorithmica 47, 2007, theorem 4; S. Huber and M. Held, "A fast straight-skeleton algorithm based on
generalized motorcycle graphs", IJCGA 22, 2012. An envelope needs no order of events, so ties, which
are common in buildings, cause no errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from urbantwin.scene.roof.facet import SPECK_M2, Facet, half_planes

__all__ = ["MOST_EDGES", "gable_ends", "skeleton_facets"]

#: Outlines with more edges are simplified before.
MOST_EDGES = 48
#: The facets must cover the outline but for this share of it.
UNCOVERED = 2e-3
#: and may overlap on this share of it.
OVERLAPPING = 0.03

POLYGON = int(shapely.GeometryType.POLYGON)

Points = NDArray[np.float64]


@dataclass(frozen=True)
class _Edges:
    """Edges of an outline, solid on their left.

    ``start``, ``end`` (N, 2); ``ahead``: unit directions; ``inward``: unit normals; ``before`` and
    ``after``: indices of the neighbours; ``reflex``: whether the corner at the start is reflex.
    """

    start: Points
    end: Points
    ahead: Points
    inward: Points
    before: NDArray[np.int64]
    after: NDArray[np.int64]
    reflex: NDArray[np.bool_]

    @classmethod
    def of(cls, outline: Polygon) -> _Edges:
        oriented = shapely.orient_polygons(outline)
        starts, ends, before, after = [], [], [], []
        count = 0
        for ring in shapely.get_rings(oriented):
            xy = shapely.get_coordinates(ring)[:-1]
            number = np.arange(len(xy))
            starts.append(xy)
            ends.append(np.roll(xy, -1, axis=0))
            before.append(np.roll(number, 1) + count)
            after.append(np.roll(number, -1) + count)
            count += len(xy)
        start, end = np.concatenate(starts), np.concatenate(ends)
        ahead = end - start
        ahead /= np.hypot(*ahead.T)[:, None]
        behind = np.concatenate(before)
        came = ahead[behind]
        turn = came[:, 0] * ahead[:, 1] - came[:, 1] * ahead[:, 0]
        return cls(
            start,
            end,
            ahead,
            np.column_stack([-ahead[:, 1], ahead[:, 0]]),
            behind,
            np.concatenate(after),
            turn < -1e-6,
        )


def skeleton_facets(
    outline: Polygon, raised: Mapping[int, float] | None = None
) -> list[Facet] | None:
    """Return facets with heights equal to distances from the eaves; ``None`` if this fails.

    Args:
        outline: simple polygon, holes allowed, without collinear corners.
        raised: edges that are not eaves, by index in the order of the outline's rings, solid on
            their left. The value is infinity for gables, which have no facet, or the height at
            which the facet of a half-hip starts.
    """
    try:
        return _envelope(outline, raised or {})
    except (shapely.GEOSException, np.linalg.LinAlgError):
        return None  # the caller uses a simpler roof for such outlines


def _envelope(outline: Polygon, raised: Mapping[int, float]) -> list[Facet] | None:
    edges = _Edges.of(outline)
    bases = np.array([raised.get(k, 0.0) for k in range(len(edges.start))])
    planes = np.column_stack([edges.inward, bases - (edges.inward * edges.start).sum(axis=1)])
    rising = np.flatnonzero(np.isfinite(bases))
    if not edges.reflex.any() and not outline.interiors:
        return _covering(_convex(edges.start, planes, rising), outline)
    reach = 2.0 * float(np.hypot(*np.ptp(edges.start, axis=0)))
    slabs = _slabs(edges, _tracks(edges, outline), raised, reach)
    tree = shapely.STRtree(slabs[rising])
    centre = edges.start.mean(axis=0)
    facets = []
    for k in rising.tolist():
        area = _area(shapely.intersection(slabs[k], outline))
        others = rising[np.sort(tree.query(area))]
        rise = planes[k] - planes[others]
        steep = np.hypot(rise[:, 0], rise[:, 1]) > 1e-9
        crossing = others[steep]
        lower = shapely.intersection(slabs[crossing], half_planes(rise[steep], reach, centre))
        # If two planes never cross, one of them is lower everywhere.
        lower = np.concatenate([lower, slabs[others[~steep & (rise[:, 2] > 1e-6)]]])
        shapely.prepare(area)
        lower = lower[(shapely.get_type_id(lower) == POLYGON) & shapely.intersects(area, lower)]
        if len(lower) and not area.is_empty:
            # Snapped to a hundredth of a millimetre: no gaps remain between planes.
            area = shapely.difference(area, shapely.union_all(lower), grid_size=1e-5)
        plane = (float(planes[k, 0]), float(planes[k, 1]), float(planes[k, 2]))
        facets += [
            Facet(part, plane)
            for part in shapely.get_parts(area)
            if isinstance(part, Polygon) and part.area > SPECK_M2
        ]
    return _covering(facets, outline)


def gable_ends(outline: Polygon, facets: list[Facet]) -> dict[int, float]:
    """Return the edges whose hip is a triangle between convex corners, with the hip's height.

    If two adjacent edges qualify, only the shorter is returned.

    Args:
        outline: as for ``skeleton_facets``.
        facets: result of ``skeleton_facets`` for it.
    """
    edges = _Edges.of(outline)
    length = np.hypot(*(edges.end - edges.start).T)
    ends: dict[int, float] = {}
    for k in np.argsort(length, kind="stable").tolist():
        if edges.reflex[k] or edges.reflex[edges.after[k]]:
            continue
        if edges.before[k] in ends or edges.after[k] in ends:
            continue
        beside = (edges.ahead[edges.before[k]] * edges.ahead[edges.after[k]]).sum()
        longer = min(length[edges.before[k]], length[edges.after[k]])
        if beside > -0.8 or longer < 0.5 * length[k]:
            continue  # its neighbours are not parallel: no ridge ends here
        middle = shapely.Point((edges.start[k] + edges.end[k]) / 2 + 0.02 * edges.inward[k])
        own = [f for f in facets if f.area.intersects(middle)]
        if len(own) != 1:
            continue
        top = own[0].top()
        # Facets rise by their distance from the edge: a triangle has this area.
        if own[0].area.area < 0.505 * length[k] * top + 0.01:
            ends[k] = top
    return ends


def _covering(facets: list[Facet], outline: Polygon) -> list[Facet] | None:
    """Return facets if they cover the outline; a small overlap is allowed."""
    total = sum(facet.area.area for facet in facets)
    if abs(total - outline.area) <= UNCOVERED * outline.area:
        return facets
    covered = shapely.union_all([facet.area for facet in facets], grid_size=1e-4).area
    spread = total - outline.area <= OVERLAPPING * outline.area
    return facets if spread and outline.area - covered <= UNCOVERED * outline.area else None


def _convex(corners: Points, planes: Points, rising: NDArray[np.int64]) -> list[Facet]:
    """Return the lower envelope of planes over a convex outline (N, 2): no slabs are needed."""
    facets = []
    count = len(corners)
    whole = [(float(x), float(y)) for x, y in corners]
    for k in rising.tolist():
        ring = whole
        # Neighbouring edges first: they cut off the largest parts.
        for other in sorted(rising.tolist(), key=lambda n: min((n - k) % count, (k - n) % count)):
            a, b, c = (planes[other] - planes[k]).tolist()
            if other != k and abs(a) + abs(b) > 1e-9:
                ring = _cut(ring, a, b, c)
                if len(ring) < 3:
                    break
        if len(ring) >= 3:
            area = Polygon(ring)
            if area.area > SPECK_M2:
                plane = (float(planes[k, 0]), float(planes[k, 1]), float(planes[k, 2]))
                facets.append(Facet(area, plane))
    return facets


def _cut(
    ring: list[tuple[float, float]], a: float, b: float, c: float
) -> list[tuple[float, float]]:
    """Return the part of a convex ring with a x + b y + c >= 0."""
    side = [a * x + b * y + c for x, y in ring]
    if min(side) >= -1e-9:
        return ring
    kept = []
    for n, (x, y) in enumerate(ring):
        if side[n - 1] * side[n] < 0:
            share = side[n - 1] / (side[n - 1] - side[n])
            left, low = ring[n - 1]
            kept.append((left + share * (x - left), low + share * (y - low)))
        if side[n] >= 0:
            kept.append((x, y))
    return kept


def _area(shape: shapely.Geometry) -> shapely.MultiPolygon:
    """Return the polygons of a geometry."""
    return shapely.MultiPolygon(
        [piece for piece in shapely.get_parts(shape) if isinstance(piece, Polygon)]
    )


def _tracks(edges: _Edges, outline: Polygon) -> dict[int, Points]:
    """Return the motorcycle track (2,) of each reflex corner, by the edge that starts there."""
    corners = np.flatnonzero(edges.reflex)
    if not len(corners):
        return {}
    normals = np.stack([edges.inward[edges.before[corners]], edges.inward[corners]], axis=1)
    speed = np.linalg.solve(normals, np.ones((len(corners), 2, 1)))[..., 0]
    origin = edges.start[corners]
    until = np.array([_wall_time(edges, k, speed[n]) for n, k in enumerate(corners.tolist())])
    # At a crossing of tracks, the motorcycle that arrives later ends: crossings sorted by arrival.
    crossings = []
    for i in range(len(corners)):
        for j in range(len(corners)):
            cross = speed[i, 0] * speed[j, 1] - speed[i, 1] * speed[j, 0]
            if i == j or abs(cross) < 1e-12:
                continue
            gap = origin[j] - origin[i]
            mine = (gap[0] * speed[j, 1] - gap[1] * speed[j, 0]) / cross
            other = (gap[0] * speed[i, 1] - gap[1] * speed[i, 0]) / cross
            if mine > 0 and other >= 0 and mine >= other - 1e-9:
                crossings.append((mine, other, i, j))
    for mine, other, i, j in sorted(crossings):
        if mine < until[i] and other <= until[j] + 1e-9:
            until[i] = mine
    return {int(k): speed[n] * until[n] for n, k in enumerate(corners.tolist())}


def _wall_time(edges: _Edges, corner: int, speed: Points) -> float:
    """Return the time at which a motorcycle reaches the outline."""
    origin = edges.start[corner]
    along = edges.end - edges.start
    gap = edges.start - origin
    cross = speed[0] * along[:, 1] - speed[1] * along[:, 0]
    safe = np.where(np.abs(cross) < 1e-12, np.inf, cross)
    time = (gap[:, 0] * along[:, 1] - gap[:, 1] * along[:, 0]) / safe
    where = (gap[:, 0] * speed[1] - gap[:, 1] * speed[0]) / safe
    hit = (time > 1e-9) & (where >= -1e-9) & (where <= 1 + 1e-9)
    hit[[corner, edges.before[corner]]] = False
    return float(time[hit].min()) if hit.any() else 0.0


def _slabs(
    edges: _Edges, tracks: dict[int, Points], raised: Mapping[int, float], reach: float
) -> NDArray[np.object_]:
    """Return the area in which each edge's plane may apply, as convex polygons in plan."""
    slabs = []
    for k in range(len(edges.start)):
        far = edges.inward[k] * reach
        left, right = int(edges.before[k]), int(edges.after[k])
        across, back = edges.ahead[k] * reach, edges.start[k] - edges.inward[k]
        ring = [
            (float(x), float(y))
            for x, y in (back - across, back + across, back + across + far, back - across + far)
        ]
        for corner, beside, track, end in (
            (edges.start[k], -edges.ahead[left], tracks.get(k), left),
            (edges.end[k], edges.ahead[right], tracks.get(right), right),
        ):
            side = edges.ahead[k] if end == left else -edges.ahead[k]
            foot = corner
            if track is not None and np.hypot(*track) > 1e-6:
                ring = _cut(ring, *_beside(foot, track, side))
                foot = corner + track
            border = _border(beside, far, bool(np.isinf(raised.get(end, 0.0))))
            ring = _cut(ring, *_beside(foot, border, side))
        slabs.append(Polygon(ring) if len(ring) > 2 else Polygon())
    return np.array(slabs)


def _beside(foot: Points, along: Points, side: Points) -> tuple[float, float, float]:
    """Return the half plane (a, b, c) beside a line, on the side of a given vector."""
    a, b = -float(along[1]), float(along[0])
    if a * side[0] + b * side[1] < 0:
        a, b = -a, -b
    return a, b, -float(a * foot[0] + b * foot[1])


def _border(beside: Points, far: Points, gable: bool) -> Points:
    """Return the direction of a slab's side: normal to its edge, or along an adjacent gable."""
    if not gable:
        return far
    rise = float(beside @ far)
    return beside * (float(far @ far) / rise) if rise > 0.2 * float(np.hypot(*far)) else far
