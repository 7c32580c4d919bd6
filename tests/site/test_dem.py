"""DEMs: a plane comes back as that plane, holes are filled or refused, bad files are named."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from pyproj import Transformer

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site import check_dem, load_site, read_heights

from .conftest import LATITUDE, LONGITUDE, site_fields

FRAME = SiteFrame(LATITUDE, LONGITUDE)
REGION = shapely.Point(0, 0).buffer(100.0)
CENTRE = Transformer.from_crs("EPSG:4326", "EPSG:25833", always_xy=True).transform(
    LONGITUDE, LATITUDE
)
Write = Callable[..., Path]


def slope(east: float, north: float, cells: int = 60, step: float = 10.0) -> np.ndarray:
    """Return a plane of 34 m in the middle that rises by ``east`` and ``north`` per metre."""
    offset = (np.arange(cells) - (cells - 1) / 2) * step
    return (34.0 + east * offset[None, :] - north * offset[:, None]).astype(np.float32)


def plane_at(points: np.ndarray, east: float, north: float) -> np.ndarray:
    """The plane of `slope` at site-frame points, by way of geographic coordinates."""
    lonlat = FRAME.lonlat_from_site(points)
    x, y = Transformer.from_crs("EPSG:4326", "EPSG:25833", always_xy=True).transform(*lonlat.T)
    return east * (np.asarray(x) - CENTRE[0]) + north * (np.asarray(y) - CENTRE[1])


def test_tilted_plane_comes_back(write_dem: Write) -> None:
    path = write_dem(slope(0.05, -0.03), centre=CENTRE)
    dem = read_heights(path, FRAME, REGION, 2.0)
    assert dem.anchor_height_m == pytest.approx(34.0, abs=1e-3)
    assert dem.missing_share == 0.0
    rows, columns = dem.heights.shape
    x, y = np.meshgrid(dem.x0 + 2.0 * np.arange(columns), dem.y0 + 2.0 * np.arange(rows))
    assert x.min() <= -100 <= 100 <= x.max()
    assert y.min() <= -100 <= 100 <= y.max()
    expected = plane_at(np.column_stack([x.ravel(), y.ravel()]), 0.05, -0.03)
    # GDAL interpolates pixel positions to an eighth of a pixel, which is 1 m here.
    assert np.abs(dem.heights.ravel() - expected).max() < 0.07
    assert dem.heights[np.argmin(np.abs(y[:, 0])), np.argmin(np.abs(x[0]))] == 0.0


def test_degrees_feet_and_scale(write_dem: Write) -> None:
    heights = np.full((80, 80), 100.0, dtype=np.float32)
    heights[:40] = 110.0  # the northern half is ten higher
    path = write_dem(heights, step=1e-4, crs="EPSG:4326", centre=(LONGITUDE, LATITUDE))
    import rasterio

    with rasterio.open(path, "r+") as raster:
        raster.units = ("ft",)
    dem = read_heights(path, FRAME, REGION, 10.0)
    high = dem.heights[-1].mean() - dem.heights[0].mean()
    assert high == pytest.approx(10 * 0.3048, abs=1e-4)


def test_region_that_sticks_out_is_refused(write_dem: Write) -> None:
    path = write_dem(slope(0, 0, cells=60), centre=(CENTRE[0] + 300.0, CENTRE[1]))
    with pytest.raises(InputError, match=r"dem\.tif: covers (49|50) % of the region; expected all"):
        check_dem(path, FRAME, REGION)
    path = write_dem(slope(0, 0), centre=(CENTRE[0] + 40_000.0, CENTRE[1]))
    with pytest.raises(InputError, match="covers 0 % of the region"):
        check_dem(path, FRAME, REGION)
    path = write_dem(slope(0, 0), centre=(0.0, 0.0), crs="EPSG:2154", step=5.0)
    with pytest.raises(InputError, match="covers 0 % of the region"):
        check_dem(path, FRAME, REGION)


@pytest.mark.parametrize("mark", [-9999.0, np.nan, 3e38])
def test_small_hole_is_filled_and_large_hole_refused(write_dem: Write, mark: float) -> None:
    heights = slope(0.0, 0.0)
    heights[29:31, 32:34] = mark
    declared = {} if mark > 0 else {"nodata": mark}
    path = write_dem(heights, centre=CENTRE, **declared)
    dem = read_heights(path, FRAME, REGION, 5.0)
    assert 0.0 < dem.missing_share < 0.05
    assert np.abs(dem.heights).max() < 1e-6
    heights[25:31, 30:38] = mark
    path = write_dem(heights, centre=CENTRE, **declared)
    # 60 m x 80 m of a circle of 100 m: 15 %.
    with pytest.raises(InputError, match=r"no height in 1\d% of the region; expected heights in"):
        check_dem(path, FRAME, REGION)


def test_bad_files_are_named(write_dem: Write, tmp_path: Path) -> None:
    bad: dict[str, tuple[Path, str]] = {}

    def keep(name: str, path: Path, words: str) -> None:
        bad[name] = (path.rename(tmp_path / f"{name}.tif"), words)

    keep("plain", write_dem(slope(0, 0), centre=CENTRE, crs=None), "not georeferenced")
    keep("bands", write_dem(np.stack([slope(0, 0)] * 3), centre=CENTRE), "holds 3 bands")
    complete = write_dem(slope(0.1, 0.1), centre=CENTRE).read_bytes()
    (tmp_path / "cut.tif").write_bytes(complete[: len(complete) // 2])
    bad["cut"] = (tmp_path / "cut.tif", "cannot be read")
    (tmp_path / "text.tif").write_text("heights\n")
    bad["text"] = (tmp_path / "text.tif", "cannot be read as a GeoTIFF")
    (tmp_path / "empty.tif").write_bytes(b"")
    bad["empty"] = (tmp_path / "empty.tif", "cannot be read as a GeoTIFF")
    bad["nowhere"] = (tmp_path / "nowhere.tif", "not found")
    bad["folder"] = (tmp_path, "is a folder")
    for path, words in bad.values():
        with pytest.raises(InputError) as caught:
            check_dem(path, FRAME, REGION)
        assert words in str(caught.value)
        assert str(caught.value).startswith(str(path))
        assert "\n" not in str(caught.value)


def test_site_with_a_dem(write_site: Callable[[object], Path], write_dem: Write) -> None:
    fields: dict[str, Any] = site_fields() | {"dem": {"file": "dem.tif", "licence": "CC0-1.0"}}
    write_dem(slope(0.02, 0.0), centre=CENTRE)
    site = load_site(write_site(fields))
    assert site.dem is not None
    assert [entry["licence"] for entry in site.inputs()] == ["ODbL-1.0", "CC0-1.0"]
    write_dem(slope(0.02, 0.0), centre=(CENTRE[0] + 290.0, CENTRE[1]))
    with pytest.raises(InputError, match=r"dem\.tif: covers \d+ % of the region"):
        load_site(write_site(fields))


def test_dem_of_another_datum_is_not_shifted(write_dem: Write) -> None:
    # Amersfoort lies 110 m from WGS84: a transform that leaves the datum out is that far off.
    delft = SiteFrame(52.0117, 4.3667)
    to_rd = Transformer.from_crs("EPSG:4326", "EPSG:28992", always_xy=True)
    centre = to_rd.transform(delft.longitude, delft.latitude)
    path = write_dem(slope(0.05, -0.03), centre=centre, crs="EPSG:28992")
    dem = read_heights(path, delft, REGION, 2.0)
    assert dem.anchor_height_m == pytest.approx(34.0, abs=0.02)


@pytest.mark.parametrize(
    ("crs", "vertical"),
    [("EPSG:5554", "DHHN92"), ("EPSG:4979", "WGS 84"), ("EPSG:25833", None)],
)
def test_datum_of_heights_is_kept(write_dem: Write, crs: str, vertical: str | None) -> None:
    centre = (LONGITUDE, LATITUDE) if crs == "EPSG:4979" else CENTRE
    step = 1e-4 if crs == "EPSG:4979" else 10.0
    if crs == "EPSG:5554":  # ETRS89 / UTM 31N and DHHN92: its zone is not this site's
        centre = Transformer.from_crs("EPSG:4326", "EPSG:25831", always_xy=True).transform(
            LONGITUDE, LATITUDE
        )
    dem = read_heights(
        write_dem(slope(0, 0, cells=80), centre=centre, crs=crs, step=step), FRAME, REGION, 5.0
    )
    assert (vertical in dem.vertical) if vertical else (dem.vertical == "")
    assert np.abs(dem.heights).max() < 1e-6
