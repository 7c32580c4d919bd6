"""Parts of the place that the twin lacks: real points without points of the twin nearby."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

__all__ = ["CELL_M", "NEAR_M", "SPACING_SHARE", "MissingPlaces", "without_surface"]

#: Distance of a real point to all synthetic ones from which it has no surface, metres; or this
#: share of its range, if larger, since the spacing of a sensor's points grows with range.
NEAR_M = 0.5
SPACING_SHARE = 0.02
#: Cell size in plan by which such points are grouped, metres.
CELL_M = 4.0
_LISTED = 20
#: Number of twin points in similar directions that are tested; maximum slope between two of them,
#: and their maximum distance as a share of the range.
_AROUND, _LEVEL, _LONGEST_SHARE = 10, 0.25, 0.3
_FLATTENED = 0.15


def without_surface(
    points: NDArray[np.float64],
    away: NDArray[np.float64],
    origin: NDArray[np.float64],
    actor: NDArray[np.bool_] | None = None,
    twin: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Return the real points without a surface of the twin nearby, (K, 4): x, y, z, distance.

    Far away a sensor's rings on the ground are metres apart: a point on the twin's ground between
    two rings is not missing, although no point of the twin is near it.

    Args:
        points: (N, 3) real points, metres.
        away: (N,) distance of each to the nearest synthetic point, metres.
        origin: (3,) position of the sensor.
        actor: (N,) mask of points on actors, which are excluded, as traffic differs.
        twin: (M, 3) the synthetic points; without them ground between rings is not excluded.
    """
    range_m = np.linalg.norm(points - origin, axis=1)
    lost = away > np.maximum(NEAR_M, SPACING_SHARE * range_m)
    if actor is not None:
        lost &= ~actor
    found = np.column_stack([points[lost], away[lost]])
    if twin is not None and len(found) and len(twin) > _AROUND:
        found = found[~_on_level_ground(found[:, :3] - origin, twin - origin)]
    return found


def _on_level_ground(points: NDArray[np.float64], twin: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the mask of points (K, 3) on level ground between neighbouring points of the twin.

    Neighbours are seen in similar directions from the sensor, at the origin. The line between two
    of them is ground if it is level and not too long.
    """
    _, near = cKDTree(_directions(twin)).query(_directions(points), k=_AROUND)
    first, second = np.triu_indices(_AROUND, 1)
    begin, way = twin[near[:, first]], twin[near[:, second]] - twin[near[:, first]]
    flat = np.hypot(way[..., 0], way[..., 1])
    longest = _LONGEST_SHARE * np.linalg.norm(points, axis=1)[:, None]
    level = (np.abs(way[..., 2]) < _LEVEL * flat) & (flat < longest)
    beyond = points[:, None] - begin
    along = (beyond * way).sum(axis=2) / np.maximum((way**2).sum(axis=2), 1e-12)
    aside = np.linalg.norm(beyond - np.clip(along, 0.0, 1.0)[..., None] * way, axis=2)
    return np.asarray((level & (aside < NEAR_M)).any(axis=1))


def _directions(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return unit vectors to points (N, 3), flattened as rings are farther apart than columns."""
    unit = points / np.maximum(np.linalg.norm(points, axis=1), 1e-9)[:, None]
    return np.asarray(unit * [1.0, 1.0, _FLATTENED])


@dataclass(eq=False)
class MissingPlaces:
    """Collects real points without a surface, over the frames of a comparison."""

    frames: int = 0
    _points: list[NDArray[np.float64]] = field(default_factory=list)

    def add(self, lost: NDArray[np.float64]) -> None:
        """Add the result of `without_surface` for a frame."""
        self.frames += 1
        self._points.append(lost)

    def points(self) -> NDArray[np.float64]:
        """Return all collected points, (K, 3) metres."""
        return np.concatenate([np.zeros((0, 4)), *self._points])[:, :3]

    def places(self) -> list[dict[str, Any]]:
        """Return the cells with most such points: the worst twenty first.

        ``x``, ``y``: mean of the points; ``low``, ``high``: 5th and 95th percentile of z;
        ``points_per_frame``; ``distance_m``: median distance to the nearest synthetic point.
        """
        found = np.concatenate([np.zeros((0, 4)), *self._points])
        if not len(found):
            return []
        cell = np.floor(found[:, :2] / CELL_M).astype(np.int64)
        _, place, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
        rows = []
        for index in np.argsort(-count, kind="stable")[:_LISTED]:
            here = found[place.ravel() == index]
            low, high = np.percentile(here[:, 2], [5, 95])
            x, y = here[:, :2].mean(axis=0)
            rows.append(
                {
                    "x": round(float(x), 2),
                    "y": round(float(y), 2),
                    "low": round(float(low), 2),
                    "high": round(float(high), 2),
                    "points_per_frame": round(len(here) / self.frames, 1),
                    "distance_m": round(float(np.median(here[:, 3])), 2),
                }
            )
        return rows
