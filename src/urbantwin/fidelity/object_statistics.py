"""Statistics of a recording's labelled objects, and differences between two recordings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.histograms import jensen_shannon

__all__ = ["HEAT_CELL_M", "RANGE_EDGES_M", "ObjectStatistics", "object_differences"]

#: Bins of distance for points per box, metres.
RANGE_EDGES_M = (0.0, 10.0, 20.0, 30.0, 40.0, 60.0, 80.0, 120.0)
#: Cell size of the heat map, metres.
HEAT_CELL_M = 2.0
_DIMENSIONS = ("length_m", "width_m", "height_m")


@dataclass(eq=False)
class ObjectStatistics:
    """The boxes of a recording, one row per frame and box.

    Attributes:
        frames: labelled frames that were added.
        classes: (B,) class names.
        box: (B, 7) centre, length, width, height, yaw.
        points: (B,) points in each box.
        distance: (B,) from the (first) sensor to the centre, metres.
    """

    frames: int = 0
    classes: list[str] = field(default_factory=list)
    box: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7)))
    points: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    distance: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(cls, frames: Iterable[Frame]) -> ObjectStatistics:
        """Return the statistics of frames; frames without labels are skipped."""
        found = cls()
        for frame in frames:
            found.add(frame)
        return found

    def add(self, frame: Frame) -> None:
        """Add the boxes of one frame, if it has labels."""
        boxes = frame.boxes
        if boxes is None:
            return
        owner = boxes.points_of(frame.points)
        self.frames += 1
        self.classes += list(boxes.class_names)
        self.box = np.concatenate([self.box, boxes.box])
        count = np.bincount(owner[owner >= 0], minlength=len(boxes))
        self.points = np.concatenate([self.points, count])
        away = np.linalg.norm(boxes.box[:, :3] - frame.sensor_places[0], axis=1)
        self.distance = np.concatenate([self.distance, away])

    def join(self, other: ObjectStatistics) -> None:
        """Add the boxes of further frames."""
        self.frames += other.frames
        self.classes += other.classes
        self.box = np.concatenate([self.box, other.box])
        self.points = np.concatenate([self.points, other.points])
        self.distance = np.concatenate([self.distance, other.distance])

    def as_json(self) -> dict[str, Any]:
        """Return per class: boxes per frame, dimensions, points per box by distance; heat map.

        The heat map lists the lower corner of each cell with boxes, and their number.
        """
        names = np.array(self.classes)
        found: dict[str, Any] = {}
        for name in sorted(set(self.classes)):
            mine = names == name
            size = self.box[mine, 3:6]
            found[name] = {
                "boxes": int(mine.sum()),
                "per_frame": float(mine.sum() / self.frames),
                "dimensions": {
                    label: {"mean": float(size[:, axis].mean()), "std": float(size[:, axis].std())}
                    for axis, label in enumerate(_DIMENSIONS)
                },
                "points_per_box": self._points_by_range(mine),
            }
        heat = [[x * HEAT_CELL_M, y * HEAT_CELL_M, n] for (x, y), n in self.heat().items()]
        return {
            "frames": self.frames,
            "boxes": len(self.box),
            "classes": found,
            "heat_map": {"cell_m": HEAT_CELL_M, "x_y_boxes": heat},
        }

    def _points_by_range(self, mine: NDArray[np.bool_]) -> list[dict[str, Any]]:
        rows = []
        for low, high in pairwise(RANGE_EDGES_M):
            here = self.points[mine & (self.distance >= low) & (self.distance < high)]
            if len(here):
                p20, median, p80 = np.percentile(here, [20, 50, 80])
                rows.append(
                    {
                        "from_m": low,
                        "to_m": high,
                        "boxes": len(here),
                        "median": float(median),
                        "p20": float(p20),
                        "p80": float(p80),
                        "empty": float((here == 0).mean()),
                    }
                )
        return rows

    def heat(self) -> Mapping[tuple[int, int], int]:
        """Return the number of boxes with their centre in each cell of ``HEAT_CELL_M``."""
        cells, count = np.unique(
            np.floor(self.box[:, :2] / HEAT_CELL_M).astype(np.int64), axis=0, return_counts=True
        )
        return {(int(x), int(y)): int(n) for (x, y), n in zip(cells, count, strict=True)}


def object_differences(real: ObjectStatistics, synthetic: ObjectStatistics) -> dict[str, Any]:
    """Return the differences of two recordings' objects; None if either has no such object.

    ``class_mix_js``: Jensen-Shannon divergence of the shares of classes; ``heat_map_js``: of the
    shares of boxes in cells of 2 m; per class ``dimensions``: synthetic minus real mean, metres;
    ``points_ratio``: geometric mean, over the distance bins that both have, of synthetic over real
    median points (each plus one), weighted by the real boxes.
    """
    ours, theirs = synthetic.as_json()["classes"], real.as_json()["classes"]
    names = sorted(set(ours) | set(theirs))
    mix = [[side.get(name, {"boxes": 0})["boxes"] for name in names] for side in (theirs, ours)]
    warm, other = real.heat(), synthetic.heat()
    cells = sorted(set(warm) | set(other))
    heat = [[side.get(cell, 0) for cell in cells] for side in (warm, other)]
    return {
        "class_mix_js": jensen_shannon(*mix) if names else None,
        "heat_map_js": jensen_shannon(*heat) if cells else None,
        "boxes_per_frame_ratio": (len(synthetic.box) / synthetic.frames)
        / (len(real.box) / real.frames)
        if synthetic.frames and real.frames and len(real.box)
        else None,
        "classes": {
            name: {
                "dimensions": {
                    label: ours[name]["dimensions"][label]["mean"]
                    - theirs[name]["dimensions"][label]["mean"]
                    for label in _DIMENSIONS
                },
                "points_ratio": _points_ratio(theirs[name], ours[name]),
            }
            for name in names
            if name in ours and name in theirs
        },
    }


def _points_ratio(real: Mapping[str, Any], synthetic: Mapping[str, Any]) -> float | None:
    ours = {row["from_m"]: row["median"] for row in synthetic["points_per_box"]}
    pairs = [
        (row["boxes"], np.log((ours[row["from_m"]] + 1) / (row["median"] + 1)))
        for row in real["points_per_box"]
        if row["from_m"] in ours
    ]
    if not pairs:
        return None
    weight, ratio = np.array(pairs, np.float64).T
    return float(np.exp((weight * ratio).sum() / weight.sum()))
