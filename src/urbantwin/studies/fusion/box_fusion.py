"""Late fusion: matching of boxes from several nodes, and fusion of matched pairs.

Pairs minimise the squared Mahalanobis distance in plan, over all pairs at once (assignment
problem). Two boxes are fused by covariance intersection, which stays consistent for any correlation
of the errors (S. J. Julier and J. K. Uhlmann, "A non-divergent estimation algorithm in the presence
of unknown correlations", ACC 1997), or by a Kalman update, which assumes independence. Scores are
combined as independent evidence: 1 - (1 - a)(1 - b).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from urbantwin.detections import DETECTED_CLASSES
from urbantwin.geometry import wrapped
from urbantwin.learn.decoding import Found, kept_of_overlapping
from urbantwin.studies.fusion.boxes import Boxes, joined_boxes
from urbantwin.tracking.road_user import group_of

__all__ = ["Rule", "covariance_intersection", "fused_boxes", "kalman_update", "matched_boxes"]

Rule = Literal["intersection", "kalman"]
#: Gate that contains 99 % of true pairs: chi-squared with two degrees of freedom.
_GATE = 9.21
#: Largest distance of a match, metres, however large the covariances.
_FARTHEST_M = 4.0
#: Tested weights of the first estimate in the intersection.
_SHARES = np.linspace(0.0, 1.0, 101)
#: Motion group of each class: boxes of different groups are never fused.
_GROUP = np.array(
    [sorted({group_of(one).name for one in DETECTED_CLASSES}).index(group_of(name).name)
     for name in DETECTED_CLASSES]
)  # fmt: skip

Floats = NDArray[np.float64]


def matched_boxes(first: Boxes, second: Boxes) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows of the first boxes and of the second, in the same frame, that match."""
    none = np.zeros(0, np.int64)
    if not len(first) or not len(second):
        return none, none
    off = first.box[:, None, :2] - second.box[None, :, :2]
    spread = first.covariance[:, None, :2, :2] + second.covariance[None, :, :2, :2]
    far = np.einsum("nmi,nmij,nmj->nm", off, np.linalg.inv(spread), off)
    never = (far > _GATE) | (np.hypot(off[..., 0], off[..., 1]) > _FARTHEST_M)
    never |= _GROUP[first.kind][:, None] != _GROUP[second.kind][None, :]
    gain = np.where(never, 0.0, 2 * _GATE - far)
    a, b = linear_sum_assignment(gain, maximize=True)
    good = gain[a, b] > 0
    return np.asarray(a[good], np.int64), np.asarray(b[good], np.int64)


def covariance_intersection(
    a: Floats, spread_a: Floats, b: Floats, spread_b: Floats
) -> tuple[Floats, Floats]:
    """Return fused estimates (N, K) and covariances (N, K, K).

    The weight of the first estimate is that of 101 with the smallest determinant.

    Args:
        a: (N, K) first estimates.
        spread_a: (N, K, K) their covariances.
        b: (N, K) second estimates; angles within half a turn of a's.
        spread_b: (N, K, K) their covariances.
    """
    know_a, know_b = np.linalg.inv(spread_a), np.linalg.inv(spread_b)
    share = _SHARES[None, :, None, None]
    know = share * know_a[:, None] + (1 - share) * know_b[:, None]
    best = np.linalg.slogdet(know)[1].argmax(axis=1)
    w = _SHARES[best][:, None]
    spread = np.linalg.inv(know[np.arange(len(a)), best])
    total = w * np.einsum("nij,nj->ni", know_a, a) + (1 - w) * np.einsum("nij,nj->ni", know_b, b)
    return np.einsum("nij,nj->ni", spread, total), spread


def kalman_update(
    a: Floats, spread_a: Floats, b: Floats, spread_b: Floats
) -> tuple[Floats, Floats]:
    """Return the same for independent errors; arguments as for `covariance_intersection`."""
    gain = np.linalg.solve(spread_a + spread_b, spread_a).transpose(0, 2, 1)
    after = a + np.einsum("nij,nj->ni", gain, b - a)
    spread = spread_a - gain @ spread_a
    return after, (spread + spread.transpose(0, 2, 1)) / 2


def fused_boxes(parts: list[Boxes], rule: Rule = "intersection") -> Boxes:
    """Return the fused boxes of several nodes, without overlaps.

    Args:
        parts: boxes of each node in one frame and at one time; the receiver's own first.
        rule: rule to fuse two estimates.
    """
    whole = parts[0]
    for other in parts[1:]:
        a, b = matched_boxes(whole, other)
        alone = np.setdiff1d(np.arange(len(whole)), a), np.setdiff1d(np.arange(len(other)), b)
        both = _two_as_one(whole.only(a), other.only(b), rule)
        whole = joined_boxes([both, whole.only(alone[0]), other.only(alone[1])])
    order = np.argsort(-whole.score, kind="stable")
    whole = whole.only(order)
    # Suppression returns boxes only: an eighth column identifies the kept rows.
    rows = np.arange(len(whole))
    tagged = Found(np.column_stack([whole.box, rows]), whole.kind, whole.score)
    kept = kept_of_overlapping(tagged, DETECTED_CLASSES)
    return whole.only(kept.box[:, 7].astype(np.int64))


def _two_as_one(first: Boxes, second: Boxes, rule: Rule) -> Boxes:
    if not len(first):
        return first
    a, b = _state(first), _state(second)
    # Detectors confuse front and back: headings are compared as axes.
    along = a[:, 3] + wrapped(b[:, 3] - a[:, 3], np.pi)
    back = (np.cos(along - b[:, 3]) < 0) & ~second.is_pedestrian
    b[back, 4] *= -1
    b[:, 3] = along
    fuse = covariance_intersection if rule == "intersection" else kalman_update
    after, spread = fuse(a, first.covariance, b, second.covariance)
    surer = first.score >= second.score
    weight = np.column_stack([first.score, second.score])
    weight = (weight + 1e-9) / (weight + 1e-9).sum(axis=1, keepdims=True)
    size = weight[:, :1] * first.box[:, 3:6] + weight[:, 1:] * second.box[:, 3:6]
    yaw = after[:, 3]
    ahead = np.where(surer, first.box[:, 6], second.box[:, 6])
    yaw = np.where(np.cos(yaw - ahead) < 0, yaw + np.pi, yaw)
    box = np.column_stack([after[:, :3], size, wrapped(yaw)])
    rates = after[:, 4:].copy()
    turned = (np.cos(yaw - a[:, 3]) < 0) & ~first.is_pedestrian
    rates[turned, 0] *= -1
    return replace(
        first,
        box=box,
        kind=np.where(surer, first.kind, second.kind),
        score=1 - (1 - first.score) * (1 - second.score),
        rates=rates,
        covariance=spread,
    )


def _state(boxes: Boxes) -> Floats:
    return np.column_stack([boxes.box[:, [0, 1, 2, 6]], boxes.rates])
