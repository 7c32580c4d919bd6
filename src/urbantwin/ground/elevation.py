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
#: The arrays in the file, in metres: places and heights within what the Earth has.
_FORM = {
    "raw": ArrayOf("f8", ("rows", "columns"), least=-20_000, most=20_000),
    "place": ArrayOf("f8", ("P",), least=-1e7, most=1e7),
}


@dataclass(frozen=True, eq=False)
class Elevation:
    """Heights above the anchor's ground.

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

    def raw_at(self, xy: ArrayLike) -> NDArray[np.float64]:
        """Return bare-earth heights (N,) at (N, 2) points, bilinear; the border's value beyond."""
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
        """Read what ``save`` wrote.

        Raises:
            InputError: missing, damaged, or no grid of heights.
        """
        data = read_arrays(path, _EXPECTED, _FORM)
        place = data["place"].tolist()
        # Older grids do not say what they were resampled from.
        if len(place) not in (3, 4) or place[2] <= 0 or min(place[3:], default=0) < 0:
            problem = "is not the place of a grid"
            raise InputError(problem, file=path, place="place", expected=_EXPECTED)
        if not data["raw"].size:
            raise InputError("has no heights", file=path, place="raw", expected=_EXPECTED)
        west, south, step, *source = place
        return cls(west, south, step, data["raw"], *source[:1])


@dataclass(frozen=True, eq=False)
class ElevationPatch:
    """Heights of the bare earth on a grid, where a source has them.

    Attributes:
        west, south: position of the first node, site frame, metres.
        step: between nodes, metres.
        heights: (rows from south to north, columns from west to east) float64 metres above the
            anchor's ground; nan where the source has none.
        detail_m: size of the smallest things that the source shows, metres (point spacing, cell).
        name: of the source.
    """

    west: float
    south: float
    step: float
    heights: NDArray[np.float64]
    detail_m: float
    name: str


#: Over this distance from its border a finer source takes over from a coarser one, metres: a step
#: between two surveys would become a cliff.
BLEND_M = 4.0
#: Nodes beyond the region that bilinear interpolation may need.
PAD = 2


def merged_elevation(
    patches: Sequence[ElevationPatch], region: shapely.Polygon
) -> tuple[Elevation, dict[str, float]]:
    """Merge the bare earth of several sources into one grid that covers a region.

    Where two sources overlap, the finer one counts, blended into the coarser one within ``BLEND_M``
    of its border. Holes that no source covers (the ground under buildings) are filled from their
    rims (GDAL's inverse-distance fill), and what lies beyond all sources takes the nearest height.

    Args:
        patches: at least one; heights above the anchor's ground.
        region: what must be covered, site frame, metres.

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
    """Heights of a patch at points, bilinear; nan where one of the four nodes has none."""
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
    # GDAL computes in single precision: centred, so that heights keep their millimetres.
    middle = float(np.mean(heights[known]))
    from rasterio.fill import fillnodata

    smooth = fillnodata(
        (nearest - middle).astype(np.float32),
        mask=known.astype(np.uint8),
        max_search_distance=float(max(heights.shape)),
        smoothing_iterations=2,
    )
    return np.where(known, heights, smooth.astype(np.float64) + middle)
