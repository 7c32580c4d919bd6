"""The ground plane of one frame: height of the sensor above it, and its tilt."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import row_keys

__all__ = ["GroundPlane", "ground_plane", "leveling", "thinned"]

#: Maximum distance of ground points from the plane, metres.
_THICK_M = 0.15
#: Maximum distances of ground points from the sensor, as streets bend and slope farther away. The
#: second is used if the first gives no plane, as for sensors on high poles.
_NEAR_M = (30.0, 60.0)
#: Maximum tilt of the sensor's z axis.
MOST_TILT_DEG = 60.0
_TRIES = 600
_CELL_M = 0.5
_LEAST_POINTS = 30


@dataclass(frozen=True, eq=False)
class GroundPlane:
    """The ground plane around a sensor.

    Attributes:
        normal: (3,) unit vector in the frame of the points, away from the ground.
        height_m: height of the frame's origin above the plane.
        share: share of the cells around the sensor, or of their columns, with points on the plane.
        sigma_m: root mean square distance of those points from it.
    """

    normal: NDArray[np.float64]
    height_m: float
    share: float
    sigma_m: float

    def above(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the height of (N, 3) points above the plane, metres."""
        return np.asarray(points @ self.normal + self.height_m)


def ground_plane(points: NDArray[np.float64], seed: int = 0) -> GroundPlane | None:
    """Return the ground: the plane with most points on it and few below.

    RANSAC (Fischler and Bolles 1981) over one point per cell of 0.5 m, so that near rings do not
    dominate, and least squares on the points of the best plane.

    Args:
        points: (N, 3) metres, frame of the sensor, z roughly upward.
        seed: seed of the tested planes.

    Returns:
        ``None`` if no plane under the sensor holds a tenth of the cells or of their columns.
    """
    away = np.linalg.norm(points, axis=1)
    found = (_plane(points[away < near], seed) for near in _NEAR_M)
    return next((one for one in found if one is not None), None)


def _plane(near: NDArray[np.float64], seed: int) -> GroundPlane | None:
    """Return the plane of points (N, 3), all of which are used; see `ground_plane`."""
    cells = near[thinned(near, _CELL_M)]
    if len(cells) < _LEAST_POINTS:
        return None
    generator = np.random.default_rng(seed)
    # Half of the planes pass through any three cells, half through the lowest of their columns.
    # Between facades few cells are ground, and with a tilted sensor the lowest ones are not.
    lowest = cells[_lowest(cells)]
    corners = np.concatenate(
        [some[generator.integers(0, len(some), (_TRIES, 3))] for some in (cells, lowest)]
    )
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    fit = length > 1.0
    normal = normal[fit] / length[fit, None]
    normal *= np.where(normal[:, 2:] < 0, -1.0, 1.0)
    height = -(normal * corners[fit, 0]).sum(axis=1)
    possible = (normal[:, 2] > np.cos(np.radians(MOST_TILT_DEG))) & (height > 0.2)
    normal, height = normal[possible], height[possible]
    if not len(normal):
        return None
    above = cells @ normal.T + height
    score = (np.abs(above) < _THICK_M).sum(axis=0) - 2.0 * (above < -3 * _THICK_M).sum(axis=0)
    best = int(score.argmax())
    found, up = normal[best], float(height[best])
    for _ in range(5):
        on = np.abs(cells @ found + up) < _THICK_M
        if on.sum() < _LEAST_POINTS:
            return None
        middle = cells[on].mean(axis=0)
        found = np.linalg.svd(cells[on] - middle, full_matrices=False)[2][2]
        found = found * np.sign(found[2])
        up = float(-found @ middle)
    on = np.abs(cells @ found + up) < _THICK_M
    columns = np.abs(lowest @ found + up) < _THICK_M
    share = max(float(on.mean()), float(columns.mean()))
    if share < 0.1 or up <= 0:
        return None
    return GroundPlane(found, up, share, float(np.sqrt(((cells[on] @ found + up) ** 2).mean())))


def _lowest(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the indices of the lowest of (N, 3) points in every column of 2 m."""
    order = np.argsort(points[:, 2], kind="stable")
    column = np.floor(points[order, :2] / 2.0).astype(np.int64)
    return np.asarray(order[np.unique(row_keys(column), axis=0, return_index=True)[1]])


def leveling(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the smallest rotation (3, 3) from a unit vector to +z."""
    x, y, z = normal
    turned = 1.0 / (1.0 + z)
    return np.array(
        [
            [1.0 - x * x * turned, -x * y * turned, -x],
            [-x * y * turned, 1.0 - y * y * turned, -y],
            [x, y, z],
        ]
    )


def thinned(points: NDArray[np.float64], cell_m: float) -> NDArray[np.int64]:
    """Return the indices (K,) of the first of (N, 3) points in every cell."""
    keys = np.floor(points / cell_m).astype(np.int64)
    _, first = np.unique(row_keys(keys), axis=0, return_index=True)
    return np.sort(first)
