"""The boxes that a trainer reads, and the objects cut out of frames by them.

A box without a point teaches nothing but false alarms: it is left out. A box with points that is
ignored (docs/reference/labels.md) is marked as its format marks such a box.
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
    """The boxes of a frame as a trainer reads them, L of them.

    Attributes:
        rows: (L,) which of the frame's boxes they are.
        names: (L,) text, what the format calls their classes; ``marked`` where one does not count.
        box: (L, 7) float32: centre, length, width, height, yaw, as the labels' text has them.
        lines: the text: ``x y z dx dy dz heading class`` a line.
    """

    rows: NDArray[np.intp]
    names: NDArray[np.str_]
    box: NDArray[np.float32]
    lines: str


def learned_boxes(boxes: LabelledObjects, format_name: str, marked: str) -> LearnedBoxes:
    """Return what a trainer reads of a frame's boxes.

    Args:
        boxes: all boxes of the frame.
        format_name: by which its classes are known.
        marked: the format's class of boxes that do not count.
    """
    theirs = classes_in(format_name)
    called = np.array([theirs.get(name) or "" for name in boxes.class_name], np.str_)
    rows = np.flatnonzero((boxes.num_points > 0) & (called != ""))
    names = np.where(boxes.ignored[rows] == "", called[rows], marked)
    lines = [label_line(boxes.box[row], name) for row, name in zip(rows, names, strict=True)]
    box = np.array([line.split()[:7] for line in lines], np.float32).reshape(-1, 7)
    # A width of its own: OpenPCDet's evaluation writes KITTI's names over these, cut to fit.
    width = max(16, *map(len, theirs), *(len(one or "") for one in theirs.values()))
    return LearnedBoxes(rows, names.astype(f"<U{width}"), box, "".join(lines))


class ObjectDatabase:
    """The points in each box of the training frames, a file each, and the table of them.

    Args:
        folder: of the export.
        name: of the folder for the objects' files.
        middle: from which height of the box the points' heights are told: ``middle``, as OpenPCDet
            has it, or ``floor``, as MMDetection3D has it.

    Attributes:
        infos: the table: class -> an entry for each object.

    Sources: OpenPCDet, ``CustomDataset.create_groundtruth_database``, and
    ``roiaware_pool3d.cpp``, whose ``check_pt_in_box3d_cpu`` grows boxes by a centimetre in plan;
    MMDetection3D, ``create_gt_database.py`` and ``box_np_ops.points_in_rbbox``, which does not.
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
            frame: its name.
            points: (N, 4) x, y, z, intensity.
            found: its boxes.
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
        """Yield the numbers of the points in each box, by the rule of the format's own tool."""
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
