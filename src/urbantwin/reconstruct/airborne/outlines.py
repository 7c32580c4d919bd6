"""Outlines of unmapped buildings, from their roof points.

Cells of a fine grid with roof points are joined; their border is simplified, rotated to the
building's main directions and moved to its outermost points (after Awrangjeb and Fraser 2014,
"Automatic segmentation of raw LIDAR data for extraction of building roofs", Remote Sensing 6).
"""

from __future__ import annotations

import numpy as np
import shapely
import shapely.geometry
import shapely.ops
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_opening, label
from scipy.spatial import cKDTree

from urbantwin.geometry import wrapped
from urbantwin.reconstruct.airborne.raster import Raster

__all__ = ["SMALLEST_M2", "cut_blocks", "find_outlines", "is_plane_like"]

#: Minimum area of a building, square metres: smaller ones are sheds, buses or containers.
SMALLEST_M2 = 12.0
#: Minimum distance of half of a building's area from its border, metres; otherwise it is a wall.
_THIN_M = 1.0
#: Maximum area of an outline, square metres: larger ones are blocks, which are split.
LARGEST_M2 = 350.0
#: Minimum jump of mean heights at a split, metres; area above which one roof is split without a
#: jump, square metres.
_JUMP_M, _HALL_M2 = 0.3, 5000.0
#: Maximum thickness of the neighbourhood of planar points, metres.
_THICK_M = 0.10
#: Maximum angle of sides that are rotated to the building's main directions, degrees.
_TURN_DEG = 22.0


