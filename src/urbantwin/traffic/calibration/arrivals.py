"""Platoons: in which part of a cycle upstream who comes by an approach would reach its end.

Arrivals are taken where a vehicle is first seen, and carried on to the stop line at the speed that
it would have if nobody held it up, so that the queue before the stop line says nothing of them.
Whether they repeat is told by Rayleigh's test over all periods that signals have (Mardia and Jupp,
Directional Statistics, 2000, 6.3): a pattern of a cycle or two is not one.
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

#: Cycles that signals upstream may have, seconds.
_CYCLES_S = (30.0, 180.0)
#: A cycle is divided into so many parts; patterns are told of so many vehicles and cycles.
_PARTS, _FEWEST, _CYCLES = 12, 40, 8
#: Numbers that come are counted in spans in which so many are expected; so many numbers tell
#: something; and who comes at random comes so evenly by chance.
_EXPECTED, _NUMBERS, _EVENLY = 5, 10, 0.01
#: Patterns that would be seen by chance in fewer cases than this are patterns.
_CHANCE = 0.001
#: First seen so far before the stop line, metres, and no slower, m/s: not in its queue.
_BEFORE_M, _SLOWEST_MS = 25.0, 3.0
#: Another signal's cycle is preferred to the junction's own where it tells so much more.
_BETTER = 1.25


def arrivals_of(
    passages: Sequence[Passage],
    roads: RoadNetwork,
    speed_factor: float,
    begin_s: float,
    end_s: float,
) -> dict[str, NDArray[np.float64]]:
    """Return by approach when each vehicle would be at its end if nobody held it up, seconds."""
    limits = {lane.road: lane.speed_limit for lane in roads.lanes}
    found: dict[str, list[float]] = defaultdict(list)
    for one in passages:
        limit = limits.get(one.approach, 0.0)
        before = one.seen.time_s <= one.passed_s
        if limit <= 0 or before.sum() < 2:
            continue
        ahead = float(np.linalg.norm(np.diff(one.seen.xy[before], axis=0), axis=1).sum())
        moves = float(np.abs(one.seen.speed[:10]).mean()) >= _SLOWEST_MS
        if ahead < _BEFORE_M or not moves:
            continue
        at = float(one.seen.time_s[0]) + ahead / (limit * speed_factor)
        # Who was there when the recording began came at an unknown time.
        if one.seen.time_s[0] > begin_s + 1.0 and at < end_s:
            found[one.approach].append(at)
    return {name: np.sort(times) for name, times in sorted(found.items())}


def platoons_of(
    arrivals: dict[str, NDArray[np.float64]], seconds: float, own_cycle_s: float
) -> list[dict[str, Any]]:
    """Return rows of ``traffic.arrivals``: of the approaches by which platoons come.

    Args:
        arrivals: by approach, seconds, as `arrivals_of` returns them.
        seconds: for how long was recorded.
        own_cycle_s: of the junction's own signals; 0 where it is not known. Signals in a row often
            have the same.
    """
    rows = []
    for name, times in arrivals.items():
        cycle_s = _period(times, seconds, own_cycle_s)
        if cycle_s is None:
            continue
        count, _ = np.histogram(times % cycle_s, np.linspace(0.0, cycle_s, _PARTS + 1))
        # Parts of a cycle in which nobody came may have somebody: half a vehicle each.
        share = (count + 0.5) / (count.sum() + 0.5 * _PARTS)
        rows.append(
            {
                "approach": name,
                "cycle_s": round(cycle_s, 2),
                "shares": [round(float(one), 4) for one in share],
            }
        )
    return rows


def come_evenly(arrivals: dict[str, NDArray[np.float64]], seconds: float, cycle_s: float) -> bool:
    """Return whether vehicles come more evenly than who knows nothing of the others.

    Numbers that come by an approach in spans of so many whole cycles that five are expected vary
    as much as they are large if vehicles come at random (test of a Poisson distribution by its
    index of dispersion: Fisher, Statistical Methods for Research Workers, 1925, section 16).
    Where fewer than ten such numbers are known nothing is told, and they are taken to come evenly.

    Args:
        arrivals: by approach, seconds, as `arrivals_of` returns them.
        seconds: for how long was recorded.
        cycle_s: in which they come; of 0 any span will do.
    """
    off, freedom = 0.0, 0
    for times in arrivals.values():
        unit_s = cycle_s or _CYCLES_S[0]
        span_s = unit_s * max(1.0, np.ceil(_EXPECTED / max(len(times), 1) * seconds / unit_s))
        count, _ = np.histogram(times, np.arange(0.0, seconds + 1e-9, span_s))
        if len(count) > 1 and count.sum():
            off += float(((count - count.mean()) ** 2).sum() / count.mean())
            freedom += len(count) - 1
    return freedom < _NUMBERS or float(chi2.cdf(off, freedom)) < _EVENLY


def _period(times: NDArray[np.float64], seconds: float, own_cycle_s: float) -> float | None:
    """Return the period in which vehicles come; ``None`` where they come at random."""
    longest = min(_CYCLES_S[1], seconds / _CYCLES)
    if len(times) < _FEWEST or longest <= _CYCLES_S[0]:
        return None
    step = 0.1 / seconds
    often = np.arange(1 / longest, 1 / _CYCLES_S[0], step)
    power = _power(times, often)
    # Of all independent frequencies of the periodogram, one in so many by chance (false alarm).
    least = np.log(max((often[-1] - often[0]) * seconds, 1.0) / _CHANCE)
    best = int(np.argmax(power))
    if own_cycle_s and _CYCLES_S[0] <= own_cycle_s <= longest:
        own = float(_power(times, np.array([1 / own_cycle_s]))[0])
        if own >= np.log(1 / _CHANCE) and own * _BETTER >= power[best]:
            return own_cycle_s
    return float(1 / often[best]) if power[best] >= least else None


def _power(times: NDArray[np.float64], often: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Rayleigh's statistic of times for frequencies (F,), 1/s: as e^-z by chance."""
    turns = np.exp(2j * np.pi * often[:, None] * times[None])
    return np.asarray(np.abs(turns.sum(axis=1)) ** 2 / len(times))
