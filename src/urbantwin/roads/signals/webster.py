"""Cycle and green times from volumes, after Webster.

Source: F. V. Webster, Traffic Signal Settings, Road Research Technical Paper 39, 1958: with lost
time L and the sum Y of the stages' critical flow ratios, delay is least at a cycle of
(1.5 L + 5) / (1 - Y) seconds, and with greens in proportion to those ratios.

Beyond capacity there is no such cycle; greens in proportion to the ratios still let all lanes be
equally full (equal degree of saturation, HCM 2016, 19). Who asks for more than all the green that
there is would have the others starve by that: it has what they leave instead.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

__all__ = [
    "LONGEST_CYCLE_S",
    "MOST_RATIO",
    "SATURATION_VEH_H",
    "SHORTEST_CYCLE_S",
    "STEP_S",
    "capped",
    "cycle_s",
    "green_seconds",
]

#: Vehicles that leave one lane in an hour of green (HCM 2016, 19: 1900 less usual adjustments).
SATURATION_VEH_H = 1800.0
#: Cycles are 60 to 120 s (RiLSA 2015, 2.7.3: 90 s as a rule, at most 120 s), in steps of 5 s.
SHORTEST_CYCLE_S, LONGEST_CYCLE_S, STEP_S = 60.0, 120.0, 5.0
#: More than this share of a cycle cannot be green.
MOST_RATIO = 0.9


def cycle_s(ratios: Sequence[float], lost_s: float, least_s: float) -> float:
    """Return the cycle, seconds.

    Args:
        ratios: critical flow ratio of each stage.
        lost_s: seconds between the stages.
        least_s: what the shortest greens and the time between them need.
    """
    whole = min(sum(ratios), MOST_RATIO)
    best = (1.5 * lost_s + 5.0) / (1.0 - whole)
    cycle = min(max(best, SHORTEST_CYCLE_S), LONGEST_CYCLE_S)
    return STEP_S * math.ceil(max(cycle, least_s) / STEP_S - 1e-6)


def capped(ratios: Sequence[float], most: float = MOST_RATIO) -> list[float]:
    """Return flow ratios of which none asks for more than there is.

    Who does has what the others leave, but no less than if all had the same.

    Args:
        ratios: critical flow ratio of each stage.
        most: what can be green.
    """
    found = np.asarray(ratios, np.float64)
    far = found > most
    if far.any():
        left = (most - found[~far].sum()) / far.sum()
        found = np.where(far, max(left, most / len(found)), found)
    return [float(one) for one in found]


def green_seconds(ratios: Sequence[float], least: Sequence[float], whole_s: float) -> list[float]:
    """Share out green in whole seconds, by the flow ratios, to nobody less than its least.

    Args:
        ratios: critical flow ratio of each stage.
        least: shortest green of each stage, whole seconds.
        whole_s: seconds to share out; at least the sum of the shortest.
    """
    weights = np.maximum(np.asarray(ratios, np.float64), 1e-6)
    shortest = np.asarray(least, np.float64)
    found = shortest.copy()
    free = np.ones(len(found), bool)
    while free.any():
        share = (whole_s - shortest[~free].sum()) * weights / weights[free].sum()
        short = free & (share < shortest)
        if not short.any():
            found[free] = share[free]
            break
        free &= ~short
    whole = np.floor(found + 1e-6)
    rest = round(whole_s - whole.sum())
    # What rounding leaves goes to those that it took most from.
    for k in np.argsort(whole - found, kind="stable")[: max(rest, 0)]:
        whole[k] += 1.0
    return [float(seconds) for seconds in whole]
