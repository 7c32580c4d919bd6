"""Heads of the classes: resolution, encoding of boxes, weights of the loss."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry.angle import wrapped
from urbantwin.learn.grid import halvings

__all__ = ["OUTPUTS", "REGRESSED", "ClassHead", "class_heads", "decoded", "encoded"]

#: Encoding of a box: offset of its centre from that of the cell (2, in cells), height of its lower
#: face above the ground (m), logarithms of length, width and height over the mean of the class (3),
#: cosine and sine of twice the heading, and whether the heading points east and north (logits).
REGRESSED = 10
#: Outputs of each class in a cell: logit of a centre, then the encoded box.
OUTPUTS = 1 + REGRESSED
#: Classes with heads at 0.4 m: at 0.8 m two neighbours fall into one cell.
_SMALL = ("pedestrian", "bicycle", "motorcycle")
#: Weight of the box loss against that of centres, for vehicles and for small classes. With 1, the
#: box loss was five to seven times that of centres, with two thirds of the shared gradient.
_BOX, _BOX_SMALL = 0.5, 0.25
#: Mean length, width and height, metres: reference of the encoded sizes.
_USUAL = {
    "car": (4.5, 1.85, 1.6),
    "truck": (8.0, 2.5, 3.0),
    "bus": (12.0, 2.55, 3.1),
    "motorcycle": (2.1, 0.8, 1.6),
    "bicycle": (1.8, 0.65, 1.75),
    "pedestrian": (0.7, 0.65, 1.72),
}
#: Bound of the decoded logarithm of a size: exp(1.5) = 4.5 times the mean.
_MOST_LOG = 1.5


@dataclass(frozen=True)
class ClassHead:
    """One class of a detector.

    Attributes:
        name: object class.
        stride: edge of the head's cells in pillars.
        usual: mean length, width and height, metres.
        box_weights: (`REGRESSED`) weights of the encoded values in the loss.
    """

    name: str
    stride: int
    usual: tuple[float, float, float]
    box_weights: tuple[float, ...]


def class_heads(names: Sequence[str], cell_m: float = 0.4) -> tuple[ClassHead, ...]:
    """Return the heads of classes in order.

    The heading of a pedestrian has a lower weight, because few points show it.

    Args:
        names: names of the classes.
        cell_m: edge of a pillar, metres.
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
    """Encode boxes relative to cells; return (N, `REGRESSED`).

    The heading is split into its axis (doubled angle, the same for front and back) and its
    direction along the axis (east or west, north or south): where one is ambiguous, the other is
    not.

    Args:
        box: (N, 7) boxes, z above the ground.
        middle: (N, 2) centres of the cells, metres.
        cell_m: edge of the cells, metres.
        head: head of the class.
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
    """Decode boxes (N, 7): the inverse of `encoded`.

    Args:
        told: (N, `REGRESSED`) outputs of the network; the last two are logits.
        middle: (N, 2) centres of the cells, metres.
        cell_m: edge of the cells, metres.
        head: head of the class.
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
