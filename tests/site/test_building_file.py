"""Footprints of another source beside the map: which heights and which buildings come of them."""

import json
from pathlib import Path

import pytest
import shapely

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site import load_site, read_extract
from urbantwin.site.building_file import read_buildings, with_buildings

FRAME = SiteFrame(48.7, 9.18)
AREA = shapely.box(-200, -200, 200, 200)


def lonlat(shape: shapely.Geometry) -> dict:
    placed = shapely.transform(shape, FRAME.lonlat_from_site)
    return json.loads(shapely.to_geojson(placed))


def feature(shape: shapely.Geometry, **properties: object) -> dict:
    return {"type": "Feature", "properties": properties, "geometry": lonlat(shape)}


def written(folder: Path, *features: dict) -> Path:
    path = folder / "buildings.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": list(features)}))
    return path


@pytest.fixture
def mapped(tmp_path: Path) -> Path:
    """Three mapped houses of 10 m by 10 m: without height, with height, with storeys."""
    lines, ways, node = [], [], 1
    tags = ({"building": "yes"}, {"building": "house", "height": "8"},
            {"building": "yes", "building:levels": "2"})  # fmt: skip
    for k, own in enumerate(tags):
        corners = shapely.get_coordinates(shapely.box(40 * k, 0, 40 * k + 10, 10))[:-1]
        refs = []
        for longitude, latitude in FRAME.lonlat_from_site(corners):
            lines.append(f'<node id="{node}" lat="{latitude:.9f}" lon="{longitude:.9f}"/>')
            refs.append(node)
            node += 1
        told = "".join(f'<tag k="{key}" v="{value}"/>' for key, value in own.items())
        nodes = "".join(f'<nd ref="{ref}"/>' for ref in (*refs, refs[0]))
        ways.append(f'<way id="{100 + k}">{nodes}{told}</way>')
    path = tmp_path / "map.osm"
    path.write_text(f'<osm version="0.6">{"".join(lines + ways)}</osm>')
    return path


def completed(mapped: Path, *features: dict):
    extract = read_extract(mapped)
    more, counts = with_buildings(
        extract, read_buildings(written(mapped.parent, *features)), FRAME, AREA
    )
    found = {one.id: one for one in more.features(FRAME, AREA) if "building" in one.tags}
    return found, counts


def test_a_mapped_building_gets_the_height_that_it_lacks_and_no_other(mapped):
    moved = shapely.box(0, 0, 11, 10)
    features = [feature(shapely.transform(moved, lambda xy, k=k: xy + [40 * k, 0]), height=21.5)
                for k in range(3)]  # fmt: skip
    found, counts = completed(mapped, *features)
    assert counts == {"footprints": 3, "heights": 1, "added": 0, "unclear": 0}
    assert found[100].tags == {"building": "yes", "height": "21.5"}
    assert found[101].tags == {"building": "house", "height": "8"}
    assert found[102].tags == {"building": "yes", "building:levels": "2"}


def test_a_building_that_the_map_lacks_is_added_with_its_courtyard(mapped):
    ring = shapely.box(0, 50, 30, 80).difference(shapely.box(10, 60, 20, 70))
    found, counts = completed(
        mapped,
        feature(ring, height=12, building="apartments"),
        feature(shapely.box(60, 50, 70, 60)),
    )
    assert counts == {"footprints": 2, "heights": 0, "added": 2, "unclear": 0}
    areas = {one.tags.get("height"): one.geometry.area for one in found.values() if one.id > 102}
    assert areas["12"] == pytest.approx(800.0, abs=0.1)
    assert areas[None] == pytest.approx(100.0, abs=0.1)


def test_what_overlaps_without_being_the_same_is_left_out(mapped):
    found, counts = completed(
        mapped,
        feature(shapely.box(5, 5, 25, 25), height=5),  # a sixteenth of it is mapped: apart
        feature(shapely.box(40, 0, 50, 30), height=5),  # a third
        feature(shapely.box(3000, 0, 3010, 10), height=5),  # elsewhere
    )
    assert counts == {"footprints": 2, "heights": 0, "added": 1, "unclear": 1}
    assert len(found) == 4


def test_a_site_of_it_loads_again_from_what_it_resolves_to(mapped):
    written(mapped.parent, feature(shapely.box(0, 0, 10, 10), height=9))
    site = mapped.parent / "site.yaml"
    site.write_text(
        "anchor: {latitude: 48.7, longitude: 9.18}\nosm: map.osm\n"
        "buildings: {file: buildings.geojson, licence: mine, attribution: me}\n"
        "rig: {sensors: [{name: a, model: VLP-16, east_m: 0, north_m: 0, height_m: 4}]}\n"
    )
    resolved = load_site(site).resolved()
    assert resolved["buildings"] == {
        "file": "buildings.geojson", "licence": "mine", "attribution": "me"}  # fmt: skip
    site.write_text(json.dumps(resolved))
    assert load_site(site).resolved()["buildings"] == resolved["buildings"]
    site.write_text(json.dumps({**resolved, "osm": None, "roads": {"file": "map.osm"}}))
    with pytest.raises(InputError, match=r"buildings.*given without an extract"):
        load_site(site)


def test_a_file_of_a_whole_country_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / "buildings.geojson"
    with path.open("wb") as file:
        file.truncate(400_000_001)  # of zeros that take no room on the disk
    with pytest.raises(InputError, match=r"larger than 400 MB.*cut to the site"):
        read_buildings(path)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[1]", "is not a JSON object"),
        ('{"type": "Polygon"}', "is not a FeatureCollection"),
        ('{"type": "FeatureCollection", "features": [3]}', "features[0]: is not a Feature"),
        ('{"type": "FeatureCollection", "features": [{"geometry": {"type": "Polygon", '
         '"coordinates": [[[900, 1], [901, 1], [901, 2], [900, 1]]]}}]}', "not in degrees"),
        ('{"type": "FeatureCollection", "features": [{"geometry": {"type": "Polygon", '
         '"coordinates": "x"}}]}', "coordinates that are none"),
        ('{"type": "FeatureCollection", "features": [{"properties": {"height": "tall"}}]}',
         "features[0].properties.height: is 'tall'"),
        ('{"type": "FeatureCollection", "features": [{"properties": {"height": -3}}]}', "is -3"),
        ('{"type": "FeatureCollection", "crs": "EPSG:25832", "features": []}', "another CRS"),
    ],
)  # fmt: skip
def test_what_is_no_file_of_buildings_is_told(tmp_path, text, told):
    path = tmp_path / "buildings.geojson"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_buildings(path)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)