def is_plane_like(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the mask (N,) of points on planes other than walls: roofs, not tree crowns."""
    if len(points) < 10:
        return np.zeros(len(points), bool)
    result = np.zeros(len(points), bool)
    tree = cKDTree(points)
    for start in range(0, len(points), 100_000):
        chunk = slice(start, start + 100_000)
        near = tree.query(points[chunk], 10)[1]
        around = points[near] - points[near].mean(axis=1, keepdims=True)
        spread = np.einsum("nki,nkj->nij", around, around) / near.shape[1]
        values, vectors = np.linalg.eigh(spread)
        thin = np.sqrt(np.maximum(values[:, 0], 0.0)) < _THICK_M
        result[chunk] = thin & (np.abs(vectors[:, 2, 0]) > 0.25)
    return result


def find_outlines(points: NDArray[np.float64]) -> list[shapely.Polygon]:
    """Return the outlines of buildings under roof points.

    Args:
        points: (N, 3) of roofs, site frame.

    Returns:
        Simple polygons of at least 12 square metres, from west to east.
    """
    from affine import Affine
    from rasterio.features import shapes

    if len(points) < 20:
        return []
    coarse = Raster.over(points.min(axis=0), points.max(axis=0), 2.0)
    count = coarse.count(points[:, :2])
    spacing = 2.0 / float(np.sqrt(np.median(count[count > 0])))
    grid = Raster.over(points.min(axis=0), points.max(axis=0), max(0.5, 1.3 * spacing), pad=3)
    covered = grid.count(points[:, :2]) > 0
    block = np.ones((3, 3), bool)
    covered = binary_opening(binary_closing(covered, block), block)
    pieces, number = label(covered)
    owner = pieces.ravel()[grid.cells(points[:, :2])]
    order = np.argsort(owner, kind="stable")
    starts = np.searchsorted(owner[order], np.arange(number + 2))
    found = []
    corner = Affine(grid.step, 0, grid.west - grid.step / 2, 0, grid.step,
                    grid.south - grid.step / 2)  # fmt: skip
    for shape, value in shapes(pieces.astype(np.int32), mask=covered, transform=corner):
        part, k = shapely.geometry.shape(shape), int(value)
        if part.area < SMALLEST_M2:
            continue
        mine = points[order[starts[k] : starts[k + 1]], :2]
        outline = _regular(_closed(part), mine, grid.step, spacing)
        if outline.area >= SMALLEST_M2 and not outline.buffer(-_THIN_M).is_empty:
            found.append(outline)
    return sorted(found, key=lambda outline: outline.bounds)


def cut_blocks(
    outlines: list[shapely.Polygon], points: NDArray[np.float64]
) -> list[shapely.Polygon]:
    """Split outlines of whole blocks where roofs differ most, until each is one house.

    Args:
        outlines: the outlines found.
        points: (N, 3) of roofs.
    """
    done: list[shapely.Polygon] = []
    left = list(outlines)
    tree = shapely.STRtree(shapely.points(points[:, :2]))
    while left:
        outline = left.pop()
        if outline.area <= LARGEST_M2:
            done.append(outline)
            continue
        mine = points[tree.query(outline, predicate="contains")]
        pieces = _halves(outline, mine)
        if len(pieces) < 2:
            done.append(outline)
        else:
            left.extend(pieces)
    return sorted(done, key=lambda outline: outline.bounds)


def _halves(outline: shapely.Polygon, points: NDArray[np.float64]) -> list[shapely.Polygon]:
    """Split an outline across its longer extent, near the centre, where heights change most."""
    angle = _direction(outline)
    along = np.array([np.cos(angle), np.sin(angle)])
    ring = np.asarray(outline.exterior.coords)[:, :2]
    if np.ptp(ring @ along) < np.ptp(ring @ np.array([-along[1], along[0]])):
        along = np.array([-along[1], along[0]])
    reach = ring @ along
    low, size = reach.min(), np.ptp(reach)
    edges = np.arange(low + 0.25 * size, low + 0.75 * size, 0.5)
    bin_of = np.digitize(points[:, :2] @ along, edges)
    count = np.bincount(bin_of, minlength=len(edges) + 1)
    mean = np.bincount(bin_of, weights=points[:, 2], minlength=len(edges) + 1) / np.maximum(
        count, 1
    )
    jump = np.abs(np.diff(mean[1:-1])) if len(edges) > 4 else np.zeros(0)
    if outline.area < _HALL_M2 and jump.max(initial=0.0) < _JUMP_M:
        return []
    at = float(edges[1 + int(np.argmax(jump))]) if jump.size else float(low + size / 2)
    across = np.array([-along[1], along[0]])
    far = 2.0 * (size + np.abs(ring).max())
    cut = shapely.LineString([at * along - far * across, at * along + far * across])
    return [
        piece for piece in shapely.get_parts(shapely.ops.split(outline, cut)) if piece.area > 1.0
    ]


def _closed(shape: shapely.Polygon) -> shapely.Polygon:
    """Return a polygon without courtyards smaller than a room."""
    holes = [ring for ring in shape.interiors if shapely.Polygon(ring).area > SMALLEST_M2]
    return shapely.Polygon(shape.exterior, holes)


def _regular(
    shape: shapely.Polygon, points: NDArray[np.float64], step: float, spacing: float
) -> shapely.Polygon:
    """Return an outline of straight sides along its main directions from a shape of cells."""
    plain = shapely.simplify(shape, 1.6 * step)
    if plain.geom_type != "Polygon" or not plain.is_valid:
        plain = shape
    angle = _direction(plain)
    rings = [
        _squared(np.asarray(ring.coords)[:-1, :2], angle, points, step, spacing)
        for ring in (shapely.orient_polygons(plain).exterior, *plain.interiors)
    ]
    if rings[0] is None:
        return plain
    regular = shapely.Polygon(rings[0], [ring for ring in rings[1:] if ring is not None])
    if not regular.is_valid:
        return plain
    overlap = shapely.intersection(regular, shape).area / shapely.union(regular, shape).area
    return regular if overlap > 0.75 else plain


def _direction(outline: shapely.Polygon) -> float:
    """Return the direction (modulo 90 degrees) of most of an outline's length, radians."""
    ring = np.asarray(outline.exterior.coords)[:, :2]
    side = np.diff(ring, axis=0)
    length = np.linalg.norm(side, axis=1)
    turn = 4.0 * np.arctan2(side[:, 1], side[:, 0])
    weight = length**2
    return float(np.arctan2((weight * np.sin(turn)).sum(), (weight * np.cos(turn)).sum()) / 4.0)


def _squared(
    ring: NDArray[np.float64],
    angle: float,
    points: NDArray[np.float64],
    step: float,
    spacing: float,
) -> NDArray[np.float64] | None:
    """Return a counter-clockwise ring with rotated and moved sides; ``None``: degenerate."""
    side = np.roll(ring, -1, axis=0) - ring
    own = np.arctan2(side[:, 1], side[:, 0])
    quarter = np.pi / 2
    snapped = angle + np.rint((own - angle) / quarter) * quarter
    near = np.abs(own - snapped) < np.radians(_TURN_DEG)
    direction = np.where(near, snapped, own)
    middle = (ring + np.roll(ring, -1, axis=0)) / 2
    length = np.linalg.norm(side, axis=1)
    lines: list[tuple[float, float]] = []
    for k in range(len(ring)):
        normal = np.array([np.sin(direction[k]), -np.cos(direction[k])])
        along = np.array([np.cos(direction[k]), np.sin(direction[k])])
        out = (points - middle[k]) @ normal
        beside = np.abs((points - middle[k]) @ along) < max(0.45 * length[k], step)
        band = beside & (np.abs(out) < 1.6 * step)
        reach = np.percentile(out[band], 95) + 0.3 * spacing if band.sum() > 5 else 0.0
        offset = float(middle[k] @ normal + reach)
        turn = wrapped(direction[k] - lines[-1][0]) if lines else 1.0
        if lines and abs(turn) < 1e-3 and abs(lines[-1][1] - offset) < 1.5 * step:
            continue
        lines.append((float(direction[k]), offset))
    return _corners(lines, middle)


def _corners(
    lines: list[tuple[float, float]], middle: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Return the corners between successive lines; parallel ones are joined by a cross piece."""
    corners = []
    reach = np.ptp(middle, axis=0).max() + 5.0
    for (a, r), (b, s) in zip(lines, lines[1:] + lines[:1], strict=True):
        system = np.array([[np.sin(a), -np.cos(a)], [np.sin(b), -np.cos(b)]])
        if abs(np.linalg.det(system)) < 0.2:
            return None
        corner = np.linalg.solve(system, [r, s])
        if np.linalg.norm(corner - middle.mean(axis=0)) > reach:
            return None
        corners.append(corner)
    return np.array(corners) if len(corners) >= 3 else None
