"""Several nodes of one run: each sees what it sees alone, and all agree on who is where."""

import json
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml

import urbantwin as ut
from urbantwin.cli import main
from urbantwin.dataset import record
from urbantwin.dataset.reading import Fleet, fused_cloud
from urbantwin.fidelity.readers import open_recording
from urbantwin.lidar import place_rig
from urbantwin.site.rig import RigSpec
from urbantwin.traffic.motion import MOTION_VERSION
from urbantwin.web import open_shown
from urbantwin.web.wanted import Wanted

SENSOR = {"model": "VLP-16", "columns": 900}
POLE = {"sensors": [{**SENSOR, "name": "p", "east_m": 0.0, "north_m": 0.0, "height_m": 3.0,
                     "pitch_deg": 5.0, "yaw_deg": 30.0}]}  # fmt: skip
#: Behind the wall, where the pole does not see.
OTHER = {"sensors": [{**SENSOR, "name": "o", "east_m": 20.0, "north_m": 32.0, "height_m": 3.0,
                      "pitch_deg": 8.0, "yaw_deg": -120.0}]}  # fmt: skip
ROOF = {"ride": {"track": 4},
        "sensors": [{**SENSOR, "name": "r", "forward_m": 0.5, "left_m": 0.0,
                     "above_roof_m": 0.4}]}  # fmt: skip
CLOCK = {"offset_s": 0.05, "drift_ppm": 400.0}
BIAS = {"forward_m": 0.5, "left_m": -0.2, "up_m": 0.1, "yaw_deg": 3.0}
NODES = [
    {"name": "pole", "rig": POLE},
    {"name": "other", "rig": OTHER, "clock": CLOCK, "pose_error": {"bias": BIAS}},
    {"name": "car", "rig": ROOF, "radio": {"latency_s": 0.03,
                                           "outages": [{"start_s": 0.55, "stop_s": 0.75}]}},
]  # fmt: skip
#: The car comes with this frame.
FIRST = 2
FRAMES = 12


@pytest.fixture(scope="module")
def paths(twin, motion, tmp_path_factory):
    """Folders of the twin and of the motion, as the command takes them."""
    base = tmp_path_factory.mktemp("nodes")
    manifest = {"kind": "motion", "version": MOTION_VERSION, **motion.manifest}
    replace(motion, manifest=manifest).save(base / "motion")
    return twin.folder, base / "motion"


def written(folder, nodes, **more):
    file = folder / "nodes.yaml"
    file.write_text(yaml.safe_dump({"nodes": nodes, **more}))
    return file


@pytest.fixture(scope="module")
def fleet(paths, tmp_path_factory):
    """Two poles and a car, recorded together in one process."""
    folder = tmp_path_factory.mktemp("fleet")
    options = {"workers": 1, "seed": 5, "pictures": False, "progress": False}
    return ut.record(*paths, folder / "fleet", nodes=written(folder, NODES), **options)


def frames_in(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for kind in ("points", "labels", "semantic", "rays")
        for path in (folder / kind).iterdir()
    }


@pytest.mark.parametrize(("name", "rig", "start_s"), [
    ("pole", POLE, 0.0), ("car", ROOF, FIRST / 10),
    ("other", {"sensors": [OTHER["sensors"][0] | {f"clock_{k}": v for k, v in CLOCK.items()}]}, 0),
])  # fmt: skip
def test_a_node_sees_what_its_rig_sees_alone(fleet, twin, motion, tmp_path, name, rig, start_s):
    seed = fleet.nodes[name].manifest["seeds"]["record"]
    assert (seed == 5) == (name == "pole")
    alone = place_rig(RigSpec.model_validate(rig), twin.mesh)
    record(twin, motion, alone, tmp_path / "d", workers=1, seed=seed, start_s=start_s)
    mine = frames_in(fleet.folder / name)
    assert mine == frames_in(tmp_path / "d")
    assert len(mine) == 4 * (FRAMES - round(10 * start_s))
    ours, theirs = fleet.nodes[name].boxes, ut.open(tmp_path / "d").boxes
    assert ours.equals(theirs)


