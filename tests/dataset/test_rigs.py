"""Recording with several sensors, each with its own time, and with a rig that rides."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

import urbantwin as ut
from urbantwin.dataset import describe, parts_of, record
from urbantwin.errors import InputError
from urbantwin.lidar import place_rig
from urbantwin.site.rig import RigSpec

from ..thorough import further


def two_sensors(twin, **changed):
    """A steady sensor, and one that turns twice as fast, late, and with a clock of its own."""
    steady = {"name": "steady", "model": "VLP-16", "east_m": 0.0, "north_m": 0.0, "height_m": 3.0}
    swift = {
        **{"name": "swift", "model": "OS1-32", "columns": 512, "height_m": 4.0},
        **{"east_m": 30.0, "north_m": -10.0, "yaw_deg": 90.0, "roll_deg": 2.0},
        **{"rate_hz": 20.0, "latency_s": 0.06, "clock_offset_s": 0.01, "clock_drift_ppm": 500.0},
        **{"dropped_frames": 0.3, "time_jitter_s": 0.001},
    }
    spec = {"sensors": [steady, swift], "frame": "site", **changed}
    return place_rig(RigSpec.model_validate(spec), twin.mesh)


@pytest.fixture(scope="module")
def fused(twin, motion, tmp_path_factory):
    out = tmp_path_factory.mktemp("fused") / "dataset"
    record(twin, motion, two_sensors(twin), out, workers=1, seed=5, start_s=0.2, stop_s=0.7)
    return out


def test_every_turn_is_told_of(fused):
    table = pq.read_table(fused / "sweeps.parquet").to_pylist()
    steady = [row for row in table if row["sensor"] == "steady"]
    assert [row["frame"] for row in steady] == [f"{n:06d}" for n in range(2, 8)]
    assert [row["start_s"] for row in steady] == pytest.approx(np.arange(2, 8) / 10)
    assert all(row["stop_s"] - row["start_s"] == pytest.approx(0.1) for row in steady)
    assert all(row["clock_start_s"] == row["start_s"] for row in steady)
    assert not any(row["lost"] for row in steady)
    swift = [row for row in table if row["sensor"] == "swift"]
    assert len(swift) == 12
    begins = np.array([row["start_s"] for row in swift])
    turns = np.array([row["turn"] for row in swift])
    # What begins to arrive within a frame: up to 0.06 s after it was measured.
    frames = np.array([int(row["frame"]) for row in swift]) / 10
    assert ((turns * 0.05 + 0.06 >= frames - 1e-9) & (turns * 0.05 + 0.06 < frames + 0.1)).all()
    assert np.abs(begins - turns * 0.05).max() <= 0.003
    assert np.std(begins - turns * 0.05) > 1e-4
    for row in swift:
        assert row["clock_start_s"] == pytest.approx(row["start_s"] * (1 + 5e-4) + 0.01)
        assert row["arrival_s"] == pytest.approx(row["start_s"] + 0.05 + 0.06)
    assert 0 < sum(row["lost"] for row in swift) < 12


def test_points_were_measured_within_the_true_turns_of_their_sensors(fused):
    """One clock is 10 ms ahead and drifts; the turns that `sweeps.parquet` tells are true."""
    frames = ut.open(fused)
    turns = [row for row in pq.read_table(fused / "sweeps.parquet").to_pylist() if not row["lost"]]
    by_clock = 0
    for frame in frames:
        for number, sensor in enumerate(("steady", "swift")):
            spans = [
                (row["start_s"], row["stop_s"])
                for row in turns
                if (row["frame"], row["sensor"]) == (frame.name, sensor)
            ]
            on = frame.sensor == number
            for times, exact in ((frame.measured_s(), True), (frame.time_s + frame.time, False)):
                inside = np.zeros(on.sum(), bool)
                for start_s, stop_s in spans:
                    inside |= (times[on] > start_s - 2e-4) & (times[on] < stop_s + 2e-4)
                if exact:
                    assert inside.all(), (frame.name, sensor)
                elif sensor == "swift":
                    by_clock += int((~inside).sum())
    assert by_clock > 1000


def test_poses_of_sensors_that_stand(fused):
    for row in pq.read_table(fused / "sweeps.parquet").to_pylist():
        stands = [0, 0, 3, 0, 0, 0]
        if row["sensor"] == "swift":
            stands = [30, -10, 4, np.pi / 2, 0, np.radians(2)]
        for kind in ("true", "reported"):
            pose = [row[f"{kind}_{name}"] for name in ("x", "y", "z", "yaw", "pitch", "roll")]
            assert pose == pytest.approx(stands, abs=1e-9)


def test_the_manifest_tells_how_the_sensors_keep_time(fused):
    manifest = json.loads((fused / "dataset.json").read_text())
    lost = [row["lost"] for row in pq.read_table(fused / "sweeps.parquet").to_pylist()]
    assert (manifest["counts"]["turns"], manifest["counts"]["turns_lost"]) == (18, sum(lost))
    rig = manifest["rig"]
    assert rig["sensors"][1]["turns_per_second"] == 20
    assert rig["sensors"][1]["latency_s"] == 0.06
    assert rig["conditions"]["weather"] == "clear"
    assert rig["carrier"] is None


@pytest.fixture(scope="module")
def separate(twin, motion, tmp_path_factory):
    out = tmp_path_factory.mktemp("separate") / "dataset"
    rig = two_sensors(twin, fused=False)
    record(twin, motion, rig, out, workers=1, seed=5, start_s=0.2, stop_s=0.7)
    return out


def test_sensors_that_are_not_fused_have_a_dataset_each(fused, separate):
    assert sorted(path.name for path in separate.iterdir()) == [
        "README.md",
        "SHA256SUMS",
        "dataset.json",
        "steady",
        "swift",
    ]
    assert [path.name for path in parts_of(separate)] == ["steady", "swift"]
    assert parts_of(fused) == [fused]
    for part in parts_of(separate):
        assert (part / "ImageSets/train.txt").read_text() == (
            fused / "ImageSets/train.txt"
        ).read_text()
        assert describe(part)["frames"] == 6
    told = describe(separate)
    assert told["kind"] == "datasets"
    assert list(told["datasets"]) == ["steady", "swift"]
    json.dumps(told)


def test_apart_or_fused_a_sensor_measures_the_same(fused, separate):
    """In the site frame: the points of each sensor are those that it has in the fused frame."""
    for index in range(2, 8):
        points = np.load(fused / f"points/{index:06d}.npy")
        rays = np.load(fused / f"rays/{index:06d}.npy")
        for number, name in enumerate(("steady", "swift")):
            own = np.load(separate / f"{name}/points/{index:06d}.npy")
            mine = points[rays["sensor"] == number]
            background = ~_of_actors(fused, index)[rays["sensor"] == number]
            assert own.shape == mine.shape
            assert own[background] == pytest.approx(mine[background], abs=1e-6)


def _of_actors(dataset, index):
    return np.fromfile(dataset / f"semantic/{index:06d}.label", np.uint32) >> 16 > 0


def test_both_echoes_of_a_beam_are_told_apart(twin, motion, rig_spec, tmp_path):
    one = rig_spec().sensors[0].model_dump(exclude_none=True)
    rig = place_rig(rig_spec(sensors=[{**one, "returns": "dual"}]), twin.mesh)
    record(twin, motion, rig, tmp_path / "dataset", workers=1, start_s=1.1)
    rays = np.load(tmp_path / "dataset/rays/000011.npy")
    second = np.flatnonzero(rays["echo"] == 1)
    assert len(second) > 10
    # A second echo stands behind the first of its own beam.
    assert (rays[second][["ring", "column", "time"]] == rays[second - 1][
        ["ring", "column", "time"]]).all()  # fmt: skip
    assert (rays["echo"][second - 1] == 0).all()
    assert len(np.unique(rays[["ring", "column", "echo"]])) == len(rays)


@pytest.mark.parametrize("fuse", [True, *further(False)])
def test_nothing_depends_on_who_records_what_when(
    twin, motion, fused, separate, digests, tmp_path, fuse
):
    """Two processes, stopped in the middle and set on again, give the same bytes."""

    def stop(_fraction, doing):
        if doing.startswith("frame 4 " if fuse else "frame 9 "):
            raise KeyboardInterrupt

    out, rig = tmp_path / "dataset", two_sensors(twin, fused=fuse)
    span = {"seed": 5, "start_s": 0.2, "stop_s": 0.7}
    with pytest.raises(KeyboardInterrupt):
        record(twin, motion, rig, out, workers=1, progress=stop, **span)
    assert not out.exists()
    told = []

    def listen(_fraction, doing):
        told.append(doing)

    record(twin, motion, rig, out, workers=2 if fuse else 1, progress=listen, **span)
    assert ("frame 5 of 6" if fuse else "frame 10 of 12") in told
    assert ("frame 3 of 6" if fuse else "frame 8 of 12") not in told
    assert digests(out) == digests(fused if fuse else separate)
    assert [path.name for path in tmp_path.iterdir()] == ["dataset"]


def riding(twin, **ride):
    sensor = {"name": "roof", "model": "VLP-16", "forward_m": 0.5, "left_m": 0.1}
    spec = {"sensors": [{**sensor, "above_roof_m": 0.4}], "ride": ride, "frame": "level"}
    return place_rig(RigSpec.model_validate(spec), twin.mesh)


def test_a_rig_that_rides_tells_where_it_was(twin, motion, tmp_path):
    out = tmp_path / "dataset"
    record(twin, motion, riding(twin, track=4), out, workers=1, seed=5, start_s=0.3, stop_s=0.8)
    manifest = json.loads((out / "dataset.json").read_text())
    assert manifest["dataset_SE3_site"] is None
    assert manifest["rig"]["carrier"] == 4
    sweeps = pq.read_table(out / "sweeps.parquet").to_pylist()
    for frame, row in zip(manifest["frames"], sweeps, strict=True):
        # The car drives east at 10 m/s from x = -8 on, along y = 8.
        x = -8 + 10 * frame["time_s"] + 0.5
        assert [row["true_x"], row["true_y"]] == pytest.approx([x, 8.1])
        assert row["reported_x"] == pytest.approx(row["true_x"])
        to_dataset = np.array(frame["dataset_SE3_site"])
        assert to_dataset @ [x, 8.1, row["true_z"], 1] == pytest.approx([0, 0, 0, 1], abs=1e-9)
        points = np.load(out / f"points/{frame['name']}.npy")
        assert np.median(points[points[:, 2] < -1, 2]) == pytest.approx(-row["true_z"], abs=0.05)


def test_a_rig_on_an_actor_that_leaves_says_when_it_is_there(twin, motion, tmp_path):
    with pytest.raises(InputError, match=r"car 4.* from 0.2 to 1.1 s") as caught:
        record(twin, motion, riding(twin, track=4), tmp_path / "out/dataset", rig_file="rig.yaml")
    assert caught.value.file == "rig.yaml"
    assert list(tmp_path.iterdir()) == []


def test_a_rig_on_nobody(twin, motion, tmp_path):
    with pytest.raises(InputError, match="track 77"):
        record(twin, motion, riding(twin, track=77), tmp_path / "dataset")
    with pytest.raises(InputError, match="bus"):
        record(twin, motion, riding(twin, **{"class": "bus"}), tmp_path / "dataset")
