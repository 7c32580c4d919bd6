"""How much of guessed volumes the streets carry, as pilot simulations show it.

Whoever passes where a queue begins stays away, as many as were missing, and the rest is driven
again. What even those who are left do not bring in, nobody is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from urbantwin.roads import RoadNetwork
from urbantwin.roads.assignment.movement_flows import IN_CARS
from urbantwin.traffic.demand.circulation import Circulation
from urbantwin.traffic.demand.demand import Bound
from urbantwin.traffic.demand.guessed_volumes import share_of_motor
from urbantwin.traffic.flow.bottleneck import Bottleneck, bottleneck
from urbantwin.traffic.flow.flow_calibration import SURE, Calibrated

__all__ = ["carried_guess"]

#: So many queues are looked at, one after the other.
QUEUES = 2
#: Least and largest share of the ways over a queue that is left.
LEFT = (0.4, 0.9)


def carried_guess(
    circulation: Circulation,
    bound: Bound,
    roads: RoadNetwork,
    pilots: Callable[[Circulation, Calibrated | None], Calibrated],
) -> tuple[Circulation, Calibrated, Bound]:
    """Return who circulates of a guess, how many that are, and how much of the guess.

    Args:
        circulation: as guessed, and bounded by signals.
        bound: how much of the guess that is.
        roads: the lanes, to tell where queues begin.
        pilots: finds the population of a circulation (``flow_calibration.calibrate``), after what
            was found with a little more traffic.
    """
    best, found = circulation, pilots(circulation, None)
    first = Bottleneck()
    for _ in range(QUEUES):
        if found.carried >= 1:
            break
        queue = bottleneck(roads, found.standing)
        first = first if first.because else queue
        flows = best.flows()
        left = _left(flows, queue.road, _missing(best, found.carried))
        if not left:
            break
        fewer = best.lowered(left, IN_CARS.keys())
        again = pilots(fewer, found)
        if _motor(fewer) * again.carried <= _motor(best) * found.carried:
            break
        best, found = fewer, again
    share = bound.share * share_of_motor(best, circulation)
    if found.carried < 1:
        share, found = share * found.carried * SURE, found.as_asked()
    if first.because:
        bound = Bound(share, f"in pilot simulations {first.because}")
    return best, found, replace(bound, share=share)


def _motor(circulation: Circulation) -> float:
    """Return how many motor vehicles come in by the hour."""
    return sum(circulation.per_hour[name] for name in sorted(IN_CARS))


def _missing(circulation: Circulation, carried: float) -> float:
    """Return how many are asked for by the hour and not carried."""
    return (1.0 - carried) * _motor(circulation)


def _left(
    flows: Mapping[tuple[str, str, str], float], road: str, missing: float
) -> dict[tuple[str, str], float]:
    """Return the share that is left of the ways over a road when those who are missing are gone."""
    over = sum(count for (edge, _, _), count in flows.items() if edge == road)
    if not over:
        return {}
    share = float(np.clip(1.0 - missing / over, *LEFT))
    return {(edge, onward): share for edge, onward, _ in flows if edge == road}