@pytest.mark.thorough
def test_workers_do_not_matter_and_what_is_there_is_kept(fleet, paths, tmp_path, digests, capsys):
    """One process, stopped in the middle; then two that go on."""
    file = written(tmp_path, NODES)
    told = []

    def stop(_share, doing):
        told.append(doing)
        if doing.startswith("frame 27 "):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ut.record(*paths, tmp_path / "fleet", nodes=file, seed=5, workers=1, pictures=False,
                  progress=stop)  # fmt: skip
    assert told[-1] == f"frame 27 of {3 * FRAMES - FIRST}"
    assert not (tmp_path / "fleet").exists()
    command = ["record", *paths, "--nodes", file, "-o", tmp_path / "fleet", "--seed", "5", "-q",
               "--workers", "2", "--no-pictures"]  # fmt: skip
    assert main([str(one) for one in command]) == 0
    assert digests(tmp_path / "fleet") == digests(fleet.folder)
    assert sorted(one.name for one in tmp_path.iterdir()) == ["fleet", "nodes.yaml"]
    assert main(["dataset", "verify", str(tmp_path / "fleet"), "-q"]) == 0
    assert main(["dataset", "verify", str(tmp_path / "fleet" / "car"), "-q"]) == 0
    spoilt = tmp_path / "fleet" / "nodes.parquet"
    spoilt.write_bytes(spoilt.read_bytes()[:-9])
    assert main(["dataset", "verify", str(tmp_path / "fleet"), "-q"]) != 0
    assert "nodes.parquet" in capsys.readouterr().err


def test_a_node_that_comes_later_is_marked_absent(fleet):
    states = fleet.states.to_pylist()
    assert len(states) == 3 * FRAMES
    there = [row["frame"] for row in states if row["node"] == "car" and row["present"]]
    assert there == [f"{k:06d}" for k in range(FIRST, FRAMES)]
    assert tuple(there) == fleet.nodes["car"].names
    assert all(row["true_x"] is None for row in states if not row["present"])
    (told,) = (one for one in fleet.warnings if one.about == "node car")
    assert "absent in 2 of 12 frames" in told.problem
    assert "from 0.2 to 1.1 s" in told.reason
    assert not fleet.frame(0).node("car").present
    with pytest.raises(ut.InputError, match="car is not there in frame 000000"):
        _ = fleet.frame(0).node("car").points


def test_a_node_that_leaves_and_comes_back(twin, motion_of, tmp_path):
    """It is there from step 1 to 3 and from 6 to 7; its points are in the site."""
    here = {"track": 3, "class": "car", "asset": "car-sedan", "y": 6.0, "speed": 5.0}
    steps = [1, 2, 3, 6, 7]
    rows = [{**here, "time_s": round(k / 10, 9), "x": 0.5 * k} for k in steps]
    rows.append({"time_s": 0.9, "track": 7, "class": "car", "asset": "car-sedan", "x": 30.0})
    comes_back = motion_of(twin, sorted(rows, key=lambda row: row["time_s"]), steps=10)
    manifest = {"kind": "motion", "version": MOTION_VERSION, **comes_back.manifest}
    replace(comes_back, manifest=manifest).save(tmp_path / "motion")
    rig = {**ROOF, "ride": {"track": 3}, "frame": "site"}
    error = {"bias": {"forward_m": 1.0, "yaw_deg": 90.0}}
    nodes = [NODES[0], {"name": "car", "rig": rig, "pose_error": error}]
    made = ut.record(twin.folder, tmp_path / "motion", tmp_path / "fleet", pictures=False,
                     nodes=written(tmp_path, nodes), workers=1, progress=False)  # fmt: skip
    assert made.nodes["car"].names == tuple(f"{k:06d}" for k in steps)
    states = [made.frame(k).node("car").state for k in range(10)]
    assert [k for k, state in enumerate(states) if state.present] == steps
    assert "from 0.1 to 0.3 s and 0.6 to 0.7 s" in made.warnings[0].reason
    assert len(made.nodes["pole"]) == 10
    for k in steps:
        state = states[k]
        np.testing.assert_allclose(state.true.translation, 0.0)
        assert state.place.translation[:2] == pytest.approx([0.5 * k, 6.0])
        # It believes to be a metre farther east, and turned to the north about its own middle.
        assert state.believed.translation[:2] == pytest.approx([0.5 * k + 1.0, 6.0])
        ahead = state.reported.apply([[0.5 * k + 2.0, 6.0, 0.0]])[0]
        assert ahead[:2] == pytest.approx([0.5 * k + 1.0, 8.0])
    made.plot(2)
    assert made.frame(5).fused().frames == {"pole": "000005", "car": None}


