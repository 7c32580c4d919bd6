"""Datasets to export: one sensor, all classes, two tilted sensors of which one drops out, a ride.

What they hold is read here by numpy, pyarrow and json alone: nothing of the exporters is used.
"""

import json
import shutil
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.spatial.transform import Rotation

from urbantwin.dataset import record
from urbantwin.lidar import place_rig
from urbantwin.site.rig import RigSpec
from urbantwin.taxonomy import BOX_SEMANTICS

from ....dataset.conftest import dataset, digests, rig
from ....thorough import further

__all__ = ["dataset", "digests", "rig"]


def two_sensors_spec(**more):
    """A tilted sensor, and a swift one that loses turns; points in the frame of the first."""
    first = {"name": "first", "model": "VLP-16", "columns": 900, "east_m": 0.0, "north_m": 0.0}
    first |= {"height_m": 3.0, "pitch_deg": 9.0, "roll_deg": 4.0, "yaw_deg": -50.0}
    swift = {"name": "swift", "model": "OS1-32", "columns": 512, "height_m": 4.0}
    swift |= {"east_m": 20.0, "north_m": -10.0, "yaw_deg": 90.0, "dropped_frames": 0.5}
    return RigSpec.model_validate({"sensors": [first, swift], "frame": "sensor", **more})


@pytest.fixture(scope="session")
def two_sensors(twin, motion, tmp_path_factory):
    out = tmp_path_factory.mktemp("two") / "dataset"
    record(
        twin, motion, place_rig(two_sensors_spec(), twin.mesh), out, workers=1, seed=5, stop_s=0.7
    )
    return out


@pytest.fixture(scope="session")
def riding(twin, motion, tmp_path_factory):
    sensor = {"name": "roof", "model": "VLP-16", "columns": 900, "forward_m": 0.5, "left_m": 0.0}
    spec = {"sensors": [{**sensor, "above_roof_m": 0.4}], "ride": {"track": 4}, "frame": "level"}
    placed = place_rig(RigSpec.model_validate(spec), twin.mesh)
    out = tmp_path_factory.mktemp("riding") / "dataset"
    record(twin, motion, placed, out, workers=1, seed=5, start_s=0.2, stop_s=0.7)
    return out


@pytest.fixture(scope="session")
def riding_in_the_site(twin, motion, tmp_path_factory):
    """The frame of the points stays where it is, and the sensor leaves it."""
    sensor = {"name": "roof", "model": "VLP-16", "columns": 900, "forward_m": 0.5, "left_m": 0.0}
    sensor |= {"above_roof_m": 0.4, "pitch_deg": 8.0}
    spec = {"sensors": [sensor], "ride": {"track": 4}, "frame": "site"}
    placed = place_rig(RigSpec.model_validate(spec), twin.mesh)
    out = tmp_path_factory.mktemp("in-site") / "dataset"
    record(twin, motion, placed, out, workers=1, seed=5, start_s=0.2, stop_s=0.5)
    return out


@pytest.fixture(scope="session")
def motley(dataset, tmp_path_factory):
    """The small dataset with an actor of every class beside its own, and a gap in its split."""
    out = tmp_path_factory.mktemp("motley") / "dataset"
    shutil.copytree(dataset, out)
    table = pq.read_table(out / "boxes.parquet")
    rows = table.to_pylist()
    for row in [row for row in rows if row["track"] == 9]:
        for number, kind in enumerate(BOX_SEMANTICS):
            more = {"track": 40000 + number, "class": kind, "x": row["x"] + 6.5 * number}
            more |= {"parked": number % 3 == 0, "num_points": number, "num_points_alone": 20}
            more |= {"occlusion": None if number == 4 else number / 10, "vy": -0.3 * number}
            more |= {"towed_by": 9 if kind == "trailer" else None, "yaw": row["yaw"] + number}
            rows.append({**row, **more, "ignored": "far" if number == 2 else None})
    rows.sort(key=lambda row: (row["frame"], row["track"]))
    pq.write_table(pa.Table.from_pylist(rows, table.schema), out / "boxes.parquet")
    manifest = json.loads((out / "dataset.json").read_text())
    manifest["counts"]["boxes"] = {
        kind: sum(row["class"] == kind for row in rows) for kind in BOX_SEMANTICS
    }
    (out / "dataset.json").write_text(json.dumps(manifest))
    names = [one["name"] for one in manifest["frames"]]
    for part, chosen in (("train", names[:5]), ("val", names[7:10]), ("test", names[10:])):
        (out / "ImageSets" / f"{part}.txt").write_text("\n".join(chosen) + "\n")
    return out


@pytest.fixture(
    params=["dataset", "motley", "two_sensors", "riding", *further("riding_in_the_site")]
)
def any_dataset(request):
    """Each of the datasets."""
    return request.getfixturevalue(request.param)


@dataclass
class Held:
    """What a frame of a dataset holds, read without the exporters."""

    name: str
    time_s: float
    points: np.ndarray
    intensity: np.ndarray
    semantic: np.ndarray
    instance: np.ndarray
    rays: np.ndarray
    boxes: list
    frame_SE3_site: np.ndarray  # noqa: N815

    def in_site(self, points):
        matrix = np.linalg.inv(self.frame_SE3_site)
        return points @ matrix[:3, :3].T + matrix[:3, 3]

    def site_rotations(self):
        """Return how boxes are turned in the site, as scipy has it."""
        turn = Rotation.from_matrix(np.linalg.inv(self.frame_SE3_site)[:3, :3])
        return turn * Rotation.from_euler("z", [[row["yaw"]] for row in self.boxes])

    def column(self, *names):
        """Return columns of the boxes, (B, len(names)); None is NaN."""
        found = [[row[name] for name in names] for row in self.boxes]
        return np.array(found, float).reshape(-1, len(names))


def _held(folder):
    manifest = json.loads((folder / "dataset.json").read_text())
    rows = pq.read_table(folder / "boxes.parquet").to_pylist()
    frames = []
    for one in manifest["frames"]:
        name = one["name"]
        values = np.load(folder / "points" / f"{name}.npy")
        labels = np.fromfile(folder / "semantic" / f"{name}.label", "<u4")
        pose = one.get("dataset_SE3_site") or manifest["dataset_SE3_site"]
        frames.append(
            Held(
                name, one["time_s"], values[:, :3].astype(float), values[:, 3],
                labels & 0xFFFF, labels >> 16, np.load(folder / "rays" / f"{name}.npy"),
                [row for row in rows if row["frame"] == name], np.array(pose),
            )
        )  # fmt: skip
    return frames


@pytest.fixture(scope="session")
def held():
    """What reads a dataset without the exporters."""
    return _held


@pytest.fixture(scope="session")
def parts():
    """What gives the names of the frames of each part of the split."""

    def read(folder):
        files = sorted((folder / "ImageSets").glob("*.txt"))
        return {file.stem: file.read_text().split() for file in files}

    return read
