"""Packets against the data itself, read by numpy and pyarrow."""

import json
import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from urbantwin.dataset import record
from urbantwin.errors import InputError
from urbantwin.web import open_shown
from urbantwin.web.chosen_frames import ChosenFrames
from urbantwin.web.packet import packet, quantised
from urbantwin.web.wanted import Wanted

from .conftest import FRAMES, HIDDEN, LATE, TRUCK, WALKER


@pytest.fixture(scope="module")
def shown(dataset):
    return open_shown(Wanted(dataset))


@pytest.fixture(scope="module")
def site_of_dataset(dataset):
    """4 x 4, from the frame of the points to the site."""
    manifest = json.loads((dataset / "dataset.json").read_text())
    return np.linalg.inv(np.array(manifest["dataset_SE3_site"]))


def test_points_are_those_of_the_files_in_the_site(shown, dataset, site_of_dataset, unpacked):
    for name in ("000000", "000021"):
        points = np.load(dataset / "points" / f"{name}.npy")
        rays = np.load(dataset / "rays" / f"{name}.npy")
        labels = np.fromfile(dataset / "semantic" / f"{name}.label", "<u4")
        header, arrays = unpacked(shown.packet(f"points/0/{int(name)}"))
        assert arrays["position"].dtype == np.uint16
        places = np.array(header["origin"]) + header["step"] * arrays["position"]
        wanted = points[:, :3] @ site_of_dataset[:3, :3].T + site_of_dataset[:3, 3]
        assert np.abs(places - wanted).max() <= header["step"] / 2 + 1e-5
        assert header["step"] <= 0.005
        assert np.abs(arrays["intensity"] / 255 - points[:, 3]).max() <= 0.5 / 255 + 1e-6
        assert (arrays["semantic"] == labels & 0xFFFF).all()
        assert (arrays["instance"] == labels >> 16).all()
        for field in ("ring", "column", "sensor", "time"):
            assert (arrays[field] == rays[field]).all()


def test_boxes_are_those_of_the_table_in_the_site(shown, dataset, site_of_dataset, unpacked):
    rows = pq.read_table(dataset / "boxes.parquet").to_pylist()
    turn = Rotation.from_matrix(site_of_dataset[:3, :3]).as_euler("ZYX")[0]
    for index in (0, 20):
        header, _ = unpacked(shown.packet(f"boxes/0/{index}"))
        mine = {row["track"]: row for row in rows if row["frame"] == f"{index:06d}"}
        assert {box["track"] for box in header["boxes"]} == set(mine)
        for box in header["boxes"]:
            row = mine[box["track"]]
            at = site_of_dataset @ [row["x"], row["y"], row["z"], 1.0]
            assert np.allclose(box["box"][:3], at[:3], atol=1e-3)
            assert np.allclose(
                box["box"][3:6], [row["length"], row["width"], row["height"]], atol=1e-3
            )
            assert abs(np.sin((box["box"][6] - row["yaw"] - turn) / 2)) < 1e-3
            assert box["class"] == row["class"]
            assert box["points"] == row["num_points"]
            assert box["difficulty"] == row["difficulty"]
            assert box["ignored"] == row["ignored"]
            given_ = row["occlusion"]
            assert box["occlusion"] == (None if given_ is None else pytest.approx(given_, abs=1e-4))
            assert box["truncation"] == pytest.approx(row["truncation"], abs=1e-4)


def test_who_stands_behind_a_truck_is_hidden_by_it(shown, dataset, unpacked):
    row = next(
        row
        for row in pq.read_table(dataset / "boxes.parquet").to_pylist()
        if row["track"] == HIDDEN and row["frame"] == "000003"
    )
    assert row["num_points"] < 5 < row["num_points_alone"], row  # else it would prove nothing
    header, _ = unpacked(shown.packet("boxes/0/3"))
    box = {one["track"]: one for one in header["boxes"]}
    assert box[HIDDEN]["hidden_by"] == [TRUCK]
    assert f"truck {TRUCK}" in box[HIDDEN]["why"]
    assert str(row["num_points_alone"]) in box[HIDDEN]["why"]
    assert box[TRUCK]["why"] is None
    assert box[TRUCK]["hidden_by"] is None


