"""Boxes of road users with motion and covariance: transformation to other frames and times.

Motion is predicted as by the filters of `tracking`, with constant speed and yaw rate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.detections import DETECTED_CLASSES
from urbantwin.geometry import Pose, wrapped
from urbantwin.learn.compiled.box_points import points_in_boxes
from urbantwin.tracking.kalman import SEEN, STATE, predicted
from urbantwin.tracking.road_user import group_of

__all__ = [
    "Boxes", "advanced_boxes", "advanced_points", "joined_boxes", "moved_boxes", "moving_of",
    "places_before", "standing_boxes",
]  # fmt: skip

#: A slower road user is static, m/s.
_SLOWEST_M_S = 0.5
#: Margin around a box within which points belong to it, metres.
_BESIDE_M = 0.15

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Boxes:
    """Road users known to a node at one moment.

    Attributes:
        box: (N, 7) centre, length, width, height, yaw, in metres and radians.
        kind: (N,) int64, numbers in ``DETECTED_CLASSES``.
        score: (N,) float64, 0..1.
        rates: (N, 2) for pedestrians the velocity in x and y, m/s; for others the speed along the
            heading, m/s, and the yaw rate, rad/s, as in `tracking.kalman`.
        covariance: (N, 6, 6) of x, y, z, yaw and the two rates.
    """

    box: Floats
    kind: NDArray[np.int64]
    score: Floats
    rates: Floats
    covariance: Floats

    def __len__(self) -> int:
        """Return the number of boxes."""
        return len(self.box)

    def only(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> Boxes:
        """Return selected boxes."""
        return Boxes(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))

    @property
    def is_pedestrian(self) -> NDArray[np.bool_]:
        """Which boxes (N,) are pedestrians, which can move in any direction."""
        return np.asarray(self.kind == DETECTED_CLASSES.index("pedestrian"))

    @property
    def velocity(self) -> Floats:
        """Velocities (N, 2) in x and y, m/s."""
        ahead = np.column_stack([np.cos(self.box[:, 6]), np.sin(self.box[:, 6])])
        return np.where(self.is_pedestrian[:, None], self.rates, self.rates[:, :1] * ahead)


def standing_boxes(box: Floats, kind: NDArray[np.int64], score: Floats) -> Boxes:
    """Return boxes (N, 7) at rest, of which no covariance is known."""
    return Boxes(box, kind, score, np.zeros((len(box), 2)), np.zeros((len(box), 6, 6)))


def joined_boxes(parts: list[Boxes]) -> Boxes:
    """Return the boxes of several as one."""
    names = Boxes.__dataclass_fields__
    return Boxes(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def moved_boxes(boxes: Boxes, outer_SE3_inner: Pose) -> Boxes:
    """Return boxes in another frame, upright, with rates and covariance turned along."""
    box, turn = boxes.box.copy(), outer_SE3_inner.rotation
    box[:, :3] = outer_SE3_inner.apply(box[:, :3])
    ahead = np.column_stack([np.cos(box[:, 6]), np.sin(box[:, 6]), np.zeros(len(box))]) @ turn.T
    box[:, 6] = np.arctan2(ahead[:, 1], ahead[:, 0])
    level = np.arctan2(turn[1, 0], turn[0, 0])
    c, s = np.cos(level), np.sin(level)
    plan = np.array([[c, -s], [s, c]])
    rates = np.where(boxes.is_pedestrian[:, None], boxes.rates @ plan.T, boxes.rates)
    jacobian = np.tile(np.eye(6), (len(box), 1, 1))
    jacobian[:, :2, :2] = plan
    jacobian[boxes.is_pedestrian, 4:, 4:] = plan
    covariance = jacobian @ boxes.covariance @ jacobian.transpose(0, 2, 1)
    return replace(boxes, box=box, rates=rates, covariance=covariance)


def moving_of(boxes: Boxes) -> NDArray[np.bool_]:
    """Return which boxes (N,) move."""
    return np.asarray(np.hypot(*boxes.velocity.T) > _SLOWEST_M_S)


def advanced_boxes(boxes: Boxes, seconds: float) -> Boxes:
    """Return boxes predicted to a later time, with their covariance.

    Args:
        boxes: boxes in a static frame.
        seconds: time to predict, seconds; not below 0.
    """
    if seconds <= 0 or not len(boxes):
        return boxes
    state = np.zeros((len(boxes), STATE))
    state[:, :SEEN] = boxes.box[:, [0, 1, 2, 6]]
    state[:, SEEN:] = boxes.rates
    after, spread = state.copy(), boxes.covariance.copy()
    for kind in np.unique(boxes.kind):
        rows = np.flatnonzero(boxes.kind == kind)
        later = np.full(len(rows), seconds)
        user = group_of(DETECTED_CLASSES[int(kind)])
        after[rows], spread[rows], _ = predicted(state[rows], spread[rows], later, user)
    box = boxes.box.copy()
    box[:, :3], box[:, 6] = after[:, :3], wrapped(after[:, 3])
    return replace(boxes, box=box, rates=after[:, SEEN:], covariance=spread)


def advanced_points(points: Floats, before: Boxes, after: Boxes) -> Floats:
    """Return points (N, 3), with those in boxes moved along with the boxes.

    Args:
        points: points in the boxes' frame.
        before: road users at the time of the points.
        after: the same road users now.
    """
    if not len(before) or not len(points):
        return points
    owner = points_in_boxes(points.astype(np.float32), before.box, _BESIDE_M)
    rows = np.flatnonzero(owner >= 0)
    moved = points.copy()
    moved[rows, :2] = _carried(points[rows, :2], before.box[owner[rows]], after.box[owner[rows]])
    return moved


def places_before(places: Floats, before: Boxes, after: Boxes) -> tuple[Floats, NDArray[np.bool_]]:
    """Return former positions of present ones (N, 2), and which (N,) have valid former content.

    A position in a box now was in the same box before. A position that was in a box and is in none
    now was occluded by the road user, and is unknown.

    Args:
        places: positions in the boxes' frame.
        before: road users at the former time.
        after: the same road users now.
    """
    if not len(before):
        return places, np.ones(len(places), bool)
    owner = _in_plan(places, after)
    left = (_in_plan(places, before) >= 0) & (owner < 0)
    rows = np.flatnonzero(owner >= 0)
    then = places.copy()
    then[rows] = _carried(places[rows], after.box[owner[rows]], before.box[owner[rows]])
    return then, ~left


def _carried(places: Floats, source: Floats, target: Floats) -> Floats:
    """Return positions (N, 2) in boxes (N, 7), moved along with the boxes to others (N, 7)."""
    turn = target[:, 6] - source[:, 6]
    c, s = np.cos(turn), np.sin(turn)
    x, y = (places - source[:, :2]).T
    return np.column_stack([target[:, 0] + c * x - s * y, target[:, 1] + s * x + c * y])


def _in_plan(places: Floats, boxes: Boxes) -> NDArray[np.int64]:
    """Return in which box (N,) places (N, 2) are in plan; -1 for none."""
    flat = np.column_stack([places, np.zeros(len(places))]).astype(np.float32)
    box = boxes.box.copy()
    box[:, 2], box[:, 5] = 0.0, 1.0
    owner: NDArray[np.int64] = points_in_boxes(flat, box, _BESIDE_M)
    return owner