def test_clocks_radio_and_poses_in_closed_form(fleet):
    rows = {(one["node"], one["frame"]): one for one in fleet.states.to_pylist()}
    for k in range(FRAMES):
        pole, other, car = (rows[name, f"{k:06d}"] for name in ("pole", "other", "car"))
        time_s = k / 10
        assert pole["clock_s"] == pytest.approx(time_s)
        assert other["clock_s"] == pytest.approx(time_s * (1 + 400e-6) + 0.05, abs=1e-12)
        # A turn of a tenth of a second begins at the frame's time.
        assert pole["sent_s"] == pytest.approx(time_s + 0.1)
        assert pole["arrival_s"] == pytest.approx(time_s + 0.1)
        if k >= FIRST:
            lost = 0.55 <= time_s + 0.1 < 0.75
            assert car["lost"] == lost
            assert car["arrival_s"] == (None if lost else pytest.approx(time_s + 0.13))
            # It drives east at 10 m/s from x = -8 on, along y = 8.
            assert car["true_x"] == pytest.approx(-8 + 10 * time_s + 0.5)
            assert [car["true_y"], car["true_yaw"]] == pytest.approx([8.0, 0.0])
            assert [car["node_x"], car["node_y"]] == pytest.approx([-8 + 10 * time_s, 8.0])
            assert all(car[f"reported_{n}"] == pytest.approx(car[f"true_{n}"]) for n in "xyz")
        # The other looks to -120 degrees: its bias is along that.
        yaw = np.radians(-120)
        ahead, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
        place = np.array([20.0, 32.0]) + 0.5 * ahead - 0.2 * left
        assert [other["reported_x"], other["reported_y"]] == pytest.approx(list(place))
        assert other["reported_z"] == pytest.approx(other["true_z"] + 0.1)
        assert other["reported_yaw"] == pytest.approx(yaw + np.radians(3))
        assert [other["true_x"], other["true_y"]] == pytest.approx([20.0, 32.0])
        assert [other["node_x"], other["node_pitch"]] == pytest.approx([20.0, 0.0])
    rays = fleet.nodes["other"][5].rays["time"]  # by its own clock
    assert rays.min() == pytest.approx(0.05 + 400e-6 * 0.5, abs=1e-4)


def inside(points, box, margin):
    """Which points are in a box, by how far they are along its axes from its middle."""
    c, s = np.cos(box[6]), np.sin(box[6])
    away = points - box[:3]
    own = np.column_stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]])
    own = np.column_stack([own, away[:, 2]])
    return (np.abs(own) <= np.asarray(box[3:6]) / 2 + margin).all(axis=1)


def test_points_of_all_nodes_lie_in_the_common_boxes(fleet):
    """By true poses; by reported ones those of the node that is wrong do not."""
    of_two = 0
    for frame in list(fleet)[FIRST:]:
        rows = frame.boxes.to_pylist()
        assert [row["track"] for row in rows] == [4, 9, 12]
        for using in ("true", "reported"):
            cloud = frame.fused(using=using)
            for row, box in zip(rows, frame.box_array, strict=True):
                mine = cloud.points[cloud.instance == row["track"], :3].astype(float)
                who = cloud.node[cloud.instance == row["track"]]
                # A turn lasts 0.1 s; noise of the range 3 cm, edges of footprints a little more.
                margin = 0.15 + 0.1 * np.hypot(row["vx"], row["vy"])
                right = inside(mine, box, margin)
                if using == "true":
                    assert right.mean() > 0.98 if len(right) else True
                    assert len(mine) == row["num_points"]
                    assert len(set(who.tolist())) == row["num_nodes"]
                    of_two += row["num_nodes"] > 1
                elif row["track"] == 9 and (who == 1).sum() > 20:
                    assert right[who == 1].mean() < 0.9
    assert of_two >= 5


