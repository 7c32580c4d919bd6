"""Part of a raster that covers an area, written as a GeoTIFF of heights."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS
from pyproj.exceptions import CRSError, ProjError

from urbantwin.acquire.area import Area
from urbantwin.acquire.remote_file import RemoteFile
from urbantwin.acquire.source import MARGIN_M
from urbantwin.acquire.web import NotAcquiredError, NothingThereError
from urbantwin.download import DownloadError
from urbantwin.errors import InputError, readable
from urbantwin.site.dem import HIGHEST_M, LOWEST_M, check_dem, metres_per_unit

__all__ = ["HeightWindow", "cut_heights", "remote_raster", "write_heights"]

#: Most raster cells of a site.
MOST_CELLS = 64_000_000
#: Cells around an area for resampling.
_PAD = 3


@dataclass(frozen=True, eq=False)
class HeightWindow:
    """A part of a raster.

    Attributes:
        heights: (H, W) float32 in the file's vertical datum, metres unless the CRS has another
            unit; NaN where unknown.
        transform: affine transform, from columns and rows to the CRS.
        crs: CRS, as WKT.
    """

    heights: NDArray[np.float32]
    transform: Any
    crs: str


@contextmanager
def remote_raster(file: RemoteFile) -> Iterator[Any]:
    """Open a GeoTIFF on a server; only the blocks that are read are fetched.

    Raises:
        NotAcquiredError: not a GeoTIFF, or damaged.
        DownloadError: the download failed.
    """
    import rasterio
    from rasterio._err import CPLE_BaseError
    from rasterio.errors import NotGeoreferencedWarning, RasterioError

    def opened(name: str, *_: object, **__: object) -> _Unclosed:
        if not name.endswith("remote.tif"):
            raise FileNotFoundError(name)
        file.seek(0)
        return _Unclosed(file)

    try:
        with ExitStack() as stack:
            stack.enter_context(warnings.catch_warnings())
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            stack.enter_context(
                rasterio.Env(GDAL_DISABLE_READDIR_ON_OPEN="EMPTY_DIR", GTIFF_REPORT_COMPD_CS=True)
            )
            yield stack.enter_context(rasterio.open("remote.tif", driver="GTiff", opener=opened))
            if file.failure is not None:
                raise file.failure
    except (RasterioError, CPLE_BaseError, ProjError) as error:
        if file.failure is not None:
            raise file.failure from None
        raise NotAcquiredError(
            f"cannot be read as a GeoTIFF ({readable(str(error.__cause__ or error), 100)})"
        ) from None


class _Unclosed:
    """A file for GDAL: closing has no effect, and failed reads return no bytes.

    GDAL would print an exception of a callback; `RemoteFile.failure` keeps it.
    """

    def __init__(self, file: RemoteFile) -> None:
        self._file = file

    def read(self, size: int = -1) -> bytes:
        """Return up to ``size`` bytes from the position on."""
        try:
            return self._file.read(size)
        except DownloadError:
            return b""

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401
        return getattr(self._file, name)

    def __enter__(self) -> _Unclosed:
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def close(self) -> None:
        return None


def cut_heights(raster: Any, area: Area) -> HeightWindow | None:  # noqa: ANN401
    """Return the part of an open raster around an area; ``None`` if they do not overlap.

    Raises:
        NotAcquiredError: no CRS, several bands, or too many cells.
    """
    from affine import Affine
    from rasterio.windows import Window

    if raster.crs is None:
        raise NotAcquiredError("has no coordinate reference system")
    if raster.count != 1:
        raise NotAcquiredError(f"has {raster.count} bands, where one of heights was expected")
    if not math.isfinite(raster.transform.determinant) or raster.transform.is_degenerate:
        raise NotAcquiredError("has cells without a size")
    try:
        west, south, east, north = area.box_in(raster.crs.to_wkt(), MARGIN_M)
    except (CRSError, ProjError, ValueError):
        return None
    back = ~raster.transform
    corners = np.array(
        [back @ one for one in ((west, south), (east, south), (east, north), (west, north))]
    )
    size = np.array([raster.width, raster.height])
    low = np.clip(np.floor(corners.min(axis=0)).astype(int) - _PAD, 0, size)
    high = np.clip(np.ceil(corners.max(axis=0)).astype(int) + _PAD, 0, size)
    width, height = (int(n) for n in high - low)
    if width <= 0 or height <= 0:
        return None
    if width * height > MOST_CELLS:
        raise NotAcquiredError(f"has {width} x {height} cells there, more than a site needs")
    window = Window(int(low[0]), int(low[1]), width, height)
    masked = raster.read(1, window=window, masked=True)
    heights = np.ma.filled(masked.astype(np.float64), np.nan)
    heights = heights * raster.scales[0] + raster.offsets[0]
    if len(CRS(raster.crs.to_wkt()).axis_info) != 3:  # a 3D CRS keeps its own unit
        heights *= metres_per_unit(raster)
    heights[~((heights > LOWEST_M) & (heights < HIGHEST_M))] = np.nan
    transform = raster.transform @ Affine.translation(int(low[0]), int(low[1]))
    return HeightWindow(heights.astype(np.float32), transform, raster.crs.to_wkt())


def write_heights(
    windows: Sequence[HeightWindow], path: Path, area: Area, crs: str | None = None
) -> str:
    """Write parts of rasters as one GeoTIFF, check that it covers the area, and return its CRS.

    Args:
        windows: parts in one CRS, side by side; the first known height is used.
        path: the file.
        area: area to cover.
        crs: CRS with vertical datum, if the rasters lack it.

    Raises:
        NotAcquiredError: the parts do not cover the area, or have several CRS.
    """
    from rasterio.io import MemoryFile

    if not windows:
        raise NothingThereError()
    own = CRS(windows[0].crs)
    if any(CRS(one.crs) != own for one in windows):
        raise NotAcquiredError("has files of several reference systems there")
    whole = windows[0] if len(windows) == 1 else _side_by_side(windows)
    heights = whole.heights
    system = _with_datum(own, crs)
    profile = {
        "driver": "GTiff", "dtype": "float32", "count": 1, "height": heights.shape[0],
        "width": heights.shape[1], "transform": whole.transform, "crs": system, "nodata": np.nan,
        "compress": "deflate", "predictor": 3,
    }  # fmt: skip
    with MemoryFile() as file:
        with file.open(**profile) as written:
            written.write(heights, 1)
        path.write_bytes(file.read())  # Python reports a full disk clearly
    try:
        check_dem(path, area.frame, area.circle)
    except InputError as error:
        raise NotAcquiredError(error.problem) from None
    return system


def _side_by_side(windows: Sequence[HeightWindow]) -> HeightWindow:
    """Return windows in one CRS as one, on the grid of the first; first known heights count."""
    from affine import Affine
    from rasterio.warp import Resampling, reproject

    first = windows[0]
    corners = []
    for one in windows:
        rows, columns = one.heights.shape
        ends = [one.transform @ end for end in ((0, 0), (columns, rows))]
        corners += [~first.transform @ end for end in ends]
    low = np.floor(np.min(corners, axis=0) + 1e-6).astype(int)
    width, height = (int(n) for n in np.ceil(np.max(corners, axis=0) - 1e-6).astype(int) - low)
    if width * height > MOST_CELLS:
        raise NotAcquiredError(f"has {width} x {height} cells there, more than a site needs")
    transform = first.transform @ Affine.translation(int(low[0]), int(low[1]))
    joined = np.full((height, width), np.nan, np.float32)
    for one in windows:
        part = np.full_like(joined, np.nan)
        reproject(
            one.heights,
            part,
            src_transform=one.transform,
            src_crs=one.crs,
            src_nodata=np.nan,
            dst_transform=transform,
            dst_crs=one.crs,
            dst_nodata=np.nan,
            resampling=Resampling.bilinear,
        )
        joined = np.where(np.isnan(joined), part, joined)
    return HeightWindow(joined, transform, first.crs)


def _with_datum(own: CRS, stated: str | None) -> str:
    """Return a raster's CRS, with the stated vertical datum if it has none."""
    if stated is not None and not own.is_compound:
        told = CRS.from_user_input(stated)
        if told.is_compound and (
            told.sub_crs_list[0].equals(own, ignore_axis_order=True)
            or told.sub_crs_list[0].to_epsg() == own.to_epsg() is not None
        ):
            return told.to_wkt()
    return own.to_wkt()
