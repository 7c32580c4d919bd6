"""A grid of square cells over the site, and rays through the air above its ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from urbantwin.errors import InputError
from urbantwin.geometry import DownwardProbe, LabelledMesh
from urbantwin.geometry.compiled import per_block

__all__ = ["BAND_M", "LEVEL_M", "STEP_M", "Cells", "Passage", "cells_over", "traverse"]

#: Height above the ground at which surfaces are imagined, and the band of heights about it, metres.
LEVEL_M = 1.0
BAND_M = 1.0
#: Step of the table of weights by range, metres.
STEP_M = 0.1

#: Maximum number of cells: four layers of a sensor then take 400 MB.
_MOST_CELLS = 25_000_000
#: Steeper faces are sides of curbs and walls, not ground.
_LEAST_UP = 0.1


@dataclass(frozen=True, eq=False)
class Cells:
    """Square cells in rows from the south and columns from the west, site frame.

    Attributes:
        x0: west edge, metres.
        y0: south edge, metres.
        size_m: side of a cell.
        height_m: (ny + 1, nx + 1) float64, height of the ground at the corners of the cells; of
            several levels the highest. Where there is no ground, that of the nearest corner with.
        semantic: (ny, nx) uint16, class of the ground at the middle of a cell; 0 for no ground.
    """

    x0: float
    y0: float
    size_m: float
    height_m: NDArray[np.float64]
    semantic: NDArray[np.uint16]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.semantic.shape[0], self.semantic.shape[1]

    def numbers(self, xy: NDArray[np.floating]) -> NDArray[np.int64]:
        """Return the cell (N,) of places (N, 2), ``row * columns + column``; -1 outside."""
        rows, columns = self.shape
        column = np.floor((xy[:, 0] - self.x0) / self.size_m)
        row = np.floor((xy[:, 1] - self.y0) / self.size_m)
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return np.where(inside, row * columns + column, -1).astype(np.int64)


def cells_over(
    mesh: LabelledMesh, bounds: tuple[float, float, float, float], size_m: float
) -> Cells:
    """Lay cells over a part of the site.

    Args:
        mesh: the static world, site frame.
        bounds: west, south, east and north edge, metres; the far edges move out to whole cells.
        size_m: side of a cell.

    Raises:
        InputError: no ground, or a cell that is not above zero or too small for the site.
    """
    west, south, east, north = bounds
    if not (np.isfinite(size_m) and size_m > 0):
        raise InputError(f"a cell of {size_m:g} m", place="cell", expected="a side above 0 m")
    # Compared as floats: a tiny cell overflows integers.
    across, along = (east - west) / size_m, (north - south) / size_m
    if across * along > _MOST_CELLS:
        raise InputError(
            f"cells of {size_m:g} m are {across * along:.3g} over {east - west:g} x "
            f"{north - south:g} m",
            place="cell",
            expected=f"at most {_MOST_CELLS:,}: a larger cell",
        )
    columns, rows = max(1, int(np.ceil(across - 1e-9))), max(1, int(np.ceil(along - 1e-9)))
    ground = mesh.select(mesh.is_ground & (mesh.normals()[:, 2] > _LEAST_UP))
    if not len(ground.faces):
        raise InputError("there is no ground to cover", expected="a twin with a street or terrain")
    probe = DownwardProbe(ground)
    above = float(ground.vertices[:, 2].max()) + 1.0

    def over(x: NDArray[np.floating], y: NDArray[np.floating]) -> NDArray[np.float64]:
        places = np.meshgrid(x, y)
        return np.stack([*places, np.full(places[0].shape, above)], axis=-1).reshape(-1, 3)

    x, y = west + size_m * np.arange(columns + 1), south + size_m * np.arange(rows + 1)
    height = probe.height_below(over(x, y)).reshape(rows + 1, columns + 1)
    unknown = np.isnan(height)
    if unknown.all():
        raise InputError("there is no ground in the region", expected="a region with ground")
    if unknown.any():
        nearest = distance_transform_edt(unknown, return_distances=False, return_indices=True)
        height = height[tuple(nearest)]
    face = probe.face_below(over(x[:-1] + size_m / 2, y[:-1] + size_m / 2))
    semantic = np.where(face >= 0, ground.semantic[face], 0).astype(np.uint16)
    return Cells(west, south, size_m, height, semantic.reshape(rows, columns))


class Passage(NamedTuple):
    """Where N rays pass `LEVEL_M` above the ground, and how long they stay near that height.

    Attributes:
        cell: (N,) int64, cell in which the ray first passes `LEVEL_M` above the ground; -1 where
            it nowhere does.
        range_m: (N,) float64, where on the ray that is; ``inf`` where it nowhere is.
        length_m: (ny, nx) float64, metres of rays within `BAND_M` about that height, by cell, each
            metre times the weight of its range.
    """

    cell: NDArray[np.int64]
    range_m: NDArray[np.float64]
    length_m: NDArray[np.float64]


def traverse(
    cells: Cells,
    origin: NDArray[np.float64],
    directions: NDArray[np.floating],
    reach_m: NDArray[np.floating],
    weight: NDArray[np.float64],
) -> Passage:
    """Follow rays from cell to cell (Amanatides and Woo 1987, Eurographics).

    The ground within a cell is bilinear between its corners; a ray's height above it is taken as
    linear there.

    Args:
        cells: the grid.
        origin: (3,) where the rays leave, site frame, metres.
        directions: (N, 3) unit vectors, site frame.
        reach_m: (N,) where each ray ends.
        weight: (W,) what a metre of a ray counts at ranges from k to k + 1 tenths of a metre; 0
            beyond the last.
    """
    count = len(directions)
    passage = Passage(
        np.full(count, -1, np.int64), np.full(count, np.inf), np.zeros(cells.shape, np.float64)
    )
    _traverse(
        cells.height_m,
        np.array([cells.x0, cells.y0, cells.size_m]),
        np.asarray(origin, np.float64),
        np.ascontiguousarray(directions, np.float64),
        np.asarray(reach_m, np.float64),
        weight,
        *passage,
    )
    return passage


@per_block
def _height(heights, x, y):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return the height at a place counted in cells."""
    rows, columns = heights.shape[0] - 1, heights.shape[1] - 1
    column = min(max(int(x), 0), columns - 1)
    row = min(max(int(y), 0), rows - 1)
    right, up = min(max(x - column, 0.0), 1.0), min(max(y - row, 0.0), 1.0)
    low = heights[row, column] * (1 - right) + heights[row, column + 1] * right
    high = heights[row + 1, column] * (1 - right) + heights[row + 1, column + 1] * right
    return low * (1 - up) + high * up


