"""Noise removal and thinning of a survey's points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from urbantwin.io.model import PointCloud
from urbantwin.reconstruct.airborne.raster import Raster, filled

__all__ = ["is_noise", "thinned"]

#: ASPRS LAS 1.4-R15, table 17: low point (noise) and high noise.
_NOISE_CLASSES = (7, 18)
#: Minimum number of points in 3 x 3 x 3 voxels around a point, otherwise it is isolated.
_ALONE, _VOXEL_M = 4, 2.0
#: Density (points per square metre) above which clouds are thinned, to one point per voxel of this
#: size.
_DENSE, _THIN_M = 40.0, 0.3
#: Depth below the surroundings from which a point is a reflection, metres.
_DEEP_M = 1.5


def is_noise(cloud: PointCloud) -> NDArray[np.bool_]:
    """Return the mask (N,) of noise: classes 7 and 18, not finite, isolated, or far below."""
    points = cloud.points
    noise = np.asarray(~np.isfinite(points).all(axis=1))
    if cloud.classification is not None:
        noise |= np.isin(cloud.classification, _NOISE_CLASSES)
    good = np.flatnonzero(~noise)
    if len(good) < 10:
        return noise
    alone = good[_few_around(points[good])]
    noise[alone] = True
    good = np.flatnonzero(~noise)
    if not len(good):
        return noise
    noise[good[_deep(points[good])]] = True
    return noise


def thinned(cloud: PointCloud) -> PointCloud:
    """Return one mean point per small voxel if a cloud is very dense.

    Roofs need at most a dozen points per square metre; photogrammetry gives hundreds.
    """
    points = cloud.points
    if len(points) < 1000:
        return cloud
    grid = Raster.over(points.min(axis=0), points.max(axis=0), 2.0)
    count = grid.count(points[:, :2])
    if np.median(count[count > 0]) / 4.0 <= _DENSE:
        return cloud
    voxel = np.floor((points - points.min(axis=0)) / _THIN_M).astype(np.int64)
    sizes = voxel.max(axis=0) + 1
    key = (voxel[:, 0] * sizes[1] + voxel[:, 1]) * sizes[2] + voxel[:, 2]
    _, first, number, size = np.unique(
        key, return_index=True, return_inverse=True, return_counts=True
    )
    sums = [np.bincount(number.ravel(), weights=points[:, axis]) for axis in range(3)]
    keep = np.zeros(len(points), bool)
    keep[first] = True
    mean = (np.column_stack(sums) / size[:, None])[np.argsort(first)]
    return replace(cloud.select(keep), points=mean)


def _few_around(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the mask of points with few others in the 27 voxels around them."""
    voxel = np.floor((points - points.min(axis=0)) / _VOXEL_M).astype(np.int64) + 1
    sizes = voxel.max(axis=0) + 2
    key = (voxel[:, 0] * sizes[1] + voxel[:, 1]) * sizes[2] + voxel[:, 2]
    keys, inverse, count = np.unique(key, return_inverse=True, return_counts=True)
    around = np.zeros(len(keys), np.int64)
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            for dz in (-1, 0, 1):
                other = keys + (dx * sizes[1] + dy) * sizes[2] + dz
                place = np.minimum(np.searchsorted(keys, other), len(keys) - 1)
                around += np.where(keys[place] == other, count[place], 0)
    return (around < _ALONE)[inverse.ravel()]


def _deep(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the mask of points far below the lowest points of surrounding cells."""
    grid = Raster.over(points.min(axis=0), points.max(axis=0), 2.0)
    lowest = filled(grid.extreme(points))
    usual = median_filter(lowest, size=7)
    cell = grid.cells(points[:, :2])
    # In the cell of a false pit few points are deep; in a canal or cutting all are.
    below = points[:, 2] < usual.ravel()[cell] - _DEEP_M
    share = np.bincount(cell[below], minlength=lowest.size) / np.maximum(
        np.bincount(cell, minlength=lowest.size), 1
    )
    return np.asarray(below & (share[cell] < 0.1))
