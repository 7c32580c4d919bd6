"""Areas that do not count, against lines of sight and plain geometry."""

import dataclasses

import numpy as np
import open3d as o3d
import pytest
import shapely

from urbantwin.dataset.ignore_regions import read_ignore_regions, write_ignore_regions
from urbantwin.errors import InputError
from urbantwin.geometry import Pose
from urbantwin.lidar.sight import IgnoreArea, ignore_areas

REGION = shapely.Point(0, 0).buffer(80)


@pytest.fixture(scope="module")
def found(rig_of, street):
    rig = rig_of(street, {"model": "VLP-16", "east_m": 3.0, "height_m": 4.0})
    return rig, {one.reason: one.area for one in ignore_areas(rig, street, REGION)}


def test_reasons_share_the_ground_between_them(found):
    rig, areas = found
    reach = rig.sensors[0].sensor.assumed_range_max_m
    disc = shapely.Point(3, 0).buffer(reach)
    assert areas["outside"].area == pytest.approx(disc.difference(REGION).area, rel=1e-6)
    assert "far" not in areas  # 100 m reach beyond the region all around.
    assert shapely.intersection(areas["outside"], areas["unseen"]).area == 0
    assert REGION.covers(areas["unseen"].buffer(-1e-6))


def test_far_is_beyond_every_sensor(rig_of, street):
    rig = rig_of(street, {"model": "VLP-16", "east_m": -40.0}, {"model": "VLP-16", "east_m": 60.0})
    wide = shapely.box(-170, -60, 95, 60)
    areas = {one.reason: one.area for one in ignore_areas(rig, street, wide)}
    reach = rig.sensors[0].sensor.assumed_range_max_m
    for x, y in ((-160, 0), (-140, 50), (-135, 0)):
        away = min(np.hypot(x + 40, y), np.hypot(x - 60, y))
        assert shapely.contains_xy(areas["far"], x, y) == (away > reach)


def test_unseen_is_what_no_line_of_sight_reaches(found, street):
    rig, areas = found
    rng = np.random.default_rng(5)
    places = rng.uniform(-30, 30, (6000, 2))
    near = np.hypot(places[:, 0] - 3, places[:, 1])
    places = places[(near > 18) & (near < 26)]  # Not under the beams, and nowhere between two.
    origin = rig.sensors[0].site_SE3_sensor.translation
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(street.vertices.astype(np.float32), street.faces.astype(np.uint32))
    hidden = np.zeros(len(places), int)
    # Of a square of 3 m about each place, as many as the average is taken over.
    steps = (-1.2, 0.0, 1.2)
    for dx in steps:
        for dy in steps:
            way = np.column_stack([places + [dx, dy], np.full(len(places), 1.0)]) - origin
            rays = np.concatenate([np.broadcast_to(origin, way.shape), way], axis=1)
            blocked = scene.test_occlusions(o3d.core.Tensor(rays.astype(np.float32)), 0.0, 0.9999)
            hidden += blocked.numpy()
    unseen = shapely.contains_xy(areas["unseen"], places[:, 0], places[:, 1])
    assert (hidden == 9).sum() > 300
    assert (hidden == 0).sum() > 300
    assert unseen[hidden == 9].mean() > 0.99
    assert unseen[hidden == 0].mean() < 0.01


def test_a_rig_that_rides_knows_only_the_region(found, street):
    rig, _ = found
    riding = dataclasses.replace(rig.sensors[0], carrier_SE3_sensor=Pose.from_ypr(np.zeros(3)))
    (area,) = ignore_areas(dataclasses.replace(rig, sensors=(riding,)), street, REGION)
    assert area.reason == "outside"
    assert shapely.contains_xy(area.area, 200, 100)
    assert not area.area.intersects(REGION.buffer(-0.01))


def test_the_file_holds_the_areas(found, tmp_path):
    _, areas = found
    path = tmp_path / "ignore_regions.geojson"
    write_ignore_regions(path, [IgnoreArea(*one) for one in areas.items()])
    first = path.read_bytes()
    again = read_ignore_regions(path)
    assert [one.reason for one in again] == list(areas)
    for one in again:
        apart = shapely.symmetric_difference(one.area, areas[one.reason]).area
        assert apart < 0.02 * areas[one.reason].length
    write_ignore_regions(path, [IgnoreArea(*one) for one in areas.items()])
    assert path.read_bytes() == first
    for text in ("[]", "{}", '{"features": [{"properties": {"reason": "x"}, "geometry": 3}]}'):
        path.write_text(text)
        with pytest.raises(InputError):
            read_ignore_regions(path)
