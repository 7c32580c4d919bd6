"""Pairs of detections and labelled objects of the same frame that are near or overlap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.detections import Detections
from urbantwin.evaluation.criterion import CRITERIA, Criterion
from urbantwin.evaluation.truth import Truth
from urbantwin.geometry import plan_overlaps, shared_heights

__all__ = ["Pairs", "pairs_of"]

_FARTHEST_M = max(one.limit for one in CRITERIA if one.measure == "distance_m")


#: Share of a detection's footprint within an object from which it belongs to that object.
_MOSTLY = 0.5


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs (P,) of a detection and an object.

    Attributes:
        detection: (P,) index of the detection.
        label: (P,) index of the object.
        distance_m: (P,) distance of the centres in plan, metres.
        bev_iou: (P,) intersection over union in plan.
        iou_3d: (P,) intersection over union in space.
        covered: (P,) share of the detection's footprint within the object's.
    """

    detection: NDArray[np.int64]
    label: NDArray[np.int64]
    distance_m: NDArray[np.float64]
    bev_iou: NDArray[np.float64]
    iou_3d: NDArray[np.float64]
    covered: NDArray[np.float64]

    @property
    def mostly_inside(self) -> NDArray[np.bool_]:
        """Mask (P,) of the detections with at least half of their footprint in the object."""
        return np.asarray(self.covered >= _MOSTLY)

    def worth(self, criterion: Criterion) -> NDArray[np.float64]:
        """Return the quality of each pair (P,) by a criterion: larger is better."""
        found: NDArray[np.float64] = getattr(self, criterion.measure)
        return -found if criterion.measure == "distance_m" else found

    def meet(self, criterion: Criterion) -> NDArray[np.bool_]:
        """Return the mask of the pairs (P,) that satisfy a criterion."""
        limit = criterion.limit
        worth = self.worth(criterion)
        return worth >= -limit if criterion.measure == "distance_m" else worth >= limit


def pairs_of(detections: Detections, truth: Truth) -> Pairs:
    """Return all pairs whose centres are within 4 m in plan or whose footprints may overlap.

    Args:
        detections: detections of the same frames as the truth, in its order.
        truth: the labelled objects.
    """
    found: list[tuple[NDArray[np.int64], NDArray[np.int64]]] = []
    count = len(truth.frames)
    ours = _by_frame(detections.frame, count)
    theirs = _by_frame(truth.frame, count)
    for mine, labels in zip(ours, theirs, strict=True):
        if not len(mine) or not len(labels):
            continue
        a, b = detections.box[mine], truth.box[labels]
        away = np.hypot(*(a[:, None, :2] - b[None, :, :2]).transpose(2, 0, 1))
        reach = (np.hypot(a[:, 3], a[:, 4])[:, None] + np.hypot(b[:, 3], b[:, 4])[None, :]) / 2
        first, second = np.nonzero(away <= np.maximum(reach, _FARTHEST_M))
        found.append((mine[first], labels[second]))
    detection = np.concatenate([one for one, _ in found] or [np.zeros(0, np.int64)])
    label = np.concatenate([one for _, one in found] or [np.zeros(0, np.int64)])
    a, b = detections.box[detection], truth.box[label]
    distance = np.hypot(a[:, 0] - b[:, 0], a[:, 1] - b[:, 1])
    touching = distance < (np.hypot(a[:, 3], a[:, 4]) + np.hypot(b[:, 3], b[:, 4])) / 2
    plan = np.zeros(len(label))
    plan[touching] = plan_overlaps(a[touching], b[touching])
    space = plan * shared_heights(a, b)
    areas = a[:, 3] * a[:, 4], b[:, 3] * b[:, 4]
    either = areas[0] * a[:, 5] + areas[1] * b[:, 5] - space
    return Pairs(
        detection=detection,
        label=label,
        distance_m=distance,
        bev_iou=plan / (areas[0] + areas[1] - plan),
        iou_3d=space / either,
        covered=plan / areas[0],
    )


def _by_frame(frame: NDArray[np.int64], count: int) -> list[NDArray[np.int64]]:
    """Return the rows of every frame, 0 to count - 1."""
    order = np.argsort(frame, kind="stable")
    borders = np.searchsorted(frame[order], np.arange(1, count))
    return np.split(order, borders)
