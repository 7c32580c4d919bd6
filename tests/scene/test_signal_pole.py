"""Poles, arms and plates for signals whose places are given."""

import math

import numpy as np
import pytest
from shapely import box

from urbantwin.roads.model import RoadSignal
from urbantwin.roads.signals import Head
from urbantwin.scene.signal_pole import signal_mesh
from urbantwin.taxonomy import semantic_id

ROAD = box(-100, -5, 100, 5)
POLE, OTHER, SIGN = (semantic_id(n) for n in ("pole", "other-object", "traffic-sign"))


def tilted(xy):
    return 0.1 * xy[:, 0] + 3


def lights(x, y, up, heading, *, level=0, size=(1.0, 0.35)):
    signal = RoadSignal(
        1, 1, "", True, "OpenDRIVE", "1000001", "-1", math.nan, "", 0, 0, up, "+",
        height=size[0], width=size[1],
    )  # fmt: skip
    return Head(signal, x, y, 0.1 * x + 3 + up, heading, level, False)


def sign(x, y, heading, *, country="DE", type_="274", size=(0.6, 0.6)):
    signal = RoadSignal(
        1, 1, "", False, country, type_, "-1", 50.0, "km/h", 0, 0, 2.5, "+",
        height=size[0], width=size[1],
    )  # fmt: skip
    return Head(signal, x, y, 0.1 * x + 3 + 2.5, heading, 0, False)


def build(*heads):
    return signal_mesh(heads, ground_height=tilted, carriageway=ROAD)


def normal(mesh):
    """The largest face's normal in plan."""
    a, b, c = np.moveaxis(mesh.triangles(), 1, 0)
    cross = np.cross(b - a, c - a)
    cross = cross[np.abs(cross[:, 2]) < 1e-9]
    return cross[np.argmax(np.linalg.norm(cross, axis=1))]


@pytest.mark.parametrize("heading", [0.0, 1.0, math.pi, -2.0])
def test_lights_look_where_they_face_and_stand_before_their_pole(heading):
    mesh, notes = build(lights(20, 8, 2.8, heading))
    assert notes == {"traffic signal heads": 1, "traffic signals": 1}
    head = mesh.select(mesh.semantic == OTHER).vertices
    ahead = np.array([math.cos(heading), math.sin(heading)])
    foot = tilted(np.array([[20.0, 8.0]]))[0]
    along = (head[:, :2] - [20, 8]) @ ahead
    assert along.min() > 0.05
    assert along.max() < 0.6
    # Visors stand out in front of the housing, and nothing behind it.
    assert head[along > 0.35][:, 2].min() > foot + 2.8 - 0.5
    assert head[:, 2].min() - foot == pytest.approx(2.8 - 0.65, abs=0.01)
    pole = mesh.select(mesh.semantic == POLE).vertices
    assert pole[:, 2].min() < foot
    assert pole[:, 2].max() > head[:, 2].max()


def test_heads_over_lanes_hang_from_one_arm_whose_pole_stands_at_the_kerb():
    """Traffic goes east; the kerb is at y = -5."""
    heads = [lights(30, y, 5.7, math.pi) for y in (-3.5, 0.0, 3.5)]
    mesh, notes = build(*heads, lights(30, -5.6, 2.8, math.pi))
    assert notes["traffic signals"] == notes["arms over lanes"] == 1
    assert notes["traffic signal heads"] == 4
    pole = mesh.select(mesh.semantic == POLE).vertices
    low = pole[pole[:, 2] < tilted(pole) + 4.5]
    assert np.abs(low[:, 1] + 5.6).max() < 0.2
    arm = pole[np.abs(pole[:, 1]) < 5]
    assert arm[:, 1].max() == pytest.approx(3.5, abs=0.1)
    assert (arm[:, 2] - tilted(arm)).min() > 5.5
    # 4.6 m and more are clear under what hangs over lanes.
    over = mesh.vertices[np.abs(mesh.vertices[:, 1]) < 5]
    assert (over[:, 2] - tilted(over)).min() > 4.6


def test_an_arm_gets_a_pole_where_none_stands():
    mesh, _ = build(lights(0, -4, 5.7, math.pi))
    low = mesh.vertices[mesh.vertices[:, 2] < tilted(mesh.vertices) + 3]
    assert low[:, 1].max() < -5.2


