"""Roofs over any outline whose faces all rise from the eaves at one pitch: the straight skeleton.

The roof over a straight skeleton is the lower envelope of slabs: one plane over every edge of the
outline, bounded at convex corners by the perpendicular there, and at reflex corners by the track
of a "motorcycle" that starts in the corner and runs along the bisector until it meets the outline
or an older track (S.-W. Cheng and A. Vigneron, "Motorcycle graphs and straight skeletons",
Algorithmica 47, 2007, theorem 4; S. Huber and M. Held, "A fast straight-skeleton algorithm based
on generalized motorcycle graphs", IJCGA 22, 2012). An envelope needs no order of events, so ties,
which are the rule in buildings, do no harm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from urbantwin.scene.roof.facet import SPECK_M2, Facet, half_plane

__all__ = ["MOST_EDGES", "gable_ends", "skeleton_facets"]

#: Outlines with more edges are simplified before.
MOST_EDGES = 48
#: The facets must cover the outline but for this share of it.
UNCOVERED = 2e-3

Points = NDArray[np.float64]


@dataclass(frozen=True)
class _Edges:
    """Edges of an outline, solid on their left.

    ``start``, ``end`` (N, 2); ``ahead`` unit directions; ``inward`` unit normals; ``before`` and
    ``after``: the numbers of the neighbours; ``reflex``: whether the corner at the start is.
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
    """Return the facets whose heights are distances from the eaves, or ``None`` if they fail.

    Args:
        outline: simple polygon, holes allowed, without collinear corners.
        raised: edges (numbers in the order of the outline's rings, solid on their left) that are
            no eaves: gables, from which no facet rises (infinity), or half-hips, where one rises
            from the given height.
    """
    raised = raised or {}
    edges = _Edges.of(outline)
    reach = 2.0 * float(np.hypot(*np.ptp(edges.start, axis=0)))
    slabs = _slabs(edges, _tracks(edges, outline), raised, reach)
    bases = np.array([raised.get(k, 0.0) for k in range(len(edges.start))])
    planes = np.column_stack([edges.inward, bases - (edges.inward * edges.start).sum(axis=1)])
    rising = np.flatnonzero(np.isfinite(bases))
    tree = shapely.STRtree(slabs[rising])
    centre = edges.start.mean(axis=0)
    facets = []
    for k in rising.tolist():
        area = _area(shapely.intersection(slabs[k], outline))
        lower = []
        for other in rising[np.sort(tree.query(area))].tolist():
            a, b, c = planes[k] - planes[other]
            if other == k or np.hypot(a, b) < 1e-9:
                continue
            lower.append(shapely.intersection(slabs[other], half_plane(a, b, c, reach, centre)))
        lower = [piece for piece in lower if isinstance(piece, Polygon)]
        if lower and not area.is_empty:
            # Snapped to a hundredth of a millimetre: no slits remain where planes meet.
            area = shapely.difference(area, shapely.union_all(lower), grid_size=1e-5)
        plane = (float(planes[k, 0]), float(planes[k, 1]), float(planes[k, 2]))
        facets += [
            Facet(part, plane)
            for part in shapely.get_parts(area)
            if isinstance(part, Polygon) and part.area > SPECK_M2
        ]
    covered = sum(facet.area.area for facet in facets)
    return facets if abs(covered - outline.area) <= UNCOVERED * outline.area else None


def gable_ends(outline: Polygon, facets: list[Facet]) -> dict[int, float]:
    """Return the edges whose hip is a triangle between convex corners, with the hip's height.

    Of two neighbours only the shorter is one.

    Args:
        outline: as for ``skeleton_facets``.
        facets: what that returned for it.
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
            continue  # its neighbours do not run side by side: no ridge ends here
        middle = shapely.Point((edges.start[k] + edges.end[k]) / 2 + 0.02 * edges.inward[k])
        own = [f for f in facets if f.area.intersects(middle)]
        if len(own) != 1:
            continue
        top = own[0].top()
        # Facets rise by their distance from the edge: a triangle has this area.
        if own[0].area.area < 0.505 * length[k] * top + 0.01:
            ends[k] = top
    return ends


def _area(shape: shapely.Geometry) -> shapely.MultiPolygon:
    """Return the polygons of a geometry."""
    return shapely.MultiPolygon(
        [piece for piece in shapely.get_parts(shape) if isinstance(piece, Polygon)]
    )


def _tracks(edges: _Edges, outline: Polygon) -> dict[int, Points]:
    """Return how far (2,) the motorcycle of each reflex corner runs, by the edge that starts."""
    corners = np.flatnonzero(edges.reflex)
    if not len(corners):
        return {}
    normals = np.stack([edges.inward[edges.before[corners]], edges.inward[corners]], axis=1)
    speed = np.linalg.solve(normals, np.ones((len(corners), 2, 1)))[..., 0]
    origin = edges.start[corners]
    until = np.array([_wall_time(edges, k, speed[n]) for n, k in enumerate(corners.tolist())])
    # Where tracks cross, the one that arrives later ends: crossings in the order of arrival.
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
    """Return when a motorcycle meets the outline."""
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
    """Return where each edge's plane may count, as convex polygons in plan."""
    slabs = []
    for k in range(len(edges.start)):
        far = edges.inward[k] * reach
        left, right = int(edges.before[k]), int(edges.after[k])
        ring = [edges.start[k], edges.end[k]]
        if right in tracks:
            ring.append(edges.end[k] + tracks[right])
        ring.append(ring[-1] + _border(edges.ahead[right], far, np.isinf(raised.get(right, 0.0))))
        back = [edges.start[k]]
        if k in tracks:
            back.append(edges.start[k] + tracks[k])
        back.append(back[-1] + _border(-edges.ahead[left], far, np.isinf(raised.get(left, 0.0))))
        slabs.append(Polygon([*ring, *back[:0:-1]]))
    return np.array(slabs)


def _border(beside: Points, far: Points, gable: bool) -> Points:
    """Return where a slab's side leads: square to its edge, or along a gable beside it."""
    if not gable:
        return far
    rise = float(beside @ far)
    return beside * (float(far @ far) / rise) if rise > 0.2 * float(np.hypot(*far)) else far
