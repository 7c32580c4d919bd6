"""Evaluation of tracked detections against labelled tracks: HOTA, MOTA and IDF1.

Luiten et al. 2021, "HOTA: A Higher Order Metric for Evaluating Multi-Object Tracking"; Bernardin
and Stiefelhagen 2008, "Evaluating Multiple Object Tracking Performance: The CLEAR MOT Metrics";
Ristani et al. 2016, "Performance Measures and a Data Set for Multi-Target, Multi-Camera Tracking".
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from urbantwin.evaluation.criterion import near
from urbantwin.evaluation.evaluate import Figures, Judged

__all__ = ["ALPHAS", "Moment", "clear_mot", "hota", "identities", "judged_tracks"]

#: Localisation thresholds of HOTA.
ALPHAS = np.arange(0.05, 0.99, 0.05)
#: Minimum similarity for MOTA and IDF1: the distance criterion of detections.
_SAME = 0.5
_EPS = np.finfo(np.float64).eps


@dataclass(frozen=True, eq=False)
class Moment:
    """One frame.

    Attributes:
        labelled: (G,) numbers of labelled tracks, consecutive from 0 over all frames.
        followed: (T,) numbers of detected tracks, likewise.
        similarity: (G, T) 0..1.
    """

    labelled: NDArray[np.int64]
    followed: NDArray[np.int64]
    similarity: NDArray[np.float64]


def judged_tracks(figures: Figures) -> dict[str, Any] | None:
    """Return the tracking values of each class; None without labelled or detected tracks.

    The similarity of two boxes depends on the distance of their centres in plan: 1 at the same
    position, 0.5 at the limit of the distance criterion (1 m; trucks, buses 2 m), 0 at twice the
    limit. Detections below the score of the best F1 or on objects that do not count are left out.

    Args:
        figures: results of all classes.
    """
    seen = figures.seen
    if not (seen.truth.track >= 0).any() or not (seen.detections.track >= 0).any():
        return None
    found = {}
    for name, one in figures.classes.items():
        moments = _moments(figures, name, one)
        labelled, followed = _counts(moments)
        if len(labelled):
            found[name] = {
                **hota(moments),
                **clear_mot(moments),
                **identities(moments),
                "objects": int(labelled.sum()),
                "tracks": len(labelled),
                "tracks_found": len(followed),
                "score": one.threshold,
            }
    return found or None


def _moments(figures: Figures, name: str, judged: Judged) -> list[Moment]:
    """Return the frames of one class."""
    seen, pairs = figures.seen, figures.pairs
    detections, truth = seen.detections, seen.truth
    chosen = np.zeros(len(detections), bool)
    chosen[judged.order] = True
    chosen &= (detections.score >= judged.threshold) & (detections.track >= 0)
    mine = chosen[pairs.detection] & (judged.roles[pairs.label] != 0)
    first, second = pairs.detection[mine], pairs.label[mine]
    alike = np.maximum(0.0, 1 - pairs.distance_m[mine] / (2 * near(name).limit))
    neutral = (judged.roles[second] < 0) & pairs.mostly_inside[mine]
    excused = ~seen.in_view
    excused[first[neutral]] = True
    asked = (judged.roles > 0) & (truth.track >= 0)
    frames = []
    for number in range(len(truth.frames)):
        ours = np.flatnonzero(chosen & (detections.frame == number))
        theirs = np.flatnonzero((judged.roles != 0) & (truth.frame == number))
        similarity = np.zeros((len(theirs), len(ours)))
        here = detections.frame[first] == number
        similarity[np.searchsorted(theirs, second[here]), np.searchsorted(ours, first[here])] = (
            alike[here]
        )
        # Detections on objects that do not count, and wrong ones outside of the labelled region,
        # are excluded.
        rows, columns = _assigned(np.where(similarity >= _SAME - _EPS, similarity, 0.0))
        left = excused[ours]
        left[columns] = ~asked[theirs[rows]]
        kept = asked[theirs]
        frames.append(
            (
                truth.track[theirs[kept]],
                detections.track[ours[~left]],
                similarity[np.ix_(kept, ~left)],
            )
        )
    labelled = np.unique(np.concatenate([one for one, _, _ in frames]))
    followed = np.unique(np.concatenate([one for _, one, _ in frames]))
    return [
        Moment(np.searchsorted(labelled, one), np.searchsorted(followed, other), similarity)
        for one, other, similarity in frames
    ]


def _assigned(worth: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the pairs of the best assignment with a positive value."""
    rows, columns = linear_sum_assignment(-worth)
    real = worth[rows, columns] > 0
    return rows[real], columns[real]


