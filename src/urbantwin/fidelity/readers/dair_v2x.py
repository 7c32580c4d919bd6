"""DAIR-V2X: ``velodyne`` in pcd, labels in JSON, of the roadside or of the vehicle.

Source: Yu et al. 2022, and the DAIR-V2X repository's ``data/README.md``. Roadside points and labels
are in the virtual LiDAR's frame (x forward, level with the ground), boxes with their middle,
height, width, length and turn about z.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from urbantwin.fidelity.cloud_formats import read_fields
from urbantwin.fidelity.frame import Boxes, Frame
from urbantwin.fidelity.readers.documents import laid_out, read_json_document
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.labels import LabelledBox, boxes_of, checked_pose
from urbantwin.fidelity.readers.plain import clouds_in
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.geometry import Pose

__all__ = ["is_dair", "open_dair"]

#: Labels of the points' own time; those in ``camera`` are of the picture's.
_LABELS = ("label/virtuallidar", "label/lidar")
_WORLD = "calib/virtuallidar_to_world"


def is_dair(path: Path) -> bool:
    """Return whether a folder is a side of the dataset: clouds beside labels in JSON."""
    beside = any((path / folder).is_dir() for folder in _LABELS)
    return bool(clouds_in(path / "velodyne", ".pcd")) and (
        beside or (path / "data_info.json").is_file()
    )


def open_dair(path: Path) -> Recording:
    """Open one side: ``single-infrastructure-side``, ``infrastructure-side``, or a vehicle's."""
    files = clouds_in(path / "velodyne", ".pcd")

    def read(index: int) -> Frame:
        file = files[index]
        found = [path / folder / f"{file.stem}.json" for folder in _LABELS]
        labels = [one for one in found if one.is_file()]
        return frame_of(
            file,
            read_fields(file),
            name=file.stem,
            boxes=_read_boxes(labels[0]) if labels else None,
            world_SE3_frame=_read_pose(path / _WORLD / f"{file.stem}.json"),
        )

    return Recording(path, "dair-v2x", tuple(file.stem for file in files), read)


def _read_boxes(path: Path) -> Boxes:
    expected = "labels of DAIR-V2X"
    with laid_out(path, expected):
        return boxes_of(
            [
                LabelledBox(_box(one), str(one["type"]), int(one.get("track_id", -1)))
                for one in read_json_document(path, expected)
            ]
        )


def _box(one: Mapping[str, Any]) -> tuple[float, float, float, float, float, float, float]:
    place, size = one["3d_location"], one["3d_dimensions"]
    return (
        float(place["x"]), float(place["y"]), float(place["z"]),
        float(size["l"]), float(size["w"]), float(size["h"]),
        float(one["rotation"]),
    )  # fmt: skip


def _read_pose(path: Path) -> Pose | None:
    if not path.is_file():
        return None
    expected = "rotation and translation"
    with laid_out(path, expected):
        values = read_json_document(path, expected)
        values = values.get("transform", values)
        return checked_pose(values["rotation"], values["translation"])
