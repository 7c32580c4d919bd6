"""When a sensor fires: its turns, what lies in a frame, and what its clock says.

**Turns.** A turn begins when the encoder stands at ``phase_deg``. With ``phase_lock`` that is at
every whole multiple of ``1 / turns_per_second``, as a motor does that is locked to a common pulse
(what Velodyne, Hesai and Ouster call phase lock): two locked sensors look into their phases at the
same moments, for ever. Without, the motor starts anywhere (a draw of the seed) and follows the
sensor's own clock, so it drifts with it.
``time_jitter_s`` moves the begin of each turn by a draw of the normal distribution, cut at three
times its standard deviation.

**Frames.** Frame n collects for ``frame_window_s`` from ``t_n = n / rate_hz`` on: the turns whose
data begin to arrive then, which is ``latency_s`` after they are measured; of a rig whose frames go
by clocks, the turns whose begin, by their sensor's clock, lies in that span, so that a wrong clock
brings turns of another moment into a frame. So no turn is in two frames, and, where frames follow
each other without a gap, none is in no frame, unless it is lost (``dropped_frames``). Sensors are
switched on when the motion starts: there are no turns before, so the first frames of a sensor whose
data come late are empty.

**Clock.** At true time t a sensor's clock says ``t + clock_offset_s + clock_drift_ppm 1e-6 t``.

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
    """One turn of a sensor, in seconds from the frame's time.

    The ray of channel c in column k fires at ``column_time_s[k] + ring_time_s[c]``, true time.
    Column k is the one that fires at encoder angle ``2 pi k / K``, whichever fires first.

    Attributes:
        column_time_s: (K,) float64, when each column begins.
        ring_time_s: (C,) float64, when each channel fires within its column.
        clock_offset_s: what the sensor's clock is ahead of true time at the frame's time.
        clock_rate: seconds that its clock counts in a true second.
        turn: the number of the turn since the start of the motion.
    """

    column_time_s: NDArray[np.float64]
    ring_time_s: NDArray[np.float64]
    clock_offset_s: float = 0.0
    clock_rate: float = 1.0
    turn: int = 0

    @property
    def first_column(self) -> int:
        """The column that fires first; those after it follow in time, around the turn."""
        return int(self.column_time_s.argmin())

    @classmethod
    def snapshot(cls, columns: int, channels: int) -> Sweep:
        """Return a turn in which every ray fires at the frame's time."""
        return cls(np.zeros(columns), np.zeros(channels))

    def reported(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what the sensor's clock says, from the frame's time, at true times."""
        return self.clock_offset_s + self.clock_rate * time_s


#: A turn this near a border of frames (in turns) begins on it: times are binary fractions.
_ON_THE_BORDER = 1e-6
#: No begin of a turn is displaced by more than so many standard deviations.
_FARTHEST_JITTER = 3.0
#: Tells the draws of timing from those of returns, whose keys hold a frame's number there.
_OF_TIMING = 1 << 47
_START, _TURN = 0, 1


@dataclass(frozen=True)
class Turn:
    """One turn of a sensor, as a frame counts it. Times are true, seconds from the frame's.

    Attributes:
        number: of the turn since the start of the motion.
        start_s: when it begins.
        stop_s: when it ends and the next one would begin.
        arrival_s: when its last data have arrived.
        dropped: whether it was lost.
    """

    number: int
    start_s: float
    stop_s: float
    arrival_s: float
    dropped: bool


def turns_of(mounted: MountedSensor, frame_index: int, seed: int) -> tuple[Turn, ...]:
    """Return the turns that arrive in a frame, those that were lost too, in their order.

    Args:
        mounted: the sensor.
        frame_index: the frame's number; its time is ``frame_index / mounted.rate_hz``.
        seed: of all random numbers.
    """
    time_s = frame_index / mounted.rate_hz
    turn_s = 1.0 / _turns_per_second(mounted)
    missing = 0.0 if mounted.phase_lock else float(_draws(mounted, seed, _START, 0)[0])
    # Turn m begins at (m - missing) turns; it is counted when its data arrive.
    first = _first_turn(mounted, time_s, turn_s, missing)
    window_s = mounted.frame_window_s
    if window_s * mounted.rate_hz > 1 - _ON_THE_BORDER:
        # The next frame's first turn in the same arithmetic: none is lost or double.
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
    """Return the turns of a sensor that a frame holds: none, one or several, in their order.

    Column k fires when the encoder stands at ``2 pi k / K``, wherever a turn begins. Without the
    effect ``rolling_shutter`` all rays of a turn fire when it begins. The columns of a sensor
    whose pattern does not repeat follow each other from the begin on.

    Args:
        mounted: the sensor.
        frame_index: the frame's number; its time is ``frame_index / mounted.rate_hz``.
        seed: of all random numbers.
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
    """Return after which share of a turn each column (K,) fires."""
    # Rounded, for binary fractions: the column at the phase is the first, not the last.
    return np.asarray(np.round(np.arange(columns) - phase * columns, 9) % columns / columns)


def span_of(sensors: Iterable[MountedSensor], frame_index: int, seed: int) -> tuple[float, float]:
    """Return the first and the last firing of a frame, and its own time between them.

    Seconds from the frame's time; what the world must be known for.
    """
    low, high = 0.0, 0.0
    for one in sensors:
        rolling = one.effects.rolling_shutter
        ring_s = ring_times(one) if rolling else np.zeros(1)
        for turn in turns_of(one, frame_index, seed):
            low = min(low, turn.start_s + float(ring_s.min()))
            high = max(high, (turn.stop_s if rolling else turn.start_s) + float(ring_s.max()))
    return low, high


def ring_times(mounted: MountedSensor) -> NDArray[np.float64]:
    """Return when each channel (C,) fires within its column, seconds, as the maker counts it.

    Where the maker publishes no firing times, all channels of a column are taken to fire at once.
    """
    times_us = mounted.sensor.firing_time_us
    if times_us is None:
        return np.zeros(mounted.sensor.channels)
    return np.asarray(times_us * 1e-6, np.float64)


def _turns_per_second(mounted: MountedSensor) -> float:
    """Return how fast the motor turns in true time."""
    if mounted.phase_lock:
        return mounted.turns_per_second
    return mounted.turns_per_second * (1.0 + mounted.clock_drift_ppm * 1e-6)


def _first_turn(mounted: MountedSensor, time_s: float, turn_s: float, missing: float) -> int:
    """Return the first turn that begins to arrive, or that its clock dates, then or later."""
    if mounted.framed_by_clock:  # when the clock says that time
        begin_s = (time_s - mounted.clock_offset_s) / (1.0 + mounted.clock_drift_ppm * 1e-6)
    else:
        begin_s = time_s - mounted.latency_s
    return math.ceil(begin_s / turn_s + missing - _ON_THE_BORDER)


def _fate(mounted: MountedSensor, seed: int, number: int) -> tuple[float, bool]:
    """Return how late a turn begins, seconds, and whether it is lost."""
    if mounted.time_jitter_s == 0 and mounted.dropped_frames == 0:
        return 0.0, False
    draws = _draws(mounted, seed, _TURN, number)
    moved = min(max(float(ndtri(draws[0])), -_FARTHEST_JITTER), _FARTHEST_JITTER)
    return moved * mounted.time_jitter_s, bool(draws[1] < mounted.dropped_frames)


def _draws(mounted: MountedSensor, seed: int, purpose: int, number: int) -> NDArray[np.float64]:
    """Return four uniform numbers in (0, 1) that belong to a sensor, a purpose and a turn."""
    key = np.array([seed % 2**64, (mounted.number << 48) | _OF_TIMING], np.uint64)
    counter = np.array([number % 2**64, purpose, 0, 0], np.uint64)
    words = np.random.Philox(key=key, counter=counter).random_raw(4)
    return np.asarray(((words >> np.uint64(11)) + 0.5) * 2.0**-53, np.float64)
