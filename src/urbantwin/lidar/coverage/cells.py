"""A grid of square cells over the site, with the height of the ground under it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from urbantwin.errors import InputError
from urbantwin.geometry import DownwardProbe, LabelledMesh
from urbantwin.taxonomy import GROUND_CLASSES, semantic_id

__all__ = ["Cells", "cells_over", "is_ground"]

#: Most cells: four layers of a sensor then take 400 MB.
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


def is_ground(mesh: LabelledMesh, normals: NDArray[np.float64] | None = None) -> NDArray[np.bool_]:
    """Return which faces (F,) are ground that one can stand on: streets, sidewalks, terrain.

    ``normals`` are those of the mesh (F, 3), where they are known.
    """
    ground = np.isin(mesh.semantic, [semantic_id(name) for name in GROUND_CLASSES])
    normals = mesh.normals() if normals is None else normals
    return np.asarray(ground & (normals[:, 2] > _LEAST_UP))


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
    ground = mesh.select(is_ground(mesh))
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
