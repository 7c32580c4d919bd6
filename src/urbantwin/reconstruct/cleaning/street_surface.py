"""The top surface of a street and the bare surface under it, on a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from urbantwin.reconstruct.cleaning.bare_earth import bare_street
from urbantwin.reconstruct.cleaning.height_grid import Grid, filled
from urbantwin.reconstruct.cleaning.rays import Rays

__all__ = ["REACH_M", "STREET_CELL_M", "WIDEST_M", "Street", "street_of_mesh", "street_of_points"]

#: Cells: fine enough for a gap between two cars, metres.
STREET_CELL_M = 0.25
#: What is narrower stands on the street: two rows of parked cars nose to nose are 10 m, a lane
#: full of vehicles 3 m; rows three abreast always have gaps.
WIDEST_M = 8.0
#: The highest vehicle is 4 m by law (EU 96/53/EC), 4.3 m in North America.
REACH_M = 4.6


@dataclass(frozen=True, eq=False)
class Street:
    """Heights over the roads and around them.

    Attributes:
        grid: its cells.
        bare: (rows, columns) the surface without what is narrower than a street, metres.
        top: (rows, columns) the highest surface within reach of a vehicle over ``bare``; nan
            where there is none.
        asked: (rows, columns) where vehicles are looked for.
        shape: of ``asked``; ``None`` where no roads are known.
    """

    grid: Grid
    bare: NDArray[np.float64]
    top: NDArray[np.float64]
    asked: NDArray[np.bool_]
    shape: shapely.Geometry | None

    @property
    def height(self) -> NDArray[np.float64]:
        """Return heights (rows, columns) over the bare surface, 0 where nothing is known."""
        return np.nan_to_num(self.top - self.bare, nan=0.0)


def street_of_mesh(
    rays: Rays,
    bounds: NDArray[np.float64],
    region: shapely.Geometry,
    roads: shapely.Geometry | None,
    widest_m: float = WIDEST_M,
    reach_m: float = REACH_M,
) -> Street:
    """Return the street as a mesh shows it.

    Args:
        rays: into the mesh.
        bounds: (2, 3) of the mesh.
        region: where to look, site frame, metres.
        roads: carriageways; ``None`` or empty looks everywhere.
        widest_m: what is narrower stands on the street, metres.
        reach_m: how far over the street its top is looked for, metres.
    """
    grid, asked, around, shape = _asked(bounds, region, roads, beside=widest_m)
    lowest = np.full(grid.shape, np.nan)
    xy = grid.centres(around)
    lowest[around] = rays.heights(xy, float(bounds[0, 2]) - 1.0, up=True)
    bare = bare_street(lowest, grid.step, widest_m)
    top = np.full(grid.shape, np.nan)
    top[around] = rays.heights(xy, bare[around] + reach_m)
    return Street(grid, bare, top, asked, shape)


def street_of_points(
    points: NDArray[np.float64],
    region: shapely.Geometry,
    roads: shapely.Geometry | None,
    step: float = STREET_CELL_M,
) -> Street:
    """Return the street as points (N, 3) of a survey show it.

    Args:
        points: site frame, metres.
        region: where to look.
        roads: carriageways; ``None`` or empty looks everywhere.
        step: side of a cell, metres: somewhat more than the distance between points.
    """
    bounds = np.array([points.min(axis=0), points.max(axis=0)])
    grid, asked, _, shape = _asked(bounds, region, roads, step)
    lowest = grid.lowest(points)
    bare = bare_street(lowest, grid.step, WIDEST_M)
    over = points[:, 2] - bare[grid.cells(points[:, :2])]
    top = grid.highest(points[over < REACH_M])
    # A cell that no point fell into between cells of a roof is the roof's.
    gap = np.isnan(top)
    top[gap] = median_filter(filled(top), 3)[gap]
    return Street(grid, bare, top, asked, shape)


def _asked(
    bounds: NDArray[np.float64],
    region: shapely.Geometry,
    roads: shapely.Geometry | None,
    step: float = STREET_CELL_M,
    beside: float = WIDEST_M,
) -> tuple[Grid, NDArray[np.bool_], NDArray[np.bool_], shapely.Geometry | None]:
    box = shapely.box(*bounds[0, :2], *bounds[1, :2])
    if roads is None or roads.is_empty:
        where, shape = shapely.intersection(region, box), None
        near = where
    else:
        shape = shapely.buffer(roads, 0.0)
        where = shapely.intersection(shapely.intersection(shape, region), box)
        near = shapely.intersection(shapely.buffer(where, beside, quad_segs=4), box)
    place = near if not near.is_empty else box
    grid = Grid.over(place.bounds, step)
    return grid, grid.inside(where), grid.inside(near), shape
