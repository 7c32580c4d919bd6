"""Kalman filters of many road users at once: prediction, correction, smoothing.

A state is x, y, z, yaw and two rates. Pedestrians: the velocity in x and y, constant except for
process noise (Y. Bar-Shalom, X. R. Li, T. Kirubarajan, "Estimation with Applications to Tracking
and Navigation", 2001, chapter 6.2). All others: the speed along the heading and the yaw rate,
linearised at the state ("constant turn rate and velocity", R. Schubert, E. Richter, G. Wanielik,
"Comparison and evaluation of advanced motion models for vehicle tracking", FUSION 2008).

The yaw rate decays, since turns are short. Smoothing follows H. E. Rauch, F. Tung and C. T.
Striebel, "Maximum likelihood estimates of linear dynamic systems", AIAA Journal 3(8), 1965.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import wrapped
from urbantwin.tracking.road_user import RoadUser

__all__ = ["SEEN", "STATE", "begun", "corrected", "innovation", "measured", "predicted", "smoothed"]

#: Size of a state, and of its measured part: x, y, z, yaw.
STATE, SEEN = 6, 4
#: Time constant of the decay of the yaw rate, seconds.
_YAW_RATE_DECAY_S = 2.0
#: Random walk of heights, metres per root second.
_HEIGHT_WALK_M = 0.3
#: Error of a detected axis above which it is an outlier, radians; or twice the standard deviation.
_AXIS_OUTLIER_RAD = 0.6
#: Half a turn: a detection measures the axis, not the front.
_HALF_TURN_RAD = np.pi

Floats = NDArray[np.float64]


def begun(seen: Floats, user: RoadUser) -> tuple[Floats, Floats]:
    """Return states (T, 6) and covariances (T, 6, 6) after one detection (T, 4) each."""
    state = np.zeros((len(seen), STATE))
    state[:, :SEEN] = seen
    spread = [user.place_m, user.place_m, user.height_m, max(user.yaw, 0.5)]
    spread += [user.speed_m_s, 0.5 if user.turns else user.speed_m_s]
    return state, np.tile(np.diag(np.square(spread)), (len(seen), 1, 1))


def measured(user: RoadUser) -> Floats:
    """Return the variances (4,) of detections: x, y, z, yaw."""
    return np.square([user.place_m, user.place_m, user.height_m, user.yaw])


def predicted(
    state: Floats, covariance: Floats, seconds: Floats, user: RoadUser
) -> tuple[Floats, Floats, Floats]:
    """Return predicted states and covariances, and the Jacobians (T, 6, 6) of the transition.

    Args:
        state: (T, 6).
        covariance: (T, 6, 6).
        seconds: (T,) time step, above zero.
        user: the motion model.
    """
    after, jacobian = state.copy(), np.tile(np.eye(STATE), (len(state), 1, 1))
    noise = np.zeros_like(jacobian)
    noise[:, 2, 2] = _HEIGHT_WALK_M**2 * seconds
    if user.turns:
        fade = np.exp(-seconds / _YAW_RATE_DECAY_S)
        turned = _YAW_RATE_DECAY_S * (1.0 - fade)
        along = state[:, 3] + state[:, 5] * turned / 2
        c, s = np.cos(along), np.sin(along)
        travelled = state[:, 4] * seconds
        after[:, 0] += travelled * c
        after[:, 1] += travelled * s
        after[:, 3] += state[:, 5] * turned
        after[:, 5] *= fade
        jacobian[:, 0, 3], jacobian[:, 1, 3] = -travelled * s, travelled * c
        jacobian[:, 0, 4], jacobian[:, 1, 4] = seconds * c, seconds * s
        jacobian[:, 0, 5], jacobian[:, 1, 5] = (
            -travelled * s * turned / 2,
            travelled * c * turned / 2,
        )
        jacobian[:, 3, 5], jacobian[:, 5, 5] = turned, fade
        _add_process_noise(noise, np.column_stack([c, s]), (0, 1), 4, seconds, user.accelerates)
        _add_process_noise(noise, np.ones((len(state), 1)), (3,), 5, seconds, user.swerves)
        across = np.column_stack([-s, c])
        slip = user.slips_m**2 * seconds
        noise[:, :2, :2] += slip[:, None, None] * across[:, :, None] * across[:, None, :]
    else:
        for axis in (0, 1):
            after[:, axis] += state[:, 4 + axis] * seconds
            jacobian[:, axis, 4 + axis] = seconds
            ones = np.ones((len(state), 1))
            _add_process_noise(noise, ones, (axis,), 4 + axis, seconds, user.accelerates)
        noise[:, 3, 3] = user.swerves * seconds
    covariance = jacobian @ covariance @ jacobian.transpose(0, 2, 1) + noise
    return after, covariance, jacobian


def _add_process_noise(
    noise: Floats,
    way: Floats,
    places: tuple[int, ...],
    rate: int,
    seconds: Floats,
    density: float,
) -> None:
    """Add the noise of a rate with white-noise derivative, and of the positions that follow it."""
    for i, place in enumerate(places):
        noise[:, place, rate] += density * seconds**2 / 2 * way[:, i]
        noise[:, rate, place] += density * seconds**2 / 2 * way[:, i]
        for k, other_place in enumerate(places):
            noise[:, place, other_place] += density * seconds**3 / 3 * way[:, i] * way[:, k]
    noise[:, rate, rate] += density * seconds


def innovation(state: Floats, seen: Floats) -> Floats:
    """Return detections (..., 4) minus states (..., 6): yaw within a quarter turn."""
    off = seen - state[..., :SEEN]
    off[..., 3] = wrapped(off[..., 3], _HALF_TURN_RAD)
    return np.asarray(off)


def corrected(
    state: Floats, covariance: Floats, seen: Floats, user: RoadUser
) -> tuple[Floats, Floats]:
    """Return states and covariances updated by one detection (T, 4) each."""
    if not user.turns:
        # A pedestrian faces its direction of motion, which is a second measurement of its axis.
        state, covariance = _axes_by_course(state, covariance)
    off = innovation(state, seen)
    noise = np.tile(measured(user), (len(state), 1))
    usual = np.maximum(_AXIS_OUTLIER_RAD, 2 * np.sqrt(covariance[:, 3, 3]))
    noise[:, 3] *= np.maximum(1.0, np.abs(off[:, 3]) / usual) ** 4
    total = covariance[:, :SEEN, :SEEN].copy()
    total[:, range(SEEN), range(SEEN)] += noise
    gain = np.linalg.solve(total, covariance[:, :SEEN, :]).transpose(0, 2, 1)
    after = state + np.einsum("tij,tj->ti", gain, off)
    covariance = covariance - gain @ covariance[:, :SEEN, :]
    return after, (covariance + covariance.transpose(0, 2, 1)) / 2


def _axes_by_course(state: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Return pedestrians' states with axes corrected by the direction of motion."""
    pace = np.hypot(state[:, 4], state[:, 5])
    course = np.arctan2(state[:, 5], state[:, 4])
    spread = np.sqrt(np.maximum(covariance[:, 4, 4], covariance[:, 5, 5]))
    course_variance = np.where(
        pace > 2 * spread, (spread / np.maximum(pace, 1e-6)) ** 2 + 0.2**2, np.inf
    )
    gain = covariance[:, 3, 3] / (covariance[:, 3, 3] + course_variance)
    state, covariance = state.copy(), covariance.copy()
    state[:, 3] += gain * wrapped(course - state[:, 3], _HALF_TURN_RAD)
    covariance[:, 3, 3] *= 1.0 - gain
    return state, covariance


def smoothed(
    state: Floats, covariance: Floats, later: Floats, foreseen: tuple[Floats, Floats, Floats]
) -> Floats:
    """Return smoothed states (T, 6) at a time.

    Args:
        state: (T, 6) filtered states at this time.
        covariance: (T, 6, 6) covariances of the filtered states.
        later: (T, 6) smoothed states of the next time.
        foreseen: result of `predicted` for the next time.
    """
    expected, spread, jacobian = foreseen
    gain = np.linalg.solve(spread, jacobian @ covariance).transpose(0, 2, 1)
    return np.asarray(state + np.einsum("tij,tj->ti", gain, later - expected))