def test_boxes_say_how_each_node_sees(fleet):
    table = fleet.boxes.to_pylist()
    for name, dataset in fleet.nodes.items():
        own = {(row["frame"], row["track"]): row for row in dataset.boxes.to_pylist()}
        for row in table:
            mine = own.get((row["frame"], row["track"]))
            for column in ("num_points", "visibility", "occlusion", "difficulty", "ignored"):
                assert row[f"{column}.{name}"] == (None if mine is None else mine[column])
    carrier = [row for row in table if row["track"] == 4]
    assert {row["carries"] for row in carrier} == {"car"}
    assert all(row["num_points.car"] is None for row in carrier)
    assert any(row["num_points.pole"] > 20 for row in carrier)  # a target of the others
    hidden = [row for row in table if row["track"] == 9]  # behind the wall
    assert max(row["visibility.pole"] or 0.0 for row in hidden) < 0.5
    assert min(row["visibility.other"] for row in hidden) > 0.5
    assert all(row["visibility"] >= row["visibility.other"] for row in hidden)
    # Where they stand is where the motion has them, at the frame's time.
    for row in carrier:
        assert [row["x"], row["y"], row["vx"]] == pytest.approx(
            [-8 + 10 * row["time_s"], 8.0, 10.0]
        )


def test_all_nodes_are_cut_at_the_same_moments(fleet):
    part_of = {}
    for dataset in fleet.nodes.values():
        for part in ("train", "val", "test"):
            for name in (dataset.folder / f"ImageSets/{part}.txt").read_text().split():
                assert part_of.setdefault(name, part) == part
    assert set(part_of.values()) == {"train", "val", "test"}


def test_a_receiver_has_what_has_arrived(fleet):
    files = Fleet(fleet.folder)
    # Complete at 0.1 s after their time and 0.03 s on the air: what the pole has is one older.
    cloud = fused_cloud(files, "000004", frame_of="pole", using="true", at="nearest")
    assert cloud.frames == {"pole": "000004", "other": "000004", "car": "000003"}
    assert cloud.age_s["car"] == pytest.approx(0.1)
    # Those of 5 and 6 are lost: at 7 the last to have arrived is 4.
    cloud = fused_cloud(files, "000007", frame_of="pole", using="true", at="nearest")
    assert cloud.frames["car"] == "000004"
    # By its clock, which is more than half a frame ahead, the frame before is nearer.
    cloud = fused_cloud(files, "000007", frame_of="pole", at="nearest")
    assert cloud.frames["other"] == "000006"
    assert cloud.age_s["other"] == pytest.approx(0.1 - 0.05 - 400e-6 * 0.6)
    none = fused_cloud(files, "000002", frame_of="pole", using="true", at="nearest")
    assert none.frames["car"] is None
    assert set(none.node.tolist()) == {0, 1}


