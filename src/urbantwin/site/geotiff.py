"""Opening of GeoTIFFs, with checks of size and CRS, and their sidecar files."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pyproj.exceptions import ProjError

from urbantwin.errors import InputError, readable

__all__ = ["files_beside", "opened_geotiff"]

#: Bytes of pixels accepted from any file, and largest compression ratio beyond; Deflate's best is
#: 1032.
_ANY, _DENSEST = 1 << 26, 2000


@contextmanager
def opened_geotiff(path: Path, expected: str) -> Iterator[Any]:
    """Open a GeoTIFF; all failures to read it are raised as InputError.

    Args:
        path: the file.
        expected: expected content, for error messages.

    Raises:
        InputError: missing, not a GeoTIFF, damaged, in an unknown CRS, or larger than its bytes can
            hold.
    """
    import rasterio
    from rasterio._err import CPLE_BaseError
    from rasterio.errors import NotGeoreferencedWarning, RasterioError

    if not path.is_file():
        problem = "is a folder" if path.is_dir() else "not found"
        raise InputError(problem, file=path, expected=expected)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            # Otherwise GDAL hides the vertical datum of a GeoTIFF 1.0.
            with rasterio.Env(GTIFF_REPORT_COMPD_CS=True):
                raster = rasterio.open(path, driver="GTiff")
        with raster:
            _check_size(raster, path, expected)
            if not math.isfinite(raster.transform.determinant) or raster.transform.is_degenerate:
                raise InputError("has pixels without a size", file=path, expected=expected)
            yield raster
    except (RasterioError, CPLE_BaseError, ProjError) as error:
        why = readable(str(error.__cause__ or error), 120)
        problem = f"cannot be read as a GeoTIFF ({why})"
        raise InputError(problem, file=path, expected=expected) from None


def _check_size(raster: Any, path: Path, expected: str) -> None:  # noqa: ANN401
    """Check that the file can hold its declared pixels, with any compression."""
    import numpy as np

    size = path.stat().st_size
    rows, columns = raster.block_shapes[0]
    wide = max(np.dtype(kind).itemsize for kind in raster.dtypes)
    whole = raster.width * raster.height * raster.count * wide
    if max(whole, rows * columns * wide) > max(_ANY, _DENSEST * size):
        raise InputError(
            f"claims {raster.width:,} x {raster.height:,} pixels in {size:,} bytes",
            file=path,
            expected=expected,
        )


def files_beside(path: Path) -> list[Path]:
    """Return the sidecar files that GDAL reads with a GeoTIFF (``.tfw``, ``.ovr``, ...)."""
    import rasterio
    from rasterio.errors import NotGeoreferencedWarning, RasterioError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(path, driver="GTiff") as raster:
                named = [Path(name) for name in raster.files]
    except RasterioError:
        return []  # reported by the reader
    return sorted(one for one in named if one.name != path.name and one.is_file())
