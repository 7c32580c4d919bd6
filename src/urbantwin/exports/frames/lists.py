"""Boxes and poses as CSV lists beside clouds, for formats that hold points only.

``boxes.csv`` is the list read by `fidelity.readers.tables`, a row per box; ``frames.csv`` has time,
part of the split, and the poses of points and sensors of each frame.
"""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from urbantwin.dataset.reading import Frame
from urbantwin.dataset.reading.objects import LabelledObjects
from urbantwin.exports.frames.box_poses import site_boxes
from urbantwin.exports.frames.box_rows import BOX_KEYS, box_rows
from urbantwin.exports.frames.source import FrameSource
from urbantwin.geometry import Pose

__all__ = ["BOX_COLUMNS", "FRAME_COLUMNS", "Lists"]

BOX_COLUMNS = ("frame", *BOX_KEYS, "ignore")
#: ``of`` is ``frame``, or the name of a sensor; the pose transforms its points to the site frame.
FRAME_COLUMNS = ("frame", "time_s", "part", "of", "x", "y", "z", "qw", "qx", "qy", "qz")


class Lists:
    """The lists of a folder, written frame by frame.

    Args:
        source: the dataset.
        folder: folder to write into.
        in_site: whether boxes and points are in the site's frame, otherwise in the dataset's.
    """

    def __init__(self, source: FrameSource, folder: Path, *, in_site: bool = False) -> None:
        self._source, self._in_site = source, in_site
        self._files = [
            (folder / name).open("w", newline="", encoding="utf-8")
            for name in ("boxes.csv", "frames.csv")
        ]
        self._boxes, self._frames = (csv.writer(one, lineterminator="\n") for one in self._files)
        self._boxes.writerow(BOX_COLUMNS)
        self._frames.writerow(FRAME_COLUMNS)

    def add(self, frame: Frame) -> None:
        """Write the rows of a frame."""
        boxes = _in_site(frame) if self._in_site else frame.objects
        for row in box_rows(boxes):
            row |= {"frame": frame.name, "ignore": row["ignored"] is not None}
            self._boxes.writerow([_text(row[name]) for name in BOX_COLUMNS])
        told = (frame.name, repr(frame.time_s), self._source.part_of(frame.name) or "")
        poses = {"frame": frame.site_SE3_dataset, **frame.site_SE3_sensors}
        if self._in_site:
            poses["frame"] = Pose(np.eye(3), np.zeros(3))
        for name, pose in poses.items():
            numbers = (*pose.translation.tolist(), *pose.quaternion())
            self._frames.writerow((*told, name, *map(repr, numbers)))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the files."""
        for one in self._files:
            one.close()


def _text(value: Any) -> str:  # noqa: ANN401
    """Return a value as text for a list: numbers unrounded, unknown values empty."""
    if value is None:
        return ""
    return str(int(value)) if isinstance(value, bool) else str(value)


def _in_site(frame: Frame) -> LabelledObjects:
    """Return the boxes of a frame in the site frame, kept upright."""
    boxes = frame.objects
    middles, turned = site_boxes(frame)
    yaw = np.arctan2(turned[:, 1, 0], turned[:, 0, 0])
    box = np.column_stack([middles, boxes.box[:, 3:6], yaw])
    return replace(boxes, box=box, velocity=boxes.velocity @ frame.site_SE3_dataset.rotation.T)
