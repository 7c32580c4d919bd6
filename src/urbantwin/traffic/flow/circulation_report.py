"""The report of a closed loop: population, halts and achieved flow."""

from __future__ import annotations

from typing import Any

import numpy as np

from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.demand.demand import Demand
from urbantwin.traffic.sumo.observed import Observed
from urbantwin.traffic.sumo.simulation import STUCK_S

__all__ = ["circulation_report"]

#: Before this minute of the simulation people are still coming in.
_SETTLED_MIN = 2
_SLICE_MIN = 10


def circulation_report(demand: Demand, seen: Observed, warmup_s: float) -> dict[str, Any]:
    """Return the ``circulation`` part of a motion's manifest.

    Args:
        demand: who circulates.
        seen: what was seen each second, from the start of the warm-up.
        warmup_s: length of the warm-up.
    """
    minutes = len(seen.samples)
    started = min(int(warmup_s // 60), minutes - 1)
    settled = min(_SETTLED_MIN, minutes - 1)
    hours = (minutes - settled) / 60
    population, passages = {}, {}
    for group in demand.populations:
        column = ACTOR_CLASSES.index(group.actor_class)
        population[group.actor_class] = {
            "planned": group.count,
            "least": int(seen.least[started:, column].min()),
            "most": int(seen.most[started:, column].max()),
        }
        # Seconds that were seen, not minutes: the last one is seldom whole.
        present = float(seen.samples[settled:, column].sum())
        speed = float(seen.metres[settled:, column].sum()) / max(present, 1.0)
        passages[group.actor_class] = {
            "asked": group.per_hour,
            "by_distance": round(group.count * speed / group.metres * 3600, 1),
            "counted": int(seen.entries[settled:, column].sum()),
        }
    drivers = [k for k, name in enumerate(ACTOR_CLASSES) if name != "pedestrian"]
    speeds = [
        {
            "from_s": round(first * 60 - warmup_s, 3),
            "metres_per_second": round(_speed(seen, first, drivers), 3),
        }
        for first in range(settled, minutes, _SLICE_MIN)
    ]
    return {
        "population": population,
        "passages_per_hour": passages,
        "counted_for_s": round(hours * 3600),
        "carried_share_of_motor_traffic": round(demand.carried, 3),
        "held_up": demand.held_up,
        "share_of_guess": round(demand.bound.share, 3),
        "guess_lowered_because": demand.bound.because,
        "mean_speed_of_vehicles": speeds,
        "longest_halt_s": round(seen.longest_halt_s, 1),
        "halted_longer_than_s": STUCK_S,
        "halted": [
            {
                "class": demand.trips[trip].actor_class,
                "until_s": round(time_s - warmup_s, 1),
                "lane": lane,
            }
            for trip, time_s, lane in seen.stuck
        ],
    }


def _speed(seen: Observed, first: int, classes: list[int]) -> float:
    """Return the mean speed of some classes over the slice that begins with a minute."""
    when = slice(first, first + _SLICE_MIN)
    samples = float(seen.samples[when][:, classes].sum())
    return float(np.sum(seen.metres[when][:, classes])) / max(samples, 1.0)
