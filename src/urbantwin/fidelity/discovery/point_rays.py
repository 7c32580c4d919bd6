"""Sensor, ring and column of every point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.column_assignment import fired_columns
from urbantwin.fidelity.compiled.ring_support import ring_support
from urbantwin.fidelity.discovery.elevation_match import TableFit, normal_density
from urbantwin.lidar import Sensor

__all__ = ["PointRays", "azimuth_of", "column_step_deg", "columns_in", "columns_of", "point_rays"]

#: A point is on a ring if its elevation residual is within this many standard deviations of the
#: ring or this angle, degrees. Some residuals are larger, of moving sensors and of motion-corrected
#: rotations: their share, and their standard deviation, degrees.
_REACH, _REACH_DEG = 4.0, 0.05
_WIDE_SHARE, _WIDE_DEG = 0.15, 0.025
#: Neighbours on a ring that support a point: columns to each side, and the largest differences of
#: range, as a share, and of elevation, degrees.
_COLUMNS_BESIDE, _RANGE_SHARE, _ALIKE_DEG = 8, 0.02, 0.012
#: Rounds in which points are assigned to sensors, each by the neighbours as assigned before.
_ROUNDS = 4
#: Support of a point without neighbours; likelihood of a point of no sensor; and the minimum
#: posterior probability of an assigned sensor.
_ALONE, _NOBODY, _SURE = 0.02, 0.01, 0.5
#: Bounds of the azimuth resolution, the step between columns, and bins of its histogram, degrees.
_LEAST_STEP_DEG, _MOST_STEP_DEG, _BIN_DEG = 0.03, 1.2, 0.005
#: A model offers a measured azimuth resolution if it is off by less than this share: motors of old
#: models are not locked to the firing clock.
_STEP_SHARE = 0.05


@dataclass(frozen=True, eq=False)
class PointRays:
    """The sensor and ring of each point of a frame.

    Attributes:
        sensor: (N,) int64, -1 if the point is on no ring.
        ring: (N,) int64, channel in the manufacturer's order, or -1.
        off_deg: (N,) elevation of the point above its channel's beam, degrees, or NaN.
        azimuth: (N,) azimuth in the sensor's frame with a yaw of 0, radians, or NaN.
        sure: (N,) posterior probability of its sensor.
    """

    sensor: NDArray[np.int64]
    ring: NDArray[np.int64]
    off_deg: NDArray[np.float64]
    azimuth: NDArray[np.float64]
    sure: NDArray[np.float64]


def point_rays(
    points: NDArray[np.float64],
    fits: Sequence[TableFit],
    steps_deg: Sequence[float],
    spreads_deg: Sequence[float],
) -> PointRays:
    """Return the sensor and ring of every point of a frame.

    Rings of other sensors pass near a point by chance. On its own ring a point has neighbours one
    column to each side, at about its range and elevation.

    Args:
        points: (N, 3), metres.
        fits: fit of each sensor.
        steps_deg: azimuth resolution of each sensor.
        spreads_deg: standard deviation of elevations on the rings of each sensor.
    """
    count = len(points)
    share = np.zeros((len(fits), count))
    ring = np.full((len(fits), count), -1, np.int64)
    off = np.full((len(fits), count), np.nan)
    azimuth = np.full((len(fits), count), np.nan)
    room = np.ones((len(fits), count))
    sorted_rows = []
    for number, fit in enumerate(fits):
        on = fit.sees(points)
        ring[number], off[number], room[number] = on.channel, on.off_deg, on.room_deg
        azimuth[number] = azimuth_of(points, fit)
        rows = np.flatnonzero(np.abs(off[number]) < max(_REACH * spreads_deg[number], _REACH_DEG))
        rows = rows[np.lexsort((azimuth[number, rows], ring[number, rows]))]
        sorted_rows.append(rows)
        share[number, rows] = 1.0
    share /= np.maximum(share.sum(axis=0), 1.0)
    for _ in range(_ROUNDS):
        odds = np.zeros_like(share)
        for number, (fit, rows) in enumerate(zip(fits, sorted_rows, strict=True)):
            spread = spreads_deg[number]
            wide = np.radians(_COLUMNS_BESIDE * steps_deg[number])
            beside = ring_support(
                ring[number, rows],
                azimuth[number, rows],
                np.sqrt(((points[rows] - fit.seen_from.place) ** 2).sum(axis=1)),
                off[number, rows],
                share[number, rows],
                wide,
                _RANGE_SHARE,
                max(2 * spread, _ALIKE_DEG),
            )
            held = np.minimum(beside / _COLUMNS_BESIDE, 1.0) ** 2 + _ALONE
            bell = (1 - _WIDE_SHARE) * normal_density(off[number, rows], spread)
            bell += _WIDE_SHARE * normal_density(off[number, rows], max(spread, _WIDE_DEG))
            odds[number, rows] = held * bell * room[number, rows]
        share = odds / (odds.sum(axis=0) + _NOBODY)
    best = share.argmax(axis=0)
    every = np.arange(count)
    mine = share[best, every] > _SURE
    return PointRays(
        np.where(mine, best, -1),
        np.where(mine, ring[best, every], -1),
        np.where(mine, off[best, every], np.nan),
        np.where(mine, azimuth[best, every], np.nan),
        share[best, every],
    )


def azimuth_of(points: NDArray[np.float64], fit: TableFit) -> NDArray[np.float64]:
    """Return the azimuth (N,) of points in a sensor's frame whose yaw is 0, radians."""
    axis = fit.seen_from.axis
    forward = np.array([axis[2], 0.0, -axis[0]]) / np.hypot(axis[0], axis[2])
    left = np.cross(axis, forward)
    away = points - fit.seen_from.place
    return np.asarray(np.arctan2(away @ left, away @ forward))