def test_points_go_on_as_their_actor_moves(fleet):
    """What the car saw of who walks, taken on from one frame to the next: at constant velocity."""
    files = Fleet(fleet.folder)
    options = {"frame_of": "pole", "using": "true", "nodes": ["car"]}
    late, on = (fused_cloud(files, "000009", at=at, **options) for at in
                ("nearest", "extrapolated"))  # fmt: skip
    taken = late.frames["car"]
    assert on.frames["car"] == taken == "000008"
    moved = on.points[:, :3].astype(float) - late.points[:, :3]
    assert np.abs(moved[on.instance == 0]).max() == 0.0
    walks = fleet.nodes["car"].boxes.to_pylist()
    (row,) = (one for one in walks if one["frame"] == taken and one["track"] == 12)
    speed = np.linalg.norm([row["vx"], row["vy"]])
    way = np.linalg.norm(moved[on.instance == 12], axis=1)
    assert len(way) > 5
    np.testing.assert_allclose(way, 0.1 * speed, atol=1e-4)
    # By a clock that is ahead, points of the same moment go back.
    options = {"frame_of": "pole", "nodes": ["other"]}
    still, on = (fused_cloud(files, "000004", at=at, **options) for at in
                 ("nearest", "extrapolated"))  # fmt: skip
    moved = on.points[:, :3].astype(float) - still.points[:, :3]
    speed = 10.0 * on.age_s["other"] * (on.instance == 4)
    np.testing.assert_allclose(np.linalg.norm(moved[on.instance != 12], axis=1),
                               np.abs(speed[on.instance != 12]), atol=2e-3)  # fmt: skip


def test_what_is_asked_of_a_cloud_must_be_there(fleet):
    frame = fleet.frame(0)
    for options, words in [
        ({"frame_of": "lamp"}, "has no node 'lamp'"), ({"frame_of": "car"}, "car is not there"),
        ({"using": "best"}, "expected true, reported"), ({"at": "nearest"}, "no receiver is given"),
        ({"nodes": ["pole", "lamp"]}, "has no node 'lamp'"),
    ]:  # fmt: skip
        with pytest.raises(ut.InputError, match=words):
            frame.fused(**options)
    with pytest.raises(ut.InputError, match="has no frame '7'"):
        fleet.frame("7")


def test_a_fleet_is_one_recording_in_the_site(fleet, tmp_path, capsys):
    recording = open_recording(fleet.folder)
    frame = recording.read(5)
    cloud = fleet.frame(5).fused(using="true")
    np.testing.assert_allclose(frame.points, cloud.points[:, :3], atol=1e-5)
    np.testing.assert_array_equal(frame.sensor, cloud.node)  # each node has one
    np.testing.assert_allclose(frame.sensor_places[:2], [[0, 0, 3], [20, 32, 3]], atol=1e-6)
    assert frame.sensor_places[2] == pytest.approx([-8 + 5 + 0.5, 8.0, frame.sensor_places[2, 2]])
    assert frame.boxes.num_points.tolist() == fleet.frame(5).boxes["num_points"].to_pylist()
    shown = open_shown(Wanted(fleet.folder))
    assert [entry.time_s for entry in shown.sides[0].entries] == list(fleet.times_s)
    assert sum(e.points for e in shown.sides[0].entries) == sum(fleet.states["points"].to_pylist())
    assert {one["name"] for one in shown.sensors} == {"pole p", "other o"}
    assert main(["view", str(fleet.folder), "--save", str(tmp_path / "page.html"), "-q"]) == 0
    assert main(["info", str(fleet.folder)]) == 0
    assert "kind: fleet" in capsys.readouterr().out
    axes = fleet.plot().axes[0]
    for place in ([0.0, 0.0], [20.0, 32.0]):  # of both poles a dot, and of the other a cross
        assert any(np.allclose(line.get_xydata(), [place]) for line in axes.lines)
    assert any(line.get_marker() == "x" for line in axes.lines)