def test_paths_are_those_of_the_table(shown, dataset, site_of_dataset, unpacked):
    header, _ = unpacked(shown.packet("tracks"))
    rows = [
        row
        for row in pq.read_table(dataset / "boxes.parquet").to_pylist()
        if row["track"] == WALKER
    ]
    mine = next(one for one in header["tracks"] if one["track"] == WALKER)
    assert mine["time_s"] == pytest.approx([row["time_s"] for row in rows])
    wanted = [site_of_dataset @ [row["x"], row["y"], row["z"], 1.0] for row in rows]
    assert np.allclose(np.array(mine["at"])[:, :3], np.array(wanted)[:, :3], atol=2e-3)
    stands = next(one for one in header["tracks"] if one["track"] == TRUCK)
    assert len(stands["at"]) == 1


def test_events_say_who_comes_when(shown, dataset):
    rows = pq.read_table(dataset / "boxes.parquet").to_pylist()
    first = min(
        int(row["frame"]) for row in rows if row["track"] == LATE and row["num_points"] >= 5
    )
    found = [one for one in shown.events if one["kind"] == "first appearance"]
    assert [(one["track"], one["frame"]) for one in found if one["track"] == LATE] == [
        (LATE, first)
    ]
    assert first >= 10
    assert not [one for one in found if one["track"] == WALKER]  # there from the first frame on
    counts = np.bincount([int(r["frame"]) for r in rows if r["num_points"] >= 5], minlength=FRAMES)
    most = next(one for one in shown.events if one["kind"] == "most actors")
    assert counts[most["frame"]] == counts.max()


def test_the_twin_is_all_its_triangles(shown, twin, unpacked):
    header, arrays = unpacked(shown.packet("twin"))
    places = np.array(header["origin"]) + header["step"] * arrays["position"]
    assert sum(group["count"] for group in header["groups"]) == len(twin.mesh.faces)
    first = {group["class"]: group for group in header["groups"]}
    wall = first["other-structure"]
    corners = places[arrays["index"][wall["first"] : wall["first"] + wall["count"]].ravel()]
    assert np.allclose(corners.min(axis=0), [5, 20, 0], atol=2e-3)
    assert np.allclose(corners.max(axis=0), [25, 20, 6], atol=2e-3)
    assert wall["material"] == "concrete"


def test_the_document_says_where_sensors_are_and_when_frames_are(shown, dataset):
    document = json.loads(json.dumps(shown.document(), allow_nan=False))
    manifest = json.loads((dataset / "dataset.json").read_text())
    sensor = manifest["rig"]["sensors"][0]
    assert np.allclose(
        np.reshape(document["sensors"][0]["pose"], (4, 4)), sensor["site_SE3_sensor"], atol=1e-6
    )
    assert document["sensors"][0]["channels"] == 16
    side = document["sides"][0]
    assert [one["time_s"] for one in side["frames"]] == [
        one["time_s"] for one in manifest["frames"]
    ]
    assert [one["points"] for one in side["frames"]] == [
        one["points"] for one in manifest["frames"]
    ]
    assert document["scene_frame"] == "site"
    assert abs(document["ground_z"]) < 0.05


def test_frames_are_chosen(dataset, unpacked, shown):
    some = open_shown(Wanted(dataset, frames=ChosenFrames.of("10:20", 3)))
    assert [one.name for one in some.sides[0].entries] == ["000010", "000013", "000016", "000019"]
    assert some.packet("points/0/1") == shown.packet("points/0/13")
    assert {one["frame"] for one in some.events} <= set(range(4))
    for words, every in (("5", 1), ("a:b", 1), ("9:9", 1), ("-1:3", 1), (None, 0), ("1:2:3", 1)):
        with pytest.raises(InputError):
            ChosenFrames.of(words, every)
    with pytest.raises(InputError, match="25 frames"):
        open_shown(Wanted(dataset, frames=ChosenFrames.of("25:", 1)))


@pytest.mark.parametrize(
    "name", ["points/0/25", "points/1/0", "points/0/-1", "points/0/0/0", "../dataset.json", "", "x"]
)
def test_other_names_are_no_packets(shown, name):
    with pytest.raises(KeyError):
        shown.packet(name)


@given(
    st.lists(st.tuples(*[st.floats(-500, 500, width=32)] * 3), min_size=1, max_size=50),
    st.floats(-1e6, 1e6),
)
def test_quantised_places_are_near_those_that_were_given(rows, far):
    points = np.array(rows, float) + far
    header, values = quantised(points)
    places = np.array(header["origin"]) + header.get("step", 1.0) * values.astype(float)
    assert np.abs(places - points).max() <= (
        header["step"] / 2 + 1e-6 if "step" in header else 1e-3
    )


