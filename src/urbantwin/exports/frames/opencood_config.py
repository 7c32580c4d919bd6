"""A configuration of OpenCOOD for a dataset: PointPillar with late fusion.

Source: OpenCOOD, ``hypes_yaml/point_pillar_late_fusion.yaml``, and the rule of
``mask_boxes_outside_range_numpy``: all eight corners of a box must be within the range, in the
agent's frame. Its default range, -3 to 1 m about the LiDAR, suits a car's roof. Inference
(``train=False``) filters by the constant ``GT_RANGE`` of ``opencood.data_utils.datasets`` instead
of the configured range (``base_postprocessor.generate_object_center``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from urbantwin.pages import text_file

__all__ = ["CONFIG_FILE", "ReachOfBoxes", "opencood_config"]

#: Name of the file, beside the parts of the split.
CONFIG_FILE = "point_pillar_late_fusion.yaml"
#: Range in OpenCOOD's configurations: least x, y, z and greatest x, y, z, metres.
STOCK_RANGE_M = (-70.4, -40.0, -3.0, 70.4, 40.0, 1.0)
#: Edge of a pillar, metres; their number along an edge is a multiple of this (three strides of 2).
PILLAR_M, MULTIPLE = 0.4, 8
#: Boxes farther away than this along an axis are omitted, metres, as in OpenCOOD's evaluation.
FARTHEST_M = 140.8
#: Margin of the range beyond the boxes, metres.
MARGIN_M = 0.3
#: OpenCOOD's default limit of objects per frame.
ROOM = 100
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2.0


@dataclass
class ReachOfBoxes:
    """Extent of boxes in the frames of the agents.

    Attributes:
        low, high: (3,) least and greatest coordinates of a corner, metres.
        sizes: length, width, height of each box, metres.
        boxes: number of boxes, counted per agent and frame.
        in_stock: number of boxes within OpenCOOD's default range.
        most: largest number of boxes in a frame.
    """

    low: NDArray[np.float64] = field(default_factory=lambda: np.full(3, np.inf))
    high: NDArray[np.float64] = field(default_factory=lambda: np.full(3, -np.inf))
    sizes: list[tuple[float, float, float]] = field(default_factory=list)
    boxes: int = 0
    in_stock: int = 0
    most: int = 0

    def add(
        self,
        middles: NDArray[np.float64],
        rotations: NDArray[np.float64],
        sizes: NDArray[np.float64],
    ) -> None:
        """Add the boxes of a frame in the frame of an agent.

        Args:
            middles: (B, 3).
            rotations: (B, 3, 3).
            sizes: (B, 3) length, width, height, metres.
        """
        if not len(middles):
            return
        corners = middles[:, None] + np.einsum("bij,bkj->bki", rotations, _CORNERS * sizes[:, None])
        near = (np.abs(corners[:, :, :2]) <= FARTHEST_M - MARGIN_M).all(axis=(1, 2))
        stock = np.array(STOCK_RANGE_M)
        kept = ((corners >= stock[:3]) & (corners <= stock[3:])).all(axis=(1, 2))
        self.boxes += len(middles)
        self.in_stock += int(kept.sum())
        self.most = max(self.most, len(middles))
        self.sizes += [(float(a), float(b), float(c)) for a, b, c in sizes]
        if near.any():
            self.low = np.minimum(self.low, corners[near].min(axis=(0, 1)))
            self.high = np.maximum(self.high, corners[near].max(axis=(0, 1)))

    @property
    def range_m(self) -> tuple[float, float, float, float, float, float]:
        """Range of whole pillars around the boxes: least x, y, z, greatest x, y, z, metres."""
        step = PILLAR_M * MULTIPLE / 2
        reach = np.maximum(np.abs(self.low), np.abs(self.high))[:2] + MARGIN_M
        x, y = (math.ceil(float(one) / step) * step for one in reach)
        low = math.floor((float(self.low[2]) - MARGIN_M) * 10) / 10
        high = math.ceil((float(self.high[2]) + MARGIN_M) * 10) / 10
        bounds = (-x, -y, low, x, y, high)
        a, b, c, d, e, f = (round(one, 1) for one in bounds)
        return a, b, c, d, e, f

    @property
    def note(self) -> str:
        """Note on the range, for the user."""
        low, high = self.range_m[2], self.range_m[5]
        return (
            f"{CONFIG_FILE} has the range z [{low:g}, {high:g}] m about the sensor; with "
            f"OpenCOOD's own, z [-3, 1], {self.in_stock} of {self.boxes} boxes remain. "
            f"Its inference ignores this file's range: set GT_RANGE = {list(self.range_m)} in its "
            "opencood/data_utils/datasets/__init__.py"
        )


def opencood_config(reach: ReachOfBoxes) -> str:
    """Return a configuration as YAML.

    Args:
        reach: extent of the boxes; at least one box.
    """
    bounds = reach.range_m
    length, width, height = (round(float(one), 2) for one in np.median(reach.sizes, axis=0))
    return text_file(
        "exports/frames/configs/opencood.yaml.j2",
        file=CONFIG_FILE,
        range=bounds,
        voxel=[PILLAR_M, PILLAR_M, round(bounds[5] - bounds[2], 1)],
        length=length,
        width=width,
        height=height,
        room=max(ROOM, 2 * reach.most),
    )
