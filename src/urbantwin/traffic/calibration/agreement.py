"""Agreement between two measurements of traffic, and of a recording with itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.traffic.calibration.measured import Measured, joined

__all__ = ["agreement", "chance_between", "own_spread", "spread_of"]

_RANDOM_SPLITS, _MIN_VALUES = 200, 8
_MEASURES = ("class_shares_points", "turn_shares_points", "speed_ks", "headway_ks")


def agreement(recorded: Measured, simulated: Measured) -> dict[str, Any]:
    """Return differences of shares, in points, and Kolmogorov-Smirnov distances."""
    return {
        "class_shares_points": _shares(recorded.new, simulated.new),
        "turn_shares_points": _shares(recorded.turns, simulated.turns),
        "speed_ks": _distance(_joined(recorded.speeds), _joined(simulated.speeds)),
        "headway_ks": _distance(recorded.all_headways, simulated.all_headways),
        "vehicles": sum(recorded.turns.values()),
        "vehicles_simulated": sum(simulated.turns.values()),
        "headways": len(recorded.all_headways),
    }


def own_spread(recorded: Measured, seed: int = 1) -> dict[str, Any]:
    """Return the random differences of a recording from itself.

    Shares: 1.96 standard errors of the share with the largest. Distributions: distances of two
    halves of the vehicles (of the headways), drawn at random 200 times: median and 95 %.
    """
    random = np.random.Generator(np.random.Philox(key=[seed, 2000]))
    speeds, headways = list(recorded.speeds), [np.array([h]) for h in recorded.all_headways]
    return {
        "class_shares_points": _error(recorded.new),
        "turn_shares_points": _error(recorded.turns),
        "speed_ks": _random_split_distances(speeds, len(speeds) // 2, random),
        "headway_ks": _random_split_distances(headways, len(headways) // 2, random),
    }


def spread_of(spans: Sequence[Measured], whole: Measured) -> dict[str, Any] | None:
    """Return the differences of spans of a simulation from the whole: median and 95 %.

    They are those expected between a recording of the spans' duration and a perfect simulation.
    ``None`` for fewer than eight spans.
    """
    if len(spans) < _MIN_VALUES:
        return None
    rows = [agreement(span, whole) for span in spans]
    summaries: dict[str, Any] = {}
    for name in _MEASURES:
        values = [row[name] for row in rows if row[name] is not None]
        summaries[name] = _median_and_95(values) if len(values) >= _MIN_VALUES else None
    return summaries


def chance_between(fitted: Measured, held_out: Measured, seed: int = 1) -> dict[str, Any]:
    """Return the random differences between two parts of a recording: median and 95 %.

    They are the score on the held-out part of a simulation that agrees perfectly with the other
    part. Entries, passages, speeds of each vehicle and headways are randomly reassigned, 200 times,
    to parts of the given sizes (a permutation test). In reality headways of one queue and vehicles
    of one platoon are correlated, so that random differences are somewhat larger.
    """
    random = np.random.Generator(np.random.Philox(key=[seed, 2002]))
    both = joined([fitted, held_out])
    return {
        "class_shares_points": _random_split_counts(both.new, sum(held_out.new.values()), random),
        "turn_shares_points": _random_split_counts(
            both.turns, sum(held_out.turns.values()), random
        ),
        "speed_ks": _random_split_distances(list(both.speeds), len(held_out.speeds), random),
        "headway_ks": _random_split_distances(
            [np.array([headway_s]) for headway_s in both.all_headways],
            len(held_out.all_headways),
            random,
        ),
    }


def _random_split_counts(
    counts: Mapping[Any, int], second: int, random: np.random.Generator
) -> dict[str, float] | None:
    """Return differences of shares, in points, of counts randomly split into two parts."""
    totals = np.array(list(counts.values()))
    first = int(totals.sum()) - second
    if first <= 0 or second <= 0:
        return None
    drawn = random.multivariate_hypergeometric(totals, second, _RANDOM_SPLITS)
    off = np.abs(drawn / second - (totals - drawn) / first).max(axis=1)
    return _median_and_95(100 * off)


def _median_and_95(values: Sequence[float] | NDArray[np.float64]) -> dict[str, float]:
    median, most = np.quantile(values, [0.5, 0.95])
    return {"median": round(float(median), 3), "p95": round(float(most), 3)}


def _shares(first: Mapping[Any, int], second: Mapping[Any, int]) -> float | None:
    """Return the largest difference of shares, in points."""
    a, b = sum(first.values()), sum(second.values())
    if not a or not b:
        return None
    names = set(first) | set(second)
    return round(100 * max(abs(first.get(x, 0) / a - second.get(x, 0) / b) for x in names), 1)


def _error(counts: Mapping[Any, int]) -> float | None:
    whole = sum(counts.values())
    if not whole:
        return None
    share = np.array(list(counts.values())) / whole
    return round(float(196 * np.sqrt(share * (1 - share) / whole).max()), 1)


def _distance(first: NDArray[np.float64], second: NDArray[np.float64]) -> float | None:
    if len(first) < _MIN_VALUES or len(second) < _MIN_VALUES:
        return None
    return round(_ks_distance(first, second), 3)


def _ks_distance(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Return the Kolmogorov-Smirnov distance, without SciPy's slow computation of its p-value."""
    pooled = np.concatenate([first, second])
    shares = [np.searchsorted(np.sort(x), pooled, side="right") / len(x) for x in (first, second)]
    return float(np.abs(shares[0] - shares[1]).max())


def _random_split_distances(
    parts: list[NDArray[np.float64]], second: int, random: np.random.Generator
) -> dict[str, float] | None:
    """Return distances of two random groups of vehicles; ``second`` is the size of the second."""
    if len(parts) < _MIN_VALUES or not 0 < second < len(parts):
        return None
    distances = []
    for _ in range(_RANDOM_SPLITS):
        order = random.permutation(len(parts))
        groups = np.split(order, [len(parts) - second])
        distances.append(
            _ks_distance(*(np.concatenate([parts[k] for k in group]) for group in groups))
        )
    return _median_and_95(distances)


def _joined(parts: tuple[NDArray[np.float64], ...]) -> NDArray[np.float64]:
    return np.concatenate(parts) if parts else np.zeros(0)
