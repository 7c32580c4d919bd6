"""Partition of a roof in plan into cells, and the choice of a roof plane for each cell.

The choice minimises the misfit of the points plus the length of borders between planes, a Potts
energy (Boykov, Veksler and Zabih 2001), by moving single cells and whole patches while that reduces
it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from urbantwin.reconstruct.airborne.roof_lines import RoofLine

__all__ = ["GRID_M", "RoofPatch", "roof_patches"]

#: Grid of corners, metres.
GRID_M = 0.01
#: Maximum misfit of a point, metres: beyond, it belongs to another object.
_FAR_M = 0.8
#: Corners are removed if their triangle with both neighbours has less than this squared, metres.
_PLAIN_M = 0.15
#: Cost of a metre of border, in cubic metres of misfit.
_BORDER = 0.08
#: Cost per square metre and metre of distance from the plane's own points.
_STRANGE = 0.04
#: Number of lines above which the plan is cut only near each line.
_MOST_LONG_LINES = 16
#: Minimum extension of a line in that case (otherwise its own length), metres.
_LONGER_M = 4.0


@dataclass(frozen=True, eq=False)
class RoofPatch:
    """A piece of a roof in plan, and its plane: a, b, c of z = a x + b y + c."""

    polygon: shapely.Polygon
    plane: NDArray[np.float64]


def roof_patches(
    outline: shapely.Polygon,
    lines: Sequence[RoofLine],
    points: NDArray[np.float64],
    label: NDArray[np.int64],
    planes: NDArray[np.float64],
) -> list[RoofPatch]:
    """Divide an outline into patches with one plane each.

    Args:
        outline: outline of the building.
        lines: candidate dividing lines.
        points: (N, 3) of the roof, without walls.
        label: (N,) index of each point's plane, -1 for none.
        planes: (P, 3) a, b, c.

    Returns:
        Patches that cover the outline without overlap, corners shared with their neighbours.
    """
    if len(planes) == 1:
        return [RoofPatch(outline, planes[0])]
    cells = _cells(outline, lines)
    cost = _misfit(cells, points, label, planes)
    border = _border_lengths(cells)
    choice = _chosen(cost, border)
    return _dissolved(cells, choice, planes)


def _cells(outline: shapely.Polygon, lines: Sequence[RoofLine]) -> NDArray[Any]:
    """Return the cells of an outline cut by lines, each slightly extended so that they meet."""
    west, south, east, north = outline.bounds
    across = float(np.hypot(east - west, north - south))
    few = len(lines) <= _MOST_LONG_LINES
    cuts = [
        shapely.LineString(line.extended(across if few else max(_LONGER_M, line.support)))
        for line in lines
    ]
    inner = shapely.intersection(np.array(cuts, dtype=object), outline.buffer(0.2))
    edges = shapely.union_all([outline.boundary, *inner.tolist()], grid_size=GRID_M)
    # remove the grid, to which later operations would be snapped
    edges = shapely.set_precision(edges, 0.0)
    cells = shapely.get_parts(shapely.polygonize(shapely.get_parts(edges)))
    inside = shapely.contains(outline, shapely.point_on_surface(cells))
    return np.asarray(cells[inside])


def _misfit(
    cells: NDArray[Any],
    points: NDArray[np.float64],
    label: NDArray[np.int64],
    planes: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the cost of each plane (P) over each cell (C): (C, P) cubic metres."""
    area = shapely.area(cells)
    tree = shapely.STRtree(shapely.points(points[:, :2]))
    cell, point = tree.query(cells, predicate="intersects")
    near = points[point]
    steep = np.sqrt(1.0 + (planes[:, :2] ** 2).sum(axis=1))
    off = np.abs(near[:, 2:] - near[:, :2] @ planes[:, :2].T - planes[:, 2]) / steep
    off = np.minimum(off, _FAR_M)
    count = np.bincount(cell, minlength=len(cells))
    sums = np.column_stack(
        [np.bincount(cell, weights=off[:, k], minlength=len(cells)) for k in range(len(planes))]
    )
    # Cells with few points have a low weight: at most a quarter square metre per point.
    weight = area / np.maximum(count, np.maximum(1.0, 4.0 * area))
    cost = sums * weight[:, None]
    middle = shapely.get_coordinates(shapely.point_on_surface(cells))
    for k in range(len(planes)):
        mine = points[label == k, :2]
        low, high = mine.min(axis=0), mine.max(axis=0)
        beyond = np.maximum(np.maximum(low - middle, middle - high), 0.0)
        cost[:, k] += _STRANGE * area * np.minimum(np.hypot(beyond[:, 0], beyond[:, 1]), 5.0)
    own = np.zeros((len(cells), len(planes)))
    known = label[point] >= 0
    np.add.at(own, (cell[known], label[point][known]), 1.0)
    # Prefer, of two fitting planes, the one with the points' labels.
    cost += 0.03 * area[:, None] * (1.0 - own / np.maximum(own.sum(axis=1, keepdims=True), 1.0))
    return np.asarray(cost)


