"""Firing times of a sensor: its turns, their assignment to frames, and its clock.

**Turns.** A turn begins when the encoder is at ``phase_deg``. With ``phase_lock`` that is at every
whole multiple of ``1 / turns_per_second``, as for a motor locked to a common pulse (Velodyne, Hesai
and Ouster call it phase lock): two locked sensors stay synchronised. Without it, the motor starts
at a random phase and follows the sensor's own clock, so it drifts with it. ``time_jitter_s`` shifts
the start of each turn by a normal draw, truncated at three standard deviations.

**Frames.** Frame n collects for ``frame_window_s`` from ``t_n = n / rate_hz`` on: the turns whose
data begin to arrive in that window, ``latency_s`` after measurement; if frames are assigned by
clock, the turns whose start on their sensor's clock is in the window, so that a wrong clock moves
turns into other frames. No turn is in two frames, and with contiguous frames every turn is in one,
unless it is lost (``dropped_frames``). Sensors start with the motion: there are no earlier turns,
so the first frames of a sensor with latency are empty.

**Clock.** At true time t a sensor's clock reads ``t + clock_offset_s + clock_drift_ppm 1e-6 t``.

All draws belong to a turn of a sensor, not to a frame, and are counter-based (Philox).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from urbantwin.lidar.rig import MountedSensor

__all__ = ["Sweep", "Turn", "ring_times", "span_of", "sweeps_of", "turns_of"]


@dataclass(frozen=True, eq=False)
class Sweep:
    """Firing times of one turn of a sensor, in seconds relative to the frame's time.

    Channel c in column k fires at ``column_time_s[k] + ring_time_s[c]``, true time. Column k fires
    at encoder angle ``2 pi k / K``, whichever column is first.

    Attributes:
        column_time_s: (K,) float64, start of each column.
        ring_time_s: (C,) float64, firing time of each channel within its column.
        clock_offset_s: offset of the sensor's clock from true time at the frame's time.
        clock_rate: seconds of its clock per true second.
        turn: number of the turn since the start of the motion.
    """

    column_time_s: NDArray[np.float64]
    ring_time_s: NDArray[np.float64]
    clock_offset_s: float = 0.0
    clock_rate: float = 1.0
    turn: int = 0

    @property
    def first_column(self) -> int:
        """The column that fires first; the others follow cyclically."""
        return int(self.column_time_s.argmin())

    @classmethod
    def snapshot(cls, columns: int, channels: int) -> Sweep:
        """Return a turn in which all rays fire at the frame's time."""
        return cls(np.zeros(columns), np.zeros(channels))

    def reported(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Convert true times to the sensor's clock, relative to the frame's time."""
        return self.clock_offset_s + self.clock_rate * time_s


#: Tolerance at the borders of frames, in turns: times are binary fractions.
_ON_THE_BORDER = 1e-6
#: Largest jitter, in standard deviations.
_FARTHEST_JITTER = 3.0
#: Separates the random numbers of timing from those of returns, whose keys hold a frame's number
#: here.
_OF_TIMING = 1 << 47
_START, _TURN = 0, 1


@dataclass(frozen=True)
class Turn:
    """One turn of a sensor. Times are true, seconds relative to the frame's.

    Attributes:
        number: number of the turn since the start of the motion.
        start_s: start.
        stop_s: end, and nominal start of the next turn.
        arrival_s: arrival of its last data.
        dropped: whether it was lost.
    """

    number: int
    start_s: float
    stop_s: float
    arrival_s: float
    dropped: bool


def turns_of(mounted: MountedSensor, frame_index: int, seed: int) -> tuple[Turn, ...]:
    """Return the turns that arrive in a frame, lost ones included, in order.

    Args:
        mounted: the sensor.
        frame_index: number of the frame; its time is ``frame_index / mounted.rate_hz``.
        seed: random seed.
    """
    time_s = frame_index / mounted.rate_hz
    turn_s = 1.0 / _turns_per_second(mounted)
    missing = 0.0 if mounted.phase_lock else float(_draws(mounted, seed, _START, 0)[0])
    # Turn m begins at (m - missing) turn durations; it counts when its data arrive.
    first = _first_turn(mounted, time_s, turn_s, missing)
    window_s = mounted.frame_window_s
    if window_s * mounted.rate_hz > 1 - _ON_THE_BORDER:
        # Computed as the next frame's first turn, so that no turn is lost or double.
        after = _first_turn(mounted, (frame_index + 1) / mounted.rate_hz, turn_s, missing)
    else:
        after = _first_turn(mounted, time_s + window_s, turn_s, missing)
    turns = []
    for number in range(max(first, 0 if missing == 0 else 1), after):
        late, lost = _fate(mounted, seed, number)
        start_s = round((number - missing) * turn_s - time_s, 12) + late
        stop_s = start_s + turn_s
        arrival_s = stop_s + mounted.latency_s
        turns.append(Turn(number, start_s, stop_s, arrival_s, lost))
    return tuple(turns)


def sweeps_of(mounted: MountedSensor, frame_index: int, seed: int) -> tuple[Sweep, ...]:
    """Return the firing times of the turns in a frame: none, one or several, in order.

    Column k fires at encoder angle ``2 pi k / K``, wherever a turn begins. Without the effect
    ``rolling_shutter`` all rays of a turn fire at its start. Columns of a non-repeating pattern
    follow each other from the start.

    Args:
        mounted: the sensor.
        frame_index: number of the frame; its time is ``frame_index / mounted.rate_hz``.
        seed: random seed.
    """
    columns = mounted.columns
    drift = mounted.clock_drift_ppm * 1e-6
    ahead_s = mounted.clock_offset_s + drift * (frame_index / mounted.rate_hz)
    rolling = mounted.effects.rolling_shutter
    ring_s = ring_times(mounted) if rolling else np.zeros(mounted.sensor.channels)
    phase = 0.0 if mounted.sensor.pattern is not None else mounted.phase_deg / 360.0
    share = _shares(columns, phase) if rolling else np.zeros(columns)
    return tuple(
        Sweep(
            turn.start_s + share * (turn.stop_s - turn.start_s),
            ring_s,
            ahead_s,
            1.0 + drift,
            turn.number,
        )
        for turn in turns_of(mounted, frame_index, seed)
        if not turn.dropped
    )


@lru_cache(maxsize=16)
def _shares(columns: int, phase: float) -> NDArray[np.float64]:
    """Return the firing time of each column (K,) as a share of the turn."""
    # Rounded: the column at the phase is the first, not the last.
    return np.asarray(np.round(np.arange(columns) - phase * columns, 9) % columns / columns)


def span_of(sensors: Iterable[MountedSensor], frame_index: int, seed: int) -> tuple[float, float]:
    """Return the first and the last firing of a frame, including its own time.

    Seconds relative to the frame's time: the interval in which poses of actors are needed.
    """
    low, high = 0.0, 0.0
    for mounted in sensors:
        rolling = mounted.effects.rolling_shutter
        ring_s = ring_times(mounted) if rolling else np.zeros(1)
        for turn in turns_of(mounted, frame_index, seed):
            low = min(low, turn.start_s + float(ring_s.min()))
            high = max(high, (turn.stop_s if rolling else turn.start_s) + float(ring_s.max()))
    return low, high


def ring_times(mounted: MountedSensor) -> NDArray[np.float64]:
    """Return the firing time of each channel (C,) within its column, seconds.

    Relative to the maker's reference instant. Without published times all channels of a column fire
    at once.
    """
    times_us = mounted.sensor.firing_time_us
    if times_us is None:
        return np.zeros(mounted.sensor.channels)
    return np.asarray(times_us * 1e-6, np.float64)


def _turns_per_second(mounted: MountedSensor) -> float:
    """Return the rotation rate in true time."""
    if mounted.phase_lock:
        return mounted.turns_per_second
    return mounted.turns_per_second * (1.0 + mounted.clock_drift_ppm * 1e-6)


def _first_turn(mounted: MountedSensor, time_s: float, turn_s: float, missing: float) -> int:
    """Return the first turn that arrives, or starts by its clock, at a time or later."""
    if mounted.framed_by_clock:  # true time at which the clock reads time_s
        begin_s = (time_s - mounted.clock_offset_s) / (1.0 + mounted.clock_drift_ppm * 1e-6)
    else:
        begin_s = time_s - mounted.latency_s
    return math.ceil(begin_s / turn_s + missing - _ON_THE_BORDER)


def _fate(mounted: MountedSensor, seed: int, number: int) -> tuple[float, bool]:
    """Return the jitter of a turn's start, seconds, and whether the turn is lost."""
    if mounted.time_jitter_s == 0 and mounted.dropped_frames == 0:
        return 0.0, False
    draws = _draws(mounted, seed, _TURN, number)
    moved = min(max(float(ndtri(draws[0])), -_FARTHEST_JITTER), _FARTHEST_JITTER)
    return moved * mounted.time_jitter_s, bool(draws[1] < mounted.dropped_frames)


def _draws(mounted: MountedSensor, seed: int, purpose: int, number: int) -> NDArray[np.float64]:
    """Return four uniform numbers in (0, 1), keyed by sensor, purpose and turn."""
    key = np.array([seed % 2**64, (mounted.number << 48) | _OF_TIMING], np.uint64)
    counter = np.array([number % 2**64, purpose, 0, 0], np.uint64)
    words = np.random.Philox(key=key, counter=counter).random_raw(4)
    return np.asarray(((words >> np.uint64(11)) + 0.5) * 2.0**-53, np.float64)
