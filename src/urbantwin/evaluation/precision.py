"""Average precision, and the operating point at one threshold of the score."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.evaluation.matching import Matched
from urbantwin.fidelity.challenge.average_precision import RECALLS, precision_over_recalls

__all__ = [
    "Operation",
    "average_precision",
    "best_operation",
    "nuscenes_precision",
    "recall_at_false_alarms",
    "resampled_precision",
]


def average_precision(found: Matched) -> float | None:
    """Return the average precision, 0..1, over forty levels of recall; None without objects."""
    return precision_over_recalls(found.right, found.total) if found.total else None


def nuscenes_precision(found: Matched) -> float | None:
    """Return the average precision as nuScenes defines it (Caesar et al. 2020), 0..1.

    It is the mean of the excess of precision over 10 %, interpolated at 101 levels of recall, for
    recalls above 10 %, scaled to 0..1.
    """
    if not found.total:
        return None
    if not found.right.any():
        return 0.0
    hits = np.cumsum(found.right)
    precision = hits / np.arange(1, len(hits) + 1)
    level = np.interp(np.linspace(0, 1, 101), hits / found.total, precision, right=0)
    return float(np.maximum(level[11:] - 0.1, 0.0).mean() / 0.9)


@dataclass(frozen=True)
class Operation:
    """Performance of a detector without the boxes below a score.

    Attributes:
        score: the threshold.
        precision: share of its boxes that are right.
        recall: share of the objects that are found.
        false_alarms_per_frame: wrong boxes per frame.
    """

    score: float
    precision: float
    recall: float
    false_alarms_per_frame: float

    @property
    def f1(self) -> float:
        """The harmonic mean of precision and recall."""
        both = self.precision + self.recall
        return 2 * self.precision * self.recall / both if both else 0.0


def best_operation(found: Matched, score: NDArray[np.float64], frames: int) -> Operation | None:
    """Return the threshold with the best F1; None without objects or matches.

    Args:
        found: detections of a class.
        score: (N,) score of every detection.
        frames: number of frames.
    """
    if not found.total or not found.right.any():
        return None
    scores = score[found.detection]
    last = np.append(scores[1:] < scores[:-1], True)  # a threshold cannot separate equal scores
    hits = np.cumsum(found.right)
    count = np.arange(1, len(hits) + 1)
    f1 = np.where(last, 2 * hits / (count + found.total), -1.0)
    at = int(f1.argmax())
    return Operation(
        score=float(scores[at]),
        precision=float(hits[at] / count[at]),
        recall=float(hits[at] / found.total),
        false_alarms_per_frame=float((count[at] - hits[at]) / frames),
    )


def recall_at_false_alarms(
    found: Matched, score: NDArray[np.float64], frames: int, per_frame: float
) -> float | None:
    """Return the best recall with at most ``per_frame`` false alarms; None without objects."""
    if not found.total:
        return None
    if not len(found.right):
        return 0.0
    scores = score[found.detection]
    last = np.append(scores[1:] < scores[:-1], True)
    hits = np.cumsum(found.right)
    wrong = np.arange(1, len(hits) + 1) - hits
    allowed = last & (wrong <= per_frame * frames + 1e-9)
    return float(hits[allowed].max(initial=0) / found.total)


def resampled_precision(
    found: Matched,
    detection_frame: NDArray[np.int64],
    objects_of_frame: NDArray[np.int64],
    draws: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Return the average precision (D,) for resampled frames; NaN without objects.

    Args:
        found: detections of a class.
        detection_frame: (N,) frame of every detection.
        objects_of_frame: (F,) number of objects to be found in each frame.
        draws: (D, F) how often each frame is drawn.
    """
    hits_at = np.flatnonzero(found.right)
    if not len(hits_at):
        return np.where(draws @ objects_of_frame > 0, 0.0, np.nan)
    # Detections after the last match do not change the result.
    upto = hits_at[-1] + 1
    frame = detection_frame[found.detection[:upto]]
    right = found.right[:upto]
    levels = np.arange(1, RECALLS + 1) / RECALLS
    result = np.full(len(draws), np.nan)
    for number, (often, total) in enumerate(
        zip(draws, (draws @ objects_of_frame).tolist(), strict=True)
    ):
        if not total:
            continue
        weight = often[frame]
        every = np.cumsum(weight)
        hits = np.cumsum(weight * right)[hits_at]
        best = np.divide(hits, every[hits_at], out=np.zeros(len(hits)), where=hits > 0)
        best = np.maximum.accumulate(best[::-1])[::-1]
        at = np.searchsorted(hits, np.ceil(levels * total - 1e-9))
        result[number] = np.where(at < len(hits), best[np.minimum(at, len(hits) - 1)], 0.0).mean()
    return result
