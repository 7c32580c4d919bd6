"""Kinds of street objects that a person adds, and mistakes in their file."""

import numpy as np
import pytest
from shapely import Point, box

from urbantwin.errors import InputError
from urbantwin.scene.catalogue import street_objects
from urbantwin.scene.furniture import furniture_mesh
from urbantwin.scene.pole import pole_mesh
from urbantwin.site import load_site
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import material_id

REGION, ROAD = box(-100, -100, 100, 100), box(-100, -5, 100, 5)
LANTERN = """
double lantern:
  tags: {highway: street_lamp, lamp_model: lantern}
  counted: lanterns
  placed: lamp
  sizes:
    height: {tag: height, usual: 6, least: 3, most: 12}
    shade: {tag: "lantern:diameter", usual: 0.5}
  parts:
    - {drum: height - 0.4, at: [0, 0, 0], radius: 0.11, material: metal-dark, class: pole}
  arms:
    - {drum: 0.45, at: [reach, 0, height - 0.45], radius: shade / 2, material: glass, class: pole}
"""


def flat(xy):
    return np.zeros(len(xy))


def node(x, y, **tags):
    tags = {key.replace("__", ":"): value for key, value in tags.items()}
    return OsmFeature("node", 1, tags, Point(x, y))


def written(tmp_path, text):
    path = tmp_path / "street_objects.yaml"
    path.write_text(text)
    return path


def test_a_lamp_of_ones_own_hangs_over_the_road(tmp_path):
    objects = street_objects(written(tmp_path, LANTERN))
    lantern = node(0, 6, highway="street_lamp", lamp_model="lantern", lantern__diameter="0.8")
    usual = node(30, 6, highway="street_lamp")
    mesh, notes = pole_mesh(
        [lantern, usual], region=REGION, ground_height=flat, carriageway=ROAD, objects=objects
    )
    assert notes["street lamps"] == 2
    glass = mesh.triangles()[mesh.material == material_id("glass")].reshape(-1, 3)
    assert np.abs(glass[:, 0]).max() == pytest.approx(0.4, abs=0.03)
    assert glass[:, 2].max() == pytest.approx(6.0)
    assert glass[:, 1].mean() == pytest.approx(6 - 1.6, abs=0.02)  # 0.6 m beyond the curb
    assert mesh.vertices[:, 0].max() > 29
    assert mesh.vertices[mesh.vertices[:, 0] > 20, 2].max() == pytest.approx(8.0)


def test_two_arms_are_built_where_the_map_says_so(tmp_path):
    objects = street_objects(written(tmp_path, LANTERN))
    lamp = node(0, 6, highway="street_lamp", lamp_model="lantern", light__count="2")
    mesh, _ = pole_mesh(
        [lamp], region=REGION, ground_height=flat, carriageway=ROAD, objects=objects
    )
    glass = mesh.triangles()[mesh.material == material_id("glass")].reshape(-1, 3)
    assert glass[:, 1].mean() == pytest.approx(6.0, abs=1e-6)
    assert np.ptp(glass[:, 1]) > 3


def test_an_object_of_the_same_name_replaces_ours(tmp_path):
    text = """
bench:
  tags: {amenity: bench, backrest: no}
  counted: logs to sit on
  parts: [{box: [0.4, 3.0, 0.4], at: [0, 0, 0], material: wood}]
"""
    objects = street_objects(written(tmp_path, text))
    benches = [node(0, 20, amenity="bench", backrest="no"), node(5, 20, amenity="bench")]
    mesh, notes = furniture_mesh(
        benches, region=REGION, ground_height=flat, carriageway=ROAD, objects=objects
    )
    assert notes == {"logs to sit on": 1}
    assert mesh.vertices[:, 2].max() == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        ("material: glass", "material: gold", "material 'gold'"),
        ("class: pole", "class: poles", "class 'poles'"),
        ("radius: shade / 2", "radius: shadow / 2", "uses 'shadow'"),
        ("radius: shade / 2", "radius: open('x')", "expression of sizes"),
        ("radius: shade / 2", "radius: shade.real", "expression of sizes"),
        ("radius: shade / 2", "radius: shade / (shade - shade)", "without a value"),
        ("radius: shade / 2", "radius: 9 ** 9 ** 9", "without a value"),
        ("radius: shade / 2", "radius: (0 - shade) ** 0.5", "without a value"),
        ("drum: 0.45, ", "", "no shape"),
        ("placed: lamp", "placed: sky", "placed"),
        ("  tags: {highway: street_lamp, lamp_model: lantern}", "", "has no tags"),
    ],
)
def test_a_mistake_is_one_line_that_names_its_place(tmp_path, before, after, told):
    assert before in LANTERN
    path = written(tmp_path, LANTERN.replace(before, after, 1))
    with pytest.raises(InputError, match="double lantern") as caught:
        street_objects(path)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_file_beside_a_site_is_its_input(tmp_path, write_osm):
    write_osm({1: (-50, 0, {}), 2: (50, 0, {})}, {1: ([1, 2], {"highway": "residential"})})
    site = tmp_path / "site.yaml"
    text = "anchor: {latitude: 48.7, longitude: 9.18}\nregion: {radius_m: 40}\nosm: map.osm\n"
    text += "rig: {sensors: [{name: a, model: OS1-64, east_m: 0, north_m: 0, height_m: 4}]}\n"
    site.write_text(text)
    assert load_site(site).street_objects is None
    written(tmp_path, LANTERN)
    found = load_site(site)
    assert found.resolved()["street_objects"]["file"] == "street_objects.yaml"
    assert ("street_objects", "street_objects.yaml") in {
        (one["kind"], one["name"]) for one in found.inputs()
    }
    site.write_text(text + "street_objects: null\n")
    assert load_site(site).street_objects is None
