"""The elevation of the bare earth as a grid in the site frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

__all__ = ["SMOOTHING_M", "Elevation"]

#: Standard deviation of the filter that takes cars, curbs and noise out of what roads lie on.
SMOOTHING_M = 5.0


@dataclass(frozen=True, eq=False)
class Elevation:
    """Heights above the anchor's ground.

    The smooth grid is the raw one filtered by a Gaussian (standard deviation ``SMOOTHING_M``). A
    weighted mean with positive weights has no gradient steeper than the steepest that it
    averages, so a road on it has no grade that the ground does not have.

    Attributes:
        west, south: position of the first cell's centre, site frame, metres.
        step: cell size, metres.
        raw: (rows from south to north, columns from west to east) float64, metres.
        source_step: cell size of the model that the grid was resampled from, metres; 0 where the
            grid is the source.
    """

    west: float
    south: float
    step: float
    raw: NDArray[np.float64]
    source_step: float = 0.0

    @property
    def detail(self) -> float:
        """Size of the smallest things that the heights can show, metres."""
        return max(self.step, self.source_step)

    @classmethod
    def flat(cls) -> Elevation:
        """Return a level plain at the anchor's height."""
        return cls(-1.0, -1.0, 1.0, np.zeros((3, 3)))

    @property
    def is_flat(self) -> bool:
        """Whether every height is the same."""
        return bool(np.ptp(self.raw) == 0)

    @cached_property
    def smooth(self) -> NDArray[np.float64]:
        """The grid that roads lie on; same shape as ``raw``."""
        return np.asarray(gaussian_filter(self.raw, SMOOTHING_M / self.step, mode="nearest"))

    def raw_at(self, xy: ArrayLike) -> NDArray[np.float64]:
        """Return bare-earth heights (N,) at (N, 2) points, bilinear; the border's value beyond."""
        return self._sample(self.raw, xy)

    def smooth_at(self, xy: ArrayLike) -> NDArray[np.float64]:
        """Return the heights (N,) that roads lie on at (N, 2) points."""
        return self._sample(self.smooth, xy)

    def _sample(self, grid: NDArray[np.float64], xy: ArrayLike) -> NDArray[np.float64]:
        points = np.asarray(xy, np.float64).reshape(-1, 2)
        rows = (points[:, 1] - self.south) / self.step
        columns = (points[:, 0] - self.west) / self.step
        return np.asarray(map_coordinates(grid, [rows, columns], order=1, mode="nearest"))

    def save(self, path: Path) -> None:
        """Write a ``.npz``; the same grid gives the same bytes."""
        np.savez_compressed(
            path,
            raw=self.raw,
            place=np.array([self.west, self.south, self.step, self.source_step], np.float64),
        )

    @classmethod
    def load(cls, path: Path) -> Elevation:
        """Read what ``save`` wrote."""
        with np.load(path) as data:
            west, south, step, *source = (float(v) for v in data["place"])
            return cls(west, south, step, data["raw"], *source)
