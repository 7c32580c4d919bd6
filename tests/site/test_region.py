"""Regions from GeoJSON: the right ground is covered, and bad polygons are named."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from pyproj import Geod

from urbantwin.errors import InputError
from urbantwin.site import load_site

from .conftest import site_fields

Write = Callable[[object], Path]
SQUARE = [[13.398, 52.499], [13.402, 52.499], [13.402, 52.501], [13.398, 52.501], [13.398, 52.499]]


def polygon(*rings: list[list[float]]) -> dict[str, Any]:
    return {"type": "Polygon", "coordinates": list(rings)}


def feature(geometry: object) -> dict[str, Any]:
    return {"type": "Feature", "properties": {}, "geometry": geometry}


def collection(*geometries: object) -> dict[str, Any]:
    return {"type": "FeatureCollection", "features": [feature(item) for item in geometries]}


SAME = {
    "geometry": polygon(SQUARE),
    "feature": feature(polygon(SQUARE)),
    "collection": collection(polygon(SQUARE)),
    "one-part multipolygon": {"type": "MultiPolygon", "coordinates": [[SQUARE]]},
    "clockwise": polygon(SQUARE[::-1]),
    "not closed": polygon(SQUARE[:-1]),
    "with heights": polygon([[*point, 34.0] for point in SQUARE]),
    "beside a marker": collection({"type": "Point", "coordinates": [13.4, 52.5]}, polygon(SQUARE)),
}


@pytest.mark.parametrize("geojson", SAME.values(), ids=SAME.keys())
@pytest.mark.parametrize("inline", [True, False])
def test_every_way_to_write_a_polygon(
    write_site: Write, tmp_path: Path, geojson: dict[str, Any], inline: bool
) -> None:
    (tmp_path / "region.geojson").write_text(json.dumps(geojson))
    fields = site_fields() | {"region": {"polygon": geojson if inline else "region.geojson"}}
    region = load_site(write_site(fields)).region
    on_the_ellipsoid = abs(Geod(ellps="WGS84").polygon_area_perimeter(*np.array(SQUARE).T)[0])
    assert region.area == pytest.approx(on_the_ellipsoid, rel=1e-4)
    assert region.is_valid
    assert region.exterior.is_ccw


def moved(east: float, north: float) -> list[list[float]]:
    return [[x + east, y + north] for x, y in SQUARE]


BOWTIE = [SQUARE[0], SQUARE[1], SQUARE[3], SQUARE[2], SQUARE[0]]
HOLE = [[13.399, 52.4995], [13.401, 52.4995], [13.4, 52.5005], [13.399, 52.4995]]
BAD: dict[str, tuple[object, list[str]]] = {
    "crosses itself": (polygon(BOWTIE), ["crosses itself at 13.4, 52.5", "simple polygon"]),
    "two points": (polygon([SQUARE[0], SQUARE[1], SQUARE[0]]), ["2 different points", "three"]),
    "a line": (
        polygon([[13.4, 52.5], [13.401, 52.5], [13.402, 52.5], [13.4, 52.5]]),
        ["on a line"],
    ),
    "wrong type": ({"type": "LineString", "coordinates": SQUARE}, ["holds no Polygon but LineS"]),
    "nothing": ({"type": "FeatureCollection", "features": []}, ["holds no Polygon"]),
    "two": (collection(polygon(SQUARE), polygon(SQUARE)), ["holds 2 polygons", "one polygon"]),
    "two parts": ({"type": "MultiPolygon", "coordinates": [[SQUARE], [SQUARE]]}, ["2 polygons"]),
    "a hole": (polygon(SQUARE, HOLE), ["has a hole"]),
    "no rings": (polygon(), ["without rings"]),
    "words": (polygon([["a", "b"]] * 4), ["not two numbers"]),
    "coordinates missing": ({"type": "Polygon"}, ["without rings"]),
    "metres": (polygon([[391000.0, 5818000.0]] * 2 + SQUARE), ["391000", "not in degrees"]),
    "not a number": (polygon([[float("nan"), 52.5], *SQUARE]), ["not a finite number"]),
    "elsewhere": (polygon(moved(0.1, 0.0)), ["6", "m away from the anchor", "around the anchor"]),
    "overseas": (polygon(moved(-90.0, -20.0)), ["hundreds of km away from the anchor"]),
    "huge": (
        polygon([[13.0, 52.3], [13.8, 52.3], [13.8, 52.7], [13.0, 52.7], [13.0, 52.3]]),
        ["reaches", "within 2000 m"],
    ),
    "latitude first": (polygon([[y, x] for x, y in SQUARE]), ["latitude comes first"]),
    "tiny": (polygon([[13.4, 52.5], [13.4001, 52.5], [13.4, 52.5001]]), ["m²", "at least 1000"]),
    "another crs": (
        polygon(SQUARE) | {"crs": {"type": "name", "properties": {"name": "EPSG:25833"}}},
        ["another CRS", "EPSG:25833"],
    ),
    "a list": ([polygon(SQUARE)], ["not a JSON object"]),
}


@pytest.mark.parametrize(("geojson", "words"), BAD.values(), ids=BAD.keys())
def test_bad_polygon_is_named(
    write_site: Write, tmp_path: Path, geojson: object, words: list[str]
) -> None:
    file = tmp_path / "region.geojson"
    file.write_text(json.dumps(geojson))
    path = write_site(site_fields() | {"region": {"polygon": "region.geojson"}})
    with pytest.raises(InputError) as caught:
        load_site(path)
    assert str(caught.value).startswith(f"{file}: ")
    for word in words:
        assert word in str(caught.value)


def test_inline_polygon_is_named_by_its_field(write_site: Write) -> None:
    path = write_site(site_fields() | {"region": {"polygon": polygon(BOWTIE)}})
    with pytest.raises(InputError, match=r"site\.yaml: region\.polygon \(line \d+\): crosses"):
        load_site(path)


def test_broken_json_is_named_with_its_line(write_site: Write, tmp_path: Path) -> None:
    (tmp_path / "region.geojson").write_text('{"type": "Polygon",\n "coordinates": [[}')
    path = write_site(site_fields() | {"region": {"polygon": "region.geojson"}})
    with pytest.raises(
        InputError, match=r"region\.geojson: line 2, column 19 \(byte 38\): is not JSON"
    ):
        load_site(path)
    (tmp_path / "region.geojson").write_bytes(bytes(range(256)))
    with pytest.raises(InputError, match="is not JSON"):
        load_site(path)


@pytest.mark.parametrize(
    "name", ["neukolln", "perth_stretched_lights", "quad_intersection", "taipei"]
)
def test_published_boundaries(write_site: Write, shared_data: Path, name: str) -> None:
    file = shared_data / "osm" / f"{name}.boundary.json"
    ring = np.array(json.loads(file.read_text())["features"][0]["geometry"]["coordinates"][0])
    longitude, latitude = (float(x) for x in ring.mean(axis=0))
    fields = site_fields() | {
        "anchor": {"latitude": latitude, "longitude": longitude},
        "region": {"polygon": str(file)},
    }
    site = load_site(write_site(fields))
    area = abs(Geod(ellps="WGS84").polygon_area_perimeter(*ring.T)[0])
    assert site.region.area == pytest.approx(area, rel=1e-4)
    corners = site.frame.lonlat_from_site(shapely.get_coordinates(site.region))
    assert np.abs(np.sort(corners, axis=0)[[0, -1]] - [ring.min(0), ring.max(0)]).max() < 1e-9
