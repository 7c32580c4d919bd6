"""Digital elevation model (DEM) of the site: checked, and resampled to the site frame.

Heights are read in the file's own vertical datum, orthometric or ellipsoidal, and in metres unless
the file states another unit. Results are relative to the anchor's height; the datum is kept for
comparison with other sources of heights.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS, Transformer

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site.geotiff import opened_geotiff

__all__ = ["DemGrid", "check_dem", "grid_step_m", "metres_per_unit", "read_heights"]

_EXPECTED = "a DEM as GeoTIFF: one band of heights with a CRS"
#: Largest fraction of the region without heights that is filled in.
MOST_MISSING = 0.05
#: Values outside this range are undeclared nodata, not heights on land: the Dead Sea's shore is at
#: -430 m, Mount Everest at 8849 m.
LOWEST_M, HIGHEST_M = -1000.0, 9500.0
#: Cells around the area for bilinear resampling.
_PAD = 2
#: Most cells per side of a window; finer rasters are read at a coarser resolution, below 1 GB.
_MOST_CELLS = 8192
#: Finest and coarsest step of the resampled grid, metres, and its most nodes.
_STEPS_M, _MOST_NODES = (0.25, 1.0), 4_000_000

_METRES = {"ft": 0.3048, "foot": 0.3048, "feet": 0.3048, "us survey foot": 1200 / 3937,
           "us-ft": 1200 / 3937, "cm": 0.01, "dm": 0.1}  # fmt: skip


@dataclass(frozen=True)
class DemGrid:
    """Heights at the nodes of a square grid, site frame.

    Attributes:
        x0: east of the first column, metres; a multiple of ``step_m``.
        y0: north of the first row, metres; a multiple of ``step_m``.
        step_m: grid step, metres.
        heights: (ny, nx) float64, metres above the anchor's ground; row 0 is the southernmost.
        anchor_height_m: height of the anchor in the file's own vertical datum.
        missing_share: fraction of the area without heights, filled from the nearest neighbour.
        source_step_m: size of the file's own cells, metres.
        vertical: datum of the file's heights as WKT: a vertical CRS, or a 3D CRS for heights above
            an ellipsoid; empty if unknown.
    """

    x0: float
    y0: float
    step_m: float
    heights: NDArray[np.float64]
    anchor_height_m: float
    missing_share: float
    source_step_m: float
    vertical: str = ""


def check_dem(path: Path, frame: SiteFrame, region: shapely.Polygon) -> None:
    """Check that a DEM covers a region (site frame) and has heights there.

    Raises:
        InputError: not a GeoTIFF of heights, no CRS, region not covered, or heights missing in more
            than 5 % of it.
    """
    low, high = shapely.get_coordinates(region).min(axis=0), shapely.get_coordinates(region).max(0)
    read_heights(path, frame, region, max(1.0, float((high - low).max()) / 100.0))


def read_heights(
    path: Path, frame: SiteFrame, area: shapely.Polygon, step_m: float | None = None
) -> DemGrid:
    """Resample a DEM (bilinear) to a grid in the site frame that covers ``area`` and the anchor.

    The grid's nodes are at multiples of ``step_m``; it reaches two steps beyond ``area``. Gaps of
    up to 5 % of ``area``, and nodes beyond the raster, get the nearest height.

    Args:
        path: a GeoTIFF of one band.
        frame: the site frame.
        area: area to cover, site frame, metres.
        step_m: grid step, metres; ``None`` for the file's own cell size, limited to 0.25 m to 1 m,
            or coarser for a large area.

    Raises:
        InputError: as for `check_dem`.
    """
    from affine import Affine
    from rasterio.warp import Resampling, reproject

    if step_m is None:
        with _opened(path) as raster:
            step_m = _own_step(raster, frame, area)
    corners = np.vstack([shapely.get_coordinates(area), [[0.0, 0.0]]])
    first = np.floor(corners.min(axis=0) / step_m).astype(int) - _PAD
    last = np.ceil(corners.max(axis=0) / step_m).astype(int) + _PAD
    nx, ny = (int(n) for n in last - first + 1)
    x, y = (first[0] + np.arange(nx)) * step_m, (first[1] + np.arange(ny)) * step_m
    with _opened(path) as raster:
        _check_cover(raster, path, frame, area)
        source, transform = _window(raster, path, frame, (x[0], y[0], x[-1], y[-1]))
        crs = CRS(raster.crs.to_wkt())
        source_step = _cell_m(raster, frame)
    grid = np.full((ny, nx), np.nan)
    reproject(
        source,
        grid,
        src_transform=transform,
        src_crs=_plan(crs).to_wkt(),
        src_nodata=np.nan,
        dst_transform=Affine(step_m, 0, x[0] - step_m / 2, 0, -step_m, y[-1] + step_m / 2),
        dst_crs=frame.proj_with_datum,
        dst_nodata=np.nan,
        resampling=Resampling.bilinear,
    )
    grid = np.ascontiguousarray(grid[::-1])
    missing = np.isnan(grid)
    east, north = np.meshgrid(x, y)
    inside = shapely.contains_xy(area, east, north)
    share = float(missing[inside].mean()) if inside.any() else float(missing.mean())
    if share > MOST_MISSING or missing.all():
        raise InputError(
            f"has no height in {share:.0%} of the region",
            file=path,
            expected=f"heights in at least {1 - MOST_MISSING:.0%} of it",
        )
    if missing.any():
        from scipy.ndimage import distance_transform_edt

        rows, columns = distance_transform_edt(missing, return_distances=False, return_indices=True)
        grid = grid[rows, columns]
    anchor = float(grid[-first[1], -first[0]])
    return DemGrid(
        float(x[0]),
        float(y[0]),
        step_m,
        grid - anchor,
        anchor,
        share,
        source_step,
        _vertical(crs),
    )


def grid_step_m(detail_m: float, bounds: tuple[float, float, float, float]) -> float:
    """Return the step of a height grid over west, south, east, north, metres.

    The step follows the detail to resolve, between 0.25 m and 1 m, or is coarser for a large area.
    """
    west, south, east, north = bounds
    widest = math.sqrt((east - west) * (north - south) / _MOST_NODES)
    return float(max(min(max(detail_m, _STEPS_M[0]), _STEPS_M[1]), widest))


def _cell_m(raster: Any, frame: SiteFrame) -> float:  # noqa: ANN401
    """Return a raster's cell size at the anchor, metres."""
    per_metre = np.diff(_pixels(raster, frame, np.array([[0.0, 0.0], [1.0, 0.0]])), axis=0)
    return 1.0 / float(np.linalg.norm(per_metre))


