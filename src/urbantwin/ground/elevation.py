"""The elevation of the bare earth: a grid in the site frame, and patches merged into it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import distance_transform_edt, map_coordinates

from urbantwin.artefact.arrays import ArrayOf, read_arrays
from urbantwin.errors import InputError
from urbantwin.site import grid_step_m

__all__ = ["Elevation", "ElevationPatch", "merged_elevation"]

_EXPECTED = "a twin's grid of heights"
#: Arrays in the file, metres, limited to positions and heights on Earth.
_FORM = {
    "raw": ArrayOf("f8", ("rows", "columns"), least=-20_000, most=20_000),
    "place": ArrayOf("f8", ("P",), least=-1e7, most=1e7),
}


@dataclass(frozen=True, eq=False)
class Elevation:
    """Heights relative to the anchor's ground.

    Attributes:
        west: x of the first cell's centre, site frame, metres.
        south: y of the first cell's centre, site frame, metres.
        step: cell size, metres.
        raw: (rows from south to north, columns from west to east) float64, metres.
        source_step: cell size of the source model of a resampled grid, metres; 0 if the grid is the
            source.
    """

    west: float
    south: float
    step: float
    raw: NDArray[np.float64]
    source_step: float = 0.0

    @property
    def detail(self) -> float:
        """Size of the smallest features that the heights resolve, metres."""
        return max(self.step, self.source_step)

    @classmethod
    def flat(cls) -> Elevation:
        """Return a horizontal plane at the anchor's height."""
        return cls(-1.0, -1.0, 1.0, np.zeros((3, 3)))

    @property
    def is_flat(self) -> bool:
        """Whether every height is the same."""
        return bool(np.ptp(self.raw) == 0)

    def raw_at(self, xy: ArrayLike) -> NDArray[np.float64]:
        """Return bare-earth heights (N,) at points (N, 2), bilinear; clamped at the border."""
        points = np.asarray(xy, np.float64).reshape(-1, 2)
        rows = (points[:, 1] - self.south) / self.step
        columns = (points[:, 0] - self.west) / self.step
        return np.asarray(map_coordinates(self.raw, [rows, columns], order=1, mode="nearest"))

    def save(self, path: Path) -> None:
        """Write a ``.npz``; the same grid gives the same bytes."""
        np.savez_compressed(
            path,
            raw=self.raw,
            place=np.array([self.west, self.south, self.step, self.source_step], np.float64),
        )

    @classmethod
    def load(cls, path: Path) -> Elevation:
        """Read a file written by ``save``.

        Raises:
            InputError: missing, damaged, or no grid of heights.
        """
        data = read_arrays(path, _EXPECTED, _FORM)
        place = data["place"].tolist()
        # Grids of earlier versions lack the cell size of their source.
        if len(place) not in (3, 4) or place[2] <= 0 or min(place[3:], default=0) < 0:
            problem = "is not the place of a grid"
            raise InputError(problem, file=path, place="place", expected=_EXPECTED)
        if not data["raw"].size:
            raise InputError("has no heights", file=path, place="raw", expected=_EXPECTED)
        west, south, step, *source = place
        return cls(west, south, step, data["raw"], *source[:1])


@dataclass(frozen=True, eq=False)
class ElevationPatch:
    """Bare-earth heights of one source on a grid.

    Attributes:
        west: x of the first node, site frame, metres.
        south: y of the first node, site frame, metres.
        step: distance between nodes, metres.
        heights: (rows from south to north, columns from west to east) float64 metres above the
            anchor's ground; nan if unknown.
        detail_m: size of the smallest features of the source, metres (point spacing, cell).
        name: name of the source.
    """

    west: float
    south: float
    step: float
    heights: NDArray[np.float64]
    detail_m: float
    name: str


#: Width along its border in which a finer source is blended into a coarser one, metres, to avoid a
#: step between two surveys.
BLEND_M = 4.0
#: Number of nodes beyond the region for bilinear interpolation.
PAD = 2


def merged_elevation(
    patches: Sequence[ElevationPatch], region: shapely.Polygon
) -> tuple[Elevation, dict[str, float]]:
    """Merge the bare earth of several sources into one grid that covers a region.

    Where two sources overlap, the finer one is used, blended into the coarser one within
    ``BLEND_M`` of its border. Holes without a source (the ground under buildings) are filled from
    their rims (GDAL's inverse-distance fill), and cells beyond all sources get the nearest height.

    Args:
        patches: at least one; heights above the anchor's ground.
        region: area to cover, site frame, metres.

    Returns:
        the elevation, and each source's share of the region in its order of use.

    Raises:
        InputError: no source has a height within the region.
    """
    low, high = np.reshape(region.bounds, (2, 2))
    low, high = np.minimum(low, 0.0), np.maximum(high, 0.0)
    step = grid_step_m(min(p.detail_m for p in patches), (*low, *high))
    first = np.floor(low / step).astype(int) - PAD
    columns, rows = np.ceil(high / step).astype(int) + PAD - first + 1
    x, y = np.meshgrid((first[0] + np.arange(columns)) * step, (first[1] + np.arange(rows)) * step)
    heights = np.full(x.shape, np.nan)
    inside = shapely.contains_xy(region, x, y)
    shares: dict[str, float] = {}
    for patch in sorted(patches, key=lambda p: -p.detail_m):
        own = _resampled(patch, x, y)
        known = np.isfinite(own)
        if not known[inside].any():
            continue
        weight = np.clip(
            distance_transform_edt(np.pad(known, 1))[1:-1, 1:-1] * step / BLEND_M, 0, 1
        )
        weight = np.where(np.isnan(heights), 1.0, weight)
        heights = np.where(known, weight * np.nan_to_num(own), 0.0) + np.where(
            known, (1 - weight) * np.nan_to_num(heights), heights
        )
        shares[patch.name] = round(float(known[inside].mean()), 4)
    if not shares:
        names = ", ".join(p.name for p in patches)
        raise InputError(f"{names}: no height of the ground within the region")
    detail = min(p.detail_m for p in patches if p.name in shares)
    west, south = first * step
    return Elevation(float(west), float(south), step, _filled(heights), detail), shares


def _resampled(
    patch: ElevationPatch, x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return a patch's heights at points, bilinear; nan if one of the four nodes has none."""
    where = [(y - patch.south) / patch.step, (x - patch.west) / patch.step]
    rows, columns = patch.heights.shape
    slack = 1e-9
    beyond = (where[0] < -slack) | (where[0] > rows - 1 + slack)
    beyond |= (where[1] < -slack) | (where[1] > columns - 1 + slack)
    known = np.isfinite(patch.heights)
    share = map_coordinates(known.astype(np.float64), where, order=1, mode="nearest")
    value = map_coordinates(np.where(known, patch.heights, 0.0), where, order=1, mode="nearest")
    return np.where(beyond | (share < 1 - 1e-6), np.nan, value)


def _filled(heights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the grid without nan."""
    known = np.isfinite(heights)
    if known.all():
        return heights
    rows, columns = distance_transform_edt(~known, return_distances=False, return_indices=True)
    nearest = heights[rows, columns]
    # Centred, since GDAL computes in single precision, so that heights keep their millimetres.
    middle = float(np.mean(heights[known]))
    from rasterio.fill import fillnodata

    smooth = fillnodata(
        (nearest - middle).astype(np.float32),
        mask=known.astype(np.uint8),
        max_search_distance=float(max(heights.shape)),
        smoothing_iterations=2,
    )
    return np.where(known, heights, smooth.astype(np.float64) + middle)