def test_a_packet_refuses_what_the_page_does_not_read():
    with pytest.raises(ValueError, match="float64"):
        packet({}, {"x": np.zeros(3)})


def test_a_sensor_that_moves_is_in_the_frame_of_its_first(tmp_path, unpacked):
    """KITTI's odometry: poses of frames, in a text; a wall stands still in the scene."""
    place = tmp_path / "sequences" / "00"
    (place / "velodyne").mkdir(parents=True)
    wall = np.column_stack([np.full(60, 12.0), np.linspace(-6, 6, 60), np.zeros(60)])
    poses = []
    for index in range(3):
        turn, at = 0.2 * index, np.array([2.0 * index, 0.5 * index, 0.0])
        rotation = Rotation.from_euler("z", turn).as_matrix()
        poses.append(np.column_stack([rotation, at]))
        seen = (wall - at) @ rotation
        rows = np.column_stack([seen, np.full(60, 0.5)]).astype("<f4")
        rows.tofile(place / "velodyne" / f"{index:06d}.bin")
    (place / "poses.txt").write_text(
        "\n".join(" ".join(f"{x:.9f}" for x in p.ravel()) for p in poses)
    )
    (place / "calib.txt").write_text("Tr: 1 0 0 0 0 1 0 0 0 0 1 0\n")
    shown = open_shown(Wanted(tmp_path / "sequences" / "00"))
    for index in range(3):
        header, arrays = unpacked(shown.packet(f"points/0/{index}"))
        places = np.array(header["origin"]) + header["step"] * arrays["position"]
        assert np.allclose(places, wall, atol=2e-3), index


def test_the_coverage_beside_a_twin_is_a_layer(place, tmp_path, unpacked):
    shutil.copytree(place / "twin", tmp_path / "twin")
    folder = tmp_path / "coverage"
    folder.mkdir()
    (folder / "coverage.json").write_text('{"kind": "coverage", "sensors": ["a", "b"]}')
    facing = np.arange(24.0, dtype="f4").reshape(2, 3, 4)
    np.savez(
        folder / "coverage.npz", x0=-2.0, y0=5.0, cell_m=0.5, rate_hz=10.0,
        height_m=np.full((4, 5), 1.5, "f4"), semantic=np.zeros((3, 4), "u2"),
        ground=facing, lying=facing, facing=facing,
    )  # fmt: skip
    shown = open_shown(Wanted(tmp_path / "twin"))
    assert shown.document()["twin"]["coverage"] == {"packet": "coverage"}
    header, arrays = unpacked(shown.packet("coverage"))
    assert (header["x0"], header["y0"], header["cell_m"]) == (-2.0, 5.0, 0.5)
    assert np.allclose(arrays["value"], (facing[0] + facing[1]) / 10.0)
    assert arrays["z"].shape == (4, 5)


@pytest.mark.parametrize("storage", ["zstd", "laz"])
def test_another_storage_shows_the_same(storage, twin, motion_of, rig, tmp_path, unpacked):
    car = {"track": 7, "class": "car", "asset": "car-sedan", "x": 9.0, "y": 2.0}
    motion = motion_of(twin, [{"time_s": 0.1 * step, **car} for step in range(3)], steps=3)
    packets = []
    for kind in ("npy", storage):
        record(twin, motion, rig, tmp_path / kind, workers=1, seed=5, storage=kind)
        shown = open_shown(Wanted(tmp_path / kind))
        assert [one.error for one in shown.sides[0].entries] == [None] * 3
        packets.append([unpacked(shown.packet(f"{k}/0/2")) for k in ("points", "boxes")])
    (plain, boxes), (other, others) = packets
    assert boxes == others
    here, there = (np.array(h["origin"]) + h["step"] * a["position"] for h, a in (plain, other))
    assert np.abs(here - there).max() < 4e-3
    for field in ("ring", "column", "sensor", "semantic", "instance"):
        assert (plain[1][field] == other[1][field]).all(), field
    stored = next((tmp_path / storage / "points").glob("000001.*"))
    stored.write_bytes(stored.read_bytes()[:99])
    shown = open_shown(Wanted(tmp_path / storage))
    with pytest.raises(InputError):
        shown.packet("points/0/1")
    assert shown.sides[0].entries[1].error.startswith("points/000001.")