def _own_step(raster: Any, frame: SiteFrame, area: shapely.Polygon) -> float:  # noqa: ANN401
    cell = _cell_m(raster, frame)
    return grid_step_m(cell, area.bounds) if math.isfinite(cell) else _STEPS_M[1]


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a GeoTIFF of heights; all failures to read it are raised as InputError."""
    with opened_geotiff(path, _EXPECTED) as raster:
        if raster.count != 1:
            raise InputError(f"holds {raster.count} bands", file=path, expected=_EXPECTED)
        if raster.dtypes[0].startswith("complex"):
            raise InputError("holds complex numbers", file=path, expected=_EXPECTED)
        if raster.crs is None or raster.transform.is_identity:
            raise InputError("is not georeferenced", file=path, expected=_EXPECTED)
        yield raster


def _check_cover(raster: Any, path: Path, frame: SiteFrame, area: shapely.Polygon) -> None:  # noqa: ANN401
    """Raise an error if part of ``area`` is outside the raster."""
    outline = shapely.segmentize(area.exterior, max(1.0, area.length / 200))
    pixels = _pixels(raster, frame, shapely.get_coordinates(outline))
    size = np.array([raster.width, raster.height])
    slack = 1e-6
    if np.isfinite(pixels).all() and (pixels >= -slack).all() and (pixels <= size + slack).all():
        return
    share = 0.0
    if np.isfinite(pixels).all():
        shape, box = shapely.Polygon(pixels), shapely.box(0, 0, *size)
        # With very large raster cells the region may shrink to a point.
        share = shapely.intersection(shape.buffer(0), box).area / max(shape.area, 1e-300)
    raise InputError(
        f"covers {math.floor(share * 100)} % of the region",
        file=path,
        expected=f"all of it: the surroundings of {frame.latitude:.6f}, {frame.longitude:.6f}",
    )


def _pixels(raster: Any, frame: SiteFrame, xy: NDArray[np.float64]) -> NDArray[np.float64]:  # noqa: ANN401
    """Return columns and rows (N, 2) of site positions (N, 2), metres; pixel edges are integers."""
    transformer = _to_raster(frame.proj_with_datum, raster.crs.to_wkt())
    easting, northing = transformer.transform(xy[:, 0], xy[:, 1])
    # Written out, because the product of Affine differs between its versions.
    t = ~raster.transform
    x, y = np.asarray(easting), np.asarray(northing)
    return np.column_stack([t.a * x + t.b * y + t.c, t.d * x + t.e * y + t.f])


@lru_cache(maxsize=4)
def _to_raster(frame: str, crs: str) -> Transformer:
    return Transformer.from_crs(frame, _plan(CRS(crs)), always_xy=True)


def _window(
    raster: Any,  # noqa: ANN401
    path: Path,
    frame: SiteFrame,
    bounds: tuple[float, float, float, float],
) -> tuple[NDArray[np.float64], Any]:
    """Return the heights (NaN where unknown) around ``bounds``, and their transform."""
    from affine import Affine
    from rasterio.enums import Resampling
    from rasterio.windows import Window

    outline = shapely.segmentize(shapely.box(*bounds).exterior, (bounds[2] - bounds[0]) / 50)
    pixels = _pixels(raster, frame, shapely.get_coordinates(outline))
    size = np.array([raster.width, raster.height])
    low = np.clip(np.floor(pixels.min(axis=0)).astype(int) - _PAD, 0, size - 1)
    high = np.clip(np.ceil(pixels.max(axis=0)).astype(int) + _PAD, low + 1, size)
    width, height = (int(n) for n in high - low)
    window = Window(int(low[0]), int(low[1]), width, height)
    shape = (min(height, _MOST_CELLS), min(width, _MOST_CELLS))
    masked = raster.read(
        1, window=window, out_shape=shape, masked=True, resampling=Resampling.average
    )
    heights = np.ma.filled(masked.astype(np.float64), np.nan)
    heights = (heights * raster.scales[0] + raster.offsets[0]) * metres_per_unit(raster)
    heights[~((heights > LOWEST_M) & (heights < HIGHEST_M))] = np.nan
    t, across, down = raster.transform, width / shape[1], height / shape[0]
    corner = (t.a * low[0] + t.b * low[1] + t.c, t.d * low[0] + t.e * low[1] + t.f)
    cell = (t.a * across, t.b * down, t.d * across, t.e * down)
    return heights, Affine(cell[0], cell[1], corner[0], cell[2], cell[3], corner[1])


def _plan(crs: CRS) -> CRS:
    """Return the horizontal part of a CRS."""
    return crs.sub_crs_list[0] if crs.is_compound else crs.to_2d()


def _vertical(crs: CRS) -> str:
    """Return the vertical part of a CRS as WKT; empty without one."""
    if crs.is_compound:
        vertical = crs.sub_crs_list[-1]
        return (crs if "ellips" in vertical.name.lower() else vertical).to_wkt()
    return crs.to_wkt() if len(crs.axis_info) == 3 else ""


def metres_per_unit(raster: Any) -> float:  # noqa: ANN401
    """Return the unit of height in metres: that of the vertical CRS, else of the band, else 1."""
    axes = CRS(raster.crs.to_wkt()).axis_info
    if len(axes) == 3:
        return float(axes[2].unit_conversion_factor)
    return _METRES.get(str(raster.units[0] or "").strip().lower(), 1.0)
