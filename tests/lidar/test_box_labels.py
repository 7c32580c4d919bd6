"""Boxes of whole frames: what hides, cuts off and does not count."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import shapely

from urbantwin.dataset.box_columns import packed_columns
from urbantwin.dataset.dataset_writer import write_boxes
from urbantwin.dataset.layout import FOLDERS, write_frame
from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar import PosedActor
from urbantwin.lidar.scanner import Scanner
from urbantwin.traffic.assets import asset_names
from urbantwin.traffic.motion import ACTOR_SCHEMA, Motion
from urbantwin.traffic.signals import SIGNAL_SCHEMA

REGION = shapely.box(-70, -70, 70, 70)


def car(track, x, y, yaw=0.0, velocity=(0.0, 0.0, 0.0)):
    pose = Pose.from_ypr((x, y, 0.0), yaw)
    return PosedActor(track, "car", asset_names("car")[0], 0, pose, np.array(velocity))


@pytest.fixture(scope="module")
def scanned(rig_of, ground_mesh, box_mesh):
    """Cars before a sensor (17 m reach up to 22.5 degrees down) and behind a wall."""
    wall = box_mesh((-40, 22, 0), (-20, 22.4, 4))
    world = LabelledMesh.concatenate([ground_mesh(half=200.0), wall])
    rig = rig_of(world, {"model": "OS1-128", "columns": 1024})
    actors = [
        car(1, 20, 0),  # Close and free.
        car(2, 1, 0),  # Under the sensor.
        car(3, 9.3, 0, np.pi / 2),  # At the edge of the lowest beams.
        car(4, -30, 26),  # Behind the wall.
        car(5, 0, 100),  # Outside of the region.
        car(6, 0, 40),
        car(7, 2.0, 42.2),  # Half hidden by the one before it.
    ]
    scanner = Scanner(world, rig, 4, region=REGION)
    return {one.track: one for one in scanner.scan(0, actors).boxes}, scanner, rig, world


def test_what_hides_and_what_cuts_off_are_told_apart(scanned):
    boxes, *_ = scanned
    assert (boxes[1].difficulty, boxes[1].ignored) == ("easy", None)
    assert boxes[1].truncation == 0
    assert (boxes[2].difficulty, boxes[2].ignored) == (None, "truncated")
    assert boxes[2].truncation == 1
    assert 0.1 < boxes[3].truncation < 0.9
    assert boxes[3].occlusion == 0
    assert (boxes[4].difficulty, boxes[4].ignored) == (None, "unseen")
    assert (boxes[4].truncation, boxes[4].occlusion) == (0, 1)
    assert (boxes[5].difficulty, boxes[5].ignored) == (None, "outside")
    assert boxes[5].num_points_alone > 0
    assert 0.2 < boxes[7].occlusion < 0.95
    assert boxes[7].difficulty in ("moderate", "hard")


def test_far_is_said_with_the_region_and_without(scanned):
    _, _, rig, world = scanned
    far = rig.sensors[0].sensor.assumed_range_max_m + 10
    (box,) = Scanner(world, rig, 4).scan(0, [car(1, far, 0)]).boxes
    assert (box.truncation, box.ignored) == (1, "far")


def test_a_car_is_cut_off_where_it_is_when_the_beams_meet_it(scanned):
    """At 30 m/s a car is metres on when the sensor looks its way: so is its truncation."""
    _, _, rig, world = scanned
    scanner = Scanner(world, rig, 4)
    moving = scanner.scan(0, [car(1, -9.0, 0.0, 0.0, (-30.0, 0.0, 0.0))]).boxes[0]
    there = -9.0 - 30.0 * moving.observed_s
    standing = scanner.scan(0, [car(1, there, 0.0)]).boxes[0]
    before = scanner.scan(0, [car(1, -9.0, 0.0)]).boxes[0]
    assert moving.observed_s > 0.02
    assert moving.truncation == pytest.approx(standing.truncation, abs=0.03)
    assert before.truncation > standing.truncation + 0.1


def test_the_table_holds_every_label(scanned, tmp_path):
    boxes, scanner, _, _ = scanned
    frame = scanner.scan(0, [car(1, 20, 0), car(2, 1, 0), car(4, -30, 26)])
    for name in FOLDERS:
        (tmp_path / name).mkdir()
    nobody = Motion({}, ACTOR_SCHEMA.empty_table(), SIGNAL_SCHEMA.empty_table())
    parked = pa.Table.from_pylist([{"track": 2}], schema=ACTOR_SCHEMA)
    motion = replace(nobody, parked=parked)
    entry = write_frame(tmp_path, 0, frame)
    entry["boxes"] = packed_columns(entry["boxes"])
    write_boxes(tmp_path / "boxes.parquet", {0: 0.0}, [entry], motion)
    table = pq.read_table(tmp_path / "boxes.parquet")
    assert table.schema.field("truncation").type == pa.float64()
    rows = {row["track"]: row for row in table.to_pylist()}
    for track, row in rows.items():
        assert row["difficulty"] == boxes[track].difficulty
        assert row["ignored"] == boxes[track].ignored
        assert row["truncation"] == pytest.approx(boxes[track].truncation)
        assert (row["difficulty"] is None) != (row["ignored"] is None)
        assert row["parked"] == (track == 2)
        assert row["towed_by"] is None


def test_levels_are_those_of_the_page(rig_of, street, crowd):
    """`docs/reference/labels.md`, written anew: points, occlusion, truncation."""
    rig = rig_of(street, {"model": "VLP-32C"})
    boxes = Scanner(street, rig, 1, region=REGION).scan(3, crowd(160, 6)).boxes
    seen = set()
    for one in boxes:
        seen.add(one.difficulty or one.ignored)
        if one.ignored is not None:
            continue
        easy = one.num_points > 20 and one.occlusion <= 0.2 and one.truncation <= 0.15
        moderate = one.num_points > 5 and one.occlusion <= 0.6 and one.truncation <= 0.3
        assert one.num_points >= 1
        assert one.truncation <= 0.5
        assert one.difficulty == ("easy" if easy else "moderate" if moderate else "hard")
    assert {"easy", "moderate", "hard", "unseen", "truncated"} <= seen


@pytest.mark.parametrize(
    ("model", "returns"),
    [("OS1-128", "strongest"), ("VLP-32C", "strongest"), ("VLP-32C", "last"), ("VLP-32C", "dual")],
)
def test_what_stands_free_is_not_occluded(rig_of, ground_mesh, model, returns):
    """Its edges share beams with the ground behind, which may win them: nothing hides it.

    Halos of plates may: they stand in for a few per cent of a truck's echoes.
    """
    kinds = ["pedestrian", "bicycle", "car", "truck"]
    rig = rig_of(ground_mesh(), {"model": model, "returns": returns})
    scanner = Scanner(ground_mesh(), rig, 2)
    for number, away in enumerate((13.0, 17.5, 22.0, 26.5, 31.0, 35.5, 40.0, 44.5)):
        pose = Pose.from_ypr((away * np.cos(number), away * np.sin(number), 0.0), 3 * number)
        name = asset_names(kinds[number % 4])[0]
        alone = PosedActor(1, kinds[number % 4], name, 0, pose, np.zeros(3))
        (box,) = scanner.scan(number, [alone]).boxes
        assert box.num_points > 0
        assert box.occlusion < 0.04
