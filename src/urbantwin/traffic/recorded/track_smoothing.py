"""Smoothing of recorded tracks: noise removed, resampled to the steps of a motion, gaps filled.

Positions are fitted by cubic smoothing splines (Reinsch, Numerische Mathematik 10, 1967). The fit
is repeated twice with less weight on outliers (iterated weights of Huber's estimator; Holland and
Welsch, Communications in Statistics A6, 1977), since trackers jump at their start. A spline can be
evaluated at any time, its derivative is the velocity, and it bridges gaps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, make_smoothing_spline

from urbantwin.traffic.recorded.track import RecordedTrack

__all__ = ["LONGEST_FILLED_S", "SmoothTrack", "smooth_positions", "smooth_track"]

#: Longer gaps are not filled, seconds.
LONGEST_FILLED_S = 2.0
_GAP_FACTOR = 1.5  # intervals longer than this multiple of the usual one are gaps
_MIN_SAMPLES = 5  # least number of samples for a spline
#: Weight of curvature against squared distance from the samples, for samples a second apart. A
#: higher one predicts held-out samples worse, a lower one leaves accelerations that no vehicle has
#: (docs/howto/recorded_traffic.md).
_STIFFNESS = 1e-3
#: Samples farther off than this multiple of the usual distance, and than this, are outliers
#: (metres).
_OUTLIER_FACTOR, _MIN_OUTLIER_M = 3.0, 0.15
_REWEIGHTINGS = 2
#: Speed, m/s, and extent, metres, below which an actor has no direction of travel.
_MIN_TRAVEL_MS, _MIN_TRAVEL_M = 0.5, 1.0
#: Duration over which headings are averaged, seconds.
_HEADING_WINDOW_S = 0.5


@dataclass(frozen=True, eq=False)
class SmoothTrack:
    """A track at N steps of the motion.

    Attributes:
        time_s: (N,) seconds.
        xy: (N, 2) centre of its bounds, metres.
        yaw: (N,) heading, rad, unwrapped.
        speed: (N,) along the heading, m/s.
        z: (N,) approximate height, metres; ``None`` if unknown.
        filled: gaps that are filled, seconds.
        absent: gaps that are not filled, seconds.
        moved_m: (M,) displacement of each recorded sample by smoothing.
    """

    time_s: NDArray[np.float64]
    xy: NDArray[np.float64]
    yaw: NDArray[np.float64]
    speed: NDArray[np.float64]
    z: NDArray[np.float64] | None
    filled: tuple[tuple[float, float], ...]
    absent: tuple[tuple[float, float], ...]
    moved_m: NDArray[np.float64]


def smooth_track(track: RecordedTrack, step_s: float, *, smooth: bool = True) -> SmoothTrack | None:
    """Return a track at the steps that it spans; ``None`` if it spans none.

    Args:
        track: the recorded track.
        step_s: time between two steps, seconds; the first is at 0.
        smooth: remove noise; else samples are only interpolated.
    """
    first = int(np.ceil(track.time_s[0] / step_s - 1e-6))
    last = int(np.floor(track.time_s[-1] / step_s + 1e-6))
    if last < first:
        return None
    times = np.round(np.arange(first, last + 1) * step_s, 9)
    filled, absent = _gaps(track.time_s)
    pieces = _pieces(track.time_s, absent)
    xy, velocity = np.empty((len(times), 2)), np.empty((len(times), 2))
    moved = np.zeros(len(track.time_s))
    for piece in pieces:
        begin, end = track.time_s[piece[0]] - 1e-6, track.time_s[piece[-1]] + 1e-6
        in_piece = (times >= begin) & (times <= end)
        own = track.time_s[piece]
        position, going = smooth_positions(
            own, track.xy[piece], np.concatenate([times[in_piece], own]), smooth=smooth
        )
        count = int(in_piece.sum())
        xy[in_piece], velocity[in_piece] = position[:count], going[:count]
        moved[piece] = np.linalg.norm(position[count:] - track.xy[piece], axis=1)
    between = np.zeros(len(times), np.bool_)
    for from_s, to_s in absent:
        between |= (times > from_s + 1e-6) & (times < to_s - 1e-6)
    if between.all():
        return None
    present = ~between
    times, xy, velocity = times[present], xy[present], velocity[present]
    yaw = _heading(track, times, xy, velocity, step_s, smooth=smooth)
    speed = velocity[:, 0] * np.cos(yaw) + velocity[:, 1] * np.sin(yaw)
    has_z = np.isfinite(track.z)
    z = np.interp(times, track.time_s[has_z], track.z[has_z]) if has_z.any() else None
    return SmoothTrack(times, xy, yaw, speed, z, filled, absent, moved)


def smooth_positions(
    time_s: NDArray[np.float64],
    xy: NDArray[np.float64],
    at_s: NDArray[np.float64],
    *,
    smooth: bool = True,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return positions (M, 2), m, and velocities (M, 2), m/s, of a path at times (M,).

    Args:
        time_s: (N,) ascending times.
        xy: (N, 2) positions, metres.
        at_s: (M,) times within.
        smooth: fit a smoothing spline; else the interpolating one.
    """
    if len(time_s) == 1:
        return np.repeat(xy, len(at_s), axis=0), np.zeros((len(at_s), 2))
    if len(time_s) < _MIN_SAMPLES:
        velocity = np.gradient(xy, time_s, axis=0)
        return tuple(  # type: ignore[return-value]
            np.column_stack([np.interp(at_s, time_s, values) for values in columns.T])
            for columns in (xy, velocity)
        )
    # Relative to the first sample, for better conditioning.
    since, ask, weight = time_s - time_s[0], at_s - time_s[0], np.ones(len(time_s))
    price = _STIFFNESS / float(np.median(np.diff(time_s)))
    shifted = xy - xy[0]
    for turn in range(1 + _REWEIGHTINGS):
        if smooth:
            lines = [make_smoothing_spline(since, axis, weight, lam=price) for axis in shifted.T]
        else:
            lines = [CubicSpline(since, axis, bc_type="natural") for axis in shifted.T]
        if not smooth or turn == _REWEIGHTINGS:
            break
        beside = np.hypot(
            *(line(since) - axis for line, axis in zip(lines, shifted.T, strict=True))
        )
        usual = max(_OUTLIER_FACTOR * 1.4826 * float(np.median(beside)), _MIN_OUTLIER_M)
        weight = np.minimum(1.0, usual / np.maximum(beside, 1e-9))
    place = np.column_stack([line(ask) for line in lines]) + xy[0]
    return place, np.column_stack([line.derivative()(ask) for line in lines])


