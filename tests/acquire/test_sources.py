"""What each kind of server has of a place, judged by the formulas that it was made from."""

import json
from urllib.parse import parse_qs, urlsplit

import laspy
import numpy as np
import pytest
import rasterio
from affine import Affine
from pyproj import Transformer
from scipy.spatial import cKDTree

from urbantwin.acquire import AnswerCache, Area, SourceSpec, Web, sources_of
from urbantwin.site.building_file import read_buildings
from urbantwin.site.dem import read_heights
from urbantwin.site.extract_file import read_extract

from .local_web import send, tile_of
from .made_world import (
    EXTRACT,
    LATITUDE,
    LONGITUDE,
    cog,
    height,
    picture,
    row,
    survey,
    terrain,
)

DEM = {"path": "/dem/{NS}{south_deg:02}{EW}{west_deg:03}.tif", "crs": "EPSG:4326+3855"}


def dem(server, name="dem", **more):
    path = more.pop("path", DEM["path"])
    return row(server, name, "elevation", "cog", path, crs=DEM["crs"], **more)


def bytes_of(server, path):
    """How many bytes were asked of a file, and how many it has."""
    asked = 0
    for one, headers in server.asked:
        if urlsplit(one).path == path:
            first, last = headers["Range"].removeprefix("bytes=").split("-")
            asked += min(int(last), len(server.files[path]) - 1) - int(first) + 1
    return asked, len(server.files[path])


def off_plane(path, area):
    """How far heights of a DEM in an area are from the plane, metres."""
    grid = read_heights(path, area.frame, area.circle, 5.0)
    y, x = np.mgrid[: grid.heights.shape[0], : grid.heights.shape[1]] * grid.step_m
    points = np.column_stack([(x + grid.x0).ravel(), (y + grid.y0).ravel()])
    inside = np.hypot(*points.T) < area.radius_m
    expected = height(*area.frame.lonlat_from_site(points[inside]).T)
    return (grid.heights.ravel()[inside] + grid.anchor_height_m) - expected, grid


def test_the_map_is_whole_within_its_bounds(fetch, area):
    got = read_extract(fetch().inputs["map"].path)
    whole = read_extract(EXTRACT)
    assert got.bounds == pytest.approx(area.box(1000.0), abs=1e-4)
    assert got.ways.keys() == whole.ways.keys()
    assert all(ref in got.nodes for way in got.ways.values() for ref in way.nodes)


def test_of_a_cog_a_small_part_is_asked_for_and_has_its_heights(server, fetch, area):
    got = fetch(dem(server, resolution_m=30.0))
    off, grid = off_plane(got.inputs["elevation"].path, area)
    assert np.abs(off).max() < 0.01
    assert "EGM2008" in grid.vertical
    asked, whole = bytes_of(server, "/dem/N48E009.tif")
    assert asked < 0.3 * whole


def test_heights_beside_a_degree_come_from_both_tiles(server, fetch, tmp_path):
    server.files["/dem/N48E008.tif"] = cog(8.0, 48.0, 1.0, 512)
    server.files["/dem/N48E009.tif"] = cog(9.0, 48.0, 1.0, 512)
    at = Area.checked(48.5, 9.0003, 80.0)
    (source,) = sources_of([SourceSpec.model_validate(dem(server))])
    web = Web(AnswerCache(tmp_path / "cache"), environment={})
    got = source.fetch(at, web, tmp_path, lambda *_: None)
    assert np.abs(off_plane(got.path, at)[0]).max() < 0.01


def test_the_finest_model_that_has_heights_there_is_taken(server, fetch, area):
    server.files["/fine.tif"] = cog(9.1, 48.6, 0.2, 256, fine=7.0)
    server.files["/elsewhere.tif"] = cog(2.0, 48.6, 0.2, 64)
    rows = [
        dem(server, "gone", path="/gone.tif", resolution_m=0.5),
        dem(server, "elsewhere", path="/elsewhere.tif", resolution_m=1.0),
        dem(server, "fine", path="/fine.tif", resolution_m=2.0),
        dem(server, "coarse", resolution_m=30.0),
    ]
    got = fetch(*rows)
    assert off_plane(got.inputs["elevation"].path, area)[0] == pytest.approx(7.0, abs=0.01)
    outcomes = {name: got.outcome[name].outcome for name in ("gone", "elsewhere", "fine")}
    assert outcomes == {"gone": "nothing there", "elsewhere": "nothing there", "fine": "fetched"}
    assert "coarse" not in got.outcome
    assert not any("dem" in path for path in server.paths())


