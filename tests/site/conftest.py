"""A small site on paper: two streets that cross, and a DEM that is a tilted plane."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
import yaml
from affine import Affine

LATITUDE, LONGITUDE = 52.5, 13.4

OSM = """<?xml version='1.0' encoding='UTF-8'?>
<osm version="0.6">
  <node id="1" lat="52.5" lon="13.4"/>
  <node id="2" lat="52.502" lon="13.4"/>
  <node id="3" lat="52.498" lon="13.4"/>
  <node id="4" lat="52.5" lon="13.403"/>
  <node id="5" lat="52.5" lon="13.397"/>
  <way id="10"><nd ref="2"/><nd ref="1"/><nd ref="3"/>
    <tag k="highway" v="residential"/><tag k="name" v="North Street"/></way>
  <way id="11"><nd ref="4"/><nd ref="1"/><nd ref="5"/>
    <tag k="highway" v="residential"/><tag k="name" v="East Street"/></way>
</osm>
"""

SENSOR = {"name": "pole", "model": "OS1-128", "east_m": 10.0, "north_m": -10.0, "height_m": 5.0}


def site_fields() -> dict[str, Any]:
    """Return the fields of a site without a mistake, to be spoilt."""
    return {
        "name": "crossing",
        "anchor": {"latitude": LATITUDE, "longitude": LONGITUDE},
        "region": {"radius_m": 100},
        "osm": "map.osm",
        "traffic": {"per_hour": {"car": 600, "pedestrian": 100}, "duration_s": 5},
        "rig": {"sensors": [dict(SENSOR)]},
    }


@pytest.fixture
def write_site(tmp_path: Path) -> Callable[[object], Path]:
    """Return a function that writes fields (or text) as ``site.yaml`` beside a map."""
    (tmp_path / "map.osm").write_text(OSM)

    def write(content: object) -> Path:
        text = content if isinstance(content, str) else yaml.safe_dump(content, sort_keys=False)
        path = tmp_path / "site.yaml"
        path.write_text(text)
        return path

    return write


@pytest.fixture
def write_dem(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes rows of heights as a GeoTIFF centred on a place."""

    def write(
        heights: np.ndarray,
        *,
        step: float = 10.0,
        crs: str | None = "EPSG:25833",
        centre: tuple[float, float],
        **more: Any,
    ) -> Path:
        rows, columns = heights.shape[-2:]
        bands = heights.reshape(-1, rows, columns)
        west, north = centre[0] - columns * step / 2, centre[1] + rows * step / 2
        path = tmp_path / "dem.tif"
        with rasterio.open(
            path,
            "w",
            driver="GTiff",
            width=columns,
            height=rows,
            count=len(bands),
            dtype=bands.dtype,
            crs=crs,
            transform=Affine(step, 0.0, west, 0.0, -step, north),
            **more,
        ) as raster:
            raster.write(bands)
        return path

    return write