@per_block
def _traverse(  # type: ignore[no-untyped-def]  # noqa: ANN202, PLR0912, PLR0913, PLR0915, PLR0917
    heights, grid, origin, directions, reach, weight,  # noqa: ANN001
    cell_out, range_out, length_out,  # noqa: ANN001
):  # fmt: skip
    rows, columns = length_out.shape
    size = grid[2]
    x0, y0 = (origin[0] - grid[0]) / size, (origin[1] - grid[1]) / size
    ceiling = heights.max() + LEVEL_M + BAND_M / 2
    farthest = len(weight) * STEP_M
    for ray in range(len(directions)):
        dx, dy = directions[ray, 0] / size, directions[ray, 1] / size
        dz = directions[ray, 2]
        # The part of the ray over the grid and not above everything that is looked at.
        t, end = 0.0, min(reach[ray], farthest)
        for start, slope, most in ((x0, dx, columns), (y0, dy, rows)):
            if slope == 0.0:
                if start < 0.0 or start >= most:
                    end = -1.0
                continue
            one, other = -start / slope, (most - start) / slope
            t, end = max(t, min(one, other)), min(end, max(one, other))
        if dz < 0.0:
            t = max(t, (ceiling - origin[2]) / dz)
        elif dz > 0.0:
            end = min(end, (ceiling - origin[2]) / dz)
        elif origin[2] > ceiling:
            end = -1.0
        if t >= end:
            continue
        column = min(max(int(np.floor(x0 + dx * t)), 0), columns - 1)
        row = min(max(int(np.floor(y0 + dy * t)), 0), rows - 1)
        above = origin[2] + dz * t - _height(heights, x0 + dx * t, y0 + dy * t)
        while t < end:
            # Where the ray leaves this cell.
            out, sideways = end, 0
            if dx != 0.0:
                edge = ((column + 1 if dx > 0.0 else column) - x0) / dx
                if edge < out:
                    out, sideways = edge, 1
            if dy != 0.0:
                edge = ((row + 1 if dy > 0.0 else row) - y0) / dy
                if edge < out:
                    out, sideways = edge, 2
            out = max(out, t)
            there = origin[2] + dz * out - _height(heights, x0 + dx * out, y0 + dy * out)
            change, length = there - above, out - t
            if cell_out[ray] < 0 and (above - LEVEL_M) * (there - LEVEL_M) <= 0.0:
                share = 0.0 if change == 0.0 else (LEVEL_M - above) / change
                cell_out[ray] = row * columns + column
                range_out[ray] = t + share * length
            low, high = LEVEL_M - BAND_M / 2, LEVEL_M + BAND_M / 2
            if change == 0.0:
                first, last = (0.0, 1.0) if low <= above <= high else (0.0, 0.0)
            else:
                one, other = (low - above) / change, (high - above) / change
                first, last = max(0.0, min(one, other)), min(1.0, max(one, other))
            if last > first:
                number = int((t + 0.5 * (first + last) * length) / STEP_M)
                if number < len(weight):
                    length_out[row, column] += (last - first) * length * weight[number]
            t, above = out, there
            if sideways == 1:
                column += 1 if dx > 0.0 else -1
            elif sideways == 2:
                row += 1 if dy > 0.0 else -1
            else:
                break
            if column < 0 or row < 0 or column >= columns or row >= rows:
                break