def test_a_model_with_holes_gives_way_to_the_next(server, fetch, area):
    with rasterio.io.MemoryFile(cog(9.1, 48.6, 0.2, 256)) as file, file.open() as raster:
        values, profile = raster.read(1), raster.profile
    values[100:156, 60:] = -9999.0
    with rasterio.io.MemoryFile() as file:
        with file.open(**profile) as out:
            out.write(values, 1)
        server.files["/holes.tif"] = file.read()
    got = fetch(dem(server, "holes", path="/holes.tif", resolution_m=1.0), dem(server))
    assert got.outcome["holes"].outcome == "failed"
    assert "no height" in got.outcome["holes"].told
    assert np.abs(off_plane(got.inputs["elevation"].path, area)[0]).max() < 0.01


def test_heights_in_feet_become_metres(server, fetch, area):
    with rasterio.io.MemoryFile(cog(9.1, 48.6, 0.2, 256)) as file, file.open() as raster:
        values, profile = raster.read(1) / 0.3048, raster.profile
    with rasterio.io.MemoryFile() as file:
        with file.open(**profile) as out:
            out.write(values.astype(np.float32), 1)
            out.units = ["ft"]
        server.files["/feet.tif"] = file.read()
    got = fetch(dem(server, path="/feet.tif"))
    assert np.abs(off_plane(got.inputs["elevation"].path, area)[0]).max() < 0.01


def test_a_service_is_asked_for_the_box_in_its_own_metres(server, fetch, area):
    def cut_out(handler):
        asked = parse_qs(urlsplit(handler.path).query)
        west, south, east, north = (float(one) for one in asked["BBOX"][0].split(","))
        columns, rows = int(asked["W"][0]), int(asked["H"][0])
        x = west + (np.arange(columns) + 0.5) * (east - west) / columns
        y = north - (np.arange(rows) + 0.5) * (north - south) / rows
        back = Transformer.from_crs(25832, 4326, always_xy=True)
        values = height(*back.transform(*np.meshgrid(x, y))).astype(np.float32)
        size = (east - west) / columns, (south - north) / rows
        transform = Affine(size[0], 0, west, 0, size[1], north)
        with rasterio.io.MemoryFile() as file:
            with file.open(driver="GTiff", dtype="float32", count=1, width=columns, height=rows,
                           crs="EPSG:25832", transform=transform) as out:  # fmt: skip
                out.write(values, 1)
            send(handler, file.read(), ("Content-Type", "image/tiff"))

    server.answers["/wcs"] = cut_out
    path = "/wcs?BBOX={xmin},{ymin},{xmax},{ymax}&W={columns}&H={rows}"
    got = fetch(row(server, "wcs", "elevation", "geotiff", path, resolution_m=2.0,
                    crs="EPSG:25832+5783"))  # fmt: skip
    off, grid = off_plane(got.inputs["elevation"].path, area)
    assert np.abs(off).max() < 0.01
    assert "DHHN92" in grid.vertical


def test_terrain_tiles_are_heights_to_their_last_bit(server, fetch, area):
    x, y = tile_of(LATITUDE, LONGITUDE, 15)
    for column in range(x - 1, x + 2):
        for line in range(y - 1, y + 2):
            server.files[f"/t/15/{column}/{line}.png"] = terrain(column, line, 15)
    got = fetch(row(server, "tiles", "elevation", "terrarium", "/t/{z}/{x}/{y}.png", zoom=15))
    with rasterio.open(got.inputs["elevation"].path) as raster:
        rows, columns = np.mgrid[: raster.height, : raster.width]
        back = Transformer.from_crs(raster.crs, 4326, always_xy=True)
        places = back.transform(*(raster.transform @ (columns + 0.5, rows + 0.5)))
        assert np.abs(raster.read(1) - height(*places)).max() <= 1 / 256 + 1e-4


@pytest.mark.parametrize("access", ["copc", "ept"])
def test_of_an_octree_the_points_around_the_place_come_and_no_others(server, fetch, area, access):
    path = "/survey.copc.laz" if access == "copc" else "/ept/ept.json"
    got = fetch(row(server, "survey", "airborne", access, path))
    cloud = laspy.read(got.inputs["airborne"].path)
    points, classes = survey()
    west, south, east, north = area.box_in("EPSG:25832", 60.0)
    inside = (points[:, 0] >= west) & (points[:, 0] <= east)
    inside &= (points[:, 1] >= south) & (points[:, 1] <= north)
    assert len(cloud) == inside.sum()
    away, which = cKDTree(points[inside]).query(cloud.xyz)
    assert away.max() < 0.01
    assert len(set(which)) == len(cloud)
    assert (cloud.classification == classes[inside][which]).all()
    assert cloud.header.parse_crs().to_epsg() or cloud.header.parse_crs().is_compound
    if access == "ept":
        tiles = {path for path in server.paths() if path.startswith("/ept/ept-data/")}
        there = [one for one in server.files if one.startswith("/ept/ept-data/")]
        assert len(tiles) < 0.6 * len(there)


