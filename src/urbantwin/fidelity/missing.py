"""What to mend next: places where real points have nothing of the twin near them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["CELL_M", "NEAR_M", "SPACING_SHARE", "MissingPlaces", "without_surface"]

#: A real point farther from every synthetic point than this has no surface, metres; or than
#: this share of its range, where a sensor's points themselves lie that far apart.
NEAR_M = 0.5
SPACING_SHARE = 0.02
#: Edge of the cells in plan that such points are gathered in, metres.
CELL_M = 4.0
_LISTED = 20


def without_surface(
    points: NDArray[np.float64],
    away: NDArray[np.float64],
    origin: NDArray[np.float64],
    actor: NDArray[np.bool_] | None = None,
) -> NDArray[np.float64]:
    """Return the real points that have nothing of the twin near them, (K, 4): x, y, z, distance.

    Args:
        points: (N, 3) real points, metres.
        away: (N,) distance of each to the nearest synthetic point, metres.
        origin: (3,) the sensor's place.
        actor: (N,) points of actors, which are left out: traffic differs, places do not.
    """
    range_m = np.linalg.norm(points - origin, axis=1)
    lost = away > np.maximum(NEAR_M, SPACING_SHARE * range_m)
    if actor is not None:
        lost &= ~actor
    return np.column_stack([points[lost], away[lost]])


@dataclass(eq=False)
class MissingPlaces:
    """Gathers real points without a surface, over the frames of a comparison."""

    frames: int = 0
    _points: list[NDArray[np.float64]] = field(default_factory=list)

    def add(self, lost: NDArray[np.float64]) -> None:
        """Add what `without_surface` found of a frame."""
        self.frames += 1
        self._points.append(lost)

    def points(self) -> NDArray[np.float64]:
        """Return all of them, (K, 3) metres."""
        return np.concatenate([np.zeros((0, 4)), *self._points])[:, :3]

    def places(self) -> list[dict[str, Any]]:
        """Return the cells with most such points: the worst twenty first.

        ``x``, ``y``: the points' middle; ``low``, ``high``: 5th and 95th percentile of z;
        ``points_per_frame``; ``distance_m``: median to the nearest synthetic point.
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
