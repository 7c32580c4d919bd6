"""Platoons: the part of an upstream signal's cycle in which vehicles would reach an approach's end.

Arrivals are taken where a vehicle is first seen, and extrapolated to the stop line at its
unhindered speed, so that the queue at the stop line has no effect. Periodicity is tested by
Rayleigh's test over all usual cycle times (Mardia and Jupp, Directional Statistics, 2000, 6.3),
which rejects patterns of only a cycle or two.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from urbantwin.roads import RoadNetwork
from urbantwin.traffic.calibration.passages import Passage

__all__ = ["arrivals_of", "come_evenly", "platoons_of"]

#: Range of cycle times of upstream signals, seconds.
_CYCLES_S = (30.0, 180.0)
#: Number of parts of a cycle; least number of vehicles, and of cycles, for a pattern.
_CYCLE_PARTS, _MIN_VEHICLES, _MIN_CYCLES = 12, 40, 8
#: Expected number of vehicles per span in which arrivals are counted; least number of spans; and
#: p-value below which arrivals count as even.
_EXPECTED, _MIN_SPANS, _EVEN_P_VALUE = 5, 10, 0.01
#: p-value below which a pattern is significant.
_PATTERN_P_VALUE = 0.001
#: Least distance to the stop line, metres, and speed, m/s, at first sight, which exclude vehicles
#: in the queue.
_MIN_APPROACH_M, _MIN_SPEED_MS = 25.0, 3.0
#: Ratio of the test statistics above which another cycle time is preferred to the junction's own.
_MIN_POWER_RATIO = 1.25


def arrivals_of(
    passages: Sequence[Passage],
    roads: RoadNetwork,
    speed_factor: float,
    begin_s: float,
    end_s: float,
) -> dict[str, NDArray[np.float64]]:
    """Return, by approach, the times at which unhindered vehicles would reach its end, seconds."""
    limits = {lane.road: lane.speed_limit for lane in roads.lanes}
    arrivals: dict[str, list[float]] = defaultdict(list)
    for passage in passages:
        limit = limits.get(passage.approach, 0.0)
        before = passage.seen.time_s <= passage.passed_s
        if limit <= 0 or before.sum() < 2:
            continue
        ahead = float(np.linalg.norm(np.diff(passage.seen.xy[before], axis=0), axis=1).sum())
        moves = float(np.abs(passage.seen.speed[:10]).mean()) >= _MIN_SPEED_MS
        if ahead < _MIN_APPROACH_M or not moves:
            continue
        arrival_s = float(passage.seen.time_s[0]) + ahead / (limit * speed_factor)
        # Arrival times of vehicles present at the start of the recording are unknown.
        if passage.seen.time_s[0] > begin_s + 1.0 and arrival_s < end_s:
            arrivals[passage.approach].append(arrival_s)
    return {name: np.sort(times) for name, times in sorted(arrivals.items())}


def platoons_of(
    arrivals: dict[str, NDArray[np.float64]], seconds: float, own_cycle_s: float
) -> list[dict[str, Any]]:
    """Return rows of ``traffic.arrivals`` for approaches with platoons.

    Args:
        arrivals: by approach, seconds, from `arrivals_of`.
        seconds: duration of the recording.
        own_cycle_s: cycle time of the junction's own signals, which adjacent signals often share; 0
            if unknown.
    """
    rows = []
    for name, times in arrivals.items():
        cycle_s = _period(times, seconds, own_cycle_s)
        if cycle_s is None:
            continue
        count, _ = np.histogram(times % cycle_s, np.linspace(0.0, cycle_s, _CYCLE_PARTS + 1))
        # Half a vehicle is added to each part, so that none has a share of 0.
        share = (count + 0.5) / (count.sum() + 0.5 * _CYCLE_PARTS)
        rows.append(
            {
                "approach": name,
                "cycle_s": round(cycle_s, 2),
                "shares": [round(float(part), 4) for part in share],
            }
        )
    return rows


def come_evenly(arrivals: dict[str, NDArray[np.float64]], seconds: float, cycle_s: float) -> bool:
    """Return whether vehicles arrive more evenly than independent ones.

    The variance of the numbers of arrivals in spans of whole cycles, with five expected in each,
    equals their mean for independent arrivals (test of a Poisson distribution by its index of
    dispersion: Fisher, Statistical Methods for Research Workers, 1925, section 16). With fewer than
    ten such numbers they are assumed to be even.

    Args:
        arrivals: by approach, seconds, from `arrivals_of`.
        seconds: duration of the recording.
        cycle_s: cycle time of the arrivals; 0: any span.
    """
    off, freedom = 0.0, 0
    for times in arrivals.values():
        unit_s = cycle_s or _CYCLES_S[0]
        span_s = unit_s * max(1.0, np.ceil(_EXPECTED / max(len(times), 1) * seconds / unit_s))
        count, _ = np.histogram(times, np.arange(0.0, seconds + 1e-9, span_s))
        if len(count) > 1 and count.sum():
            off += float(((count - count.mean()) ** 2).sum() / count.mean())
            freedom += len(count) - 1
    return freedom < _MIN_SPANS or float(chi2.cdf(off, freedom)) < _EVEN_P_VALUE


def _period(times: NDArray[np.float64], seconds: float, own_cycle_s: float) -> float | None:
    """Return the period of arrivals; ``None`` if they are random."""
    longest = min(_CYCLES_S[1], seconds / _MIN_CYCLES)
    if len(times) < _MIN_VEHICLES or longest <= _CYCLES_S[0]:
        return None
    step = 0.1 / seconds
    often = np.arange(1 / longest, 1 / _CYCLES_S[0], step)
    power = _rayleigh_z(times, often)
    # False-alarm probability of the maximum over all independent frequencies of the periodogram.
    least = np.log(max((often[-1] - often[0]) * seconds, 1.0) / _PATTERN_P_VALUE)
    best = int(np.argmax(power))
    if own_cycle_s and _CYCLES_S[0] <= own_cycle_s <= longest:
        own = float(_rayleigh_z(times, np.array([1 / own_cycle_s]))[0])
        if own >= np.log(1 / _PATTERN_P_VALUE) and own * _MIN_POWER_RATIO >= power[best]:
            return own_cycle_s
    return float(1 / often[best]) if power[best] >= least else None


def _rayleigh_z(times: NDArray[np.float64], often: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Rayleigh's statistic z of times at frequencies (F,), 1/s; its p-value is e^-z."""
    turns = np.exp(2j * np.pi * often[:, None] * times[None])
    return np.asarray(np.abs(turns.sum(axis=1)) ** 2 / len(times))