def column_step_deg(rays: Sequence[PointRays], sensor: int) -> float | None:
    """Return a sensor's azimuth resolution, degrees; None with too few points.

    It is the mode of the gaps between neighbours on a ring, within each frame.
    """
    gaps = []
    for one in rays:
        mine = np.flatnonzero(one.sensor == sensor)
        mine = mine[np.lexsort((one.azimuth[mine], one.ring[mine]))]
        gap = np.degrees(np.diff(one.azimuth[mine]))
        gaps.append(gap[np.diff(one.ring[mine]) == 0])
    gap = np.concatenate(gaps) if gaps else np.zeros(0)
    gap = gap[(gap > _LEAST_STEP_DEG) & (gap < _MOST_STEP_DEG)]
    if len(gap) < 100:
        return None
    count, edges = np.histogram(gap, np.arange(_LEAST_STEP_DEG, _MOST_STEP_DEG, _BIN_DEG))
    smooth = np.convolve(count, np.ones(5), mode="same")
    middle = edges[int(smooth.argmax())] + _BIN_DEG / 2
    near = gap[np.abs(gap - middle) < 0.15 * middle]
    return float(near.mean())


def columns_of(model: Sensor | None, step_deg: float | None) -> int | None:
    """Return the columns per turn of a model at an azimuth resolution; None if it has none."""
    if step_deg is None:
        return None
    measured = 360 / step_deg
    if model is None:
        return round(measured)
    best = min(model.columns_options, key=lambda one: abs(one / measured - 1))
    return best if abs(best / measured - 1) < _STEP_SHARE else None


def columns_in(
    rays: PointRays, sensor: int, model: Sensor | None, columns: int
) -> NDArray[np.int64]:
    """Return the columns (M,) of a sensor's points: whole numbers from 0 at a yaw of 0."""
    mine = rays.sensor == sensor
    rate_hz = 0.0 if model is None else model.rate_hz
    return fired_columns(rays.ring[mine], rays.azimuth[mine], columns, model, rate_hz)
