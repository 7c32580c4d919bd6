"""Matching of detections to objects: right, wrong, or not counted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.evaluation.criterion import Criterion
from urbantwin.evaluation.pairs import Pairs

__all__ = ["Matched", "matched"]


@dataclass(frozen=True, eq=False)
class Matched:
    """The counted detections of one class, by falling score.

    Attributes:
        detection: (M,) index of the detection.
        label: (M,) index of the matched object, -1 if the detection is wrong.
        total: number of objects to be found.
    """

    detection: NDArray[np.int64]
    label: NDArray[np.int64]
    total: int

    @property
    def right(self) -> NDArray[np.bool_]:
        """Mask (M,) of the detections that match an object."""
        return self.label >= 0


def matched(
    pairs: Pairs,
    order: NDArray[np.int64],
    roles: NDArray[np.int64],
    counts: NDArray[np.bool_],
    criterion: Criterion,
) -> Matched:
    """Match detections to objects by falling score, each to the best unmatched object.

    PASCAL VOC (Everingham et al. 2010), nuScenes and Argoverse 2 match in the same way. A detection
    without a match is wrong, unless it lies on an object that does not count or outside of the
    labelled region.

    Args:
        pairs: pairs of all detections and objects.
        order: detections (M,) of the class, by falling score.
        roles: (L,) role of every object, see `truth.roles_of`.
        counts: (N,) whether a detection is wrong if it has no match.
        criterion: the matching criterion.
    """
    rank = np.full(len(counts), -1, np.int64)
    rank[order] = np.arange(len(order))
    mine = (rank[pairs.detection] >= 0) & (roles[pairs.label] != 0)
    meets = pairs.meet(criterion)
    wanted = np.flatnonzero(mine & meets & (roles[pairs.label] > 0))
    worth = pairs.worth(criterion)[wanted]
    wanted = wanted[np.lexsort((pairs.label[wanted], -worth, rank[pairs.detection[wanted]]))]
    label = np.full(len(order), -1, np.int64)
    taken: set[int] = set()
    for row, object_ in zip(
        rank[pairs.detection[wanted]].tolist(), pairs.label[wanted].tolist(), strict=True
    ):
        if label[row] < 0 and object_ not in taken:
            label[row] = object_
            taken.add(object_)
    neutral = mine & (roles[pairs.label] < 0) & (meets | pairs.mostly_inside)
    excused = ~counts
    excused[pairs.detection[neutral]] = True
    kept = (label >= 0) | ~excused[order]
    return Matched(order[kept], label[kept], int((roles > 0).sum()))
