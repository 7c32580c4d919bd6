"""Which detections are right, which are wrong, and which do not count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.evaluation.criterion import Criterion
from urbantwin.evaluation.pairs import Pairs

__all__ = ["Matched", "matched"]


@dataclass(frozen=True, eq=False)
class Matched:
    """The detections of one class that count, by falling score.

    Attributes:
        detection: (M,) number of the detection.
        label: (M,) number of the object that it found, -1 where it is wrong.
        total: how many objects there were to find.
    """

    detection: NDArray[np.int64]
    label: NDArray[np.int64]
    total: int

    @property
    def right(self) -> NDArray[np.bool_]:
        """Which of them (M,) found an object."""
        return self.label >= 0


def matched(
    pairs: Pairs,
    order: NDArray[np.int64],
    roles: NDArray[np.int64],
    counts: NDArray[np.bool_],
    criterion: Criterion,
) -> Matched:
    """Let detections find objects, by falling score: each the best that none found before.

    So do PASCAL VOC (Everingham et al. 2010), nuScenes and Argoverse 2. A detection that finds
    none counts as wrong, but for those of objects that do not count and for those outside of what
    is labelled.

    Args:
        pairs: of all detections and objects.
        order: detections (M,) of the class, by falling score.
        roles: (L,) of every object, see `truth.roles_of`.
        counts: (N,) of every detection, whether it is wrong where it finds nothing.
        criterion: what is to be met.
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
