"""Outlines of buildings read from files that GDAL and SQLite wrote."""

import json
import socket
import sqlite3
import struct

import numpy as np
import pyogrio
import pytest
import shapely
from pyproj import Transformer

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.reconstruct.airborne import read_footprints

#: Delft; EPSG:28992 is 100 m off WGS84 unless its datum is shifted.
FRAME = SiteFrame(52.011, 4.366)
AREA = shapely.box(-150, -150, 150, 150)
TO_RD = Transformer.from_crs(4326, 28992, always_xy=True)


def in_rd(shape):
    """A shape of the site frame in EPSG:28992."""
    return shapely.transform(
        shape, lambda xy: np.column_stack(TO_RD.transform(*FRAME.lonlat_from_site(xy).T))
    )


def write(path, shapes, crs="EPSG:28992", **options):
    raw = np.array([shapely.to_wkb(shape) for shape in shapes], dtype=object)
    pyogrio.raw.write(
        path, raw, field_data=[], fields=[], crs=crs,
        geometry_type=options.pop("geometry_type", "Unknown"), **options,
    )  # fmt: skip
    return path


HOUSES = [shapely.box(0, 0, 10, 8), shapely.box(30, 5, 42, 20), shapely.box(-90, -40, -70, -30)]


@pytest.mark.parametrize("ending", ["gpkg", "geojson", "sqlite", "shp"])
def test_outlines_come_back_where_they_stand(tmp_path, ending):
    shapes = [in_rd(house) for house in HOUSES]
    crs = "EPSG:28992"
    if ending == "geojson":  # RFC 7946: longitude and latitude
        shapes = [shapely.transform(h, FRAME.lonlat_from_site) for h in HOUSES]
        crs = "EPSG:4326"
    kind = "Polygon" if ending == "shp" else "Unknown"
    path = write(tmp_path / f"houses.{ending}", shapes, crs, geometry_type=kind)
    found = read_footprints(path, FRAME, AREA)
    assert len(found) == 3
    for outline, house in zip(found, HOUSES, strict=True):
        assert outline.hausdorff_distance(house) < 0.02


def test_holes_multipolygons_and_what_is_no_polygon(tmp_path):
    yard = shapely.Polygon(HOUSES[1].exterior.coords, [shapely.box(33, 8, 38, 15).exterior.coords])
    both = shapely.MultiPolygon([HOUSES[0], yard])
    bow = shapely.Polygon([(60, 0), (80, 20), (80, 0), (60, 20)])  # crosses itself
    far = shapely.box(400, 400, 420, 420)
    shapes = [both, bow, far, shapely.Point(0, 0), shapely.LineString([(0, 0), (9, 9)])]
    path = write(tmp_path / "mixed.gpkg", [in_rd(shape) for shape in shapes])
    notes = []
    found = read_footprints(path, FRAME, AREA, notes=notes)
    assert sum(outline.area for outline in found) == pytest.approx(80 + 180 - 35 + 200, rel=0.001)
    assert all(outline.is_valid for outline in found)
    assert len(notes) == 1
    assert "2 features are no polygons" in notes[0]


def test_curves_and_polyhedral_surfaces(tmp_path):
    """GDAL cannot write them through pyogrio: their blobs are put into a GeoPackage by hand."""
    path = write(tmp_path / "odd.gpkg", [in_rd(HOUSES[0])])
    x, y = shapely.get_coordinates(in_rd(shapely.Point(50, 50)))[0]
    circle = np.array([[-5, 0], [0, 5], [5, 0], [0, -5], [-5, 0]], float) + [x, y]
    curve = struct.pack("<BII", 1, 10, 1) + struct.pack("<BII", 1, 8, 5) + circle.tobytes()
    square = np.array([[0, 0], [6, 0], [6, 6], [0, 6], [0, 0]], float) + [x + 40, y]
    wall = np.array([[0, 0, 0], [6, 0, 0], [6, 0, 5], [0, 0, 5], [0, 0, 0]], float) + [x + 40, y, 0]

    def face(ring):
        return struct.pack("<BIII", 1, 1003, 1, len(ring)) + ring.tobytes()

    solid = [np.column_stack([square, np.full(5, z)]) for z in (0.0, 5.0)]
    surface = struct.pack("<BII", 1, 1015, 3) + b"".join(map(face, [*solid, wall]))
    with sqlite3.connect(path) as base:
        for (name,) in base.execute("select name from sqlite_master where type='trigger'"):
            base.execute(f'drop trigger "{name}"')
        (blob,) = base.execute("select geom from odd").fetchone()
        header = blob[: 8 + (0, 32, 48, 48, 64)[(blob[3] >> 1) & 7]]
        for odd in (curve, surface):
            base.execute("insert into odd(geom) values (?)", (header + odd,))
        base.execute("update gpkg_ogr_contents set feature_count = 3")
    base.close()
    house, disc, box = read_footprints(path, FRAME, AREA)
    assert house.area == pytest.approx(80, rel=0.001)
    assert disc.area == pytest.approx(np.pi * 25, rel=0.002)
    assert box.area == pytest.approx(36, rel=0.001)


def test_of_several_layers_the_one_of_buildings_is_read(tmp_path):
    path = tmp_path / "city.gpkg"
    write(path, [in_rd(shapely.box(k, 60, k + 5, 65)) for k in range(0, 90, 9)], layer="gardens")
    write(path, [in_rd(house) for house in HOUSES], layer="buildings", append=False)
    notes = []
    assert len(read_footprints(path, FRAME, AREA, notes=notes)) == 3
    assert notes == ["city.gpkg: layer buildings read; not gardens"]