def test_heads_that_no_arm_reaches_hang_from_one_wire_between_two_poles():
    """A plain of asphalt 80 m wide; traffic goes east."""
    heads = [lights(0, y, 5.7, math.pi) for y in (-3.5, 0.0, 3.5)]
    mesh, notes = signal_mesh(heads, ground_height=tilted, carriageway=box(-99, -40, 99, 40))
    assert notes == {"span wires": 1, "traffic signal heads": 3, "traffic signals": 2}
    up = mesh.vertices[:, 2] - tilted(mesh.vertices)
    low = mesh.vertices[up < 4.6]
    assert np.abs(low[:, 1]).min() > 40.0  # poles alone, beside the carriageway
    assert {-1.0, 1.0} == set(np.sign(low[:, 1]))
    lit = mesh.select(mesh.semantic == OTHER).vertices
    assert np.ptp(lit[:, 1]) == pytest.approx(7.0 + 0.65, abs=0.05)
    poles = mesh.vertices[np.abs(mesh.vertices[:, 1]) > 40.0]
    assert (poles[:, 2] - tilted(poles)).max() > (lit[:, 2] - tilted(lit)).max()


def test_low_heads_over_the_carriageway_hang_on_their_pole_or_high_above():
    pole, bracket = lights(0, -5.6, 2.8, math.pi), lights(0, -4.7, 2.8, math.pi)
    mesh, notes = build(pole, bracket)
    assert notes == {"traffic signal heads": 2, "traffic signals": 1}
    mesh, notes = build(lights(0, -3, 2.8, math.pi))
    assert notes["traffic signal heads"] == 1
    over = mesh.vertices[np.abs(mesh.vertices[:, 1]) < 5]
    assert (over[:, 2] - tilted(over)).min() > 4.6


def test_signs_over_the_carriageway_without_a_pole_are_left_out():
    mesh, notes = build(sign(0, -3, math.pi))
    assert notes == {"signs without a place beside the carriageway, left out": 1}
    assert len(mesh.faces) == 0


def test_horizontal_lights_lie_side_by_side():
    mesh, _ = build(lights(0, 8, 5.7, math.pi, size=(0.35, 1.0)))
    head = mesh.select(mesh.semantic == OTHER).vertices
    assert np.ptp(head[:, 1]) > 1.2
    assert np.ptp(head[:, 2]) < 0.8


@pytest.mark.parametrize(
    ("country", "type_", "corners"),
    [("DE", "274", 16), ("DE", "206", 8), ("DE", "205", 3), ("US", "R2-1", 4), ("US", "R1-1", 8)],
)
def test_plates_have_the_shape_of_their_sign_and_face_traffic(country, type_, corners):
    mesh, notes = build(sign(10, 7, math.pi, country=country, type_=type_))
    assert notes == {"sign posts": 1, "signs": 1}
    plate = mesh.select(mesh.semantic == SIGN)
    front = plate.vertices[plate.vertices[:, 0] < plate.vertices[:, 0].mean()]
    assert len(np.unique(np.round(front, 6), axis=0)) == corners
    assert (mesh.material[mesh.semantic == SIGN] == plate.material[0]).all()
    if corners == 3:  # on its tip
        lowest = plate.vertices[:, 2].min()
        assert (np.abs(front[:, 2] - lowest) < 1e-6).sum() == 1
    if corners == 8:  # on a side
        assert (np.abs(front[:, 2] - front[:, 2].min()) < 1e-6).sum() == 2
    assert abs(normal(plate)[1]) < 1e-9


def test_what_stands_on_bridges_is_left_out_and_told():
    mesh, notes = build(lights(0, 8, 2.8, 0.0, level=1))
    assert len(mesh.faces) == 0
    assert notes == {"signals and signs on bridges, left out": 1}


def test_solids_are_closed_and_look_outwards():
    mesh, _ = build(lights(0, 8, 2.8, 1.0), sign(20, 8, 2.0), sign(40, 8, 2.0, type_="206"))
    a, b, c = np.moveaxis(mesh.triangles(), 1, 0)
    for label in (OTHER, SIGN, POLE):
        own = mesh.semantic == label
        volume = (a[own] * np.cross(b[own], c[own])).sum() / 6
        shift = ((a[own] + [7, 5, 3]) * np.cross(b[own] - a[own], c[own] - a[own])).sum() / 6
        assert volume > 0
        assert shift == pytest.approx(volume, rel=1e-6)
