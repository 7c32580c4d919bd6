"""What stands beside the streets of six real extracts: sound triangles, nothing on the roads."""

import time

import numpy as np
import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.scene.map_objects import map_objects
from urbantwin.site.extract_file import read_extract
from urbantwin.taxonomy import semantic_id

from ..real_files import osm_extract

PLACES = {
    "taipei": (25.052396, 121.522635),
    "neukolln": (52.47328, 13.439643),
    "munich": (48.1545, 11.5340),
    "West-Oakland": (37.8087, -122.2986),
    "quad_intersection": (47.644172, -122.303614),
    "perth_stretched_lights": (-31.974855, 115.897588),
}
STREETS = ("primary", "secondary", "tertiary", "residential", "unclassified", "trunk", "motorway")
#: What reaches over streets by design: wires and arms, crowns, bridges, rails in the pavement.
FREE_M = 4.0


def sloping(xy):
    return 0.03 * xy[:, 0] - 0.02 * xy[:, 1]


@pytest.fixture(scope="module", params=PLACES)
def built(request, shared_data):
    name = request.param
    extract = read_extract(osm_extract(shared_data, name))
    place = PLACES[name]
    if name in ("munich", "West-Oakland"):  # somewhere in the middle of what it holds
        longitude, latitude = np.median(np.array(list(extract.nodes.values())), axis=0)
        place = (float(latitude), float(longitude))
    region = shapely.box(-150, -150, 150, 150)
    features = extract.features(SiteFrame(*place), region)
    streets = [
        f.geometry.buffer(3.0)
        for f in features
        if f.tags.get("highway") in STREETS and f.tags.get("bridge", "no") == "no"
    ]
    road = shapely.union_all(streets)
    start = time.process_time()
    objects = map_objects(features, [], region=region, ground_height=sloping, carriageway=road)
    return objects, road, region, time.process_time() - start


def test_there_are_no_degenerate_faces_and_no_nan(built):
    objects, _, _, _ = built
    for name, (mesh, _) in objects.items():
        assert np.isfinite(mesh.vertices).all(), name
        assert not len(mesh.faces) or mesh.areas().min() > 1e-8, name
        assert (mesh.part > 0).all(), name


def test_solids_are_closed_and_face_outward(built):
    objects, _, _, _ = built
    for name, (mesh, _) in objects.items():
        solid = mesh.select(mesh.semantic != semantic_id("vegetation"))
        if not len(solid.faces):
            continue
        edges = np.sort(solid.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        assert set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}, name
        a, b, c = np.moveaxis(solid.triangles() - solid.vertices.mean(axis=0), 1, 0)
        volume = np.bincount(solid.part, (a * np.cross(b, c)).sum(axis=1) / 6)
        assert (volume[np.unique(solid.part)] > 0).all(), name


def test_nothing_stands_in_the_way_of_traffic(built):
    objects, road, _, _ = built
    inner = shapely.buffer(road, -0.3)
    shapely.prepare(inner)
    for name in ("poles", "trees", "barriers", "furniture", "wires", "bridges"):
        mesh = objects[name][0]
        middle = mesh.triangles().mean(axis=1)
        above = middle[:, 2] - sloping(middle[:, :2])
        low = (above < FREE_M) & (above > 0.05)
        assert not shapely.contains_xy(inner, middle[low, 0], middle[low, 1]).any(), name


def test_nothing_floats(built):
    objects, _, _, _ = built
    for name in ("poles", "trees", "barriers", "furniture"):
        mesh = objects[name][0]
        if not len(mesh.faces):
            continue
        corner = mesh.vertices[mesh.faces.ravel()]
        above = corner[:, 2] - sloping(corner[:, :2])
        lowest = np.full(mesh.part.max() + 1, np.inf)
        np.minimum.at(lowest, np.repeat(mesh.part, 3), above)
        own = np.unique(mesh.part)
        assert (lowest[own] < 0).all(), name


def test_it_takes_little_of_the_time_of_a_build(built):
    _, _, _, seconds = built
    assert seconds < 3.0
