"""What stands out of facades: how far, where it may, and where walkers are in the way."""

import numpy as np
import pytest
import trimesh
from shapely import box, contains_xy

from urbantwin.scene.building import building_mesh
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import material_id

REGION = box(-200, -200, 200, 200)
CARRIAGEWAY = box(-200, -14, 200, -8)
#: Houses stand north of it; the footway reaches up to them, or to 3 m before them.
TO_THE_WALL, BEFORE_GARDENS = box(-200, -14, 200, 0), box(-200, -14, 200, -3)


def house(number, x=0.0, **tags):
    told = {"building": "apartments", "building:levels": "4", "roof:shape": "flat", **tags}
    return OsmFeature("way", number, told, box(x, 0, x + 18, 10))


def build(*features, street=None):
    return building_mesh(
        features,
        region=REGION,
        ground_height=lambda xy: np.zeros(len(xy)),
        carriageway=CARRIAGEWAY,
        street=street,
    )[:2]


def low_points_before_the_wall(mesh):
    corners = mesh.triangles().reshape(-1, 3)
    return corners[(corners[:, 1] < -0.16) & (corners[:, 2] < 2.3)]


def test_without_a_street_facades_are_plain():
    mesh, notes = build(house(1))
    assert mesh.vertices[:, 1].min() == pytest.approx(0.0, abs=1e-6)
    assert "downpipes" not in notes


def test_doors_have_steps_before_gardens_and_none_onto_the_footway():
    many = [house(number, x) for number, x in enumerate(np.arange(-190.0, 170.0, 20.0), start=1)]
    mesh, notes = build(*many, street=BEFORE_GARDENS)
    assert notes["entrance steps"] == notes["doors"] == len(many)
    steps = low_points_before_the_wall(mesh)
    # One to three steps of 16.5 cm; goings of 29 cm.
    assert set(np.round(np.unique(steps[steps[:, 2] > 0.05, 2]) - 0.02, 3)) <= {0.165, 0.33, 0.495}
    assert -0.9 < steps[:, 1].min() < -0.28
    mesh, notes = build(*many, street=TO_THE_WALL)
    assert "entrance steps" not in notes
    assert not len(low_points_before_the_wall(mesh))


def test_a_raised_door_keeps_its_size():
    def door(street):
        mesh, _ = build(house(1), street=street)
        return mesh.triangles()[mesh.material == material_id("wood")].reshape(-1, 3)

    low, high = door(TO_THE_WALL), door(BEFORE_GARDENS)
    assert np.ptp(high[:, 2]) == pytest.approx(np.ptp(low[:, 2]), abs=1e-6)
    assert high[:, 2].min() > low[:, 2].min() + 0.1


@pytest.mark.thorough
def test_about_the_stated_share_of_houses_has_balconies_and_none_is_in_a_neighbour():
    counts = []
    for number in range(1, 61):
        _, notes = build(house(number), street=TO_THE_WALL)
        counts.append(notes.get("balconies", 0))
    assert 0.12 < np.mean(np.array(counts) > 0) < 0.48
    number = 1 + int(np.argmax(counts))
    beside = box(18.8, -6, 40, 10)
    neighbour = OsmFeature("way", 999, {"building": "garage"}, beside)
    alone, _ = build(house(number), street=TO_THE_WALL)
    mesh, _ = build(house(number), neighbour, street=TO_THE_WALL)

    def reaches_in(mesh):
        own = mesh.vertices[mesh.faces[mesh.part == 1]].reshape(-1, 3)
        return contains_xy(beside.buffer(-0.01), own[:, 0], own[:, 1]).any()

    assert reaches_in(alone)
    assert not reaches_in(mesh)


def test_every_part_is_a_closed_solid():
    mesh, _ = build(house(3), street=BEFORE_GARDENS)
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert solid.is_watertight
    assert solid.area_faces.min() > 1e-6
