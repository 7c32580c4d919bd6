"""Average precision of boxes in space: IoU 0.5, forty levels of recall."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

__all__ = ["IOU", "RECALLS", "Box", "average_precision", "box_ious", "mean_precision"]

#: A detection this much in common with a labelled box has found it.
IOU = 0.5
#: Levels of recall that precision is read at: 1/40 to 1 (Simonelli et al. 2019, R40).
RECALLS = 40


@dataclass(frozen=True, eq=False)
class Box:
    """A labelled or detected box: (7,) centre, length, width, height, yaw; class and score."""

    box: NDArray[np.float64]
    name: str
    score: float = 1.0


def box_ious(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the volumes in common over the volumes of either (A, B) of upright boxes.

    Args:
        first: (A, 7) centre, length, width, height, yaw; metres and radians.
        second: (B, 7).
    """
    a, b = _footprints(first), _footprints(second)
    plan = shapely.area(shapely.intersection(a[:, None], b[None, :]))
    low = np.maximum(
        (first[:, 2] - first[:, 5] / 2)[:, None], (second[:, 2] - second[:, 5] / 2)[None, :]
    )
    high = np.minimum(
        (first[:, 2] + first[:, 5] / 2)[:, None], (second[:, 2] + second[:, 5] / 2)[None, :]
    )
    common = plan * np.maximum(high - low, 0.0)
    either = first[:, 3:6].prod(axis=1)[:, None] + second[:, 3:6].prod(axis=1)[None, :] - common
    return np.asarray(np.divide(common, either, out=np.zeros_like(common), where=either > 0))


def _footprints(boxes: NDArray[np.float64]) -> NDArray[np.object_]:
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2
    local = signs[None] * boxes[:, None, 3:5]
    c, s = np.cos(boxes[:, 6])[:, None], np.sin(boxes[:, 6])[:, None]
    x = local[..., 0] * c - local[..., 1] * s + boxes[:, 0, None]
    y = local[..., 0] * s + local[..., 1] * c + boxes[:, 1, None]
    return np.asarray(shapely.polygons(np.stack([x, y], axis=-1)), dtype=object)


def average_precision(
    labels: Mapping[str, Sequence[Box]], detections: Mapping[str, Sequence[Box]], name: str
) -> float | None:
    """Return the average precision of one class; None where no frame has a label of it.

    Detections are taken by falling score; each finds the labelled box of its frame that it has
    most in common with, if that is at least ``IOU`` and none found it before (Everingham et
    al. 2010). The mean over forty levels of recall of the best precision at that recall or above.

    Args:
        labels: boxes by frame. Detections in other frames do not count.
        detections: boxes by frame.
        name: the class.
    """
    total = sum(box.name == name for boxes in labels.values() for box in boxes)
    if not total:
        return None
    scores: list[float] = []
    right: list[bool] = []
    for frame, boxes in labels.items():
        true = [box.box for box in boxes if box.name == name]
        told = [box for box in detections.get(frame, ()) if box.name == name]
        told.sort(key=lambda box: -box.score)
        scores += [box.score for box in told]
        if not true or not told:
            right += [False] * len(told)
            continue
        ious = box_ious(np.array([box.box for box in told]), np.array(true))
        taken = np.zeros(len(true), bool)
        for row in ious:
            best = int(np.where(taken, -1.0, row).argmax())
            hit = bool(row[best] >= IOU and not taken[best])
            taken[best] |= hit
            right.append(hit)
    if not scores:
        return 0.0
    order = np.argsort(-np.array(scores), kind="stable")
    hits = np.cumsum(np.array(right)[order])
    precision = hits / np.arange(1, len(hits) + 1)
    best_from_here = np.maximum.accumulate(precision[::-1])[::-1]
    needed = np.ceil(np.arange(1, RECALLS + 1) / RECALLS * total - 1e-9)
    at = np.searchsorted(hits, needed)
    return float(np.where(at < len(hits), best_from_here[np.minimum(at, len(hits) - 1)], 0).mean())


def mean_precision(
    labels: Mapping[str, Sequence[Box]],
    detections: Mapping[str, Sequence[Box]],
    names: Sequence[str],
) -> tuple[float | None, dict[str, float | None]]:
    """Return the mean over the classes that have labels, and the precision of each class."""
    each = {name: average_precision(labels, detections, name) for name in names}
    given = [value for value in each.values() if value is not None]
    return (float(np.mean(given)) if given else None), each
