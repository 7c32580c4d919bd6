"""Bare-earth points, by the survey's classes or by a morphological filter.

The filter is SMRF (Pingel, Clarke and McBride 2013, "An improved simple morphological filter for
the terrain classification of airborne LIDAR data", ISPRS J. 77), which opens the surface of lowest
points with growing windows as Zhang et al. 2003 ("A progressive morphological filter for removing
nonground measurements from airborne LIDAR data", IEEE TGRS 41(4)) do.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, gaussian_gradient_magnitude, grey_opening

from urbantwin.io.model import PointCloud
from urbantwin.reconstruct.airborne.raster import Raster, filled

__all__ = ["GROUND", "WATER", "ground_by_filter", "has_ground_class", "inside_any"]

#: ASPRS LAS 1.4-R15, table 17.
GROUND, WATER = 2, 9
#: Parameters of SMRF, from Pingel et al. 2013, section 4 (their optimum over the ISPRS samples is
#: slope 0.15, window 18 m, elevation threshold 0.5 m, scaling 1.25 at cells of 1 m). The window is
#: wider here: blocks in cities are.
_CELL_M, _SLOPE, _WINDOW_M, _HEIGHT_M, _SCALING = 1.0, 0.15, 30.0, 0.4, 1.25


def has_ground_class(cloud: PointCloud) -> bool:
    """Return whether a survey classifies ground: at least one point in 200."""
    if cloud.classification is None or not len(cloud.points):
        return False
    return bool((cloud.classification == GROUND).mean() > 0.005)


def ground_by_filter(
    points: NDArray[np.float64], footprints: Sequence[shapely.Polygon] = ()
) -> NDArray[np.bool_]:
    """Return the mask (N,) of bare-earth points by SMRF.

    Args:
        points: (N, 3) without noise, metres.
        footprints: outlines of buildings, in which nothing is ground.
    """
    grid = Raster.over(points.min(axis=0), points.max(axis=0), _CELL_M)
    lowest = grid.extreme(points)
    if footprints:
        east, north = grid.middles()
        lowest[inside_any(footprints, np.column_stack([east.ravel(), north.ravel()]))
               .reshape(grid.shape)] = np.nan  # fmt: skip
    surface = filled(lowest)
    thing = np.isnan(lowest)
    opened = surface
    for radius in range(1, int(_WINDOW_M / _CELL_M) + 1):
        size = 2 * radius + 1
        # A square and its 45 degree rotation form an octagon, similar to SMRF's disk.
        lower = grey_opening(opened, size=(size, size), mode="nearest")
        thing |= opened - lower > _SLOPE * radius * _CELL_M
        opened = lower
    bare = filled(np.where(thing, np.nan, surface))
    slope = gaussian_gradient_magnitude(bare, 1.0) / _CELL_M
    xy = points[:, :2]
    allowed = _HEIGHT_M + _SCALING * grid.sample(slope, xy) * _CELL_M
    near = np.abs(points[:, 2] - grid.sample(bare, xy)) <= allowed
    # Feet of walls extend into object cells: no ground where all neighbours are objects.
    deep = ~binary_dilation(~thing, np.ones((3, 3)))
    cell = grid.cells(xy)
    near &= ~deep.ravel()[cell]
    if footprints:
        near &= ~inside_any(footprints, xy)
    return near


def inside_any(footprints: Sequence[shapely.Polygon], xy: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the mask (N,) of points inside any outline."""
    if not len(footprints):
        return np.zeros(len(xy), bool)
    area = shapely.union_all(list(footprints))
    shapely.prepare(area)
    return np.asarray(shapely.contains_xy(area, xy))
