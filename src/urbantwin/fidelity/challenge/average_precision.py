"""Average precision of boxes in space: IoU 0.5, forty recall levels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import box_ious

__all__ = [
    "IOU",
    "RECALLS",
    "Box",
    "average_precision",
    "mean_precision",
    "precision_over_recalls",
]

#: Minimum IoU of a detection that matches a labelled box.
IOU = 0.5
#: Recall levels of the precision: 1/40 to 1 (Simonelli et al. 2019, R40).
RECALLS = 40


@dataclass(frozen=True, eq=False)
class Box:
    """A labelled or detected box: (7,) centre, length, width, height, yaw; class and score."""

    box: NDArray[np.float64]
    name: str
    score: float = 1.0


def average_precision(
    labels: Mapping[str, Sequence[Box]], detections: Mapping[str, Sequence[Box]], name: str
) -> float | None:
    """Return the average precision of one class; None if no frame has a label of it.

    Detections are processed by falling score; each matches the labelled box of its frame with the
    largest IoU, if that is at least ``IOU`` and the box is unmatched (Everingham et al. 2010). The
    result is the mean over forty recall levels of the best precision at that recall or above.

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
    order = np.argsort(-np.array(scores), kind="stable")
    return precision_over_recalls(np.array(right, bool)[order], total)


def precision_over_recalls(right: NDArray[np.bool_], total: int) -> float:
    """Return the mean over forty recall levels of the best precision at that recall or above.

    Args:
        right: (N,) mask of the detections, by falling score, that match an object.
        total: number of objects, at least one.
    """
    if not len(right):
        return 0.0
    hits = np.cumsum(right)
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
