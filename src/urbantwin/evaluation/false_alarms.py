"""False alarms by reason, and recurring ones at one position."""

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

#: Reasons why a detection is wrong; the first that applies counts.
REASONS = {
    "twice": "of an object that another detection has found",
    "misplaced": "near an object of its class or overlapping it, but not near enough",
    "class": "at an object of another class",
    "nothing": "where no labelled object is",
}
#: False alarms within this distance are at one position, metres.
_PLACE_M = 1.0
#: Minimum share and number of frames in which recurring false alarms occur.
_OFTEN, _FEWEST = 0.5, 4


def false_alarm_reasons(
    found: Matched, pairs: Pairs, roles: NDArray[np.int64], criterion: Criterion
) -> list[str]:
    """Return why each detection (M,) is wrong, one of ``REASONS``; empty if it is right.

    Args:
        found: detections of a class.
        pairs: pairs of all detections and objects.
        roles: (L,) role of every object for that class.
        criterion: criterion by which detections are right.
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
    """Return the number of wrong detections that recur at one position in half of the frames.

    With a fixed sensor these are static objects: posts, signs, hedges.

    Args:
        seen: the frames.
        detections: (W,) indices of the wrong detections.

    Returns:
        The number of recurring detections, and of their positions; None with too few frames.
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
