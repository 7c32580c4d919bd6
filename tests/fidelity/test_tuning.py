"""Tuning against frames whose truth is known: recorded, stripped of labels, begun wrongly."""

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import yaml

from urbantwin.artefact import sha256_of, write_json
from urbantwin.cli import main
from urbantwin.dataset import record
from urbantwin.errors import InputError
from urbantwin.fidelity.tuning import Tuning, split_in_time, tune
from urbantwin.fidelity.tuning.actor_terms import ActorTerms, Clusters, actor_changes, actor_knobs
from urbantwin.fidelity.tuning.group_fit import NOT_DETERMINED
from urbantwin.fidelity.tuning.knobs import starts
from urbantwin.fidelity.tuning.loss import SECTORS
from urbantwin.fidelity.tuning.study import Journal, search
from urbantwin.geometry import LabelledMesh
from urbantwin.lidar import place_rig
from urbantwin.site import load_rig_spec, load_traffic_changes
from urbantwin.taxonomy import material_id, semantic_id
from urbantwin.traffic import Motion
from urbantwin.traffic.motion import ACTOR_SCHEMA
from urbantwin.traffic.resize import resized
from urbantwin.traffic.signals import SIGNAL_SCHEMA
from urbantwin.twin import load_twin

from ..whole_page import whole_page

FRAMES = 10
TRUE = {
    "rate_hz": 10.0,
    "frame": "sensor",
    "reflectivity": {"asphalt": 0.7},
    "sensors": [
        {
            "name": "pole",
            "model": "VLP-16",
            "columns": 900,
            "east_m": 1.0,
            "north_m": -2.0,
            "up_m": 5.0,
            "yaw_deg": 30.0,
            "pitch_deg": 6.0,
            "roll_deg": -1.0,
            "calibration": {"range_noise": 1.8, "light": 0.8, "missing": 0.04},
        }
    ],
}
MOVED = {"east_m": 0.5, "north_m": -0.4, "up_m": 0.2, "yaw_deg": 2.0, "pitch_deg": -1.0}
POLE = "sensors.pole.calibration."


def box(middle, size, material):
    x, y, z = np.array([-1, 1]) / 2 * np.array(size)[:, None] + np.array(middle)[:, None]
    corners = np.array([[a, b, c] for a in x for b in y for c in z])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [part for a, b, c, d in sides for part in ((a, b, c), (a, c, d))]
    return LabelledMesh.build(corners, faces, semantic_id("building"), material_id(material))


def road(reach=90.0):
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * reach
    faces = [[0, 1, 2], [0, 2, 3]]
    return LabelledMesh.build(corners, faces, semantic_id("road"), material_id("asphalt"))


def twin_of(mesh, folder):
    folder.mkdir(parents=True)
    mesh.save(folder / "scene.npz")
    region = [[-60, -60], [60, -60], [60, 60], [-60, 60]]
    manifest = {
        "kind": "twin",
        "version": "test",
        "name": "test",
        "driving_side": "right",
        "notes": {},
        "anchor": {"latitude": 60.17, "longitude": 24.94},
        "region_m": region,
        "inputs": [],
        "files": {"scene.npz": sha256_of(folder / "scene.npz")},
    }
    write_json(folder / "twin.json", manifest)
    return load_twin(folder)


def motion_of(twin, rows=()):
    manifest = {"seed": 7, "steps": FRAMES, "step_s": 0.1, "twin_sha256": twin.sha256}
    filled = [
        {f.name: row.get(f.name, "" if pa.types.is_string(f.type) else 0) for f in ACTOR_SCHEMA}
        for row in rows
    ]
    table = pa.Table.from_pylist(filled, schema=ACTOR_SCHEMA)
    return Motion(manifest, table, SIGNAL_SCHEMA.empty_table())


def written(path, document):
    path.write_text(yaml.safe_dump(document))
    return path


def wrong(document, **changed):
    """The rig as somebody believed it to be."""
    found = json.loads(json.dumps(document))
    found.pop("reflectivity", None)
    sensor = found["sensors"][0]
    sensor.pop("calibration", None)
    for name, step in changed.items():
        sensor[name] += step
    return found


def on(twin, file):
    return place_rig(load_rig_spec(file, twin.frame), twin.mesh, file=file)


