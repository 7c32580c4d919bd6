"""Tracks, tracklets, trajectories and poses of a dataset, against how its actors were driven."""

import shutil
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import urbantwin as ut
from urbantwin.dataset import record
from urbantwin.dataset.reading.tables import read_table
from urbantwin.dataset.trajectories import (
    paths_of_trajectories,
    write_trajectories,
)
from urbantwin.lidar import place_rig
from urbantwin.site.rig import RigSpec
from urbantwin.traffic.assets import asset
from urbantwin.traffic.motion import ACTOR_SCHEMA


def columns(table, *names):
    return np.column_stack([table[name].to_numpy() for name in names])


def of_track(table, track):
    return table.filter(pa.array(table["track"].to_numpy() == track))


def test_a_tracklet_is_the_way_of_a_car_in_the_site(dataset):
    """Recorded in a frame that is turned by 30 degrees; the car drives 10 m/s east along y = 8."""
    frames = ut.open(dataset)
    assert set(frames.tracks["track"].to_pylist()) == {4, 9, 12}
    car = of_track(frames.tracklets, 4)
    assert car["frame"].to_pylist() == [f"{n:06d}" for n in range(2, 12)]
    time_s = car["time_s"].to_numpy()
    assert (np.diff(time_s) > 0.05).all()
    np.testing.assert_allclose(car["x"].to_numpy(), -8 + 10 * time_s, atol=0.03)
    np.testing.assert_allclose(car["y"].to_numpy(), 8.0, atol=0.03)
    np.testing.assert_allclose(columns(car, "vx", "vy", "vz"), [[10, 0, 0]] * 10, atol=1e-6)
    np.testing.assert_allclose(columns(car, "yaw", "pitch", "roll"), 0.0, atol=1e-9)
    told = of_track(frames.tracks, 4).to_pylist()[0]
    assert (told["class"], told["first_frame"], told["last_frame"]) == ("car", "000002", "000011")
    assert told["way_m"] == pytest.approx(10 * (time_s[-1] - time_s[0]), abs=0.03)
    assert told["fastest_m_s"] == pytest.approx(10.0)
    labelled = sum(int((frame.instance == 4).sum()) for frame in frames)
    assert told["points"] == labelled > 0


def test_what_stands_at_an_angle_in_a_tilted_frame(twin, motion, rig_spec, tmp_path):
    rig = place_rig(rig_spec(frame="sensor"), twin.mesh)
    record(twin, motion, rig, tmp_path / "dataset", workers=1, start_s=0.5, stop_s=0.6, seed=5)
    frames = ut.open(tmp_path / "dataset")
    for table in (frames.tracklets, frames.trajectories):
        stands = of_track(table, 9)
        np.testing.assert_allclose(stands["yaw"].to_numpy(), np.pi / 4, atol=0.01)
        np.testing.assert_allclose(columns(stands, "x", "y"), [[15, 24]] * len(stands), atol=0.3)
    # The frame of the points is tilted by 5 degrees, and so are boxes that stand upright in it.
    tilt = columns(of_track(frames.tracklets, 9), "pitch", "roll")
    assert np.degrees(np.hypot(*tilt.T)) == pytest.approx(5.0, abs=0.05)


@pytest.mark.parametrize("boxes", ["track", "tumtraf"])
def test_trajectories_meet_the_boxes_that_were_labelled(twin, motion_of, tmp_path, boxes):
    """A truck on a curve and a slope; TUMTraf's annotators have its load apart."""
    body = asset("truck-rigid-26t")
    rows = [
        {
            "time_s": round(0.1 * step, 9),
            **{"track": 3, "class": "truck", "asset": body.name, "speed": 6.0},
            **{"length": body.length, "width": body.width, "height": body.height},
            "x": 15 * np.sin(0.04 * step),
            "y": 25 - 15 * np.cos(0.04 * step),
            "z": 0.03 * step,
            "yaw": 0.04 * step,
            "pitch": -0.05,
        }
        for step in range(12)
    ]
    motion = motion_of(twin, rows)
    sensor = {"name": "pole", "model": "VLP-16", "columns": 900, "height_m": 5.0}
    spec = {"sensors": [{**sensor, "east_m": 0.0, "north_m": 0.0}], "boxes": boxes}
    rig = place_rig(RigSpec.model_validate(spec), twin.mesh)
    record(twin, motion, rig, tmp_path / "dataset", workers=1, seed=5, start_s=0.4, stop_s=0.6)
    frames = ut.open(tmp_path / "dataset")
    assert len(frames.tracks) == (2 if boxes == "tumtraf" else 1)
    for row in frames.tracklets.to_pylist():
        found = frames.paths.at(row["track"], np.array([row["time_s"]]))
        assert found.translation[0] == pytest.approx([row["x"], row["y"], row["z"]], abs=2e-3)
        assert found.rotation[0][2, 0] == pytest.approx(np.sin(0.05), abs=1e-6)
    # From the motion's first step to its last, which no frame shows.
    times = of_track(frames.trajectories, 3)["time_s"].to_numpy()
    assert times == pytest.approx(np.arange(12) / 10)
    ways = frames[0].trajectories(past=0.2, future=0.5)
    # From 0.2 s before the frame at 0.4 s to 0.5 s after it.
    assert sorted(set(ways["time_s"].to_pylist())) == pytest.approx(np.arange(2, 10) / 10)


