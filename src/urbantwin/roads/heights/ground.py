"""The ground under carriageways: regressed without cars, curbs and noise."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from urbantwin.ground import Elevation
from urbantwin.roads.grade_separation import Lift

__all__ = ["RoadGround"]

#: Standard deviation of the weights: what takes cars, curbs and noise out of the ground, metres.
SMOOTHING_M = 5.0
#: Cell size of the grid that the regression is solved on, metres.
CELL_M = 2.0
#: Weight of ground beside the road, relative to the ground under it: a canal, a retaining wall or
#: an embankment beside a street does not tilt it; where no road is, the ground goes on.
BESIDE = 0.003


class RoadGround:
    """Local linear regression of the ground under carriageways, and the lift of ramps and bridges.

    At every point a plane is fitted to the cells under carriageways nearby, weighted by a Gaussian
    (Cleveland & Devlin, "Locally weighted regression", JASA 83, 1988): it keeps every plane as it
    is, and a road beside a step in the ground stays on its own side.

    Args:
        elevation: the ground.
        lift: how far roads are lifted off it.
        carriageway: (N, 2) points that cover the carriageways of the ground level densely.
    """

    def __init__(self, elevation: Elevation, lift: Lift, carriageway: NDArray[np.float64]) -> None:
        self._elevation = elevation
        self._lift = lift
        self._carriageway = carriageway

    def __call__(self, xy: NDArray[np.float64], level: int) -> NDArray[np.float64]:
        """Return heights (N,) at points (N, 2) for roads of a level, metres."""
        xy = np.asarray(xy, np.float64).reshape(-1, 2)
        lift = self._lift.at(xy, level)
        if self._elevation.is_flat:
            return np.asarray(lift + self._elevation.raw.flat[0])
        grid, place = self._grid
        where = (xy - place[:2]) / place[2]
        z = map_coordinates(grid, [where[:, 1], where[:, 0]], order=1, mode="nearest")
        return np.asarray(z + lift)

    def lift_at(self, xy: NDArray[np.float64], level: int) -> NDArray[np.float64]:
        """Return how far roads of a level are lifted (N,) at points (N, 2), metres."""
        return self._lift.at(xy, level)

    @cached_property
    def _grid(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Regressed heights, and the place and size of their cells."""
        ground = self._elevation
        block = max(1, round(CELL_M / ground.step))
        weight = np.full(ground.raw.shape, BESIDE)
        cell = np.round((self._carriageway - [ground.west, ground.south]) / ground.step).astype(int)
        rows, columns = ground.raw.shape
        inside = (cell >= 0).all(axis=1) & (cell[:, 0] < columns) & (cell[:, 1] < rows)
        weight[cell[inside, 1], cell[inside, 0]] = 1.0
        # Moments of weight, place and height; the border's cells go on beyond the grid.
        pad = [(0, -n % block) for n in (rows, columns)]
        weight, z = np.pad(weight, pad, mode="edge"), np.pad(ground.raw, pad, mode="edge")
        y, x = (
            np.pad(np.arange(n, dtype=np.float64), side, mode="edge")
            for n, side in zip((rows, columns), pad, strict=True)
        )
        x, y = x[None, :], y[:, None]
        sigma = max(SMOOTHING_M, ground.detail / 2) / ground.step / block

        def moment(value: NDArray[np.float64]) -> NDArray[np.float64]:
            shape = (z.shape[0] // block, block, z.shape[1] // block, block)
            summed = (weight * value).reshape(shape).sum(axis=(1, 3))
            return np.asarray(gaussian_filter(summed, sigma, mode="nearest", truncate=3.0))

        w, wx, wy, wz = moment(np.ones_like(z)), moment(x + 0 * y), moment(y + 0 * x), moment(z)
        wxx, wxy, wyy = moment(x * x + 0 * y), moment(x * y), moment(y * y + 0 * x)
        wxz, wyz = moment(x * z), moment(y * z)
        mx, my, mz = wx / w, wy / w, wz / w
        xx, xy, yy = wxx / w - mx * mx, wxy / w - mx * my, wyy / w - my * my
        xz, yz = wxz / w - mx * mz, wyz / w - my * mz
        scale = xx * yy - xy * xy
        east, north = (yy * xz - xy * yz) / scale, (xx * yz - xy * xz) / scale
        nodes = [(np.arange(n) + 0.5) * block - 0.5 for n in w.shape]
        fitted = mz + east * (nodes[1][None, :] - mx) + north * (nodes[0][:, None] - my)
        step = ground.step * block
        place = np.array(
            [
                ground.west + nodes[1][0] * ground.step,
                ground.south + nodes[0][0] * ground.step,
                step,
            ]
        )
        return fitted, place
