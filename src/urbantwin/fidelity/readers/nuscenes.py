"""nuScenes: its tables, key frames and sweeps of one LiDAR.

Source: Caesar et al. 2020, and the schema of the nuscenes-devkit. Points are in the sensor's frame,
with x to the right and y forward; boxes are given in the world and transformed. Only key frames
(two per second) are labelled, and their points if there is ``lidarseg`` or ``panoptic``.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.arrays import ArrayOf, read_arrays
from urbantwin.artefact.document import read_bytes
from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Boxes, Frame
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.labels import LabelledBox, actor_class, boxes_of, track_of
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.geometry import Pose
from urbantwin.io.points import read_fields
from urbantwin.io.poses import heading, pose_of_quaternion
from urbantwin.io.trust import laid_out, read_json_document
from urbantwin.taxonomy import ACTOR_SEMANTICS, classes_in, semantic_id

__all__ = ["box_of_row", "is_nuscenes", "names_of_samples", "open_nuscenes"]

_EXPECTED = "a table of nuScenes"
_OF_POINTS = "labels of points of nuScenes"
_CHANNEL = "/LIDAR_TOP/"
_NOTE = "The sensor's frame has x to the right and y forward."

Row = dict[str, Any]


def _version(path: Path) -> Path | None:
    """Return the folder of tables: ``v1.0-mini`` first, then in the order of names."""
    found = sorted(p.parent for p in path.glob("v*/sample_data.json"))
    return found[0] if found else None


def is_nuscenes(path: Path) -> bool:
    """Return whether a folder has tables of nuScenes."""
    return _version(path) is not None


def open_nuscenes(path: Path) -> Recording:
    """Open the available key frames and sweeps of ``LIDAR_TOP`` in order of time.

    Raises:
        InputError: a table is missing or invalid, or no sweep is available.
    """
    version = _version(path)
    if version is None:
        raise InputError("holds no tables", file=path, expected="v1.0-mini or the like")
    with laid_out(version / "sample_data.json", _EXPECTED):
        listed = _of_lidar(version)
        listed.sort(key=lambda row: int(row["timestamp"]))
        if any("\0" in row["filename"] for row in listed):
            raise ValueError("a name of a file with a NUL")
        sweeps = [row for row in listed if (path / row["filename"]).is_file()]
        names = tuple(map(_name, sweeps))
    if not sweeps:
        raise InputError(f"none of its {len(listed)} sweeps is there", file=path)
    sensors = _by_token(version, "calibrated_sensor")
    vehicles = _by_token(version, "ego_pose")
    labels = _Labels(version)
    of_points = _PointLabels(path, version)

    def read(index: int) -> Frame:
        row = sweeps[index]
        file = path / row["filename"]
        with laid_out(version, _EXPECTED):
            world = _pose(vehicles[row["ego_pose_token"]])
            world = world @ _pose(sensors[row["calibrated_sensor_token"]])
            boxes = labels.of(row["sample_token"], world) if row["is_key_frame"] else None
            token = row["token"]
            if not isinstance(token, str):
                raise TypeError(f"a token is {token!r:.40}")
        return frame_of(
            file,
            read_fields(file),
            name=names[index],
            given=of_points.of(token),
            boxes=boxes,
            world_SE3_frame=world,
            notes=(_NOTE,),
        )

    notes = [_NOTE]
    if len(sweeps) < len(listed):
        notes.append(f"{len(listed) - len(sweeps)} of {len(listed)} sweeps are not there.")
    return Recording(path, "nuscenes", names, read, tuple(notes))


def names_of_samples(path: Path) -> dict[str, str]:
    """Return the name of the key frame of each sample.

    Raises:
        InputError: a table is missing or invalid.
    """
    version = _version(path)
    if version is None:
        raise InputError("holds no tables", file=path, expected="v1.0-mini or the like")
    with laid_out(version / "sample_data.json", _EXPECTED):
        return {
            row["sample_token"]: _name(row) for row in _of_lidar(version) if row["is_key_frame"]
        }


class _Labels:
    """Annotations by sample, with the classes of their objects."""

    def __init__(self, version: Path) -> None:
        with laid_out(version / "sample_annotation.json", _EXPECTED):
            self._annotations: dict[str, list[Row]] = defaultdict(list)
            for row in _rows(version, "sample_annotation"):
                self._annotations[row["sample_token"]].append(row)
        with laid_out(version / "instance.json", _EXPECTED):
            categories = {
                token: row["name"] for token, row in _by_token(version, "category").items()
            }
            self._called = {
                token: categories[row["category_token"]]
                for token, row in _by_token(version, "instance").items()
            }

    def of(self, sample: str, world_SE3_sensor: Pose) -> Boxes:
        sensor_SE3_world = world_SE3_sensor.inverse()
        return boxes_of(
            [
                LabelledBox(
                    box_of_row(row, sensor_SE3_world),
                    self._called[row["instance_token"]],
                    track_of(row["instance_token"]),
                    num_points=int(row.get("num_lidar_pts", -1)),
                )
                for row in self._annotations.get(sample, [])
            ]
        )


class _PointLabels:
    """Classes and objects of points by sweep; the tables are optional."""

    def __init__(self, root: Path, version: Path) -> None:
        self._root = root
        self._files: dict[str, dict[str, str]] = {}
        for task in ("lidarseg", "panoptic"):
            with laid_out(version / f"{task}.json", _EXPECTED):
                there = (version / f"{task}.json").is_file()
                self._files[task] = {
                    row["sample_data_token"]: row["filename"]
                    for row in (_rows(version, task) if there else [])
                }
        self._semantic = np.zeros(256, np.int64)
        if any(self._files.values()):
            with laid_out(version / "category.json", _EXPECTED):
                for row in _rows(version, "category"):
                    self._semantic[int(row["index"])] = _semantic_of(row["name"])

    def of(self, sweep: str) -> dict[str, NDArray[Any]]:
        """Return ``semantic`` and ``instance`` (N,) of a sweep, as far as available."""
        found: dict[str, NDArray[Any]] = {}
        if sweep in self._files["panoptic"]:
            file = self._root / self._files["panoptic"][sweep]
            with laid_out(file, _OF_POINTS):
                values = read_arrays(file, _OF_POINTS, {"data": ArrayOf("u2", ("N",))})["data"]
                found["instance"] = np.where(values % 1000 > 0, values, 0).astype(np.int64)
                found["semantic"] = self._semantic[np.minimum(values // 1000, 255)]
        if sweep in self._files["lidarseg"]:
            file = self._root / self._files["lidarseg"][sweep]
            with laid_out(file, _OF_POINTS):
                index = np.frombuffer(read_bytes(file, _OF_POINTS), np.uint8)
                found["semantic"] = self._semantic[index]
        return found


def _semantic_of(category: str) -> int:
    """Return our semantic class for a category; 0 if there is none."""
    ours = next((o for o, theirs in classes_in("nuscenes", "point").items() if theirs == category),
                ACTOR_SEMANTICS.get(actor_class(category)))  # fmt: skip
    return 0 if ours is None else semantic_id(ours)


def box_of_row(
    row: Row, frame_SE3_world: Pose
) -> tuple[float, float, float, float, float, float, float]:
    """Return a box in a frame from its translation, size and rotation in the world."""
    pose = frame_SE3_world @ _pose(row)
    width, length, height = (float(value) for value in row["size"])
    x, y, z = pose.translation.tolist()
    return x, y, z, length, width, height, heading(pose.rotation)


def _of_lidar(version: Path) -> list[Row]:
    return [row for row in _rows(version, "sample_data") if _CHANNEL in f"/{row['filename']}"]


def _name(row: Row) -> str:
    return Path(row["filename"]).name.split(".")[0]


def _rows(version: Path, name: str) -> list[Row]:
    file = version / f"{name}.json"
    rows = read_json_document(file, _EXPECTED)
    if not isinstance(rows, list):
        raise InputError("is not a list", file=file, expected=_EXPECTED)
    return rows


def _by_token(version: Path, name: str) -> dict[str, Row]:
    with laid_out(version / f"{name}.json", _EXPECTED):
        return {row["token"]: row for row in _rows(version, name)}


def _pose(row: Row) -> Pose:
    w, x, y, z = (float(value) for value in row["rotation"])
    return pose_of_quaternion(w, x, y, z, row["translation"])