def unlabelled(twin, rig_file, target, seed=3):
    """Frames as a sensor writes them: a folder of x, y, z, intensity, and nothing else."""
    dataset = target.with_name(f"{target.name}_dataset")
    record(twin, motion_of(twin), on(twin, rig_file), dataset, workers=1, seed=seed)
    target.mkdir()
    for file in sorted((dataset / "points").iterdir()):
        shutil.copy(file, target / file.name)
    return target


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A street of a twin, a rig there, and what it really sees."""
    folder = tmp_path_factory.mktemp("tuning")
    houses = [((-18, 14, 5), (14, 9, 14)), ((9, 19, 4), (17, 8, 12)), ((21, -15, 6), (11, 13, 16))]
    houses += [((-14, -19, 3), (19, 7, 10)), ((33, 9, 4), (6, 12, 12)), ((-33, -2, 4), (5, 9, 9))]
    paints = ("concrete", "plaster")
    parts = [box(*one, paints[number % 2]) for number, one in enumerate(houses)]
    twin = twin_of(LabelledMesh.concatenate([road(), *parts]), folder / "twin")
    true = written(folder / "true.yaml", TRUE)
    begun = written(folder / "wrong.yaml", wrong(TRUE, **MOVED))
    return twin, begun, unlabelled(twin, true, folder / "real")


class Opened:
    """Which files are opened, and when the fit appears."""

    def __init__(self):
        self.events, self.on = [], False
        sys.addaudithook(self.hook)

    def hook(self, event, arguments):
        if self.on and event in ("open", "os.rename"):
            self.events.append((event, str(arguments[0]), str(arguments[1])))


@pytest.fixture(scope="module")
def fitted(place, tmp_path_factory):
    """The fit of everything, and the files that were opened meanwhile."""
    twin, begun, real = place
    out = tmp_path_factory.mktemp("fit") / "tuned"
    opened = Opened()
    opened.on = True
    found = tune(real, twin, on(twin, begun), begun, out, tuning=Tuning(trials=140))
    opened.on = False
    return found, out, opened.events


@pytest.mark.thorough
def test_a_known_truth_is_recovered(place, fitted):
    found, out, _ = fitted
    rig = yaml.safe_load((out / "rig.yaml").read_text())
    sensor, truth = rig["sensors"][0], TRUE["sensors"][0]
    for name in ("east_m", "north_m", "up_m"):
        assert sensor[name] == pytest.approx(truth[name], abs=0.03)
    for name in ("yaw_deg", "pitch_deg", "roll_deg"):
        assert sensor[name] == pytest.approx(truth[name], abs=0.15)
    unit = sensor["calibration"]
    assert unit["range_offset_m"] == pytest.approx(0.0, abs=0.03)
    assert unit["range_noise"] == pytest.approx(1.8, rel=0.1)
    assert unit["missing"] == pytest.approx(0.04, abs=0.01)
    bright = rig["reflectivity"]
    assert bright["asphalt"] / bright["concrete"] == pytest.approx(0.7, rel=0.08)
    assert unit["intensity"] == pytest.approx(1.0, rel=0.1)
    assert unit["light"] * bright["asphalt"] == pytest.approx(0.8 * 0.7, rel=0.15)
    assert on(place[0], out / "rig.yaml").sensors[0].calibration.missing == unit["missing"]
    assert {one["verdict"] for one in found["held_out"]["groups"].values()} == {"better"}


def test_the_report_shows_before_and_after_on_frames_held_out(fitted):
    found, out, _ = fitted
    measures = found["held_out"]["measures"]
    for name in ("hausdorff_p95_m", "js_mean", "chamfer_m"):
        assert measures[name]["tuned"] < 0.8 * measures[name]["start"]
        assert measures[name]["real"] is not None
    page = whole_page((out / "report.html").read_text())
    assert "move.east_m" in page.cells
    assert any(tag == "img" for tag, _ in page.tags)


def test_no_held_out_frame_is_opened_before_the_fit_is_written(place, fitted):
    found, _, events = fitted
    first, last = found["split"]["held_out"]
    names = sorted(file.name for file in place[2].iterdir())
    held = {str(place[2] / name) for name in names[first : last + 1]}
    assert held
    there = next(
        k
        for k, one in enumerate(events)
        if one[0] == "os.rename" and Path(one[2]).name == "tuning.json"
    )
    looked = [k for k, one in enumerate(events) if one[0] == "open" and one[1] in held]
    assert looked
    assert min(looked) > there


QUICK = Tuning(fit=("dropout", "noise"), trials=12, report=False)


def quick(place, real, out, tuning=QUICK, progress=None):
    twin, _, _ = place
    rig = written(out.with_suffix(".yaml"), wrong(TRUE))
    tune(real, twin, on(twin, rig), rig, out, tuning=tuning, progress=progress)
    return [(out / name).read_bytes() for name in ("rig.yaml", "tuning.json")]


def test_held_out_frames_workers_and_interruptions_change_nothing(place, tmp_path, monkeypatch):
    real = place[2]
    expected = quick(place, real, tmp_path / "plain")

    spoilt = tmp_path / "spoilt" / "real"
    shutil.copytree(real, spoilt)
    split = split_in_time(FRAMES)
    files = sorted(spoilt.iterdir())
    for number in (*split.gap, *split.held_out):
        files[number].write_bytes(b"no cloud at all")
    workers = replace(QUICK, workers=3)
    assert quick(place, spoilt, tmp_path / "spoilt" / "tuned", workers) == expected
    judged = json.loads((tmp_path / "spoilt" / "tuned" / "held_out.json").read_text())
    assert f"{split.held_out[0]:06}.npy" in " ".join(judged["problems"])

    stopped = tmp_path / "stopped" / "tuned"
    stopped.parent.mkdir()

    def stop(share, doing):
        if doing.startswith("noise"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        quick(place, real, stopped, progress=stop)
    assert not stopped.exists()
    recalled = []
    recall = Journal.recall

    def counted(self, *asked):
        found = recall(self, *asked)
        recalled.append(found is not None)
        return found

    monkeypatch.setattr(Journal, "recall", counted)
    assert quick(place, real, stopped) == expected
    assert sum(recalled) >= QUICK.trials
    assert not list(stopped.parent.glob(".*journal"))


def test_it_is_said_when_frames_held_out_are_worse_than_before(place, tmp_path):
    """The last frames are of a sensor that was exchanged: what was fitted is wrong for it."""
    twin, _, real = place
    mixed = tmp_path / "real"
    shutil.copytree(real, mixed)
    new = unlabelled(twin, written(tmp_path / "new.yaml", wrong(TRUE)), tmp_path / "new")
    for number in split_in_time(FRAMES).held_out:
        name = f"{number:06d}.npy"
        shutil.copy(new / name, mixed / name)
    quick(place, mixed, tmp_path / "tuned", replace(QUICK, fit=("noise",)))
    judged = json.loads((tmp_path / "tuned" / "held_out.json").read_text())
    assert judged["groups"]["noise"]["verdict"] == "worse"
    assert judged["warnings"] == ["noise: worse than before on frames held out"]


@pytest.mark.thorough
def test_what_the_data_cannot_tell_is_kept(tmp_path):
    """A bare plane looks alike from everywhere, and levelled points tell the tilt by rings."""
    twin = twin_of(road(), tmp_path / "twin")
    level = {**TRUE, "frame": "level"}
    real = unlabelled(twin, written(tmp_path / "true.yaml", level), tmp_path / "real")
    shift = {"east_m": 0.4, "up_m": 0.3, "pitch_deg": 1.3, "roll_deg": -0.6}
    rig = written(tmp_path / "wrong.yaml", wrong(level, **shift))
    found = tune(
        real,
        twin,
        on(twin, rig),
        rig,
        tmp_path / "out",
        tuning=replace(QUICK, fit=("pose",), trials=70),
    )
    knobs = found["knobs"]
    for name in ("move.east_m", "move.north_m", "move.yaw_deg"):
        assert knobs[name]["state"] == NOT_DETERMINED
        assert knobs[name]["value"] == 0.0
    assert knobs["move.up_m"]["value"] == pytest.approx(-0.3, abs=0.03)
    assert knobs["move.pitch_deg"]["value"] == pytest.approx(-1.3, abs=0.03)
    assert knobs["move.roll_deg"]["value"] == pytest.approx(0.6, abs=0.03)


def clusters(count, size, seed, frames=64):
    generator = np.random.default_rng(seed)
    found = np.tile(size, (count, 1)) * generator.lognormal(0, 0.08, (count, 3))
    time = np.arange(count) * SECTORS // count
    return Clusters(found, time, found[:, 0] > 2.2, frames)


def joined(a, b):
    parts = [
        np.concatenate(x) for x in ((a.size, b.size), (a.time, b.time), (a.vehicle, b.vehicle))
    ]
    return Clusters(*parts, a.frames)


def test_density_and_size_of_actors_are_found(tmp_path):
    cars, people = np.array([4.4, 1.8, 1.5]), np.array([0.6, 0.4, 1.72])
    twin = joined(clusters(400, cars, 1), clusters(300, people, 2))
    real = joined(clusters(600, cars * [1.1, 0.95, 1.05], 3), clusters(210, people, 4))
    terms = ActorTerms(real, twin)
    knobs = actor_knobs(terms)
    with Journal(tmp_path / "journal", "one") as journal:
        values, _ = search(
            "a", knobs, terms, fixed={}, begin=starts(knobs), trials=300, seed=0, journal=journal
        )
    expected = {"density.vehicles": 1.5, "density.small": 0.7, "size.car.length": 1.1}
    expected |= {"size.car.width": 0.95, "size.car.height": 1.05, "size.pedestrian.height": 1.0}
    assert set(values) == set(expected)
    for name, value in expected.items():
        assert values[name] == pytest.approx(value, rel=0.02)

    file = tmp_path / "traffic.yaml"
    file.write_text(yaml.safe_dump(actor_changes(values, {"car": 1000.0, "pedestrian": 100.0})))
    changes = load_traffic_changes(file)
    assert changes["per_hour"]["car"] == pytest.approx(1500, rel=0.02)
    assert changes["size"]["car"]["length"] == values["size.car.length"].__round__(5)


def test_resized_actors_have_the_bounds_that_they_say(place):
    row = {"track": 4, "class": "car", "asset": "car-sedan", "length": 4.0, "width": 2.0}
    row["height"] = 1.5
    motion = motion_of(
        place[0], [row, row | {"track": 5, "class": "pedestrian", "asset": "pedestrian-man"}]
    )
    after = resized(motion, {"car": {"length": 1.1, "height": 0.9}})
    car, person = after.actors.to_pylist()
    span = np.ptp(after.mesh(car["asset"], 0).vertices, axis=0)
    np.testing.assert_allclose(span, [car["length"], car["width"], car["height"]], rtol=1e-6)
    before = motion.actors.to_pylist()[0]
    assert car["height"] == pytest.approx(0.9 * before["height"], abs=0.005)
    assert person["asset"] == "pedestrian-man"
    assert after.mesh("pedestrian-man", 0) is motion.mesh("pedestrian-man", 0)
    assert after.actors["length"].to_pylist() == pytest.approx([4.4, 4.0])


def test_parts_follow_each_other_with_a_gap_and_the_last_is_held_out():
    split = split_in_time(100)
    assert split.held_out == tuple(range(70, 100))
    assert split.gap == tuple(range(65, 70))
    assert (*split.training, *split.validation) == tuple(range(65))
    for count in range(2, 40):
        split = split_in_time(count)
        parts = (*split.training, *split.validation, *split.gap, *split.held_out)
        assert parts == tuple(range(count))
        assert split.training
        assert split.held_out


@pytest.mark.parametrize("share", [0.0, 1.0, float("nan")])
def test_a_share_that_leaves_nothing_is_refused(share):
    with pytest.raises(InputError, match="share held out"):
        split_in_time(10, share)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--fit", "pose,colour"], "'colour' cannot be fitted"),
        (["--held-out", "1.5"], "share held out is 1.5"),
        (["--layout", "kitti"], "is not laid out as KITTI"),
        ([], "holds 1 frame"),
    ],
)
def test_bad_input_is_one_line(place, tmp_path, capfd, options, said):
    twin, rig, real = place
    one = tmp_path / "one"
    one.mkdir()
    shutil.copy(real / "000000.npy", one)
    asked = ["rig", "tune", one, twin.folder, "--rig", rig, "-o", tmp_path / "out", *options]
    assert main([str(word) for word in asked]) == 2
    errors = capfd.readouterr().err.strip().splitlines()
    assert len(errors) == 1
    assert said in errors[0]
    assert not (tmp_path / "out").exists()


def test_the_command_prints_what_it_found(place, tmp_path, capfd):
    twin, rig, real = place
    asked = ["rig", "tune", real, twin.folder, "--rig", rig, "-o", tmp_path / "out", "--json"]
    asked += ["--fit", "pose", "--trials", "30", "--no-report"]
    assert main([str(word) for word in asked]) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["frames"]["held_out"] == [7, 9]
    assert "move.up_m" in found["knobs"]
    assert set(found["held_out"]) == {"pose"}
    assert load_rig_spec(tmp_path / "out" / "rig.yaml", twin.frame).frame == "sensor"
