"""Objects of other sizes: what is learned must not be the cars of one country and year.

Yang et al. 2021, "ST3D: Self-training for Unsupervised Domain Adaptation on 3D Object Detection"
(random object scaling): a detector that knew cars of one size alone misses smaller ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from urbantwin.learn.compiled.box_points import points_in_boxes
from urbantwin.learn.frames import IGNORED, LevelFrame

__all__ = ["resized"]

#: Length and width of a car times this, both alike: 3.4 m in place of 4.4 m is a small one.
_CAR = (0.78, 1.1)
#: The same of everybody else, and heights of all: a small car is as high as a large one.
_ELSE, _HEIGHT = (0.92, 1.08), (0.92, 1.08)
#: Points so far outside of a box go with it, metres.
_MARGIN_M = 0.1


def resized(frame: LevelFrame, classes: Sequence[str], draw: np.random.Generator) -> LevelFrame:
    """Return a frame whose labelled objects have other sizes, about the middle of their ground.

    Args:
        frame: on level ground.
        classes: names of the frame's numbers of classes.
        draw: random numbers.
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
