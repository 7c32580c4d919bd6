"""What was seen a while ago, moved to where it is now: boxes, points, cells of a map.

Road users go on as the filters of `tracking` foresee it: at the speed, and with the rate of turn,
that their node told. What stands stays where it is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.detections import DETECTED_CLASSES
from urbantwin.geometry import wrapped
from urbantwin.learn.compiled.box_points import points_in_boxes
from urbantwin.studies.fusion.box_codec import Boxes
from urbantwin.tracking.kalman import SEEN, STATE, predicted
from urbantwin.tracking.road_user import group_of

__all__ = ["advanced_boxes", "advanced_points", "moving_of", "places_before"]

#: Who is slower stands, m/s.
SLOWEST_M_S = 0.5
#: Points so near to a box are its own, metres.
_BESIDE_M = 0.15


def moving_of(boxes: Boxes) -> NDArray[np.bool_]:
    """Return which boxes (N,) move."""
    return np.asarray(np.hypot(*boxes.velocity.T) > SLOWEST_M_S)


def advanced_boxes(boxes: Boxes, seconds: float) -> Boxes:
    """Return boxes some time later, and how much less is known of them then.

    Args:
        boxes: in a frame of reference that stands.
        seconds: how much later; nothing is moved back.
    """
    if seconds <= 0 or not len(boxes):
        return boxes
    state = np.zeros((len(boxes), STATE))
    state[:, :SEEN] = boxes.box[:, [0, 1, 2, 6]]
    state[:, SEEN:] = boxes.rates
    after, spread = state.copy(), boxes.covariance.copy()
    for kind in np.unique(boxes.kind):
        mine = np.flatnonzero(boxes.kind == kind)
        later = np.full(len(mine), seconds)
        user = group_of(DETECTED_CLASSES[int(kind)])
        after[mine], spread[mine], _ = predicted(state[mine], spread[mine], later, user)
    box = boxes.box.copy()
    box[:, :3], box[:, 6] = after[:, :3], wrapped(after[:, 3])
    return replace(boxes, box=box, rates=after[:, SEEN:], covariance=spread)


def advanced_points(
    points: NDArray[np.float64], before: Boxes, after: Boxes
) -> NDArray[np.float64]:
    """Return points (N, 3) with those in boxes moved as the boxes are.

    Args:
        points: in the frame of the boxes.
        before: where road users were when the points were measured.
        after: where the same ones are now.
    """
    if not len(before) or not len(points):
        return points
    owner = points_in_boxes(points.astype(np.float32), before.box, _BESIDE_M)
    mine = np.flatnonzero(owner >= 0)
    moved = points.copy()
    of = owner[mine]
    turn = after.box[of, 6] - before.box[of, 6]
    c, s = np.cos(turn), np.sin(turn)
    x, y = (points[mine, :2] - before.box[of, :2]).T
    moved[mine, 0] = after.box[of, 0] + c * x - s * y
    moved[mine, 1] = after.box[of, 1] + s * x + c * y
    return moved


def places_before(
    places: NDArray[np.float64], before: Boxes, after: Boxes
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return where places (N, 2) of now were then, and which of them (N,) show anything of then.

    What is in a box now was in the same box then; what was in a box then and is in none now has
    been left, and nothing is known of it.

    Args:
        places: in the frame of the boxes.
        before: where road users were.
        after: where the same ones are now.
    """
    if not len(before):
        return places, np.ones(len(places), bool)
    owner = _in_plan(places, after)
    left = (_in_plan(places, before) >= 0) & (owner < 0)
    mine = np.flatnonzero(owner >= 0)
    of = owner[mine]
    turn = before.box[of, 6] - after.box[of, 6]
    c, s = np.cos(turn), np.sin(turn)
    x, y = (places[mine] - after.box[of, :2]).T
    found = places.copy()
    found[mine, 0] = before.box[of, 0] + c * x - s * y
    found[mine, 1] = before.box[of, 1] + s * x + c * y
    return found, ~left


def _in_plan(places: NDArray[np.float64], boxes: Boxes) -> NDArray[np.int64]:
    flat = np.column_stack([places, np.zeros(len(places))]).astype(np.float32)
    box = boxes.box.copy()
    box[:, 2], box[:, 5] = 0.0, 1.0
    found: NDArray[np.int64] = points_in_boxes(flat, box, _BESIDE_M)
    return found
