"""Training boxes of a frame, and the object database cut out by them.

A box without points would teach false positives only, so it is omitted. A box with points that is
ignored (docs/reference/labels.md) gets its format's mark for such boxes.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.box_columns import label_line
from urbantwin.dataset.reading.objects import LabelledObjects
from urbantwin.taxonomy import classes_in

__all__ = ["LearnedBoxes", "ObjectDatabase", "learned_boxes"]


@dataclass(frozen=True, eq=False)
class LearnedBoxes:
    """The training boxes of a frame, L of them.

    Attributes:
        rows: (L,) indices among the frame's boxes.
        names: (L,) class names of the format; ``marked`` for boxes that do not count.
        box: (L, 7) float32: centre, length, width, height, yaw, equal to the labels' text.
        lines: the labels' text: ``x y z dx dy dz heading class`` per line.
    """

    rows: NDArray[np.intp]
    names: NDArray[np.str_]
    box: NDArray[np.float32]
    lines: str


def learned_boxes(boxes: LabelledObjects, format_name: str, marked: str) -> LearnedBoxes:
    """Return the training boxes of a frame.

    Args:
        boxes: all boxes of the frame.
        format_name: name of the format, for its classes.
        marked: the format's class of boxes that do not count.
    """
    theirs = classes_in(format_name)
    called = np.array([theirs.get(name) or "" for name in boxes.class_name], np.str_)
    rows = np.flatnonzero((boxes.num_points > 0) & (called != ""))
    names = np.where(boxes.ignored[rows] == "", called[rows], marked)
    lines = [label_line(boxes.box[row], name) for row, name in zip(rows, names, strict=True)]
    box = np.array([line.split()[:7] for line in lines], np.float32).reshape(-1, 7)
    # A fixed width, because OpenPCDet's evaluation overwrites these with KITTI's names.
    width = max(16, *map(len, theirs), *(len(one or "") for one in theirs.values()))
    return LearnedBoxes(rows, names.astype(f"<U{width}"), box, "".join(lines))


class ObjectDatabase:
    """Database of objects: a file with the points in each training box, and a table of them.

    Args:
        folder: folder of the export.
        name: name of the folder for the objects' files.
        middle: reference height of the points: ``middle`` of the box, as in OpenPCDet, or its
            ``floor``, as in MMDetection3D.

    Attributes:
        infos: the table: class -> an entry per object.

    Sources: OpenPCDet, ``CustomDataset.create_groundtruth_database``, and ``roiaware_pool3d.cpp``,
    whose ``check_pt_in_box3d_cpu`` enlarges boxes by a centimetre in plan; MMDetection3D,
    ``create_gt_database.py`` and ``box_np_ops.points_in_rbbox``, which does not.
    """

    def __init__(
        self, folder: Path, name: str, middle: Literal["middle", "floor"] = "middle"
    ) -> None:
        self._folder = folder
        self._name = name
        self._floor = middle == "floor"
        self.infos: dict[str, list[dict[str, Any]]] = defaultdict(list)
        (folder / name).mkdir()

    def add(self, frame: str, points: NDArray[np.float32], found: LearnedBoxes) -> None:
        """Write the objects of a frame.

        Args:
            frame: name of the frame.
            points: (N, 4) x, y, z, intensity.
            found: training boxes of the frame.
        """
        for number, (inside, name, box) in enumerate(
            zip(self.inside(points, found.box), found.names.tolist(), found.box, strict=True)
        ):
            place = f"{self._name}/{frame}_{name}_{number}.bin"
            own = points[inside]
            stored = box.copy()
            if self._floor:
                stored[2] -= stored[5] / 2
            own[:, :3] -= stored[:3]
            (self._folder / place).write_bytes(own.tobytes())
            self.infos[name].append(
                {
                    "name": name,
                    "path": place,
                    "gt_idx": number,
                    "box3d_lidar": stored,
                    "num_points_in_gt": len(own),
                }
            )

    def inside(
        self, points: NDArray[np.float32], boxes: Iterable[NDArray[np.float32]]
    ) -> Iterator[NDArray[np.intp]]:
        """Yield the indices of the points in each box, by the rule of the format's own tool."""
        margin = np.float32(0.0 if self._floor else 0.01)
        order = np.argsort(points[:, 0], kind="stable")
        x = points[order, 0]
        for box in boxes:
            reach = np.hypot(box[3], box[4]) / 2 + 0.1
            near = order[slice(*np.searchsorted(x, [box[0] - reach, box[0] + reach]))]
            offset = points[near, :3] - box[:3]
            c, s = np.cos(-box[6]), np.sin(-box[6])
            along = np.abs(offset[:, 0] * c - offset[:, 1] * s)
            across = np.abs(offset[:, 0] * s + offset[:, 1] * c)
            held = (along < box[3] / 2 + margin) & (across < box[4] / 2 + margin)
            yield np.sort(near[held & (np.abs(offset[:, 2]) <= box[5] / 2)])
