"""The example's inputs are what its generator writes."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rasterio

from urbantwin.geometry import SiteFrame
from urbantwin.site import read_extract


@pytest.fixture(scope="module")
def made(two_avenues: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    subprocess.run([sys.executable, two_avenues / "make_inputs.py", folder], check=True)
    return folder


def test_the_map_is_what_the_generator_writes(made: Path, two_avenues: Path) -> None:
    name = "two-avenues.osm"
    assert (made / name).read_bytes() == (two_avenues / name).read_bytes()


def test_the_ground_is_what_the_generator_writes(made: Path, two_avenues: Path) -> None:
    # GDAL's compression may change between versions; the heights and their places may not.
    name = "two-avenues-dem.tif"
    with rasterio.open(made / name) as new, rasterio.open(two_avenues / name) as committed:
        assert new.crs == committed.crs
        assert new.transform == committed.transform
        np.testing.assert_array_equal(new.read(1), committed.read(1))


def test_the_example_is_small(two_avenues: Path) -> None:
    assert sum(path.stat().st_size for path in two_avenues.iterdir()) < 100_000


def test_the_ground_slopes_by_3_to_4_percent(two_avenues: Path) -> None:
    with rasterio.open(two_avenues / "two-avenues-dem.tif") as raster:
        heights = raster.read(1).astype(float)
        rows, columns = np.indices(heights.shape)
        plane = np.column_stack([columns.ravel() * 3.0, rows.ravel() * 3.0, np.ones(heights.size)])
    (by_east, by_south, _), *_ = np.linalg.lstsq(plane, heights.ravel(), rcond=None)
    assert 0.03 < np.hypot(by_east, by_south) < 0.04


def test_the_map_holds_what_helsinki_lacks(two_avenues: Path) -> None:
    extract = read_extract(two_avenues / "two-avenues.osm")
    tags = [way.tags for way in extract.ways.values()]
    assert any(tag.get("area:highway") == "traffic_island" for tag in tags)
    assert sum("turn:lanes" in tag or "turn:lanes:forward" in tag for tag in tags) == 4
    assert any("min_height" in tag and "building:part" in tag for tag in tags)
    assert any(tag.get("cycleway") == "lane" for tag in tags)
    assert [relation.tags["building"] for relation in extract.relations.values()] == ["apartments"]
    signals = [
        extract.nodes[node]
        for node, tag in extract.node_tags.items()
        if tag.get("highway") == "traffic_signals"
    ]
    np.testing.assert_allclose(
        SiteFrame(48.7, 9.18).site_from_lonlat(np.mean(signals, axis=0)), 0.0, atol=0.01
    )
