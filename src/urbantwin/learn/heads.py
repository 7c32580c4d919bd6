"""What the network says of each class: which grid, how boxes are told, what counts how much."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry.angle import wrapped
from urbantwin.learn.grid import halvings

__all__ = ["OUTPUTS", "REGRESSED", "ClassHead", "class_heads", "decoded", "encoded"]

#: Of each box: offset of its centre from the cell's middle (2, in cells), its floor above the
#: ground, logarithms of its sides over the class's usual ones (3), cosine and sine of twice its
#: heading, and whether it heads east and whether north.
REGRESSED = 10
#: The values of each class in each cell: how likely a centre is there, and its box.
OUTPUTS = 1 + REGRESSED
#: People and two-wheelers are looked for in cells of 0.4 m: in those of 0.8 m two of them are one.
_SMALL = ("pedestrian", "bicycle", "motorcycle")
#: What boxes count beside centres, of vehicles and of whoever is small. With 1 boxes had five to
#: seven times the loss of centres, and two thirds of the gradient of what all share.
_BOX, _BOX_SMALL = 0.5, 0.25
#: Usual length, width, height, metres: where the sizes begin.
_USUAL = {
    "car": (4.5, 1.85, 1.6),
    "truck": (8.0, 2.5, 3.0),
    "bus": (12.0, 2.55, 3.1),
    "motorcycle": (2.1, 0.8, 1.6),
    "bicycle": (1.8, 0.65, 1.75),
    "pedestrian": (0.7, 0.65, 1.72),
}
#: What a network that has learned nothing says of a size is cut here: exp(1.5) = 4.5 times.
_MOST_LOG = 1.5


@dataclass(frozen=True)
class ClassHead:
    """One class of a detector.

    Attributes:
        name: a detector's class.
        stride: cells of the pillars along an edge of its cells.
        usual: its length, width and height, metres.
        box_weights: of what is regressed (`REGRESSED`), within its loss.
    """

    name: str
    stride: int
    usual: tuple[float, float, float]
    box_weights: tuple[float, ...]


def class_heads(names: Sequence[str], cell_m: float = 0.4) -> tuple[ClassHead, ...]:
    """Return the heads of classes in their order.

    A person's heading is seen in few points: it counts less.

    Args:
        names: of the classes.
        cell_m: edge of a pillar.
    """
    heads = []
    for name in names:
        small = name in _SMALL
        whole = _BOX_SMALL if small else _BOX
        angle = 0.25 if name == "pedestrian" else 1.0
        each = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0, angle, angle, 0.2 * angle, 0.2 * angle)
        weights = tuple(whole * one for one in each)
        stride = (1 if small else 2) << halvings(cell_m)
        heads.append(ClassHead(name, stride, _USUAL[name], weights))
    return tuple(heads)


def encoded(
    box: NDArray[np.float64], middle: NDArray[np.float64], cell_m: float, head: ClassHead
) -> NDArray[np.float32]:
    """Return what is to be regressed (N, `REGRESSED`) for boxes by cells.

    The heading is told as the axis, by its doubled angle (front and back alike), and which way
    along it, by two halves of the compass: of these one is clear wherever the other is not.

    Args:
        box: (N, 7), z above the ground.
        middle: (N, 2) of the cells, metres.
        cell_m: their edge.
        head: of the class.
    """
    told = np.empty((len(box), REGRESSED), np.float32)
    told[:, :2] = (box[:, :2] - middle) / cell_m
    told[:, 2] = box[:, 2] - box[:, 5] / 2
    told[:, 3:6] = np.log(box[:, 3:6] / head.usual)
    told[:, 6], told[:, 7] = np.cos(2 * box[:, 6]), np.sin(2 * box[:, 6])
    told[:, 8], told[:, 9] = np.cos(box[:, 6]) > 0, np.sin(box[:, 6]) > 0
    return told


def decoded(
    told: NDArray[np.floating], middle: NDArray[np.float64], cell_m: float, head: ClassHead
) -> NDArray[np.float64]:
    """Return the boxes (N, 7) of what cells regress: what `encoded` tells, backwards.

    Args:
        told: (N, `REGRESSED`); the last two as the network says them, above 0 for yes.
        middle: (N, 2) of the cells, metres.
        cell_m: their edge.
        head: of the class.
    """
    box = np.empty((len(told), 7))
    box[:, :2] = middle + told[:, :2] * cell_m
    box[:, 3:6] = head.usual * np.exp(np.clip(told[:, 3:6], -_MOST_LOG, _MOST_LOG))
    box[:, 2] = told[:, 2] + box[:, 5] / 2
    yaw = np.arctan2(told[:, 7], told[:, 6]) / 2
    ahead = told[:, 8] * np.cos(yaw) + told[:, 9] * np.sin(yaw)
    yaw = np.where(ahead < 0, yaw + np.pi, yaw)
    box[:, 6] = wrapped(yaw)
    return box
