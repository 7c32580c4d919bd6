"""Measuring the static world from frames of a sensor that does not move."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers import Recording, open_recording
from urbantwin.lidar import beam_directions
from urbantwin.lidar import sensor as model_of
from urbantwin.lidar.measured import MeasuredBackground

__all__ = ["measure_recording", "measured_background"]

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


def measure_recording(
    real: Path,
    model: str,
    out: Path,
    *,
    columns: int | None = None,
    intensity_scale: float = 1.0,
    progress: Callable[[float, str], None] | None = None,
) -> dict[str, Any]:
    """Measure the static world from a recording and write it.

    Args:
        real: a recording that `readers.open_recording` takes, of a sensor that stands still.
        model: of the sensor: a name of the catalogue or a sensor's file.
        out: the ``.npz`` to write.
        columns: per turn; the model's default if not given.
        intensity_scale: what the data call full scale.
        progress: called with the share that is done and what is being done.

    Returns:
        How many frames were read, how many beams there are and have a background, and how much of
        the looks at it came back.

    Raises:
        InputError: the recording or the sensor is not what it should be.
    """
    if not intensity_scale > 0:
        raise InputError(f"the intensity scale is {intensity_scale:g}", expected="more than 0")
    sensor = model_of(model)
    if sensor.pattern is not None:
        raise InputError(f"{sensor.name} scans a pattern", expected="a sensor with channels")
    if columns is not None and columns not in sensor.columns_options:
        offered = ", ".join(map(str, sensor.columns_options))
        raise InputError(f"{sensor.name} has no {columns} columns", expected=f"one of {offered}")
    # As the beams of a turning head point while the channels of a column fire one after another.
    beams = beam_directions(sensor, columns, turns_per_second=sensor.rate_hz)
    recording = open_recording(real)
    say = progress or (lambda fraction, doing: None)

    def frames(source: Recording) -> Iterator[Frame]:
        for number in range(len(source)):
            say(0.9 * number / len(source), f"frame {number + 1} of {len(source)}")
            yield source.read(number)

    found = measured_background(
        frames(recording), beams.reshape(-1, 3), beams.shape[:2], intensity_scale=intensity_scale
    )
    found.save(out)
    say(1.0, "done")
    known = found.known
    return {
        "frames": len(recording),
        "beams": int(known.size),
        "beams_with_background": int(known.sum()),
        "returned": round(float(found.returned.ravel()[known].mean()), 4) if known.any() else None,
    }


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
