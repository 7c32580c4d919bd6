"""What wrong detections are: of what is there, how often, and whether always at one place."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from urbantwin.detections import frames_about
from urbantwin.evaluation.criterion import Criterion
from urbantwin.evaluation.matching import Matched
from urbantwin.evaluation.pairs import Pairs
from urbantwin.evaluation.reading import Seen

__all__ = ["REASONS", "false_alarm_reasons", "standing_false_alarms"]

#: Why a detection is wrong, the first that holds.
REASONS = {
    "twice": "of an object that another detection has found",
    "misplaced": "near an object of its class or overlapping it, but not near enough",
    "class": "at an object of another class",
    "nothing": "where no labelled object is",
}
#: False alarms within this distance of each other are at one place, metres.
_PLACE_M = 1.0
#: In this share of the frames, and in no fewer than so many frames.
_OFTEN, _FEWEST = 0.5, 4


def false_alarm_reasons(
    found: Matched, pairs: Pairs, roles: NDArray[np.int64], criterion: Criterion
) -> list[str]:
    """Return why each detection (M,) is wrong, one of ``REASONS``; empty where it is right.

    Args:
        found: the detections of a class.
        pairs: of all detections and objects.
        roles: (L,) of every object for that class.
        criterion: by which they are right.
    """
    wrong = set(found.detection[~found.right].tolist())
    reasons = dict.fromkeys(wrong, "nothing")
    meets = pairs.meet(criterion)
    wider = Criterion(criterion.measure, 2 * criterion.limit)
    close = pairs.meet(wider) if criterion.measure == "distance_m" else pairs.bev_iou > 0
    own = roles[pairs.label] > 0
    for reason, chosen in (
        ("class", ~own & meets),
        ("misplaced", own & (close | (pairs.bev_iou > 0))),
        ("twice", own & meets),
    ):
        for detection in pairs.detection[chosen].tolist():
            if detection in wrong:
                reasons[detection] = reason
    return [reasons.get(one, "") for one in found.detection.tolist()]


def standing_false_alarms(seen: Seen, detections: NDArray[np.int64]) -> Mapping[str, float] | None:
    """Return how many wrong detections come at one place in half of the frames or more.

    Where a sensor stands still, such are of what always stands there: posts, signs, hedges.

    Args:
        seen: the frames.
        detections: (W,) numbers of the wrong ones.

    Returns:
        How many of them do, and at how many places; None with too few frames to tell.
    """
    count = len(seen.truth.frames)
    if count < _FEWEST:
        return None
    places = seen.detections.box[detections, :2]
    frames = seen.detections.frame[detections]
    near, seen_in = frames_about(places, frames, _PLACE_M)
    often = seen_in >= max(_OFTEN * count, _FEWEST)
    left = set(np.flatnonzero(often).tolist())
    groups = 0
    while left:
        left -= set(near[min(left)])
        groups += 1
    return {"detections": int(often.sum()), "places": groups}
