"""Articulation: where the stiff bodies of a vehicle that bends are, from the way of its nose.

Each body hangs between two guides (`assets.Body`). On rails both lie on the track. On a road the
front one is the joint to the body ahead, and the rear axle follows it without sliding sideways,
along a tractrix.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import stations_of_points
from urbantwin.traffic.assets.body import Body

__all__ = ["Poses", "on_rails", "towed"]

#: How far a towed axle is moved at a time, metres: a tractrix is followed in small steps.
_STEP_M = 0.05

Poses = list[tuple[NDArray[np.float64], NDArray[np.float64]]]


def on_rails(
    bodies: Sequence[Body], track: NDArray[np.float64], nose_m: NDArray[np.float64]
) -> Poses:
    """Return where bodies are whose guides lie on a track.

    Args:
        bodies: from the nose.
        track: (P, 2) points of the track, as far back as the vehicle is long, metres.
        nose_m: (N,) how far along the track the nose is, metres; before its first and beyond its
            last point the track goes straight on.

    Returns:
        Of each body the middle (N, 2) and the heading (N,), rad, continuous.
    """
    return [
        _between(body, *(_along(track, nose_m - guide) for guide in body.guides_m))
        for body in bodies
    ]


def towed(
    bodies: Sequence[Body],
    middle: NDArray[np.float64],
    yaw: NDArray[np.float64],
    *,
    length_m: float,
) -> Poses:
    """Return where bodies are of which the first drives and the others are towed.

    Args:
        bodies: from the nose; the first guide of a towed one is its joint.
        middle: (N, 2) the middle of a piece from the nose on that does not bend, site frame.
        yaw: (N,) heading of the first, rad.
        length_m: of that piece.

    Returns:
        Of each body the middle (N, 2) and the heading (N,), rad, continuous.
    """
    nose = middle + _unit(yaw) * (length_m / 2)
    first = bodies[0]
    found = [(nose - _unit(yaw) * first.middle_m, yaw)]
    ahead_m, ahead = first.middle_m, found[0]
    for body in bodies[1:]:
        joint = ahead[0] + _unit(ahead[1]) * (ahead_m - body.guides_m[0])
        axle = _tractrix(joint, float(ahead[1][0]), body.guides_m[1] - body.guides_m[0])
        ahead_m, ahead = body.middle_m, _between(body, joint, axle)
        found.append(ahead)
    return found


def _between(
    body: Body, front: NDArray[np.float64], rear: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the middle and the heading of a body by its guides, each (N, 2)."""
    chord = front - rear
    yaw = np.unwrap(np.arctan2(chord[:, 1], chord[:, 0]))
    guides = (front + rear) / 2
    return guides + _unit(yaw) * (sum(body.guides_m) / 2 - body.middle_m), yaw


def _along(track: NDArray[np.float64], at_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points (N, 2) of a track at stations, straight on beyond its ends."""
    along = stations_of_points(track)
    points = np.column_stack([np.interp(at_m, along, track[:, k]) for k in (0, 1)])
    for end, inner, beyond in ((0, 1, at_m), (-1, -2, at_m - along[-1])):
        out = np.maximum(-beyond if end == 0 else beyond, 0.0)
        ahead = (track[end] - track[inner]) / max(np.linalg.norm(track[end] - track[inner]), 1e-9)
        points += out[:, None] * ahead
    return np.asarray(points)


def _tractrix(joint: NDArray[np.float64], yaw: float, bar_m: float) -> NDArray[np.float64]:
    """Return where an axle (N, 2) is that a bar of some length pulls behind a joint (N, 2)."""
    axle = np.empty_like(joint)
    axle[0] = joint[0] - bar_m * np.array([np.cos(yaw), np.sin(yaw)])
    # Plain numbers: of two at a time, arrays take ten times as long.
    (from_x, from_y), (x, y) = joint[0].tolist(), axle[0].tolist()
    for k, (to_x, to_y) in enumerate(joint[1:].tolist(), 1):
        leg_x, leg_y = to_x - from_x, to_y - from_y
        steps = max(1, math.ceil(math.sqrt(leg_x * leg_x + leg_y * leg_y) / _STEP_M))
        for step in range(1, steps + 1):
            share = step / steps
            pull_x, pull_y = from_x + share * leg_x, from_y + share * leg_y
            bar_x, bar_y = x - pull_x, y - pull_y
            drawn = bar_m / max(math.sqrt(bar_x * bar_x + bar_y * bar_y), 1e-9)
            x, y = pull_x + bar_x * drawn, pull_y + bar_y * drawn
        axle[k] = x, y
        from_x, from_y = to_x, to_y
    return axle


def _unit(yaw: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([np.cos(yaw), np.sin(yaw)])
