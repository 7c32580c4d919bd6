"""Rasters that claim what their files cannot hold, and constant ones that can."""

import numpy as np
import pytest
import rasterio
from affine import Affine

from urbantwin.errors import InputError
from urbantwin.interface.inspection import summary_of as summary
from urbantwin.site.geotiff import opened_geotiff


def write(path, width, height, rows=None, **more):
    with rasterio.open(
        path, "w", driver="GTiff", width=width, height=height, count=1, dtype="float32",
        crs="EPSG:25833", transform=Affine(1.0, 0, 4e5, 0, -1.0, 5.8e6), **more,
    ) as raster:  # fmt: skip
        if rows is not None:
            raster.write(rows, 1)
    return path


def test_a_small_file_that_claims_a_country(tmp_path):
    path = write(tmp_path / "a.tif", 100_000, 100_000, SPARSE_OK=True, tiled=True)
    assert path.stat().st_size < 3_000_000
    for read in (summary, lambda path: opened_geotiff(path, "a DEM").__enter__()):
        with pytest.raises(InputError, match="claims 100,000 x 100,000 pixels in"):
            read(path)


def test_what_deflate_packs_best_is_read(tmp_path):
    path = write(tmp_path / "a.tif", 5000, 5000, np.full((5000, 5000), 31.5, "f4"),
                 compress="deflate", tiled=True)  # fmt: skip
    assert path.stat().st_size < 5000 * 5000 * 4 / 500
    found = summary(path)
    assert (found["lowest"], found["highest"], found["missing"]) == (31.5, 31.5, 0.0)


def test_cells_without_heights_are_counted(tmp_path):
    rows = np.arange(12, dtype="f4").reshape(3, 4)
    rows[0, 0] = np.nan
    rows[2, 3] = -9999
    found = summary(write(tmp_path / "a.tif", 4, 3, rows, nodata=-9999))
    assert (found["lowest"], found["highest"]) == (1.0, 10.0)
    assert found["missing"] == round(2 / 12, 4)
