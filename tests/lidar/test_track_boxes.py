"""Boxes of tracks: one size, whatever limbs do, and where the actor is."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from urbantwin.geometry import Pose
from urbantwin.lidar import PosedActor
from urbantwin.lidar.annotated import LAST_TRACK, truck_of_load
from urbantwin.lidar.scanner import Scanner
from urbantwin.traffic.assets import Fleet, asset, asset_names
from urbantwin.traffic.assets.annotators import drawn_size
from urbantwin.traffic.paths.track_box import track_size

WALKER = asset_names("pedestrian")[0]


@pytest.fixture(scope="module")
def walked(rig_of, ground_mesh):
    """The same walker in every phase, labelled with both kinds of boxes."""
    world = ground_mesh(half=60.0)
    rig = rig_of(world, {"model": "OS1-128", "columns": 1024})
    size = track_size(asset(WALKER))
    pose = Pose.from_ypr((8.0, 9.0, 0.0), 0.7, 0.0, 0.0)
    found = {}
    for kind in ("track", "tight", "tumtraf"):
        scanner = Scanner(world, replace(rig, boxes=kind), 3)
        found[kind] = [
            scanner.scan(0, [PosedActor(1, "pedestrian", WALKER, k, pose, np.zeros(3), size=size)])
            for k in range(13)
        ]
    return found, rig


def test_a_track_s_box_does_not_breathe_and_a_tight_one_does(walked):
    found, rig = walked
    boxes = {kind: np.array([one.boxes[0].box for one in frames]) for kind, frames in found.items()}
    np.testing.assert_allclose(np.ptp(boxes["track"], axis=0), 0, atol=1e-12)
    assert np.ptp(boxes["tight"][:, 3]) > 0.5
    low, high = boxes["tight"][:12, 3].min(), boxes["tight"][:12, 3].max()
    assert low < boxes["track"][0, 3] < high
    # Over the actor's place, turned as it is.
    at = rig.dataset_SE3_site.apply(np.array([[8.0, 9.0, 0.0]]))[0]
    box = boxes["track"][0]
    np.testing.assert_allclose(box[:3], at + [0, 0, box[5] / 2], atol=1e-9)
    assert box[6] == pytest.approx(boxes["tight"][0, 6])


def test_points_are_the_same_whatever_the_boxes(walked):
    found, _ = walked
    pairs = zip(found["track"] * 2, found["tight"] + found["tumtraf"], strict=True)
    for one, other in pairs:
        np.testing.assert_array_equal(one.points, other.points)
        np.testing.assert_array_equal(one.instance, other.instance)
        assert one.boxes[0].num_points == other.boxes[0].num_points > 20


def test_annotators_draw_one_box_for_a_track_and_stand_it_on_the_ground(walked):
    """TUMTraf's draw people a fifth wider than they are, each in a width of its own."""
    found, rig = walked
    boxes = np.array([one.boxes[0].box for one in found["tumtraf"]])
    np.testing.assert_allclose(np.ptp(boxes, axis=0), 0, atol=1e-12)
    true = track_size(asset(WALKER))
    drawn = np.array([drawn_size("tumtraf", "pedestrian", true, k, 3) for k in range(1, 400)])
    np.testing.assert_allclose(boxes[0, 3:6], drawn[0])
    assert len({*drawn[:, 1].tolist()}) > 10
    assert np.median(drawn[:, 1]) > 1.15 * true[1]
    at = rig.dataset_SE3_site.apply(np.array([[8.0, 9.0, 0.0]]))[0]
    np.testing.assert_allclose(boxes[0, :3], at + [0, 0, boxes[0, 5] / 2], atol=1e-9)
    assert drawn_size("kitti", "pedestrian", true, 1, 3) == true  # nothing was measured


