"""Detections of each node alone, with velocities from the node's own tracks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.detections import DETECTED_CLASSES, joined
from urbantwin.fidelity.frame import Frame
from urbantwin.geometry import Pose
from urbantwin.learn.detecting import found_in
from urbantwin.learn.model import Model
from urbantwin.studies.fusion.boxes import Boxes, moved_boxes
from urbantwin.studies.fusion.nodes import Look, Node
from urbantwin.tracking.estimation import estimates
from urbantwin.tracking.kalman import measured
from urbantwin.tracking.linking import Linking, linked, underside
from urbantwin.tracking.road_user import RoadUser, group_of

__all__ = ["detected_by", "local_pose", "with_motion"]

#: Standard deviations of a speed, m/s, and of a yaw rate, rad/s, from the third detection on.
_SPEED_M_S, _TURNS = 1.0, 0.3
_KNOWN_FROM = 3


def local_pose(frame: Frame, look: Look) -> tuple[Pose, Pose]:
    """Return the pose of a node's local frame: in the node's frame, and in the site as reported.

    The local frame has the axes of the node's frame and its origin at the mean position of the
    node's sensors. The node's messages use the local frame.

    Args:
        frame: frame of the node.
        look: time and pose of the frame.
    """
    frame_SE3_local = Pose(np.eye(3), frame.sensor_places.mean(axis=0))
    return frame_SE3_local, look.reported @ frame_SE3_local


def detected_by(model: Model, frame: Frame, least: float) -> Boxes:
    """Return the detections of a model in one node's frame alone: in the local frame, at rest.

    Args:
        model: the detector.
        frame: frame of the node.
        least: minimum score of a box.
    """
    found, _ = found_in(model, frame, least=least)
    names = [model.design.classes[one] for one in found.number]
    kind = np.array([DETECTED_CLASSES.index(name) for name in names], np.int64)
    covariance = np.zeros((len(kind), 6, 6))
    for row, name in enumerate(names):
        user = group_of(name)
        rates = (user.speed_m_s, 0.5 if user.turns else user.speed_m_s)
        covariance[row] = np.diag([*measured(user), *np.square(rates)])
    box = found.box.copy()
    box[:, :3] -= frame.sensor_places.mean(axis=0)
    return Boxes(box, kind, found.score.astype(np.float64), np.zeros((len(kind), 2)), covariance)


def with_motion(
    node: Node, seen: Mapping[int, Boxes], local: Mapping[int, Pose]
) -> dict[int, Boxes]:
    """Return a node's detections with velocities from tracks of its earlier detections.

    Args:
        node: the node.
        seen: its detections by moment, in the local frame.
        local: reported poses of the local frame.
    """
    moments = sorted(seen)
    if len(moments) < 2:
        return dict(seen)
    still = {moment: moved_boxes(seen[moment], local[moment]) for moment in moments}
    rows = [(one.box, [DETECTED_CLASSES[k] for k in one.kind], one.score) for one in still.values()]
    found = joined([str(one) for one in moments], rows)
    time_s = np.array([node.looks[one].clock_s for one in moments])
    users = [group_of(name) for name in found.class_names]
    tracks = linked(found, users, time_s, Linking())
    velocity = np.full((len(found), 2), np.nan)
    for name in sorted({users[int(one[0])].name for one in tracks}):
        _follow(found.frame, found.box, [t for t in tracks if users[int(t[0])].name == name],
                users, time_s, velocity)  # fmt: skip
    return {
        moment: moved_boxes(
            _going(still[moment], velocity[found.frame == number]), local[moment].inverse()
        )
        for number, moment in enumerate(moments)
    }


def _follow(
    frame: NDArray[np.int64],
    box: NDArray[np.float64],
    tracks: list[NDArray[np.int64]],
    users: list[RoadUser],
    time_s: NDArray[np.float64],
    velocity: NDArray[np.float64],
) -> None:
    """Set the velocities of road users that were detected often enough."""
    seen = underside(box)
    user = users[int(tracks[0][0])]
    made = estimates(
        [frame[rows] for rows in tracks], [seen[rows] for rows in tracks], user, time_s,
        smooth=False,
    )  # fmt: skip
    for rows, one in zip(tracks, made, strict=True):
        known = rows[_KNOWN_FROM - 1 :]
        velocity[known] = one.velocity[frame[known] - one.frame[0]]


def _going(boxes: Boxes, velocity: NDArray[np.float64]) -> Boxes:
    """Return boxes with velocities (N, 2) in the site frame; NaN where they are unknown."""
    known = np.isfinite(velocity[:, 0])
    ahead = np.column_stack([np.cos(boxes.box[:, 6]), np.sin(boxes.box[:, 6])])
    along = np.column_stack([(velocity * ahead).sum(axis=1), np.zeros(len(boxes))])
    rates = np.where(boxes.is_pedestrian[:, None], velocity, along)
    covariance = boxes.covariance.copy()
    covariance[known, 4, 4] = _SPEED_M_S**2
    covariance[known, 5, 5] = np.where(boxes.is_pedestrian[known], _SPEED_M_S, _TURNS) ** 2
    return replace(boxes, rates=np.where(known[:, None], rates, 0.0), covariance=covariance)
