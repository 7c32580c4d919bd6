"""Augmentation by random object scaling, against a bias to the vehicle sizes of one country.

Yang et al. 2021, "ST3D: Self-training for Unsupervised Domain Adaptation on 3D Object Detection".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from urbantwin.learn.compiled.box_points import points_in_boxes
from urbantwin.learn.frames import IGNORED, LevelFrame

__all__ = ["resized"]

#: Range of factors of length and width of a car (the same for both).
_CAR = (0.78, 1.1)
#: Range of factors for other classes, and for all heights.
_ELSE, _HEIGHT = (0.92, 1.08), (0.92, 1.08)
#: Margin of a box within which points are scaled with it, metres.
_MARGIN_M = 0.1


def resized(frame: LevelFrame, classes: Sequence[str], draw: np.random.Generator) -> LevelFrame:
    """Scale labelled objects about the centre of their lower face.

    Args:
        frame: levelled frame.
        classes: names of the classes, in order.
        draw: random generator.
    """
    count = len(frame.box)
    is_car = np.array([one >= 0 and classes[one] == "car" for one in frame.number], bool)
    plan = np.where(is_car, draw.uniform(*_CAR, count), draw.uniform(*_ELSE, count))
    height = draw.uniform(*_HEIGHT, count)
    free = frame.number == IGNORED
    plan[free] = height[free] = 1.0
    owner = points_in_boxes(frame.points, frame.box, _MARGIN_M)
    rows = np.flatnonzero(owner >= 0)
    mine = owner[rows]
    bottom = frame.box[:, 2] - frame.box[:, 5] / 2
    points = frame.points.copy()
    middle = frame.box[mine, :2]
    points[rows, :2] = middle + (points[rows, :2] - middle) * plan[mine, None]
    points[rows, 2] = bottom[mine] + (points[rows, 2] - bottom[mine]) * height[mine]
    box = frame.box.copy()
    box[:, 3:5] *= plan[:, None]
    box[:, 5] *= height
    box[:, 2] = bottom + box[:, 5] / 2
    return replace(frame, points=points, box=box)
