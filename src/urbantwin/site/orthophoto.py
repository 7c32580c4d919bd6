"""Orthophotos resampled to a grid in the site frame."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site.geotiff import opened_geotiff
from urbantwin.site.imagery import ImagerySource
from urbantwin.site.map_tiles import read_tiles

__all__ = ["Orthophoto", "read_orthophoto"]

_EXPECTED = "a GeoTIFF of red, green and blue (and opacity), 8 bits each, with a CRS"
#: Limits of the grid's cell size, which otherwise is that of the picture, metres.
FINEST_M, COARSEST_M = 0.05, 2.0
#: Most cells of a grid: 50 MB of colours, and 1 GB during classification of materials.
MOST_CELLS = 16_000_000
#: Most pixels of a file read at once; overviews of finer files are read instead.
MOST_PIXELS = 64_000_000


@dataclass(frozen=True, eq=False)
class Orthophoto:
    """Colours of the ground.

    Attributes:
        x0: west edge of the first column, metres; a multiple of ``cell_m``.
        y0: south edge of the first row, metres; a multiple of ``cell_m``.
        cell_m: side of a cell, metres.
        rgb: (ny, nx, 3) uint8, sRGB; row 0 is the southernmost.
        known: (ny, nx) bool, whether a picture covers the cell.
        source_cell_m: pixel size of the picture, of the coarsest of several, metres.
        notes: notes on each source, for the manifest.
    """

    x0: float
    y0: float
    cell_m: float
    rgb: NDArray[np.uint8]
    known: NDArray[np.bool_]
    source_cell_m: float
    notes: tuple[dict[str, object], ...]


@dataclass(frozen=True, eq=False)
class _Raster:
    """Pixels of a source around the area: (4, H, W) uint8 with opacity."""

    pixels: NDArray[np.uint8]
    transform: Any
    crs: Any
    cell_m: float
    problems: tuple[str, ...] = ()


def read_orthophoto(
    sources: Sequence[ImagerySource],
    frame: SiteFrame,
    area: shapely.Polygon,
    environment: Mapping[str, str] | None = None,
) -> Orthophoto:
    """Read pictures of an area; earlier sources take precedence.

    Args:
        sources: at least one.
        frame: the site frame.
        area: the area, site frame, metres; its bounds are read.
        environment: environment variables with keys; the process's own if not given.

    Raises:
        InputError: a file is not an image, has no CRS, is truncated or elsewhere; no tile can be
            read; or a key is not set.
    """
    from rasterio.enums import Resampling
    from rasterio.transform import Affine
    from rasterio.warp import reproject

    bounds = area.bounds
    rasters = [
        _from_file(source, frame, bounds)
        if source.path is not None
        else _from_tiles(source, frame, bounds, environment)
        for source in sources
    ]
    size = np.array([bounds[2] - bounds[0], bounds[3] - bounds[1]])
    coarsest = math.sqrt(float(size.prod()) / MOST_CELLS)
    cell_m = min(max(FINEST_M, *(r.cell_m for r in rasters), coarsest), COARSEST_M)
    cell_m = max(round(cell_m, 2), FINEST_M, math.ceil(coarsest * 100) / 100)
    first = np.floor(np.array(bounds[:2]) / cell_m).astype(int)
    nx, ny = (int(n) for n in np.ceil(np.array(bounds[2:]) / cell_m).astype(int) - first)
    north = (first[1] + ny) * cell_m
    rgb = np.zeros((ny, nx, 3), np.uint8)
    known = np.zeros((ny, nx), bool)
    notes = []
    for source, raster in zip(sources, rasters, strict=True):
        out = np.zeros((4, ny, nx), np.uint8)
        reproject(
            raster.pixels,
            out,
            src_transform=raster.transform,
            src_crs=raster.crs,
            dst_transform=Affine(cell_m, 0, first[0] * cell_m, 0, -cell_m, north),
            dst_crs=frame.proj_with_datum,
            resampling=Resampling.bilinear,
            num_threads=2,
            tolerance=0.02,
        )
        out = out[:, ::-1]
        new = (out[3] > 250) & ~known
        rgb[new] = np.moveaxis(out[:3], 0, 2)[new]
        known |= new
        note: dict[str, object] = {
            "name": source.name,
            "pixel_m": round(raster.cell_m, 3),
            "covers": round(float(new.mean()), 4),
        }
        # Many files, or an address, are identified by their pixels.
        if source.path is None:
            note["pixels_sha256"] = hashlib.sha256(raster.pixels.tobytes()).hexdigest()
        if raster.problems:
            note["problems"] = list(raster.problems)
        notes.append(note)
    return Orthophoto(
        float(first[0] * cell_m),
        float(first[1] * cell_m),
        cell_m,
        rgb,
        known,
        max(r.cell_m for r in rasters),
        tuple(notes),
    )


def _from_tiles(
    source: ImagerySource,
    frame: SiteFrame,
    bounds: tuple[float, float, float, float],
    environment: Mapping[str, str] | None,
) -> _Raster:
    from rasterio.transform import Affine

    outline = shapely.get_coordinates(shapely.segmentize(shapely.box(*bounds), 50.0))
    mosaic = read_tiles(source, frame.lonlat_from_site(outline), environment)
    cell = mosaic.cell_m * math.cos(math.radians(frame.latitude))
    transform = Affine(mosaic.cell_m, 0, mosaic.west, 0, -mosaic.cell_m, mosaic.north)
    return _Raster(mosaic.pixels, transform, "EPSG:3857", cell, mosaic.problems)


def _from_file(
    source: ImagerySource, frame: SiteFrame, bounds: tuple[float, float, float, float]
) -> _Raster:
    path = source.path
    assert path is not None
    with opened_geotiff(path, _EXPECTED) as raster:
        return _window(raster, source, path, frame, bounds)


def _window(
    raster: Any,  # noqa: ANN401
    source: ImagerySource,
    path: Path,
    frame: SiteFrame,
    bounds: tuple[float, float, float, float],
) -> _Raster:
    """Return a file's pixels around bounds in the site frame."""
    from rasterio.enums import ColorInterp, Resampling
    from rasterio.transform import Affine
    from rasterio.windows import Window

    if raster.count not in (3, 4):
        bands = "1 band" if raster.count == 1 else f"{raster.count} bands"
        raise InputError(f"holds {bands}", file=path, expected=_EXPECTED)
    if set(raster.dtypes) != {"uint8"}:
        raise InputError(f"holds {raster.dtypes[0]}", file=path, expected=_EXPECTED)
    crs = _crs(raster, source, path)
    if raster.transform.is_identity:
        raise InputError("is not georeferenced", file=path, expected=_EXPECTED)
    pixels = _pixels_of(raster.transform, crs, frame, bounds)
    size = np.array([raster.width, raster.height])
    if np.isfinite(pixels).all():
        low = np.clip(np.floor(pixels.min(axis=0)).astype(np.int64) - 2, 0, size)
        high = np.clip(np.ceil(pixels.max(axis=0)).astype(np.int64) + 2, 0, size)
    if not np.isfinite(pixels).all() or (high - low <= 4).any():
        raise InputError(
            "covers nothing of the region",
            file=path,
            expected=f"the surroundings of {frame.latitude:.6f}, {frame.longitude:.6f}",
        )
    width, height = (int(n) for n in high - low)
    cell_m = math.sqrt((bounds[2] - bounds[0]) * (bounds[3] - bounds[1]) / _area(pixels))
    shrink = max(1.0, math.sqrt(width * height / MOST_PIXELS), FINEST_M / 2 / cell_m)
    shape = (max(1, round(height / shrink)), max(1, round(width / shrink)))
    window = Window(int(low[0]), int(low[1]), width, height)
    out = np.full((4, *shape), 255, np.uint8)
    how = {"window": window, "out_shape": (3, *shape), "resampling": Resampling.average}
    out[:3] = raster.read((1, 2, 3), **how)
    alpha = raster.count == 4 and raster.colorinterp[3] == ColorInterp.alpha
    mask = raster.dataset_mask(window=window, out_shape=shape)
    out[3] = np.minimum(mask, raster.read(4, window=window, out_shape=shape)) if alpha else mask
    t = raster.transform
    across, down = width / shape[1], height / shape[0]
    corner = (t.a * low[0] + t.b * low[1] + t.c, t.d * low[0] + t.e * low[1] + t.f)
    moved = Affine(t.a * across, t.b * down, corner[0], t.d * across, t.e * down, corner[1])
    return _Raster(out, moved, crs, cell_m * max(across, down))


