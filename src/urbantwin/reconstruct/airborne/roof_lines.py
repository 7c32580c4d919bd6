"""Dividing lines of a roof in plan: creases between planes, and height steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.spatial import cKDTree

from urbantwin.geometry import wrapped

__all__ = ["RoofLine", "main_directions", "roof_lines"]

#: Cell size of the label map, metres.
_GRID_M = 0.25
#: Maximum distance of border points from their line, metres.
_BAND_M = 0.45
#: Minimum length of a border, metres.
_SHORTEST_M = 1.0
#: Differences below which lines are the same, metres and degrees.
_SAME_M, _SAME_DEG = 0.3, 6.0


@dataclass(frozen=True, eq=False)
class RoofLine:
    """A straight segment in plan.

    Attributes:
        start, end: (2,) metres.
        support: length of the border that it explains, metres.
        crease: whether two planes intersect there.
    """

    start: NDArray[np.float64]
    end: NDArray[np.float64]
    support: float
    crease: bool

    def extended(self, by: float) -> NDArray[np.float64]:
        """Return both ends (2, 2), extended outward."""
        along = self.end - self.start
        along = along / max(float(np.linalg.norm(along)), 1e-9)
        return np.array([self.start - by * along, self.end + by * along])


def main_directions(outline: shapely.Polygon) -> NDArray[np.float64]:
    """Return the directions (K,) of an outline's longer sides, radians, longest first."""
    ring = np.asarray(outline.exterior.coords)[:, :2]
    side = np.diff(ring, axis=0)
    length = np.linalg.norm(side, axis=1)
    angle = np.arctan2(side[:, 1], side[:, 0]) % np.pi
    chosen: list[float] = []
    weights: list[float] = []
    for k in np.argsort(-length, kind="stable").tolist():
        for j, other in enumerate(chosen):
            turn = wrapped(angle[k] - other, np.pi)
            if abs(turn) < np.radians(4.0):
                weights[j] += length[k]
                break
        else:
            chosen.append(float(angle[k]))
            weights.append(float(length[k]))
    order = np.argsort(-np.array(weights), kind="stable")
    return np.array(chosen)[order][: max(2, int((np.array(weights) > 2.0).sum()))][:6]


def roof_lines(
    outline: shapely.Polygon,
    points: NDArray[np.float64],
    label: NDArray[np.int64],
    planes: NDArray[np.float64],
) -> list[RoofLine]:
    """Return the lines between the planes of a roof.

    Args:
        outline: outline of the building.
        points: (N, 3) of the roof.
        label: (N,) index of each point's plane, -1 for none.
        planes: (P, 3) a, b, c.

    Returns:
        Lines, those with most support first; near duplicates left out.
    """
    if len(planes) < 2:
        return []
    borders = _borders(outline, points, label)
    directions = main_directions(outline)
    found: list[RoofLine] = []
    for (i, j), at in borders.items():
        difference = planes[i] - planes[j]
        tilt = float(np.hypot(difference[0], difference[1]))
        gap = at @ difference[:2] + difference[2]
        rest = at
        if tilt > 0.1:
            away = np.abs(gap) / tilt
            # Where both planes have equal heights, the border is their crease.
            close = (away < 0.7) & (np.abs(gap) < 0.6)
            if close.sum() * _GRID_M >= _SHORTEST_M:
                along = np.array([-difference[1], difference[0]]) / tilt
                normal = difference[:2] / tilt
                foot = -difference[2] / tilt * normal
                reach = at[close] @ along
                low, high = np.percentile(reach, [1, 99])
                found.append(RoofLine(foot + low * along, foot + high * along, high - low, True))
                rest = at[~close]
        found.extend(_steps(rest, directions))
    return _distinct(found, outline)


def _borders(
    outline: shapely.Polygon, points: NDArray[np.float64], label: NDArray[np.int64]
) -> dict[tuple[int, int], NDArray[np.float64]]:
    """Return the positions (M, 2) between the labels of each pair, from a map of nearest labels."""
    west, south, east, north = outline.bounds
    x = np.arange(west, east + _GRID_M, _GRID_M)
    y = np.arange(south, north + _GRID_M, _GRID_M)
    nodes = np.stack(np.meshgrid(x, y), axis=-1)
    flat = nodes.reshape(-1, 2)
    labelled = label >= 0
    nearest = cKDTree(points[labelled, :2]).query(flat)[1]
    grid = _smooth(label[labelled][nearest].reshape(nodes.shape[:2]))
    inside = shapely.contains_xy(outline.buffer(0.1), flat).reshape(grid.shape)
    places: list[NDArray[np.float64]] = []
    pairs: list[NDArray[np.int64]] = []
    for rows, columns in ((slice(None), slice(1, None)), (slice(1, None), slice(None))):
        back = (slice(None), slice(-1)) if columns.start else (slice(-1), slice(None))
        here, there = grid[back], grid[rows, columns]
        cut = (here != there) & inside[back] & inside[rows, columns]
        places.append((nodes[back][cut] + nodes[rows, columns][cut]) / 2)
        pairs.append(np.sort(np.column_stack([here[cut], there[cut]]), axis=1))
    at, pair = np.concatenate(places), np.concatenate(pairs)
    if not len(at):
        return {}
    kinds, number = np.unique(pair, axis=0, return_inverse=True)
    number = number.ravel()
    return {
        (int(i), int(j)): at[number == k]
        for k, (i, j) in enumerate(kinds)
        if (number == k).sum() * _GRID_M >= _SHORTEST_M
    }


