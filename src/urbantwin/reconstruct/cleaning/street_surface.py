"""Top surface of a street and the bare surface under it, on a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import grey_opening, median_filter

from urbantwin.reconstruct.cleaning.height_grid import Grid, filled
from urbantwin.reconstruct.cleaning.rays import Rays

__all__ = [
    "REACH_M",
    "STREET_CELL_M",
    "WIDEST_M",
    "Street",
    "bare_earth",
    "street_of_mesh",
    "street_of_points",
]


def bare_street(lowest: NDArray[np.float64], step: float, widest_m: float) -> NDArray[np.float64]:
    """Return the surface without objects narrower than ``widest_m``.

    A morphological opening removes what a square of that size cannot enter from below. Planes of
    any slope are unchanged, and so are steps between two wider surfaces.

    Args:
        lowest: (rows, columns) heights of the lowest surface, metres; nan if unknown.
        step: cell size, metres.
        widest_m: maximum width of removed objects, metres.
    """
    size = 2 * int(np.ceil(widest_m / step / 2)) + 1
    # the filter removes single-cell pits (noise), which would lower the whole window
    return np.asarray(grey_opening(median_filter(filled(lowest), 3), size, mode="nearest"))


def bare_earth(
    lowest: NDArray[np.float64],
    step: float,
    *,
    slope: float = 0.2,
    widest_m: float = 60.0,
    least_m: float = 0.3,
) -> NDArray[np.bool_]:
    """Return the mask of cells (rows, columns) that show the bare earth.

    The simple morphological filter of Pingel, Clarke and McBride (2013, ISPRS J. 77, 21-30): the
    surface is opened with increasing windows; cells that an opening lowers by more than the terrain
    can rise over that window are objects.

    Args:
        lowest: heights of the lowest surface, metres; nan if unknown.
        step: cell size, metres.
        slope: steepest terrain, rise over run.
        widest_m: widest building, metres.
        least_m: height above the surroundings below which cells are ground.
    """
    surface = filled(lowest)
    # Pits are noise, closed as in the paper's first step.
    pit = -(grey_opening(-surface, 3, mode="nearest")) - surface > 1.0
    surface = np.where(pit, median_filter(surface, 5), surface)
    stands = pit
    last = surface
    reach, before = 1, 0
    while before * 2 * step < widest_m:
        opened = grey_opening(last, 2 * reach + 1, mode="nearest")
        stands |= last - opened > max(least_m, slope * reach * step)
        last = opened
        before, reach = reach, max(reach + 1, int(reach * 1.5))
    # Exclude cells without a surface.
    return np.asarray(~(stands | np.isnan(lowest)))


#: Cell size, fine enough for a gap between two cars, metres.
STREET_CELL_M = 0.25
#: Maximum width of objects on the street, metres: two rows of parked cars nose to nose are 10 m, a
#: lane of vehicles 3 m; rows three abreast always have gaps.
WIDEST_M = 8.0
#: Maximum height of vehicles with margin, metres: 4 m by law (EU 96/53/EC), 4.3 m in North America.
REACH_M = 4.6


@dataclass(frozen=True, eq=False)
class Street:
    """Heights of the roads and their surroundings.

    Attributes:
        grid: its cells.
        bare: (rows, columns) the surface without objects narrower than a street, metres.
        top: (rows, columns) the highest surface within the height of a vehicle above ``bare``; nan
            if there is none.
        asked: (rows, columns) mask of the cells to search for vehicles.
        shape: outline of the roads; ``None`` if unknown.
    """

    grid: Grid
    bare: NDArray[np.float64]
    top: NDArray[np.float64]
    asked: NDArray[np.bool_]
    shape: shapely.Geometry | None

    @property
    def height(self) -> NDArray[np.float64]:
        """Return heights (rows, columns) above the bare surface, 0 if unknown."""
        return np.nan_to_num(self.top - self.bare, nan=0.0)


def street_of_mesh(
    rays: Rays,
    bounds: NDArray[np.float64],
    region: shapely.Geometry,
    roads: shapely.Geometry | None,
    widest_m: float = WIDEST_M,
    reach_m: float = REACH_M,
) -> Street:
    """Return the street surface of a mesh.

    Args:
        rays: ray caster of the mesh.
        bounds: (2, 3) bounds of the mesh.
        region: search region, site frame, metres.
        roads: carriageways; ``None`` or empty searches everywhere.
        widest_m: maximum width of objects on the street, metres.
        reach_m: maximum height of their top above the street, metres.
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
    """Return the street surface of survey points (N, 3).

    Args:
        points: site frame, metres.
        region: search region.
        roads: carriageways; ``None`` or empty searches everywhere.
        step: cell size, metres, larger than the distance between points.
    """
    bounds = np.array([points.min(axis=0), points.max(axis=0)])
    grid, asked, _, shape = _asked(bounds, region, roads, step)
    lowest = grid.lowest(points)
    bare = bare_street(lowest, grid.step, WIDEST_M)
    over = points[:, 2] - bare[grid.cells(points[:, :2])]
    top = grid.highest(points[over < REACH_M])
    # Empty cells between cells of a roof belong to the roof.
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