def _border_lengths(cells: NDArray[Any]) -> coo_array:
    """Return the lengths of shared borders, a symmetric (C, C) matrix."""
    tree = shapely.STRtree(cells)
    a, b = tree.query(cells, predicate="intersects")
    ahead = a < b
    a, b = a[ahead], b[ahead]
    length = shapely.length(
        shapely.intersection(shapely.boundary(cells[a]), shapely.boundary(cells[b]))
    )
    there = length > 1e-6
    a, b, length = a[there], b[there], length[there]
    return coo_array(
        (np.concatenate([length, length]), (np.concatenate([a, b]), np.concatenate([b, a]))),
        shape=(len(cells),) * 2,
    )


def _chosen(cost: NDArray[np.float64], border: coo_array) -> NDArray[np.int64]:
    """Choose a plane for each cell: single cells, then patches, until the cost is minimal."""
    choice = np.asarray(cost.argmin(axis=1), np.int64)
    lengths = border.toarray()
    for _ in range(12):
        changed = _move(np.arange(len(choice)), cost, lengths, choice)
        same = choice[border.row] == choice[border.col]
        graph = coo_array(
            (np.ones(int(same.sum()), bool), (border.row[same], border.col[same])),
            shape=border.shape,
        )
        _, patch = connected_components(graph, directed=False)
        changed |= _move(patch, cost, lengths, choice)
        if not changed:
            break
    return choice


def _move(
    group: NDArray[Any],
    cost: NDArray[np.float64],
    lengths: NDArray[np.float64],
    choice: NDArray[np.int64],
) -> bool:
    """Give each group of cells the cheapest plane of its neighbours, in sequence."""
    changed = False
    order = np.argsort(group, kind="stable")
    for members in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
        around = lengths[members].sum(axis=0)
        around[members] = 0.0
        beside = np.bincount(choice, weights=around, minlength=cost.shape[1])
        total = cost[members].sum(axis=0) + _BORDER * (around.sum() - beside)
        best = int(total.argmin())
        if best != choice[members[0]] and total[best] < total[choice[members[0]]] - 1e-9:
            choice[members] = best
            changed = True
    return changed


def _dissolved(
    cells: NDArray[Any], choice: NDArray[np.int64], planes: NDArray[np.float64]
) -> list[RoofPatch]:
    """Join cells of one plane, and remove corners on straight borders on both sides alike."""
    joined: list[shapely.Polygon] = []
    number: list[int] = []
    for k in np.unique(choice).tolist():
        for part in shapely.get_parts(shapely.coverage_union_all(cells[choice == k])):
            joined.append(part)
            number.append(k)
    polygons = np.array(joined, dtype=object)
    plain = shapely.coverage_simplify(polygons, _PLAIN_M, simplify_boundary=True)
    if shapely.is_valid(plain).all() and shapely.coverage_is_valid(plain):
        polygons = plain
    return [RoofPatch(p, planes[k]) for p, k in zip(polygons, number, strict=True)]