def _smooth(grid: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return a label map in which each cell has the most frequent label of its 3 x 3 cells."""
    best = grid.copy()
    most = np.zeros(grid.shape)
    for number in np.unique(grid):
        share = median_filter((grid == number).astype(np.uint8), size=3)
        take = (share > 0) & (share > most)
        best[take] = number
        most[take] = share[take]
    return best


def _steps(at: NDArray[np.float64], directions: NDArray[np.float64]) -> list[RoofLine]:
    """Fit lines to the positions of a border, preferably along given directions."""
    found: list[RoofLine] = []
    rest = at
    while len(rest) * _GRID_M >= _SHORTEST_M and len(found) < 12:
        best: tuple[float, float, float] | None = None
        free = _free_direction(rest)
        for k, angle in enumerate([*directions.tolist(), *free]):
            normal = np.array([-np.sin(angle), np.cos(angle)])
            offset = np.sort(rest @ normal)
            count = np.searchsorted(offset, offset + _BAND_M) - np.arange(len(offset))
            at_most = int(np.argmax(count))
            # A free direction must explain clearly more than a direction of the outline.
            score = float(count[at_most]) * (1.0 if k < len(directions) else 0.75)
            if best is None or score > best[0]:
                middle = float(np.median(offset[at_most : at_most + count[at_most]]))
                best = (score, float(angle), middle)
        if best is None or best[0] * _GRID_M < _SHORTEST_M:
            break
        _, angle, middle = best
        along, normal = (
            np.array([np.cos(angle), np.sin(angle)]),
            np.array([-np.sin(angle), np.cos(angle)]),
        )
        near = np.abs(rest @ normal - middle) < _BAND_M
        reach = np.sort(rest[near] @ along)
        for run in np.split(reach, np.flatnonzero(np.diff(reach) > 1.5) + 1):
            if len(run) * _GRID_M >= _SHORTEST_M:
                foot = middle * normal
                found.append(
                    RoofLine(
                        foot + run[0] * along, foot + run[-1] * along, float(np.ptp(run)), False
                    )
                )
        rest = rest[~near]
    return found


def _free_direction(at: NDArray[np.float64]) -> list[float]:
    spread = at - at.mean(axis=0)
    values, vectors = np.linalg.eigh(spread.T @ spread)
    if values[1] <= 0:
        return []
    return [float(np.arctan2(vectors[1, 1], vectors[0, 1]))]


def _distinct(lines: list[RoofLine], outline: shapely.Polygon) -> list[RoofLine]:
    """Return lines without duplicates of others or of sides of the outline."""
    ring = np.asarray(outline.exterior.coords)[:, :2]
    sides = len(ring) - 1
    # Creases are exact and come first, then the longest.
    ranked = sorted(lines, key=lambda item: (not item.crease, -item.support))
    start = np.concatenate([ring[:-1], np.array([line.start for line in ranked]).reshape(-1, 2)])
    end = np.concatenate([ring[1:], np.array([line.end for line in ranked]).reshape(-1, 2)])
    kept = np.zeros(len(start), bool)
    kept[:sides] = True
    for k in range(sides, len(start)):
        kept[k] = not _along_any(start[k], end[k], start[kept], end[kept])
    return [line for line, keep in zip(ranked, kept[sides:], strict=True) if keep]


def _along_any(
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
) -> bool:
    """Return whether a line coincides with one of others (K, 2), over nearly all its length."""
    own = end - start
    size = float(np.hypot(own[0], own[1]))
    if size < 1e-6:
        return True
    along = ends - starts
    length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)
    along = along / length[:, None]
    turned = np.abs(along[:, 0] * own[1] - along[:, 1] * own[0]) / size
    near = turned <= np.sin(np.radians(_SAME_DEG))
    first, second = start - starts, end - starts
    for to in (first, second):
        near &= np.abs(along[:, 0] * to[:, 1] - along[:, 1] * to[:, 0]) <= _SAME_M
    a, b = (along * first).sum(axis=1), (along * second).sum(axis=1)
    overlap = np.minimum(np.maximum(a, b), length) - np.maximum(np.minimum(a, b), 0.0)
    return bool((near & (overlap > size - 1.0)).any())
