"""Trajectories: SUMO's positions, which jump between lanes, smoothed into drivable paths.

SUMO moves an actor along the centre lines of lanes. Consecutive lines need not touch nor have their
geometric length, so that the position may jump by a metre while the simulated speed does not
change. Therefore the integral of the speed is kept as distance, and the position is smoothed as a
function of it.

A standing actor stays still, and none moves backwards. In SUMO parallel lanes of a curve have one
length, so that a vehicle that changes between them jumps by metres along the road, which is spread
over a longer distance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import atan, exp, pi, tan

import numpy as np
from numpy.typing import NDArray

__all__ = ["Trajectory", "smoothed", "steered"]


def steered(
    xy: NDArray[np.float64], yaw: NDArray[np.float64], rear_m: float
) -> NDArray[np.float64]:
    """Return the headings (N,) of a vehicle whose centre follows a path; the rear axle trails.

    The rear axle moves along the heading (the bicycle model; Rajamani, Vehicle Dynamics and
    Control, 2012, section 2.2), so the heading is the tractrix's of the path. On a straight piece
    tan(d / 2) decays with exp(-s / rear_m), d being the angle from the heading to the path. A
    standing vehicle keeps its heading. In a steady curve of radius R the heading lags the centre's
    course by asin(rear_m / R).

    Args:
        xy: (N, 2) centre of the vehicle, m.
        yaw: (N,) heading, of which only the first is used, rad.
        rear_m: distance of the rear axle behind the centre.
    """
    if rear_m <= 0 or len(yaw) < 2:
        return yaw.copy()
    moved = np.diff(xy, axis=0)
    lengths_m, course = np.hypot(*moved.T).tolist(), np.arctan2(moved[:, 1], moved[:, 0]).tolist()
    heading = [float(yaw[0])]
    for length, towards in zip(lengths_m, course, strict=True):
        off = (towards - heading[-1] + pi) % (2 * pi) - pi
        left = 2 * atan(tan(off / 2) * exp(-length / rear_m))
        heading.append(heading[-1] + off - left)
    return np.array(heading)


_GRID_M = 0.1
#: Widths of fit windows. Vehicles follow their curves (local parabolas), more gently at higher
#: speed, since a driver takes about a second to turn the wheel. Pedestrians cut the corners of
#: walking areas, where SUMO moves them to and fro by a metre (local lines).
_WINDOWS_M = {"vehicle": (6.0, 10.0, 14.0, 18.0), "person": (2.6,)}
_STEERING_S = 1.0
_DEGREE = {"vehicle": 2, "person": 1}
_MIN_EXTENT_M = 0.5  # a path with a smaller extent has no direction of travel
#: Jump along the road above which it is corrected, and distance before and after over which it is
#: spread, metres.
_MIN_LEAP_M, _LEAP_SPREAD_M = 0.75, 15.0


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The path of one actor, (N,) samples in time.

    Attributes:
        xy: (N, 2) centre of the actor's bounds, site frame, m.
        yaw: (N,) heading, counter-clockwise from east, rad, continuous (not wrapped).
        distance_m: (N,) distance travelled since the first sample.
        speed: (N,) m/s, SUMO's except where a jump is corrected.
    """

    xy: NDArray[np.float64]
    yaw: NDArray[np.float64]
    distance_m: NDArray[np.float64]
    speed: NDArray[np.float64]


def smoothed(
    front: NDArray[np.float64],
    angle_deg: NDArray[np.float64],
    speed: NDArray[np.float64],
    *,
    step_s: float,
    length_m: float,
    walks: bool,
) -> Trajectory:
    """Return the trajectory of one actor from consecutive samples.

    Position and heading are fitted by local polynomials over the distance travelled (Savitzky and
    Golay, Analytical Chemistry 36, 1964), which keep curves and smooth jumps. Vehicles keep SUMO's
    heading, from the rear to the front along the lane; pedestrians face their direction of travel.

    Args:
        front: (N, 2) SUMO's position: the middle of the front, m.
        angle_deg: (N,) SUMO's angle, clockwise from north.
        speed: (N,) m/s, over the step that ends at each sample.
        step_s: time between samples, seconds.
        length_m: the actor's length.
        walks: whether it is a pedestrian.
    """
    yaw = np.unwrap(np.pi / 2 - np.radians(angle_deg))
    distance = np.concatenate([[0.0], np.cumsum(speed[1:]) * step_s])
    total = float(distance[-1])
    if total < _MIN_EXTENT_M:
        point, heading = front.mean(axis=0), np.full(len(yaw), np.median(yaw))
        start = distance - distance.mean()
        ahead = np.column_stack([np.cos(heading), np.sin(heading)])
        return Trajectory(point + ahead * (start - length_m / 2)[:, None], heading, distance, speed)
    if not walks:
        front, yaw, speed = _without_leaps(front, yaw, speed, distance, step_s)
    grid = np.linspace(0.0, total, max(int(np.ceil(total / _GRID_M)), 3) + 1)
    kind, spacing = "person" if walks else "vehicle", float(grid[1])
    steering_m = _STEERING_S * np.interp(grid, *_by_distance(distance, speed))
    x, y, heading = (
        _smoothed_twice(np.interp(grid, *_by_distance(distance, values)), spacing, kind, steering_m)
        for values in (front[:, 0], front[:, 1], yaw)
    )
    if walks:
        course = (
            _smoothed_twice(np.gradient(values), spacing, kind, steering_m) for values in (y, x)
        )
        heading = np.unwrap(np.arctan2(*course))
    at_x, at_y, at_yaw = (np.interp(distance, grid, values) for values in (x, y, heading))
    back = length_m / 2
    return Trajectory(
        np.column_stack([at_x - np.cos(at_yaw) * back, at_y - np.sin(at_yaw) * back]),
        at_yaw,
        distance,
        speed,
    )


