"""Measuring the static world from frames of a sensor that does not move."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.lidar.measured import MeasuredBackground

__all__ = ["measured_background"]

#: Ranges of one surface fall into one or two neighbouring bins this wide, metres.
_BIN_M = 0.4
#: A point farther from every beam than this share of the beams' distance is none of theirs.
_ASIDE = 1.0


def measured_background(
    frames: Iterable[Frame],
    directions: NDArray[np.float64],
    shape: tuple[int, int],
    *,
    intensity_scale: float = 1.0,
) -> MeasuredBackground:
    """Return per-beam statistics of what stands still.

    A point belongs to the beam whose direction is nearest. The background of a beam is the
    most frequent range (bins of 0.4 m, two neighbours together; of equally frequent ones the
    farthest): objects are there now and then, and always nearer. Looks that end before it are
    obstructed and count neither way; of the others, the share that came back is the drop-out.
    What stands still in most frames, a parked car, is background.

    Args:
        frames: points in the sensor's own frame; two looks of one beam in a frame count once.
        directions: (C * K, 3) unit vectors of its beams, ring by ring.
        shape: C and K.
        intensity_scale: what the data call full scale.

    Raises:
        InputError: no frame, or no point on any beam.
    """
    tree = cKDTree(directions)
    near, _ = tree.query(directions[:: max(1, len(directions) // 5000)], k=2)
    widest = _ASIDE * max(float(np.median(near[:, 1])), 2e-3)
    beams, ranges, lights, count = [], [], [], 0
    for frame in frames:
        count += 1
        away = np.linalg.norm(frame.points, axis=1)
        aside, beam = tree.query(frame.points / np.maximum(away, 1e-9)[:, None])
        on = np.flatnonzero(aside <= widest)
        on = on[np.unique(beam[on], return_index=True)[1]]
        beams.append(beam[on])
        ranges.append(away[on])
        light = np.full(len(away), np.nan) if frame.intensity is None else frame.intensity
        lights.append(light[on] / intensity_scale)
    if not count or not sum(len(one) for one in beams):
        raise InputError(
            "no point lies on a beam of the sensor", expected="frames of it, in its own frame"
        )
    beam, range_m, light = (np.concatenate(part) for part in (beams, ranges, lights))
    total = len(directions)
    mode = _mode(beam, range_m, total)
    member = np.abs(range_m - mode[beam]) < _BIN_M
    inside = np.bincount(beam[member], minlength=total)
    middle = _sum(beam, range_m, member, total) / np.maximum(inside, 1)
    spread = _sum(beam, (range_m - middle[beam]) ** 2, member, total) / np.maximum(inside, 1)
    before = np.bincount(beam[range_m < mode[beam] - _BIN_M], minlength=total)
    lit = member & np.isfinite(light)
    lights_n = np.bincount(beam[lit], minlength=total)
    bright = _sum(beam, np.nan_to_num(light), lit, total) / np.maximum(lights_n, 1)
    range_m, sigma_m, returned, intensity = (
        one.reshape(shape).astype(np.float32)
        for one in (
            np.where(inside > 0, middle, 0.0),
            np.sqrt(np.maximum(spread, 0.0)),
            np.where(inside > 0, inside / np.maximum(count - before, 1), 0.0).clip(0, 1),
            np.where(lights_n > 0, bright, np.nan),
        )
    )
    return MeasuredBackground(range_m, sigma_m, returned, intensity)


def _sum(
    beam: NDArray[np.int64],
    values: NDArray[np.float64],
    chosen: NDArray[np.bool_],
    total: int,
) -> NDArray[np.float64]:
    return np.bincount(beam[chosen], values[chosen], minlength=total).astype(np.float64)


def _mode(beam: NDArray[np.int64], range_m: NDArray[np.float64], total: int) -> NDArray[np.float64]:
    """Return the most frequent range (total,) of each beam; 0 where it never came back."""
    number = np.floor(range_m / _BIN_M).astype(np.int64)
    span = int(number.max()) + 3
    # Each range counts in its bin and in the one before: a bin then stands for two neighbours.
    key = np.concatenate([beam * span + number + 1, beam * span + number])
    found, times = np.unique(key, return_counts=True)
    owner, bin_ = found // span, found % span
    order = np.lexsort((bin_, times, owner))
    last = order[np.flatnonzero(np.diff(np.append(owner[order], -1)))]
    mode = np.zeros(total)
    # Bin b counted the ranges from (b - 1) to (b + 1) bins: its middle is b bins.
    mode[owner[last]] = bin_[last] * _BIN_M
    return mode