def test_of_buildings_the_row_groups_around_the_place_are_read(server, fetch):
    index = {"url": f"{server.url}/stac/catalog.json", "kind": "overture"}
    got = fetch(row(server, "overture", "buildings", "geoparquet", index=index))
    found = read_buildings(got.inputs["buildings"].path)
    assert len(found) == 5
    assert {one.tags["height"] for one in found} == {"12.5"}
    assert {one.tags["roof:shape"] for one in found} == {"flat"}
    assert got.inputs["buildings"].url == f"{server.url}/overture/one.parquet"
    assert "/overture/other.parquet" not in server.paths()


def test_a_picture_shows_at_each_place_the_tile_of_that_place(server, fetch, area):
    x, y = tile_of(LATITUDE, LONGITUDE, 17)
    for column in range(x - 2, x + 3):
        for line in range(y - 2, y + 3):
            server.files[f"/p/17/{column}/{line}.png"] = picture(column, line)
    got = fetch(row(server, "photos", "imagery", "xyz", "/p/{z}/{x}/{y}.png", zoom=17))
    with rasterio.open(got.inputs["imagery"].path) as raster:
        to = Transformer.from_crs(4326, raster.crs, always_xy=True)
        for longitude, latitude in area.outline(0.0):
            column, line = tile_of(latitude, longitude, 17)
            seen = next(iter(raster.sample([to.transform(longitude, latitude)])))
            assert seen.tolist() == [column % 256, line % 256, 90, 255]


def test_an_index_of_features_leads_to_the_newest_file_there(server, fetch, area):
    server.files["/new.tif"] = cog(9.1, 48.6, 0.2, 64, fine=2.0)
    server.files["/old.tif"] = cog(9.1, 48.6, 0.2, 64, fine=1.0)

    def items(handler):
        box = [float(one) for one in parse_qs(urlsplit(handler.path).query)["bbox"][0].split(",")]
        assert box == pytest.approx(area.box(60.0), abs=1e-5)
        ring = [[9.1, 48.6], [9.3, 48.6], [9.3, 48.8], [9.1, 48.8], [9.1, 48.6]]
        features = [
            {"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [ring]},
             "properties": {"datetime": f"{year}-01-01T00:00:00Z"},
             "links": [{"href": f"{server.url}/trap.tif"}],
             "assets": {"dtm": {"href": f"{server.url}/{name}.tif"},
                        "text": {"href": f"{server.url}/{name}.txt"}}}
            for name, year in (("old", 2019), ("new", 2024))
        ]  # fmt: skip
        send(handler, json.dumps({"type": "FeatureCollection", "features": features}).encode())

    server.answers["/items"] = items
    index = {"url": f"{server.url}/items?bbox={{west}},{{south}},{{east}},{{north}}",
             "address": r"http://.*\.tif", "newest": "datetime"}  # fmt: skip
    got = fetch(row(server, "stac", "elevation", "cog", index=index, crs="EPSG:4326+3855"))
    assert off_plane(got.inputs["elevation"].path, area)[0] == pytest.approx(2.0, abs=0.01)
    assert not {"/trap.tif", "/old.tif"} & set(server.paths())


@pytest.mark.parametrize("same", [True, False])
def test_a_model_of_another_datum_is_not_used_beside_a_survey(server, fetch, same):
    """The survey is above DHHN92; between it and EGM2008 PROJ knows no way without grids."""
    survey = row(server, "survey", "airborne", "copc", "/survey.copc.laz")
    crs = "EPSG:4326+5783" if same else "EPSG:4326+3855"
    got = fetch(row(server, "dem", "elevation", "cog", DEM["path"], crs=crs), survey)
    assert ("elevation" in got.inputs) == same
    assert got.outcome["dem"].outcome == ("fetched" if same else "not used")
    if not same:
        assert got.outcome["dem"].told == (
            "its heights are above EGM2008 height, those of survey above DHHN92 height"
        )
        assert any("is not used beside the survey" in str(one) for one in got.found.warnings)
