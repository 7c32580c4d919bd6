"""Estimation of the static background from frames of fixed sensors."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.beam_assignment import BeamsOf
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.histograms import full_scale
from urbantwin.fidelity.readers import open_recording
from urbantwin.fidelity.sampling import evenly
from urbantwin.fidelity.stirring_looks import MOST_FRAMES, Looks, stirring_before
from urbantwin.lidar.background import MeasuredBackground, Stirring
from urbantwin.lidar.background_file import save_backgrounds
from urbantwin.progress import Progress, untold
from urbantwin.reconstruct.recording.range_modes import RangeModes, range_modes

__all__ = ["LEAST_FRAMES", "measure_recording", "measured_backgrounds"]

#: Function that returns the mask (N,) of the positions (N, 3) that belong to waiting traffic.
Waits = Callable[[NDArray[np.float64]], NDArray[np.bool_]]
#: Minimum number of frames. A range needs two returns: a surface that returns every second beam
#: yields them in 99 of 100 cases (binomial), and is recognised as static in nine of ten.
LEAST_FRAMES = 11
#: Minimum share of the points on static surfaces, else the sensor moves: 44 % in 24 frames of a
#: car's sensor in different streets (KITTI), more than 90 % for simulated fixed sensors.
_LEAST_STILL = 0.6
#: Ranges of a beam in two frames agree within this, metres: 96 to 98 % do for a fixed sensor
#: (simulated, with traffic), 32 % for two places, and 33 to 48 % if the sensor moved by 2 m or
#: turned by 5 degrees.
_ALIKE_M = 0.3
#: A frame shows another place if the lower quartile of its agreement with the other frames is below
#: this share of the best agreement of two frames. At most this share of the frames may (a bus in
#: front of the sensor).
_LEAST_ALIKE, _MOST_ELSEWHERE = 0.65, 0.1

#: Maximum number of returns per sensor in memory; longer recordings are sampled evenly.
_MOST_LOOKS = 30_000_000
#: Minimum share of the points on beams of the sensors, else sensor or frame of reference are wrong.
_LEAST_ON = 0.5


def measured_backgrounds(
    frames: Iterable[Frame],
    sensors: Sequence[BeamsOf],
    *,
    intensity_scale: float | None = None,
    waits: Sequence[Waits] = (),
    interval_s: float | None = None,
    file: Path | None = None,
) -> list[MeasuredBackground]:
    """Return per-beam statistics of the static background for each sensor.

    The ranges of a beam are those of `range_modes.range_modes`: a range beyond which frames have
    returns is not background, however long it was occupied.

    Args:
        frames: frames in order of time; two returns of one beam in a frame count once.
        sensors: beams of the recording's sensors.
        intensity_scale: full scale of the recorded intensity; estimated from its maximum if not
            given.
        waits: for each sensor, a function that returns the mask of the positions (N, 3) in the
            sensor frame that belong to waiting traffic, which is excluded.
        interval_s: time between frames, seconds; one rotation of the sensors if not given.
        file: the recording, for errors.

    Raises:
        InputError: fewer than `LEAST_FRAMES` frames, most points lie on no beam of the sensors or
            beyond their maximum range, most points are not static, or frames show several places.
    """
    looks: list[list[tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]]] = [
        [] for _ in sensors
    ]
    count, points, brightest = 0, 0, 0.0
    for frame in frames:
        light = np.full(len(frame.points), np.nan) if frame.intensity is None else frame.intensity
        brightest = max(brightest, float(np.nan_to_num(light).max(initial=0)))
        count, points = count + 1, points + len(frame.points)
        for kept, one in zip(looks, sensors, strict=True):
            rows, beam, range_m = one.of(frame)
            found = (range_m[rows].astype(np.float32), light[rows].astype(np.float32))
            kept.append((beam.astype(np.int32), *found))
    if count < LEAST_FRAMES:
        raise InputError(
            f"{count} {'frame does' if count == 1 else 'frames do'} not show what is static",
            file=file,
            expected=f"{LEAST_FRAMES} frames or more, over half a minute where traffic waits",
        )
    on = sum(len(beam) for kept in looks for beam, *_ in kept)
    if on < max(1, _LEAST_ON * points):
        names = ", ".join(one.sensor.name for one in sensors)
        raise InputError(
            f"{on} of {points} points lie on beams of {names}",
            file=file,
            expected="frames of that sensor in its own frame, or its pose in theirs",
        )
    scale = full_scale(brightest) if intensity_scale is None else intensity_scale
    backgrounds: list[MeasuredBackground] = []
    some, stirring = evenly(count, MOST_FRAMES), []
    for one in sensors:
        mine = looks.pop(0)
        kept = [mine[number] for number in some]
        points = sum(len(beam) for beam, *_ in mine)
        farthest = one.sensor.assumed_range_max_m
        beyond = sum(int((range_m > farthest).sum()) for _, range_m, _ in mine)
        if 2 * beyond > points:
            raise InputError(
                f"{beyond / points:.0%} of the points lie farther off than {one.sensor.name} sees",
                file=file,
                expected=f"metres in the sensor's frame, up to {farthest:g}",
            )
        modes = _modes(one, mine, count)
        still = float((modes.share.sum(axis=1) * modes.looks).sum()) / max(1, points)
        if still < _LEAST_STILL:
            raise InputError(
                f"{still:.0%} of the points of {one.name or one.sensor.name} are static",
                file=file,
                expected="frames of a static sensor, in its own frame",
            )
        _check_places(one, kept, some, file)
        its = waits[len(backgrounds)] if waits else None
        if its is not None:
            modes = _without_traffic(one, modes, its)
        stirring.append(Looks.of(one, kept, modes, its))
        backgrounds.append(_background(one, modes, scale))
    interval_s = 1 / sensors[0].turns_per_second if interval_s is None else interval_s
    spread = (count - 1) / (len(some) - 1)
    stirs = stirring_before(stirring, interval_s=interval_s * spread)
    return [
        one if mine is None else _with_stirring(one, mine, scale)
        for one, mine in zip(backgrounds, stirs, strict=True)
    ]


def _check_places(
    one: BeamsOf,
    looks: Sequence[tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]],
    numbers: Sequence[int],
    file: Path | None,
) -> None:
    """Raise an error if frames show several places, or the sensor moved or turned meanwhile."""
    met = np.zeros((len(looks), one.count), np.float32)
    for row, (beam, range_m, _) in zip(met, looks, strict=True):
        row[beam] = range_m
    alike = np.full((len(looks), len(looks)), np.nan)
    for i, j in combinations(range(len(looks)), 2):
        both = (met[i] > 0) & (met[j] > 0)
        if both.any():
            alike[i, j] = alike[j, i] = (np.abs(met[i] - met[j])[both] < _ALIKE_M).mean()
    if np.isnan(alike).all():
        return
    with np.errstate(invalid="ignore"):
        quarter = np.array([np.nanquantile(row, 0.25) for row in alike if np.isfinite(row).any()])
    elsewhere = (quarter < _LEAST_ALIKE * np.nanmax(alike)).sum()
    if elsewhere > max(1, _MOST_ELSEWHERE * len(looks)):
        first, then = sorted(divmod(int(np.nanargmin(alike)), len(looks)))
        raise InputError(
            f"{one.name or one.sensor.name} sees another place in frame {numbers[then]} than in "
            f"frame {numbers[first]}: {alike[first, then]:.0%} of the beams end alike",
            file=file,
            expected="frames of a static sensor, in its own frame",
        )


def _with_stirring(one: MeasuredBackground, stirring: Stirring, scale: float) -> MeasuredBackground:
    """Return a background with moving foliage.

    Frames whose return is foliage behind the nearest static surface are excluded from the shares of
    the surfaces.
    """
    bright = (stirring.intensity / np.float32(scale)).clip(0, 1)
    nearest = np.where(one.share > 0, one.range_m, np.inf).min(axis=0).ravel()[stirring.beam]
    past = (stirring.range_m > nearest).mean(axis=0)
    share = one.share.reshape(len(one.share), -1).copy()
    mine = share[:, stirring.beam]
    share[:, stirring.beam] = mine / np.maximum(1 - past, np.maximum(mine.sum(axis=0), 1e-3))
    return replace(
        one, share=share.reshape(one.share.shape), stirring=replace(stirring, intensity=bright)
    )


def _without_traffic(one: BeamsOf, modes: RangeModes, waits: Waits) -> RangeModes:
    """Return the ranges without waiting traffic; beams without another range have no background."""
    aim = one.directions.reshape(-1, 3)
    share = modes.share.copy()
    for mode in range(share.shape[1]):
        some = np.flatnonzero(share[:, mode] > 0)
        place = aim[some] * modes.range_m[some, mode, None]
        share[some[waits(place)], mode] = 0
    # Ranges beyond keep their share of the returns: nothing that passed by obstructed them.
    gone = (share.sum(axis=1) == 0) & (modes.share.sum(axis=1) > 0)
    order = np.argsort(-share, axis=1, kind="stable")
    images = {
        name: np.take_along_axis(values, order, axis=1)
        for name, values in (
            ("share", share),
            ("range_m", np.where(share > 0, modes.range_m, np.float32(0))),
            ("sigma_m", np.where(share > 0, modes.sigma_m, np.float32(0))),
            ("intensity", modes.intensity),
        )
    }
    return replace(modes, **images, looks=np.where(gone, 0, modes.looks).astype(np.int32))


def measure_recording(
    real: Path,
    sensors: Sequence[BeamsOf],
    out: Path,
    *,
    intensity_scale: float | None = None,
    waits: Sequence[Waits] = (),
    interval_s: float | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Measure the static background of a recording and write it.

    Args:
        real: a recording of fixed sensors that `readers.open_recording` opens.
        sensors: beams of the recording's sensors.
        out: the ``.npz`` file to write.
        intensity_scale: full scale of the recorded intensity; estimated if not given.
        waits: see `measured_backgrounds`.
        interval_s: see `measured_backgrounds`.
        progress: called with the fraction done and the current step.

    Returns:
        The number of frames read, and for each sensor a summary (`described`).

    Raises:
        InputError: the recording or the intensity scale is invalid.
    """
    if intensity_scale is not None and not intensity_scale > 0:
        raise InputError(f"the intensity scale is {intensity_scale:g}", expected="more than 0")
    recording = open_recording(real)
    if interval_s is None:
        interval_s = 1 / sensors[0].turns_per_second
    say = progress or untold
    most = max(1, _MOST_LOOKS // sum(one.count for one in sensors))
    used = evenly(len(recording), most)
    problems = []

    def frames() -> Iterable[Frame]:
        for done, number in enumerate(used):
            say(0.8 * done / len(used), f"frame {done + 1} of {len(used)}")
            try:
                yield recording.read(number)
            except InputError as error:
                problems.append(str(error))
                if len(problems) == len(used):
                    raise

    found = measured_backgrounds(
        frames(),
        sensors,
        intensity_scale=intensity_scale,
        waits=waits,
        interval_s=interval_s * max(1, len(recording) - 1) / max(1, len(used) - 1),
        file=real,
    )
    save_backgrounds(out, found)
    say(1.0, "done")
    return {
        "frames": len(used) - len(problems),
        "of": len(recording),
        "sensors": [described(one) for one in found],
        **({"problems": problems} if problems else {}),
        **({"notes": list(recording.notes)} if recording.notes else {}),
    }


def described(one: MeasuredBackground) -> dict[str, Any]:
    """Return a summary of a background: numbers of beams, and the mean share of returns."""
    known = one.known
    returned = one.returned[known]
    told = np.isfinite(returned)
    return {
        **({"name": one.name} if one.name else {}),
        "model": one.model,
        "beams": int(known.size),
        "with_background": int(known.sum()),
        "with_several_ranges": int(((one.share > 0).sum(axis=0) > 1).sum()),
        "returned": round(float(returned[told].mean()), 4) if told.any() else None,
        "with_what_stirs": 0 if one.stirring is None else len(one.stirring.beam),
    }


def _modes(
    one: BeamsOf,
    looks: list[tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]],
    frames: int,
) -> RangeModes:
    """Return the ranges of a sensor's beams; clears ``looks`` to free memory."""
    number = np.repeat(np.arange(frames, dtype=np.int32), [len(beam) for beam, *_ in looks])
    beam, range_m, light = (np.concatenate(part) for part in zip(*looks, strict=True))
    looks.clear()
    return range_modes(beam, number, range_m, light, cells=one.count, frames=frames)


def _background(one: BeamsOf, modes: RangeModes, scale: float) -> MeasuredBackground:
    shape = (one.sensor.channels, one.columns)

    def images(values: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.ascontiguousarray(values.T).reshape(-1, *shape)

    return MeasuredBackground(
        images(modes.range_m),
        images(modes.sigma_m),
        images(modes.share),
        images(np.where(modes.share > 0, modes.intensity / np.float32(scale), np.nan).clip(0, 1)),
        modes.looks.reshape(shape),
        one.sensor.name,
        one.turns_per_second,
        one.name,
    )
