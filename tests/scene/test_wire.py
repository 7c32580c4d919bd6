"""Wires: the curve of a chain in closed form, heights above rails, supports off the carriageway."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import LineString, Point, box

from urbantwin.scene.wire import wire_mesh
from urbantwin.scene.wire.catenary import catenaries, parameter_of_sag
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import semantic_id

REGION = box(-200, -100, 200, 100)
ROAD = box(-200, -6, 200, 6)
WIRE, POLE = semantic_id("other-object"), semantic_id("pole")


def flat(xy):
    return np.zeros(len(xy))


def feature(geometry, number=1, **tags):
    return OsmFeature("node" if isinstance(geometry, Point) else "way", number, tags, geometry)


def build(*features, ground=flat, road=ROAD, **more):
    return wire_mesh(features, region=REGION, ground_height=ground, carriageway=road, **more)


@given(st.floats(5, 400), st.floats(0.005, 0.2), st.floats(-0.3, 0.3))
def test_a_wire_hangs_as_a_chain_does(span, sag_share, slope):
    """y'' = sqrt(1 + y'^2) / c, whatever the heights of its ends; the sag as asked for."""
    sag = sag_share * span
    level = catenaries([[0, 0, 10]], [[span, 0, 10]], [sag], 400)[0]
    assert level[:, 2].min() == pytest.approx(10 - sag, rel=1e-6)
    points = catenaries([[0, 0, 10]], [[span, 0, 10 + slope * span]], [sag], 400)[0]
    assert points[0] == pytest.approx([0, 0, 10], abs=1e-6)
    assert points[-1] == pytest.approx([span, 0, 10 + slope * span], abs=1e-6)
    c = float(parameter_of_sag(span, sag))
    step = span / 400
    z = points[:, 2]
    bend = (z[2:] - 2 * z[1:-1] + z[:-2]) / step**2
    tilt = (z[2:] - z[:-2]) / (2 * step)
    assert bend == pytest.approx(np.sqrt(1 + tilt**2) / c, rel=2e-3)


def test_power_lines_sag_between_towers_that_stand_on_the_ground():
    line = LineString([(-150, 50), (0, 50), (150, 50)])
    mesh, notes = build(
        feature(line, power="line", cables="3", voltage="110000"),
        feature(Point(0, 50), 2, power="tower", height="28"),
    )
    assert notes["power lines"] == 1
    assert notes["power towers"] == 3
    assert notes["supports of power lines seeded"] == 2
    wires = mesh.select(mesh.semantic == WIRE)
    tower = mesh.select((mesh.semantic != WIRE) & (np.abs(mesh.triangles()[..., 0]).max(1) < 10))
    assert tower.vertices[:, 2].min() == pytest.approx(-0.5, abs=0.1)
    assert 28 * 0.84 < tower.vertices[:, 2].max() < 29
    # At mid-span 3 % of 150 m below the hooks, whose height is a share of their towers'.
    low = wires.vertices[np.abs(np.abs(wires.vertices[:, 0]) - 75) < 6][:, 2].min()
    hooks = 0.85 * (28 + 30) / 2
    assert low == pytest.approx(hooks - 0.03 * 150, abs=0.1)


def test_poles_of_the_map_are_not_drawn_twice():
    line = LineString([(-50, 50), (0, 50), (50, 50)])
    _, notes = build(
        feature(line, power="minor_line"),
        *(feature(Point(x, 50), 2 + k, power="pole") for k, x in enumerate((-50, 0, 50))),
    )
    assert notes == {"power lines": 1}


def test_the_contact_wire_of_a_tram_is_5_5_m_above_its_rails_and_held_from_beside_the_road():
    def tilted(xy):
        return 0.03 * xy[:, 0]

    mesh, notes = build(feature(LineString([(-100, 2), (100, 2)]), railway="tram"), ground=tilted)
    assert notes["contact wires, m"] == 200
    assert notes["spans across streets seeded"] == 7
    over = mesh.vertices[(np.abs(mesh.vertices[:, 1] - 2) < 0.05)]
    above = over[:, 2] - 0.03 * over[:, 0]
    assert above.min() == pytest.approx(5.5, abs=0.03)
    poles = mesh.select(mesh.semantic == POLE)
    low = poles.vertices[poles.vertices[:, 2] - 0.03 * poles.vertices[:, 0] < 4]
    assert len(low) > 0
    assert (np.abs(low[:, 1]) > 6.2).all()
    # Nothing hangs lower than the wire over the road.
    on_road = np.abs(mesh.vertices[:, 1]) < 6
    assert (mesh.vertices[on_road, 2] - 0.03 * mesh.vertices[on_road, 0]).min() > 5.4


def test_a_wall_holds_a_span_where_houses_are_nearer_than_a_place_for_a_mast():
    house = feature(box(-100, 6.3, 100, 20), 5, building="yes")
    _, alone = build(feature(LineString([(-100, 2), (100, 2)]), railway="tram"))
    _, notes = build(feature(LineString([(-100, 2), (100, 2)]), railway="tram"), house)
    assert notes["masts of contact wires seeded"] < alone["masts of contact wires seeded"]


def test_mapped_masts_hold_the_wire_instead():
    track = feature(LineString([(-100, 30), (100, 30)]), railway="rail", electrified="contact_line")
    masts = [feature(Point(x, 33), 10 + x, power="catenary_mast") for x in range(-90, 91, 45)]
    _, notes = build(track, *masts)
    assert notes["brackets at mapped masts"] == len(masts)
    assert "masts of contact wires seeded" not in notes


@pytest.mark.parametrize(
    "tags",
    [
        {"railway": "tram", "tunnel": "yes"},
        {"railway": "tram", "electrified": "no"},
        {"railway": "rail", "electrified": "rail"},
        {"power": "line", "location": "underground"},
        {"power": "cable"},
    ],
)
def test_no_wires_where_there_are_none(tags):
    mesh, notes = build(feature(LineString([(-100, 2), (100, 2)]), **tags))
    assert len(mesh.faces) == 0
    assert notes == {}


def test_a_lamp_on_a_wire_hangs_between_the_walls_of_its_street():
    lamp = feature(Point(0, 0), 1, highway="street_lamp", lamp_mount="suspended")
    street = feature(LineString([(-50, 0), (50, 0)]), 2, highway="residential")
    houses = [
        feature(box(-50, y, 50, y + 10), 3 + k, building="yes") for k, y in enumerate((9, -20))
    ]
    mesh, notes = build(lamp, street, *houses)
    assert notes == {"lamps on wires": 1}
    assert mesh.vertices[:, 1].max() == pytest.approx(9, abs=0.05)
    assert mesh.vertices[:, 1].min() == pytest.approx(-10, abs=0.05)
    assert mesh.vertices[:, 2].min() > 6
    _, notes = build(lamp, street)
    assert notes == {"lamps on wires without a wall or a wire, left out": 1}


def test_wires_end_at_the_region_and_where_imported_geometry_is():
    line = feature(LineString([(-500, 50), (0, 50), (500, 50)]), power="line")
    mesh, _ = build(line)
    assert np.abs(mesh.vertices[:, 0]).max() < 220
    mesh, _ = build(line, without=box(-300, 0, 0, 100))
    assert shapely.contains_xy(box(-300, 0, -5, 100), *mesh.vertices[:, :2].T).sum() == 0
