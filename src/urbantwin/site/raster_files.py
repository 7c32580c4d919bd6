"""The files that a raster consists of: world files and overviews may lie beside it."""

from __future__ import annotations

import warnings
from pathlib import Path

__all__ = ["files_beside"]


def files_beside(path: Path) -> list[Path]:
    """Return what GDAL reads with a GeoTIFF (``.tfw``, ``.ovr``, ``.aux.xml``), without itself."""
    import rasterio
    from rasterio.errors import NotGeoreferencedWarning, RasterioError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(path, driver="GTiff") as raster:
                named = [Path(name) for name in raster.files]
    except RasterioError:
        return []  # Whoever reads its values says what is wrong with it.
    return sorted(one for one in named if one.name != path.name and one.is_file())