def test_the_real_outlines_of_delft(shared_data):
    path = shared_data / "airborne/delft-ahn3/bgt/bgt_pand.sqlite"
    frame = SiteFrame(52.0113, 4.3664)
    found = read_footprints(path, frame, shapely.box(-300, -300, 300, 300))
    assert len(found) == 160
    # The area does not depend on where the outlines are put.
    _, _, raw, _ = pyogrio.raw.read(path, columns=[])
    assert sum(outline.area for outline in found) == pytest.approx(
        shapely.area(shapely.from_wkb(raw)).sum(), rel=0.001
    )


def bad_files(folder):
    rd = [in_rd(house) for house in HOUSES]
    text = folder / "text.gpkg"
    text.write_text("no database")
    cut = folder / "cut.gpkg"
    cut.write_bytes(write(folder / "whole.gpkg", rd).read_bytes()[:3000])
    lines = folder / "lines.geojson"
    line = {"type": "LineString", "coordinates": [[4.3, 52.0], [4.4, 52.1]]}
    feature = {"type": "Feature", "properties": {}, "geometry": line}
    lines.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    # Metres of EPSG:28992 that are said to be degrees, and metres of another zone.
    degrees = write(folder / "degrees.geojson", rd, "EPSG:4326")
    zone = write(folder / "zone.gpkg", rd, "EPSG:32617")
    return {
        "no such file": folder / "none.gpkg",
        "cannot be read": text,
        "ca": cut,
        "holds no polygons": lines,
        "of its 3 outlines lies in the area": zone,
        "none of its": degrees,
    }


def test_bad_files_are_one_clear_line(tmp_path):
    for problem, path in bad_files(tmp_path).items():
        with pytest.raises(InputError, match=problem) as error:
            read_footprints(path, FRAME, AREA)
        assert str(error.value).startswith(str(path))
        assert "\n" not in str(error.value)


def test_a_missing_crs_is_asked_for(tmp_path):
    with pytest.warns(UserWarning, match="crs"):
        path = write(tmp_path / "bare.shp", [in_rd(HOUSES[0])], crs=None, geometry_type="Polygon")
    with pytest.raises(InputError, match="no coordinate reference system"):
        read_footprints(path, FRAME, AREA)
    assert len(read_footprints(path, FRAME, AREA, crs="EPSG:28992")) == 1
    with pytest.raises(InputError, match="without a known transform"):
        read_footprints(path, FRAME, AREA, crs="EPSG:999999")


def test_another_continent_is_named(shared_data):
    path = shared_data / "airborne/delft-ahn3/bgt/bgt_pand.sqlite"
    with pytest.raises(InputError, match=r"they lie around 52\.01\d+, 4\.36\d+"):
        read_footprints(path, SiteFrame(40.46, -79.95), AREA)


GEOJSON = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "properties": {"url": "http://houses.example/1", "name": "\u0041 link"},
            "geometry": shapely.geometry.mapping(
                shapely.transform(HOUSES[0], FRAME.lonlat_from_site)
            ),
        }
    ],
}


def orders(url):
    """Files that tell GDAL to ask an address."""
    link = {"type": "link", "properties": {"href": f"{url}/crs", "type": "proj4"}}
    plain = json.dumps(GEOJSON)
    linked = json.dumps({"crs": link, **GEOJSON})
    vrt = f"<SrcDataSource>/vsicurl/{url}/a.geojson</SrcDataSource>"
    return {
        "link.geojson": linked,
        "letters.geojson": linked.replace('"link"', '"\\u006cink"'),
        "quotes.geojson": linked.replace('"crs"', "'crs'").replace('"link"', "'link'"),
        "twice.geojson": linked[:-1] + ', "crs": {"type": "name", "properties": {"name": "x"}}}',
        "inside.geojson": plain.replace(
            '"geometry": {', f'"geometry": {{"crs": {json.dumps(link)}, '
        ),
        "houses.vrt": '<OGRVRTDataSource><OGRVRTLayer name="a">'
        f"{vrt}</OGRVRTLayer></OGRVRTDataSource>",
        "houses.gpkg": f"<OGRWFSDataSource><URL>{url}/wfs</URL></OGRWFSDataSource>",
        "houses.json": json.dumps(
            {
                "type": "gdal_streamed_alg",
                "command_line": f"gdal vector pipeline ! read /vsicurl/{url}/a.json ! reproject",
            }
        ),
    }


def test_no_file_makes_gdal_ask_an_address(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.05)
        for name, text in orders(f"http://127.0.0.1:{server.getsockname()[1]}").items():
            path = tmp_path / name
            path.write_text(text)
            with pytest.raises(InputError, match=r"by a link|cannot be read") as error:
                read_footprints(path, FRAME, AREA)
            assert str(error.value).startswith(str(path))
        with pytest.raises(TimeoutError):
            server.accept()


def test_a_crs_by_name_and_addresses_of_houses_are_no_links(tmp_path):
    named = {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}
    path = tmp_path / "houses.geojson"
    path.write_text(json.dumps({"crs": named, **GEOJSON}))
    assert len(read_footprints(path, FRAME, AREA)) == 1