def _gaps(
    time_s: NDArray[np.float64],
) -> tuple[tuple[tuple[float, float], ...], tuple[tuple[float, float], ...]]:
    """Return the gaps that are filled and those that are not, as intervals."""
    passed = np.diff(time_s)
    usual = float(np.median(passed)) if len(passed) else 0.0
    wide = np.flatnonzero(passed > _GAP_FACTOR * usual)
    spans = [(float(time_s[k]), float(time_s[k + 1])) for k in wide]
    short = tuple(span for span in spans if span[1] - span[0] <= LONGEST_FILLED_S)
    return short, tuple(span for span in spans if span not in short)


def _pieces(
    time_s: NDArray[np.float64], absent: tuple[tuple[float, float], ...]
) -> list[NDArray[np.int64]]:
    """Return the samples between the gaps that are not filled."""
    cuts = np.searchsorted(time_s, [back for _, back in absent])
    return np.split(np.arange(len(time_s)), cuts)


def _heading(
    track: RecordedTrack,
    times: NDArray[np.float64],
    xy: NDArray[np.float64],
    velocity: NDArray[np.float64],
    step_s: float,
    *,
    smooth: bool,
) -> NDArray[np.float64]:
    """Return the heading (N,), rad: recorded, else of travel; standing actors keep it."""
    has_yaw = np.isfinite(track.yaw)
    pace = np.linalg.norm(velocity, axis=1)
    far = bool(np.ptp(xy, axis=0).max() >= _MIN_TRAVEL_M)
    sure = pace >= _MIN_TRAVEL_MS
    if has_yaw.any():
        recorded = np.unwrap(track.yaw[has_yaw])
        yaw = np.interp(times, track.time_s[has_yaw], recorded)
        if not smooth:
            return yaw
        if not far:
            return np.full(len(times), _mean_angle(recorded))
    elif far and sure.any():
        yaw = np.arctan2(velocity[:, 1], velocity[:, 0])
    else:
        moved = track.xy[-1] - track.xy[0]
        return np.full(len(times), float(np.arctan2(moved[1], moved[0])))
    if sure.any():
        moving_steps = np.flatnonzero(sure)
        yaw = np.interp(np.arange(len(times)), moving_steps, np.unwrap(yaw[moving_steps]))
    half = round(_HEADING_WINDOW_S / step_s / 2)
    padded = np.pad(yaw, half, mode="edge")
    return np.asarray(np.convolve(padded, np.full(2 * half + 1, 1 / (2 * half + 1)), "valid"))


def _mean_angle(yaw: NDArray[np.float64]) -> float:
    return float(np.arctan2(np.sin(yaw).mean(), np.cos(yaw).mean()))