def _crs(raster: Any, source: ImagerySource, path: Path) -> Any:  # noqa: ANN401
    """Return the file's CRS, or the one given by the user."""
    import pyproj
    from rasterio.crs import CRS
    from rasterio.errors import CRSError

    if source.spec.crs is not None:
        try:
            # GDAL would fetch an address or open a path given as a CRS; PROJ does neither.
            known = pyproj.CRS.from_user_input(source.spec.crs)
            if "/" in source.spec.crs:
                return CRS.from_wkt(known.to_wkt())
            return CRS.from_user_input(source.spec.crs)
        except (CRSError, pyproj.exceptions.CRSError):
            raise source.document.error(
                f"is {source.spec.crs!r}, which is not known",
                ("imagery", source.number, "crs"),
                "a code such as EPSG:25832",
            ) from None
    if raster.crs is None:
        raise InputError(
            "has no CRS", file=path, expected="one in the file, or imagery: crs in site.yaml"
        )
    return raster.crs


def _pixels_of(
    transform: Any,  # noqa: ANN401
    crs: Any,  # noqa: ANN401
    frame: SiteFrame,
    bounds: tuple[float, float, float, float],
) -> NDArray[np.float64]:
    """Return columns and rows (N, 2) along the border of bounds given in the site frame."""
    from pyproj import CRS, Transformer

    outline = shapely.get_coordinates(
        shapely.segmentize(shapely.box(*bounds).exterior, (bounds[2] - bounds[0]) / 20)
    )
    change = Transformer.from_crs(
        frame.proj_with_datum, CRS.from_user_input(crs.to_wkt()), always_xy=True
    )
    x, y = (np.asarray(v) for v in change.transform(outline[:, 0], outline[:, 1]))
    t = ~transform
    return np.column_stack([t.a * x + t.b * y + t.c, t.d * x + t.e * y + t.f])


def _area(ring: NDArray[np.float64]) -> float:
    return float(shapely.Polygon(ring).area)
