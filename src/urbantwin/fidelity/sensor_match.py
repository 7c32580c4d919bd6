"""Checks whether two frames can be of one kind of sensor: rings, field of view, steps, range."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.frame import Frame

__all__ = ["doubts_about_sensors"]

Array = NDArray[np.float64]

#: Minimum number of points of a ring.
_LEAST_IN_RING = 10
#: Factors by which ring counts and point densities may differ, and the number of rings that may be
#: missing, as cars in front of either sensor hide some.
_FACTOR, _DENSER = 1.25, 1.8
_RINGS = 3
#: Tolerance of the fields of view, degrees.
_VIEW_DEG = 4.0
#: A steeper elevation means that the assumed sensor position is wrong.
_STEEPEST_DEG = -70.0
#: Percentile of elevations that represents the lowest beams.
_LOWEST = 0.5
#: A frame has a sharp end if this share of its points lies in the last tenth of its range; the
#: other frame must have this share of its points beyond.
_SHARP, _BEYOND = 0.012, 0.02
#: Distances between which ground is compared, and the size of its cells, metres.
_NEAR_M, _FAR_M, _CELL_M = 4.0, 25.0, 2.0
_LEAST_CELLS, _LEAST_IN_CELL = 20, 8
#: Points up to this above the lowest of their cell are ground, metres.
_LEVEL_M = 0.2


@dataclass(frozen=True, eq=False)
class _Seen:
    """Range, elevation and azimuth (degrees) of each point from its sensor."""

    range_m: Array
    elevation: Array
    azimuth: Array
    ring: NDArray[np.int64] | None


def doubts_about_sensors(real: Frame, other: Frame) -> list[str]:
    """Return the signs of different kinds of sensor, one sentence each.

    Both frames must be in one frame of reference. Walls that the twin lacks raise no doubt: only
    beams below the horizon, sharp ends of the range and the density of common ground are compared.
    """
    if not len(real.points) or not len(other.points):
        return []
    places = _places(real, other)
    seen = _seen(real, places[0]), _seen(other, places[1])
    said = [*_view(*seen), *_reach(*seen)]
    ground = _ground_of_both(
        real.points - places[0].mean(axis=0), other.points - places[1].mean(axis=0)
    )
    if not said:
        said += _rings(*seen, ground)
    if not said and ground is not None:
        said += _density(ground)
    return said


def _places(real: Frame, other: Frame) -> tuple[Array, Array]:
    """Return the sensor positions of each frame; uncertain real ones are taken from the other."""
    own, its = real.sensor_places, other.sensor_places
    if real.ring is None and not own.any():
        return its, its
    if len(own) == 1 and _raggedness(real, its) < _raggedness(real, own):
        return its, its
    return own, its


def _raggedness(frame: Frame, places: Array) -> float:
    """Return the spread of elevations within rings relative to that of all; small at the sensor."""
    seen = _seen(frame, places)
    if seen.ring is None:
        return 0.0
    _, ring = np.unique(seen.ring, return_inverse=True)
    many = np.maximum(np.bincount(ring), 1)
    mean = np.bincount(ring, seen.elevation) / many
    spread = np.abs(seen.elevation - seen.elevation.mean()).mean()
    return float(np.abs(seen.elevation - mean[ring]).mean() / max(spread, 1e-9))


def _seen(frame: Frame, places: Array) -> _Seen:
    sensor = np.zeros(len(frame.points), np.int64)
    if frame.sensor is not None and frame.sensor.min() >= 0 and frame.sensor.max() < len(places):
        sensor = frame.sensor
    x, y, z = (frame.points - places[sensor]).T
    flat = np.hypot(x, y)
    ring = None
    if frame.ring is not None and frame.ring.min() >= 0:
        ring = (0 if frame.sensor is None else frame.sensor * 65_536) + frame.ring
    return _Seen(
        np.hypot(flat, z), np.degrees(np.arctan2(z, flat)), np.degrees(np.arctan2(y, x)), ring
    )


def _step(seen: _Seen) -> float:
    """Return the median step in azimuth within rings, degrees; 0 if it is unknown."""
    assert seen.ring is not None
    order = np.lexsort([seen.azimuth, seen.ring])
    _, first, count = np.unique(seen.ring[order], return_index=True, return_counts=True)
    found = []
    for begin, many in zip(first, count, strict=True):
        if many >= _LEAST_IN_RING:
            steps = np.diff(seen.azimuth[order[begin : begin + many]])
            steps = steps[steps > 1e-3]
            if len(steps):
                found.append(float(np.median(steps)))
    return float(np.median(found)) if found else 0.0


def _many_rings(seen: _Seen, chosen: NDArray[np.bool_]) -> int:
    """Return the number of rings with enough of the chosen points (N,)."""
    assert seen.ring is not None
    _, count = np.unique(seen.ring[chosen], return_counts=True)
    return int((count >= _LEAST_IN_RING).sum())


def _rings(real: _Seen, other: _Seen, ground: _Ground | None) -> Iterator[str]:
    """Yield doubts if common ground is hit by more rings of one frame, or rings differ in step.

    Elevations are not compared: they are those of beams only if the sensor's position is known, and
    a ring of a twin without houses has other visible parts than the real one.
    """
    if real.ring is None or other.ring is None:
        return
    if ground is not None:
        counts = [
            _many_rings(one, low) for one, low in zip((real, other), ground.points, strict=True)
        ]
        if min(counts) >= 4 and max(counts) > max(_FACTOR * min(counts), min(counts) + _RINGS):
            yield (
                f"Ground that both show is seen by {counts[0]} rings of the real frames and by "
                f"{counts[1]} of the other: not the same sensor?"
            )
    steps = _step(real), _step(other)
    if min(steps) > 0 and max(steps) > 1.6 * min(steps):
        yield (
            f"Points of a ring are {steps[0]:.2f} degrees apart in the real frames and "
            f"{steps[1]:.2f} in the other: another sensor, or another number of columns?"
        )


def _below(degrees: float) -> str:
    return f"{abs(degrees):.0f} degrees {'down' if degrees < 0 else 'up'}"


def _view(real: _Seen, other: _Seen) -> Iterator[str]:
    """Yield a doubt if the lowest beams, which hit the ground of any twin, differ in elevation."""
    mine, its = (float(np.percentile(one.elevation, _LOWEST)) for one in (real, other))
    if abs(mine - its) > _VIEW_DEG and min(mine, its) > _STEEPEST_DEG:
        yield (
            f"The lowest beams of the real frames look {_below(mine)} and the other's "
            f"{_below(its)}: another sensor, or mounted in another way?"
        )


def _reach(real: _Seen, other: _Seen) -> Iterator[str]:
    """Yield a doubt if one frame ends sharply and the other goes on."""
    for one, far, names in ((real, other, ("real", "other")), (other, real, ("other", "real"))):
        ends = float(np.percentile(one.range_m, 99.9))
        sharp = float((one.range_m > 0.9 * ends).mean())
        beyond = float((far.range_m > 1.1 * ends).mean())
        if sharp > _SHARP and beyond > _BEYOND:
            yield (
                f"The {names[0]} frames end sharply at {ends:.0f} m, and {beyond:.0%} of the "
                f"{names[1]}'s points lie farther away: another sensor, or cut to a range? "
                "Cut both alike."
            )


@dataclass(frozen=True, eq=False)
class _Ground:
    """Ground that two frames have in common.

    Attributes:
        counts: points of each frame in the cells that hold enough of both, (C,) each.
        points: mask of each frame's points in these cells.
    """

    counts: tuple[NDArray[np.int64], NDArray[np.int64]]
    points: tuple[NDArray[np.bool_], NDArray[np.bool_]]


def _ground_of_both(*frames: Array) -> _Ground | None:
    """Return the ground near the sensors that both frames' points (N, 3) cover."""
    side = int(2 * _FAR_M / _CELL_M)
    lowest, cells = [], []
    for points in frames:
        flat = np.hypot(points[:, 0], points[:, 1])
        near = (flat > _NEAR_M) & (flat < _FAR_M)
        if not near.any():
            return None
        near &= points[:, 2] < np.percentile(points[near, 2], 60)
        east, north = np.floor((points[:, :2] + _FAR_M) / _CELL_M).astype(np.int64).T
        cell = np.where(near, east * side + north, side * side)
        low = np.full(side * side + 1, np.inf)
        np.minimum.at(low, cell, points[:, 2])
        low[-1] = np.inf
        cells.append(cell)
        lowest.append(low)
    with np.errstate(invalid="ignore"):
        alike = np.abs(lowest[0] - lowest[1]) < _LEVEL_M
    counts, inside = [], []
    for points, cell, low in zip(frames, cells, lowest, strict=True):
        inside.append(alike[cell] & (points[:, 2] < low[cell] + _LEVEL_M))
        counts.append(np.bincount(cell[inside[-1]], minlength=side * side + 1))
    both = (counts[0] >= _LEAST_IN_CELL) & (counts[1] >= _LEAST_IN_CELL)
    if both.sum() < _LEAST_CELLS:
        return None
    first, second = (here & both[cell] for here, cell in zip(inside, cells, strict=True))
    return _Ground((counts[0][both], counts[1][both]), (first, second))


def _density(ground: _Ground) -> Iterator[str]:
    """Yield a doubt if common ground has clearly more points in one frame."""
    ratio = float(np.median(ground.counts[0] / ground.counts[1]))
    if not 1 / _DENSER < ratio < _DENSER:
        yield (
            f"On ground that both show, the real frames have {ratio:.2g} times the other's points: "
            "another sensor or number of columns, or thinned?"
        )
