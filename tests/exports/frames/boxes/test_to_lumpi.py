"""Datasets as LUMPI: read as its SDK reads it, and by our reader.

The SDK is not on PyPI. It reads with pandas and plyfile; what is done here is what its
``LumpiParser`` does (objects/LumpiParser.py): ``read_csv`` whose last column is dropped, the index
of a pose ``floor(time * 10)``, clouds in the order of their names.
"""

import json
import math
import shutil

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from urbantwin.errors import InputError
from urbantwin.exports.frames import DATASET_FORMATS, export_dataset
from urbantwin.fidelity.readers import open_recording
from urbantwin.taxonomy import classes_in

CLASSES = ("person", "car", "bicycle", "motorcycle", "bus", "truck", "unknown")


def exported(dataset, tmp_path):
    said = []
    out, _ = export_dataset(dataset, "lumpi", tmp_path / "out", tell=said.append)
    return out, said


def poses_of(measurement):
    """What ``read_track`` makes of labels: by index, then object."""
    table = pd.read_csv(measurement / "Label.csv")
    data = pd.DataFrame(table[list(table)[:-1]]).to_numpy().astype(np.float64)
    found = {}
    for row in data:
        found.setdefault(int(np.floor(row[0] * 10)), {})[int(row[1])] = row
    return found


def clouds_of(measurement):
    return sorted((measurement / "lidar").glob("*.ply"))


def looks_the_same(cloud, site, sessions):
    """Azimuth and distance are those from the sensor's own place."""
    for number, one in sessions.items():
        here = cloud["id"] == number
        back = np.linalg.inv(np.array(one["extrinsic"]))
        seen = site[here] @ back[:3, :3].T + back[:3, 3]
        far = cloud["distance"][here]
        np.testing.assert_allclose(far, np.linalg.norm(seen, axis=1), atol=1e-4)
        turn = np.radians(cloud["azimuth"][here])
        flat = np.hypot(seen[:, 0], seen[:, 1])
        np.testing.assert_allclose(flat * np.cos(turn), seen[:, 0], atol=1e-3)
        np.testing.assert_allclose(flat * np.sin(turn), seen[:, 1], atol=1e-3)


def is_the_same_box(pose, row, frame, at):
    place = frame.in_site(np.array([[row["x"], row["y"], row["z"]]]))[0]
    np.testing.assert_allclose(pose[9:12], place, atol=1e-9)
    sizes = [row[name] for name in ("length", "width", "height")]
    np.testing.assert_allclose(pose[12:15], sizes, atol=1e-12)
    ahead = frame.site_rotations()[at].apply([1.0, 0, 0])
    assert math.cos(pose[15] - math.atan2(ahead[1], ahead[0])) == pytest.approx(1)
    assert (pose[6], pose[8]) == (4, row["num_points"])
    # The rectangle from above: its corner is at the top left, the box in its middle.
    assert pose[2] + pose[4] / 2 == pytest.approx(place[0])
    assert pose[3] - pose[5] / 2 == pytest.approx(place[1])
    corners = Rotation.from_euler("z", pose[15]).apply(
        [[a * sizes[0] / 2, b * sizes[1] / 2, 0] for a in (1, -1) for b in (1, -1)]
    )
    assert 2 * corners[:, 0].max() == pytest.approx(pose[4])
    assert 2 * corners[:, 1].max() == pytest.approx(pose[5])


def test_its_sdk_reads_points_and_poses(any_dataset, held, parts, judge, tmp_path):
    out, _ = exported(any_dataset, tmp_path)
    named = {file: tmp_path / f"{k}.npz" for k, file in enumerate(out.rglob("*.ply"))}
    assert judge("plyfile_says", job=[list(map(str, pair)) for pair in named.items()])
    theirs = classes_in("lumpi")
    meta = json.loads((out / "meta.json").read_text())["session"]
    manifest = json.loads((any_dataset / "dataset.json").read_text())
    frames = iter(held(any_dataset))
    of_part = {name: part for part, names in parts(any_dataset).items() for name in names}
    count = 0
    for k, measurement in enumerate(sorted(out.glob("Measurement*"))):
        poses = poses_of(measurement)
        sessions = {int(n): one for n, one in meta.items() if one["experimentId"] == k}
        assert {one["type"] for one in sessions.values()} == {"lidar"}
        for index, file in enumerate(clouds_of(measurement)):
            frame = next(frames)
            count += 1
            (start_s,) = {one["start_s"] for one in sessions.values()}
            assert start_s + index / 10 == pytest.approx(frame.time_s)
            assert {one["part"] for one in sessions.values()} == {of_part.get(frame.name) or ""}
            cloud = dict(np.load(named[file]))
            site = frame.in_site(frame.points)
            np.testing.assert_allclose(
                np.column_stack([cloud[axis] for axis in "xyz"]), site, atol=2e-5
            )
            np.testing.assert_allclose(cloud["intensity"] / 255, frame.intensity, atol=1e-7)
            np.testing.assert_array_equal(cloud["ray"], frame.rays["ring"])
            time = frame.time_s - start_s + frame.rays["time"]
            np.testing.assert_allclose(cloud["time"] * 1e-6, time, atol=1e-6)
            sensor = np.searchsorted(sorted(sessions), cloud["id"])
            np.testing.assert_array_equal(sensor, frame.rays["sensor"])
            assert set(cloud["id"].tolist()) <= set(sessions)
            if manifest["rig"]["ride"] is None:
                looks_the_same(cloud, site, sessions)
            rows = {row["track"]: row for row in frame.boxes}
            found = poses.get(index, {})
            assert set(found) == set(rows)
            for at, (track, row) in enumerate(rows.items()):
                is_the_same_box(found[track], row, frame, at)
                assert CLASSES[int(found[track][7])] == theirs[row["class"]]
    assert count == len(held(any_dataset))
    assert next(frames, None) is None