def test_trajectories_go_on_for_a_while(twin, motion_of, tmp_path):
    """Of two minutes, one second is recorded; who is parked has two rows, who is not seen none."""
    row = {"class": "car", "asset": "car-sedan", "length": 4.7, "width": 1.8, "height": 1.4}
    rows = [
        {"time_s": float(step), "track": track, "x": 2.0 * step, "y": 5.0 * track, **row}
        for step in range(121)
        for track in (4, 5)
    ]
    parked = pa.Table.from_pylist(
        [
            {
                **{f.name: "" if pa.types.is_string(f.type) else 0 for f in ACTOR_SCHEMA},
                **{"track": 30_001, "x": 7.0, **row},
            }
        ],
        schema=ACTOR_SCHEMA,
    )
    motion = replace(motion_of(twin, rows, steps=121, step_s=1.0), parked=parked)
    path = tmp_path / "trajectories.parquet"
    write_trajectories(path, motion, {4, 30_001}, (60.0, 61.0))
    table = read_table(path)
    car = of_track(table, 4)
    assert car["time_s"].to_pylist() == list(range(40, 82))
    np.testing.assert_allclose(
        columns(car, "x", "y", "z"), [[2 * t, 20, 0.7] for t in range(40, 82)]
    )
    assert of_track(table, 30_001)["time_s"].to_pylist() == [40.0, 81.0]
    assert set(table["track"].to_pylist()) == {4, 30_001}
    order = columns(table, "time_s", "track")
    assert (order == order[np.lexsort(order.T[::-1])]).all()
    body = paths_of_trajectories(table).at(30_001, np.array([39.5, 60.2]))
    assert body.stretch[0] == body.stretch[1] >= 0
    assert body.translation[:, 0] == pytest.approx(7.0)


def test_the_ego_is_the_vehicle_that_carries_the_rig(twin, motion, tmp_path):
    sensor = {"name": "roof", "model": "VLP-16", "forward_m": 0.5, "left_m": 0.1}
    spec = {"sensors": [{**sensor, "above_roof_m": 0.4}], "ride": {"track": 4}, "frame": "level"}
    rig = place_rig(RigSpec.model_validate(spec), twin.mesh)
    record(twin, motion, rig, tmp_path / "dataset", workers=1, seed=5, start_s=0.3, stop_s=0.6)
    frames = ut.open(tmp_path / "dataset")
    for frame, turn in zip(frames, frames.sweeps.to_pylist(), strict=True):
        x = -8 + 10 * turn["start_s"]
        assert frame.site_SE3_ego.translation == pytest.approx([x, 8, 0])
        assert frame.site_SE3_sensor("roof").translation[:2] == pytest.approx([x + 0.5, 8.1])
    # Who carries the rig has no label, but a way.
    assert 4 not in frames.tracks["track"].to_pylist()
    assert 4 in frames.trajectories["track"].to_pylist()
    # The road comes towards it: a metre in each frame.
    frame = frames[0]
    road = frame.instance == 0
    assert np.nanmax(np.abs(frame.flow()[road])) == 0.0
    towards = frame.flow(ego=True)[road]
    towards = towards[np.isfinite(towards[:, 0])]
    n = len(towards)
    np.testing.assert_allclose(towards, np.broadcast_to([-1, 0, 0], (n, 3)), atol=1e-4)
    # Ranges are from the sensor, which drives, not from a place in the site.
    far = frames.box_range_m
    car = columns(frames.boxes, "x", "y")
    assert far == pytest.approx(np.linalg.norm(car, axis=1), abs=1e-3)


def test_poses_of_a_rig_that_stands(dataset):
    frames = ut.open(dataset)
    names = frames.poses["name"].to_pylist()
    assert names.count("ego") == names.count("pole") == len(frames) == 12
    frame = frames[5]
    assert frame.site_SE3_sensor().translation == pytest.approx([0, 0, 3])
    assert frame.site_SE3_ego.translation == pytest.approx(frame.site_SE3_dataset.translation)
    with pytest.raises(ut.InputError, match=r"no sensor 'roof'.* expected pole"):
        frame.site_SE3_sensor("roof")


def test_a_dataset_of_an_older_version_computes_what_it_lacks(dataset, tmp_path):
    folder = tmp_path / "dataset"
    shutil.copytree(dataset, folder)
    for name in ("tracks", "tracklets", "trajectories", "poses"):
        (folder / f"{name}.parquet").unlink()
    old, new = ut.open(folder), ut.open(dataset)
    for name in ("tracks", "tracklets", "poses"):
        assert getattr(old, name).equals(getattr(new, name)), name
    with pytest.raises(
        ut.InputError, match=r"has no trajectories.parquet.*urbantwin dataset sequence"
    ):
        _ = old.trajectories
    assert old[3].boxes.equals(new[3].boxes)


def test_the_tables_are_in_the_manifest_and_damage_is_told(dataset, tmp_path):
    told = ut.open(dataset).manifest
    for name in ("tracks", "tracklets", "trajectories", "poses"):
        assert f"{name}.parquet" in told["tables_sha256"]
        assert name in told["layout"]
    folder = tmp_path / "dataset"
    shutil.copytree(dataset, folder)
    (folder / "trajectories.parquet").write_bytes(b"PAR1 and no more")
    with pytest.raises(ut.InputError, match=r"trajectories\.parquet"):
        _ = ut.open(folder).trajectories
    assert pq.read_table(dataset / "tracks.parquet").num_rows == 3


def test_frames_in_which_nobody_is(twin, motion, rig, tmp_path):
    record(twin, motion, rig, tmp_path / "dataset", workers=1, seed=5, stop_s=0.1)
    frames = ut.open(tmp_path / "dataset")
    for name in ("boxes", "tracks", "tracklets", "trajectories"):
        assert getattr(frames, name).num_rows == 0
    assert len(frames.poses) == 4
    near = frames.where(classes="car", within_m=10.0, max_occlusion=0.5)
    assert (len(near), near[1].boxes.num_rows) == (2, 0)
    assert len(frames.where(with_boxes=True)) == 0
    flow = near[0].flow()
    assert (flow[np.isfinite(flow)] == 0).all()