def _counts(moments: Sequence[Moment]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the number of frames of each labelled and each detected track."""
    labelled = np.bincount(np.concatenate([one.labelled for one in moments]))
    followed = np.bincount(np.concatenate([one.followed for one in moments]))
    return labelled.astype(np.float64), followed.astype(np.float64)


def _summed(moments: Sequence[Moment], values: Iterable[NDArray[Any]]) -> NDArray[np.float64]:
    """Return the sum over frames of values (G, T) for each pair of labelled and detected tracks."""
    labelled, followed = _counts(moments)
    found = np.zeros((len(labelled), len(followed)))
    for one, value in zip(moments, values, strict=True):
        found[np.ix_(one.labelled, one.followed)] += value
    return found


def _among_all(similarity: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the share of each pair in the total similarity of its two members."""
    sums = similarity.sum(0)[None, :] + similarity.sum(1)[:, None] - similarity
    return np.asarray(np.divide(similarity, sums, out=np.zeros_like(sums), where=sums > _EPS))


def hota(moments: Sequence[Moment]) -> dict[str, float]:
    """Return HOTA and its parts, DetA and AssA, each the mean over `ALPHAS`.

    Args:
        moments: frames in order, with at least one label.
    """
    labelled, followed = _counts(moments)
    shared = _summed(moments, (_among_all(one.similarity) for one in moments))
    globally = shared / np.maximum(labelled[:, None] + followed[None, :] - shared, _EPS)
    right = np.zeros(len(ALPHAS))
    same = np.zeros((len(ALPHAS), len(labelled), len(followed)))
    for one in moments:
        worth = globally[np.ix_(one.labelled, one.followed)] * one.similarity
        rows, columns = linear_sum_assignment(-worth)
        for k, alpha in enumerate(ALPHAS):
            near_enough = one.similarity[rows, columns] >= alpha - _EPS
            right[k] += near_enough.sum()
            same[k, one.labelled[rows[near_enough]], one.followed[columns[near_enough]]] += 1
    either = labelled[:, None] + followed[None, :]
    association = (same * same / np.maximum(1, either[None] - same)).sum(axis=(1, 2))
    association /= np.maximum(1, right)
    detection = right / np.maximum(1, labelled.sum() + followed.sum() - right)
    return {
        "hota": float(np.sqrt(detection * association).mean()),
        "deta": float(detection.mean()),
        "assa": float(association.mean()),
    }


def clear_mot(moments: Sequence[Moment]) -> dict[str, float | int]:
    """Return MOTA, the mean similarity of matches (MOTP), and the number of identity swaps.

    Args:
        moments: frames in order, with at least one label.
    """
    last: dict[int, int] = {}
    before: dict[int, int] = {}
    right, similar, swaps = 0, 0.0, 0
    for one in moments:
        kept = np.array([before.get(int(number), -1) for number in one.labelled], np.int64)
        worth = 1000.0 * (kept[:, None] == one.followed[None, :]) + one.similarity
        worth[one.similarity < _SAME - _EPS] = 0.0
        rows, columns = _assigned(worth)
        before = {}
        for row, column in zip(rows, columns, strict=True):
            whose, who = int(one.labelled[row]), int(one.followed[column])
            swaps += last.get(whose, who) != who
            last[whose] = before[whose] = who
        right += len(rows)
        similar += float(one.similarity[rows, columns].sum())
    labelled, followed = _counts(moments)
    wrong = followed.sum() - right
    return {
        "mota": float((right - wrong - swaps) / max(1.0, labelled.sum())),
        "motp": similar / max(1, right),
        "swaps": int(swaps),
    }


def identities(moments: Sequence[Moment]) -> dict[str, float]:
    """Return IDF1, from the best assignment of whole tracks.

    Args:
        moments: frames in order, with at least one label.
    """
    labelled, followed = _counts(moments)
    shared = _summed(moments, (one.similarity >= _SAME - _EPS for one in moments))
    # Maximising right frames minimises wrong ones: an unassigned track adds no further loss.
    rows, columns = linear_sum_assignment(-shared)
    right = shared[rows, columns].sum()
    return {"idf1": float(2 * right / max(1.0, labelled.sum() + followed.sum()))}
