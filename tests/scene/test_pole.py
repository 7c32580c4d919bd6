import numpy as np
import pytest
from shapely import Point, Polygon, box

from urbantwin.scene.pole import pole_mesh
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import semantic_id

REGION = box(-100, -100, 100, 100)
ROAD = box(-100, -5, 100, 5)
POLE, OTHER, SIGN = (semantic_id(n) for n in ("pole", "other-object", "traffic-sign"))


def tilted(xy):
    return 0.1 * xy[:, 0] + 3


def node(x, y, number=1, **tags):
    return OsmFeature(
        "node", number, {k.replace("__", ":"): v for k, v in tags.items()}, Point(x, y)
    )


def build(*features, road=ROAD, ground=tilted):
    return pole_mesh(features, region=REGION, ground_height=ground, carriageway=road)


def test_no_pole_stands_on_a_carriageway():
    mesh, notes = build(
        node(10, 4, highway="street_lamp"),
        node(-10, 0, 2, traffic_sign="stop"),
        node(0, 4.5, 3, highway="bus_stop"),
        node(30, 0, 4, barrier="bollard"),
    )
    low = mesh.vertices[:, 2] < tilted(mesh.vertices) + 1
    assert (np.abs(mesh.vertices[low, 1]) > 5).all()
    assert notes["poles moved off carriageways"] == 3
    assert notes["poles on carriageways, left out"] == 1
    assert "bollards" not in notes


def test_a_street_lamp_has_its_mapped_height_and_reaches_for_the_road():
    mesh, _ = build(node(0, 7, highway="street_lamp", height="9 m"))
    assert mesh.vertices[:, 2].max() == pytest.approx(3 + 9.0)
    top = mesh.vertices[mesh.vertices[:, 2] > 11.8]
    assert top[:, 1].min() < 7 - 1.2
    assert set(mesh.semantic) == {POLE}


def test_a_lamp_far_from_any_road_has_no_arm():
    mesh, _ = build(node(0, 60, highway="street_lamp"), node(5, 60, 2, highway="street_lamp"))
    assert np.abs(mesh.vertices[:, 1] - 60).max() < 0.3
    assert sorted(set(mesh.part)) == [1, 2]


def test_lamps_on_walls_are_not_drawn_but_told():
    mesh, notes = build(node(0, 8, highway="street_lamp", support="wall_mounted"))
    assert len(mesh.faces) == 0
    assert notes == {"lamps hung or on walls, not drawn": 1}


def test_a_sign_faces_its_mapped_direction():
    mesh, _ = build(node(0, 8, traffic_sign="DE:206", direction="90"))
    plate = mesh.select(mesh.semantic == SIGN)
    assert np.ptp(plate.vertices[:, 0]) == pytest.approx(0.02)
    assert plate.vertices[:, 0].mean() > 0
    assert np.ptp(plate.vertices[:, 1]) > 0.5


def test_every_pole_touches_the_ground():
    mesh, _ = build(
        node(20, 8, highway="street_lamp"),
        node(-20, 8, 2, power="pole"),
        node(-30, 8, 3, man_made="pole"),
        node(-40, 8, 4, traffic_sign="x"),
        node(50, 8, 5, highway="bus_stop"),
        node(60, 8, 6, barrier="bollard", height="0.8"),
    )
    assert len(set(mesh.part)) == 6
    for part in set(mesh.part):
        own = mesh.select(mesh.part == part).vertices
        lowest = own[own[:, 2].argmin()]
        assert -0.5 < lowest[2] - tilted(lowest[None])[0] < -0.1


def test_poles_outside_the_region_and_other_nodes_are_left_out():
    mesh, notes = build(node(500, 0, power="pole"), node(0, 50, 2, natural="tree"))
    assert len(mesh.faces) == 0
    assert notes == {}
    mesh, _ = build(node(0, 8, highway="street_lamp"), road=Polygon())
    assert len(mesh.faces) > 0