@pytest.mark.parametrize("name", ["CAR", "VAN"])
def test_sides_of_the_fleet_are_drawn_as_tumtraf_s_annotators_draw_them(name, shared_data):
    with (shared_data / "statistics/tumtraf-s110-boxes.csv").open() as opened:
        (told,) = [row for row in csv.DictReader(opened) if row["class"] == name]
    kind, fleet = name.lower(), Fleet("DE", 11)
    drawn = np.array(
        [
            drawn_size("tumtraf", kind, track_size(asset(body)), number, 11)
            for number, body in ((n, fleet.body(kind, n, bends=False)) for n in range(300))
        ]
    )
    for k, side in enumerate(("length", "width", "height")):
        low, middle, high = np.quantile(drawn[:, k], [0.05, 0.5, 0.95])
        theirs = [float(told[f"{side}_{q}_m"]) for q in ("p05", "median", "p95")]
        assert middle == pytest.approx(theirs[1], rel=0.05)
        assert high - low == pytest.approx(theirs[2] - theirs[0], rel=0.25)


def test_a_truck_is_a_cab_and_a_load_where_annotators_have_it_so(rig_of, ground_mesh):
    world = ground_mesh(half=60.0)
    rig = rig_of(world, {"model": "OS1-128", "columns": 1024})
    name, pose = "truck-box-7t5", Pose.from_ypr((8.0, 9.0, 0.0), 2.3, 0.0, 0.0)
    truck = PosedActor(7, "truck", name, 0, pose, np.zeros(3), size=track_size(asset(name)))
    entire = Scanner(world, rig, 3).scan(0, [truck])
    frame = Scanner(world, replace(rig, boxes="tumtraf"), 3).scan(0, [truck])
    cab, load = frame.boxes
    assert [(one.actor_class, one.track) for one in frame.boxes] == [
        ("truck", 7), ("trailer", LAST_TRACK - 7),
    ]  # fmt: skip
    assert truck_of_load(load.track) == 7
    # The same points, each of one of the two, on its side of the gap behind the cab.
    assert cab.num_points + load.num_points == pytest.approx(entire.boxes[0].num_points, rel=0.02)
    ahead = np.array([np.cos(cab.box[6]), np.sin(cab.box[6])])
    middle = entire.boxes[0].box
    for one, sign in ((cab, 1), (load, -1)):
        own = frame.points[frame.instance == one.track, :2].astype(float) - middle[:2]
        assert len(own) > 20
        along = own @ ahead - (middle[3] / 2 - asset(name).cab_m)
        assert np.mean(sign * along > -0.25) > 0.95
    apart = (np.asarray(cab.box[:2]) - load.box[:2]) @ ahead
    assert apart == pytest.approx(middle[3] / 2, abs=1e-6)


def test_most_of_a_walker_is_in_its_box(walked):
    """What stands out of the middle box is a foot or a hand at the end of its swing."""
    found, _ = walked
    for frame in found["track"]:
        x, y, z, length, width, _, yaw = frame.boxes[0].box
        own = frame.points[frame.instance == 1, :3].astype(float) - [x, y, z]
        c, s = np.cos(yaw), np.sin(yaw)
        along = np.abs(own[:, 0] * c + own[:, 1] * s)
        aside = np.abs(own[:, 1] * c - own[:, 0] * s)
        inside = (along < length / 2 + 0.02) & (aside < width / 2 + 0.02)
        assert inside.mean() > 0.85
        assert along.max() < length / 2 + 0.2


def test_an_actor_without_a_size_has_its_mesh_s_box(rig_of, ground_mesh):
    world = ground_mesh(half=60.0)
    rig = rig_of(world, {"model": "OS1-128", "columns": 512})
    pose = Pose.from_ypr((8.0, 9.0, 0.0), 0.7, -0.05, 0.0)
    actor = PosedActor(1, "car", asset_names("car")[0], 0, pose, np.zeros(3))
    tight = Scanner(world, replace(rig, boxes="tight"), 3).scan(0, [actor]).boxes[0].box
    np.testing.assert_array_equal(Scanner(world, rig, 3).scan(0, [actor]).boxes[0].box, tight)
    known = actor._replace(size=(4.0, 1.7, 1.5))
    box = Scanner(world, rig, 3).scan(0, [known]).boxes[0].box
    np.testing.assert_allclose(box[3:6], [4.0, 1.7, 1.5])
    up = pose.rotation[:, 2] * 0.75
    at = rig.dataset_SE3_site.apply((pose.translation + up)[None])[0]
    np.testing.assert_allclose(box[:3], at, atol=1e-9)