RIDES = {"ride": {"class": "car"}, "sensors": ROOF["sensors"]}
BAD = {
    "twice": ([NODES[0], NODES[0]], {}, "nodes (line 1): nodes are named 'pole' twice"),
    "case": ([NODES[0], {"name": "Pole"}], {}, "named 'pole' and 'Pole'"),
    "unknown": ([{"name": "a", "rigg": "x"}], {}, "nodes[0].rigg (line 3): is not a field that"),
    "deep": ([{"name": "a", "rig": POLE, "clock": {"ofset_s": 1}}], {}, "expected 'offset_s'"),
    "none": ([], {}, "nodes (line 1): is empty"),
    "path": ([{"name": "../a", "rig": POLE}], {}, "cannot name a folder"),
    "taken": ([{"name": "Pictures", "rig": POLE}], {}, "is the folder of the pictures"),
    "class": ([{"name": "a", "rig": RIDES, "ride": "bus"}], {},
              "nodes.yaml: nodes[0].ride (line 3): the motion has no bus; expected one of car"),
    "own class": ([{"name": "a", "rig": {**RIDES, "ride": {"class": "tram"}}}], {},
                  "nodes[0].rig.ride.class: the motion has no tram"),
    "word": ([{"name": "a", "rig": RIDES, "ride": "hovercraft"}], {}, "expected one of car, "),
    "stands": ([{"name": "a", "rig": POLE, "ride": "car"}], {}, "the rig is static"),
    "both": ([{"name": "a", "rig": ROOF}, {"name": "b", "rig": ROOF}], {},
             "b and a are mounted on the same actor, track 4"),
    "too few": ([{"name": k, "rig": RIDES} for k in "abc"], {}, "no car is left"),
    "wall": ([NODES[0], {"name": "b", "rig": {"sensors": [
        {**SENSOR, "name": "q", "east_m": 15, "north_m": 20, "up_m": -3}]}}], {},
        "nodes[1].rig.sensors[0].up_m: -3 m is under the ground"),
    "file": ([{"name": "a", "rig": "nowhere.yaml"}], {}, "nowhere.yaml: not found"),
    "rates": ([NODES[0], {"name": "b", "rig": {**OTHER, "rate_hz": 5.0}}], {},
              "b has 5.0 frames per second, pole 10.0; expected rate_hz: of all nodes"),
    "apart": ([{"name": "a", "rig": {**POLE, "fused": False}}], {}, "for each sensor"),
    "loss": ([{"name": "a", "rig": POLE, "radio": {"loss": 1.5}}], {}, "expected at most 1"),
    "backwards": ([{"name": "a", "rig": POLE, "radio": {"outages": [
        {"start_s": 3, "stop_s": 2}]}}], {}, "stops at 2 s; expected later than its start"),
}  # fmt: skip


@pytest.mark.parametrize(("nodes", "more", "words"), BAD.values(), ids=BAD.keys())
def test_what_cannot_be_recorded_is_told_in_one_line(paths, tmp_path, capsys, nodes, more, words):
    file = written(tmp_path, nodes, **more)
    code = main(
        ["record", *map(str, paths), "--nodes", str(file), "-o", str(tmp_path / "out"), "-q"]
    )
    told = capsys.readouterr().err
    assert words in told
    assert code == 2
    assert told.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["nodes.yaml"]


def test_what_takes_one_dataset_names_the_nodes(fleet, tmp_path, capsys):
    assert main(["dataset", "sequence", str(fleet.folder), "-o", str(tmp_path / "s")]) == 2
    assert "is a fleet; expected the dataset of one node: car, other" in capsys.readouterr().err


def test_options_of_one_rig_are_refused_beside_nodes(paths, tmp_path, capsys):
    file = written(tmp_path, NODES)
    for option in (["--rig", "r.yaml"], ["--ride", "4"], ["--separate"], ["--fused"],
                   ["--background", "a.npz"], ["--fuse"]):  # fmt: skip
        assert main(["record", *map(str, paths), "--nodes", str(file), *option, "-q"]) == 2
        assert "several nodes are given" in capsys.readouterr().err


def test_a_rate_for_all(paths, tmp_path):
    slow = {"name": "b", "rig": {**OTHER, "rate_hz": 5.0}}
    file = written(tmp_path, [NODES[0], slow], rate_hz=5.0)
    made = ut.record(*paths, tmp_path / "fleet", nodes=file, stop=0.2, workers=1, pictures=False,
                     progress=False, effects="none")  # fmt: skip
    assert made.manifest["rate_hz"] == 5.0
    assert list(made.times_s) == [0.0, 0.2]
    assert made.summary()["nodes"]["b"]["frames"] == 2
    sensors = json.loads((made.folder / "pole/dataset.json").read_text())["rig"]["sensors"]
    assert not any(sensors[0]["effects"].values())
    assert pq.read_table(made.folder / "nodes.parquet").num_rows == 4