def test_our_reader_has_it_back(any_dataset, held, tmp_path):
    out, _ = exported(any_dataset, tmp_path)
    theirs = classes_in("lumpi")
    frames = iter(held(any_dataset))
    for measurement in sorted(out.glob("Measurement*")):
        recording = open_recording(measurement)
        assert recording.layout == "lumpi"
        for index in range(len(recording.names)):
            read, frame = recording.read(index), next(frames)
            np.testing.assert_allclose(read.points, frame.in_site(frame.points), atol=2e-5)
            np.testing.assert_array_equal(read.ring, frame.rays["ring"])
            np.testing.assert_array_equal(read.sensor, frame.rays["sensor"])
            time = frame.rays["time"].astype(float)
            np.testing.assert_allclose(read.time_s, time - time.min(), atol=2e-6)
            assert read.boxes.track.tolist() == [row["track"] for row in frame.boxes]
            assert read.boxes.source_names == tuple(theirs[row["class"]] for row in frame.boxes)
            if frame.boxes:
                points = [row["num_points"] for row in frame.boxes]
                assert read.boxes.num_points.tolist() == points
            for name in ("column", "semantic", "instance"):
                assert getattr(read, name) is None
            assert read.boxes.velocity is None
            assert read.boxes.occlusion is None


def test_ten_frames_a_second_or_none(dataset, tmp_path):
    for rate in (5.0, 20.0):
        other = tmp_path / f"at-{rate:g}"
        shutil.copytree(dataset, other)
        manifest = json.loads((other / "dataset.json").read_text())
        manifest["rig"]["rate_hz"] = rate
        for number, one in enumerate(manifest["frames"]):
            one["time_s"] = number / rate
        (other / "dataset.json").write_text(json.dumps(manifest))
        with pytest.raises(InputError, match=f"has {rate:g} frames a second") as raised:
            export_dataset(other, "lumpi", tmp_path / "out")
        assert "\n" not in str(raised.value)
        assert not (tmp_path / "out").exists()
        for to in ("nuscenes", "openlabel", "opv2v"):  # the others take any rate
            export_dataset(other, to, tmp_path / f"{to}-{rate:g}")


def test_a_gap_begins_a_new_measurement(dataset, tmp_path):
    """The SDK goes by the order of the clouds: a frame that is missing would shift the labels."""
    thin = tmp_path / "thin"
    shutil.copytree(dataset, thin)
    manifest = json.loads((thin / "dataset.json").read_text())
    dropped = {manifest["frames"][n]["name"] for n in (4, 5, 9)}
    manifest["frames"] = [one for one in manifest["frames"] if one["name"] not in dropped]
    (thin / "dataset.json").write_text(json.dumps(manifest))
    for file in (thin / "ImageSets").glob("*.txt"):
        kept = [name for name in file.read_text().split() if name not in dropped]
        file.write_text("\n".join(kept) + "\n")
    out, _ = exported(thin, tmp_path)
    sizes = [len(clouds_of(one)) for one in sorted(out.glob("Measurement*"))]
    # 0 to 3, 6 and 7; of the validation 8, of the test 10 and 11.
    assert sizes == [4, 2, 1, 2]
    for one in out.glob("Measurement*"):
        assert set(poses_of(one)) <= set(range(len(clouds_of(one))))


def test_it_says_before_what_is_lost(motley, two_sensors, tmp_path):
    _, said = exported(motley, tmp_path)
    text = "\n".join(said)
    assert "car and van are merged: boxes are car in lumpi" in text
    assert "tram and animal and obstacle are merged: boxes are unknown" in text
    assert "time in whole microseconds" in text
    assert not DATASET_FORMATS["lumpi"].holds & {"column", "echo", "velocity", "occlusion"}
    said = []
    export_dataset(two_sensors, "lumpi", tmp_path / "two", tell=said.append)
    assert "of boxes: only the heading, where the frame of the points is tilted" in said
