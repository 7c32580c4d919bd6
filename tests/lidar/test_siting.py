"""What a sensor sees of a junction against closed forms and Open3D; where it would see most."""

import numpy as np
import open3d as o3d
import pytest
import shapely

from urbantwin.geometry import LabelledMesh
from urbantwin.lidar.catalogue import sensor, sensor_names
from urbantwin.lidar.pattern import beam_directions
from urbantwin.lidar.sight import sight_of_rig, stand_in_sight
from urbantwin.lidar.sight.field_of_view import FieldOfView
from urbantwin.lidar.sight.ground import CELL_M, ground_in_plan
from urbantwin.lidar.sight.junction import Stance, judged
from urbantwin.lidar.sight.line_of_sight import LineOfSight
from urbantwin.roads import RoadNetwork
from urbantwin.roads.network import Lane
from urbantwin.site.rig import RigSpec

ALL_AROUND = FieldOfView(
    np.array(
        [[np.cos(a), np.sin(a), b] for a in np.radians(np.arange(360)) for b in (-0.99, 0.99)]
    ),
    (0.0, 200.0),
)
REGION = shapely.box(-90, -90, 90, 90)


def lane(name, start, end, level=0):
    centre = np.array([start, end], float)
    return Lane(name, "", "driving", 8.0, 14.0, centre, np.zeros((0, 2)), level, ("car",), (), "")


@pytest.fixture(scope="module")
def crossing():
    """Two streets of 8 m that cross at the origin."""
    lanes = (lane("a", (-80, 0, 0), (80, 0, 0)), lane("b", (0, -80, 0), (0, 80, 0)))
    return RoadNetwork("right", (), lanes, (), (), ())


@pytest.fixture(scope="module")
def corners(box_mesh, ground_mesh):
    """Ground with the two streets of the crossing on it, and a house at each corner."""
    houses = [
        box_mesh((x, y, 0), (x + 30, y + 30, 12), part=k + 1)
        for k, (x, y) in enumerate([(12, 12), (-42, 12), (-42, -42), (12, -42)])
    ]
    return LabelledMesh.concatenate([ground_mesh(semantic="terrain", material="grass"), *houses])


def rig_spec(**place):
    one = {"name": "pole", "model": "OS1-128", "height_m": 6.0, "pitch_deg": 5.0, **place}
    return RigSpec.model_validate({"sensors": [one]})


@pytest.mark.parametrize("name", ["OS1-128", "VLP-16", "HDL-64E"])
def test_a_field_of_view_holds_its_beams_and_ends_above_and_below_them(name):
    assert name in sensor_names()
    model = sensor(name)
    field = FieldOfView.coarse(model, 512)
    beams = beam_directions(model, 2048).reshape(-1, 3)
    lowest, highest = np.radians([model.elevation_deg.min(), model.elevation_deg.max()])
    inside = np.arcsin(beams[:, 2])
    well = (inside > lowest + 0.01) & (inside < highest - 0.01)
    assert field.holds(beams[well]).all()
    azimuth = np.radians(np.arange(0.0, 360.0, 0.7))
    for elevation in (lowest - 0.03, highest + 0.03):
        flat = np.cos(elevation)
        rays = np.column_stack(
            [
                flat * np.cos(azimuth),
                flat * np.sin(azimuth),
                np.full(len(azimuth), np.sin(elevation)),
            ]
        )
        assert not field.holds(rays).any()