def _without_leaps(
    front: NDArray[np.float64],
    yaw: NDArray[np.float64],
    speed: NDArray[np.float64],
    distance: NDArray[np.float64],
    step_s: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return front (N, 2), heading (N,) and speed (N,) without jumps along the road.

    The path stays; the speed changes a little around the jump.
    """
    ahead = np.column_stack([np.cos(yaw), np.sin(yaw)])
    onward = (np.diff(front, axis=0) * ahead[:-1]).sum(axis=1)
    leaps = np.abs(onward - np.diff(distance)) > _MIN_LEAP_M
    if not leaps.any():
        return front, yaw, speed
    # The path of forward motion, without steps back.
    forward = [0]
    for row in range(1, len(front)):
        if (front[row] - front[forward[-1]]) @ ahead[forward[-1]] > 0:
            forward.append(row)
    station_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(front[forward], axis=0).T))])
    # Smoothed lead over the simulated distance.
    grid = np.arange(-_LEAP_SPREAD_M, distance[-1] + _LEAP_SPREAD_M, _GRID_M)
    gain = np.interp(grid, distance[forward], station_m - distance[forward])
    width = 2 * round(_LEAP_SPREAD_M / _GRID_M) + 1
    padded = np.pad(gain, width // 2, mode="edge")
    gain = np.convolve(padded, np.full(width, 1 / width), "valid")
    place = np.maximum.accumulate(distance + np.interp(distance, grid, gain))
    moved = np.concatenate([speed[:1], np.diff(place) / step_s])
    return (
        np.column_stack([np.interp(place, station_m, front[forward, axis]) for axis in (0, 1)]),
        np.interp(place, station_m, yaw[forward]),
        np.clip(moved, 0.0, None),
    )


def _by_distance(
    distance: NDArray[np.float64], values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return distinct distances and the mean value at each (one where the actor stood)."""
    distinct, group = np.unique(np.round(distance, 3), return_inverse=True)
    return distinct, np.bincount(group, values) / np.bincount(group)


def _smoothed_twice(
    values: NDArray[np.float64], spacing: float, kind: str, wanted_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Fit local polynomials twice, so that the result has no corners.

    Args:
        values: (N,) values to smooth, every ``spacing`` metres.
        spacing: metres.
        kind: ``vehicle`` or ``person``.
        wanted_m: (N,) wanted width of the window at each; results between two fitted widths are
            interpolated.
    """
    windows = _WINDOWS_M[kind]
    fits = []
    for window_m in windows:
        wanted = round(window_m / spacing / 2) * 2 + 1
        hat = _hat(min(wanted, len(values) - 1 + len(values) % 2), _DEGREE[kind])
        fits.append(_fitted(_fitted(values, hat), hat))
        if window_m >= wanted_m.max():
            break
    place = np.interp(wanted_m, windows, np.arange(len(windows))).clip(0, len(fits) - 1)
    below = np.floor(place).astype(int)
    share = place - below
    column = np.arange(len(values))
    all_fits = np.array(fits)
    above = np.minimum(below + 1, len(fits) - 1)
    return np.asarray(all_fits[below, column] * (1 - share) + all_fits[above, column] * share)


@cache
def _hat(window: int, degree: int) -> NDArray[np.float64]:
    """Return the matrix (window, window) from values to those of the fitted polynomial."""
    powers = np.vander(np.linspace(-1, 1, window), degree + 1)
    return np.asarray(powers @ np.linalg.pinv(powers))


def _fitted(values: NDArray[np.float64], hat: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return each value of the fit to the window around it; near the ends, of the last window."""
    window, half = len(hat), len(hat) // 2
    inner = np.convolve(values, hat[half][::-1], "valid")
    return np.concatenate([hat[:half] @ values[:window], inner, hat[half + 1 :] @ values[-window:]])