def test_beams_per_steradian_are_those_of_evenly_spread_ones():
    rng = np.random.default_rng(0)
    rays = rng.normal(size=(200_000, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    band = rays[np.abs(rays[:, 2]) < 0.4]
    expected = len(band) / (4 * np.pi * 0.4)
    assert FieldOfView(band, (0.0, 100.0)).per_steradian == pytest.approx(expected, rel=0.03)


def test_a_low_wall_hides_what_is_in_its_shadow(box_mesh, ground_mesh):
    """From 6 m, a wall 3 m high 10 m away hides points 1 m high up to 10 (6-1)/(6-3) m."""
    wall = box_mesh((9.9, -200, 0), (10.0, 200, 3), "fence")
    mesh = LabelledMesh.concatenate([ground_mesh(half=200), wall])
    ground = ground_in_plan(shapely.box(-40, -40, 40, 40))
    stance = Stance(np.array([0.0, 0.0, 6.0]), 6.0, 0.0, 0.0, 0.0)
    found = judged(stance, ground, LineOfSight(mesh, np.zeros(2)), ALL_AROUND)
    x = ground.points[:, 0]
    sure = np.abs(x - 16.667) > CELL_M
    assert np.array_equal(found.sees[sure], (x < 10)[sure] | (x > 16.667)[sure])
    assert found.nearest_m == pytest.approx(np.hypot(9.9, 3.0), rel=0.03)


def test_lines_of_sight_are_those_of_open3d(crossing, corners, rig_of):
    rig = rig_of(corners, {"east_m": 9.0, "north_m": 9.0, "height_m": 6.0, "yaw_deg": -135.0})
    sight = sight_of_rig(rig, crossing, REGION, corners)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(corners.vertices.astype(np.float32)),
        o3d.core.Tensor(corners.faces.astype(np.uint32)),
    )
    origin = np.array([9.0, 9.0, 6.0])
    offset = sight.points - origin
    away = np.linalg.norm(offset, axis=1)
    rays = np.column_stack([np.broadcast_to(origin, offset.shape), offset / away[:, None]])
    hit = scene.cast_rays(o3d.core.Tensor(rays.astype(np.float32)))["t_hit"].numpy()
    flat = np.abs(np.degrees(np.arcsin(offset[:, 2] / away)))
    limit = -sensor("OS1-128").elevation_deg.min()
    sure = np.abs(flat - limit) > 0.5
    assert np.array_equal(sight.sees[0][sure], ((hit >= away - 0.3) & (flat < limit))[sure])
    assert 0.3 < sight.seen < 0.98
    # Lanes within 50 m of the anchor, each place once: two strips less the square they share.
    expected = 2 * 100 * 8 - 8 * 8
    assert sight.notes()["junction_m2"] == pytest.approx(expected, rel=0.03)


@pytest.mark.thorough
def test_what_hides_the_junction_is_told_with_a_better_place(crossing, corners, box_mesh, rig_of):
    """A hedge around the sensor, higher than it, leaves it nothing to see."""
    hedge = [
        box_mesh(low, high, "vegetation", "foliage", 50 + k)
        for k, (low, high) in enumerate(
            [
                ((7, 7, 0), (11, 7.5, 9)),
                ((7, 7, 0), (7.5, 11, 9)),
                ((7, 10.5, 0), (11, 11, 9)),
                ((10.5, 7, 0), (11, 11, 9)),
            ]
        )
    ]
    mesh = LabelledMesh.concatenate([corners, *hedge])
    rig = rig_of(mesh, {"east_m": 9.0, "north_m": 9.0, "height_m": 6.0, "yaw_deg": -135.0})
    sight = sight_of_rig(rig, crossing, REGION, mesh)
    assert sight.seen == 0.0
    (told,) = sight.sensors
    assert told.hiding[0].what == "trees and hedges"
    assert told.hiding[0].nearest_m == pytest.approx(1.5, abs=0.6)
    assert told.view.nearest_m == pytest.approx(1.5, abs=0.05)
    first = next(iter(sight.warnings()))
    assert "sees 0 % of the junction's lanes and crossings" in str(first)
    assert "behind trees and hedges" in str(first)
    better = told.better.stance.written()
    moved = sight_of_rig(rig_of(mesh, better), crossing, REGION, mesh)
    assert moved.seen == pytest.approx(told.better.seen, abs=0.02)
    assert moved.seen > 0.8
    assert not list(moved.warnings())


@pytest.mark.thorough
def test_only_a_proposed_sensor_moves_and_only_where_it_is_worth_it(crossing, corners, box_mesh):
    hedge = box_mesh((5, 4.5, 0), (11, 7.8, 9), "vegetation", "foliage", 50)
    mesh = LabelledMesh.concatenate([corners, hedge])
    given = rig_spec(east_m=9.0, north_m=9.0)
    assert stand_in_sight(given, crossing, REGION, mesh) == given
    proposed = rig_spec(east_m=9.0, north_m=9.0, proposed=True)
    stood = stand_in_sight(proposed, crossing, REGION, mesh).sensors[0]
    assert stood.proposed is None
    place = shapely.Point(stood.east_m, stood.north_m)
    assert place.distance(shapely.box(5, 4.5, 11, 7.8)) > 3.0
    assert abs(stood.east_m) > 4.0
    assert abs(stood.north_m) > 4.0
    again = proposed.model_copy(update={"sensors": [stood.model_copy(update={"proposed": True})]})
    assert stand_in_sight(again, crossing, REGION, mesh).sensors[0] == stood
    # Inside a house it cannot stand at all.
    inside = rig_spec(east_m=20.0, north_m=20.0, proposed=True)
    out = stand_in_sight(inside, crossing, REGION, mesh).sensors[0]
    assert (out.east_m, out.north_m) != (20.0, 20.0)


def test_ground_below_a_sensor_is_not_in_its_way_and_a_facade_is(
    crossing, ground_mesh, box_mesh, rig_of
):
    """Level beams meet a facade 2 m away nearer than 10 m within 78.5 degrees of its normal."""
    mesh = ground_mesh(half=200, semantic="terrain", material="grass")
    place = {"model": "OS0-128", "east_m": 9.0, "north_m": 9.0, "height_m": 4.0}
    sight = sight_of_rig(rig_of(mesh, place), crossing, REGION, mesh)
    assert sight.sensors[0].view.near == 0.0
    walled = LabelledMesh.concatenate([mesh, box_mesh((11, -190, 0), (12, 190, 40))])
    (told,) = sight_of_rig(rig_of(walled, place), crossing, REGION, walled).sensors
    assert told.view.nearest_m == pytest.approx(2.0, abs=0.02)
    assert told.view.near > 0.4
    assert any("nearer than 10 m" in problem for problem in told.problems(little=False))
    assert told.better is not None


def test_each_sensor_is_judged_by_the_junction_that_it_stands_at(crossing, ground_mesh, rig_of):
    mesh = ground_mesh(half=200, semantic="terrain", material="grass")
    far = RoadNetwork(
        "right",
        (),
        (*crossing.lanes, lane("c", (150, 100, 0), (150, 190, 0))),
        (),
        (),
        (),
    )
    region = shapely.box(-190, -190, 190, 190)
    rig = rig_of(mesh, {"east_m": 9.0, "north_m": 9.0}, {"east_m": 158.0, "north_m": 145.0})
    sight = sight_of_rig(rig, far, region, mesh)
    assert [one.view.seen > 0.7 for one in sight.sensors] == [True, True]
    assert not (sight.sees[0] & sight.sees[1]).any()
    assert not list(sight.warnings())
