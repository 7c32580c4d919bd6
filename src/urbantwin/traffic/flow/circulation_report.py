"""The report of a closed loop: population, halts and achieved flow."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from urbantwin.roads import RoadNetwork
from urbantwin.roads.assignment.movement_flows import IN_CARS
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.demand.demand import Demand
from urbantwin.traffic.flow.bottleneck import bottleneck
from urbantwin.traffic.sumo.observed import Observed
from urbantwin.traffic.sumo.simulation import STUCK_S, Simulated

__all__ = ["circulation_report"]

_SLICE_MIN = 10
#: Below this share of the motor traffic requested the report says where the longest queue begins.
_MIN_CARRIED_SHARE = 0.95


def circulation_report(
    demand: Demand, simulated: Simulated, warmup_s: float, roads: RoadNetwork
) -> dict[str, Any]:
    """Return the ``circulation`` part of a motion's manifest.

    Passages are those after the warm-up: ``counted``, where vehicles come in from outer roads, and
    ``by_distance``: the distance that all vehicles of a class travelled, over the mean distance
    from one entry into the region to the next.

    Args:
        demand: the demand of a closed loop.
        simulated: the simulation of it, from the start of the warm-up.
        warmup_s: length of the warm-up.
        roads: the lanes, for where a queue begins.
    """
    seen = simulated.observed
    minutes = len(seen.samples)
    started = min(int(warmup_s // 60), minutes - 1)
    counted_s = float(seen.seconds[started:].sum())
    population, passages = {}, {}
    # Passengers are in addition to the circulating actors; vehicles may come from a reserve.
    departed = Counter(
        demand.trips[trip].actor_class
        for trip in simulated.departed
        if demand.trips[trip].in_reserve
    )
    for group in demand.populations:
        column = ACTOR_CLASSES.index(group.actor_class)
        count = group.count + departed[group.actor_class]
        population[group.actor_class] = {
            "planned": count,
            "least": int(seen.least[started:, column].min()),
            "most": int(seen.most[started:, column].max()),
        }
        # By sampled seconds, since the last minute is seldom complete.
        present = float(seen.samples[started:, column].sum())
        speed = float(seen.metres[started:, column].sum()) / max(present, 1.0)
        passages[group.actor_class] = {
            "asked": group.per_hour,
            "by_distance": round(count * speed / group.metres * 3600, 1),
            "counted": int(seen.entries[started:, column].sum()),
        }
    motor = [row for name, row in passages.items() if name in IN_CARS]
    requested = sum(row["asked"] for row in motor)
    driven = sum(row["by_distance"] for row in motor)
    if demand.outer and counted_s:
        driven = sum(row["counted"] for row in motor) * 3600.0 / counted_s
    share = driven / requested if requested else None
    inside = {
        lane: seconds / max(float(seen.seconds.sum()), 1.0)
        for lane, seconds in seen.queued.items()
        if lane.rpartition("_")[0] not in demand.outer
    }
    drivers = [k for k, name in enumerate(ACTOR_CLASSES) if name != "pedestrian"]
    speeds = [
        {
            "from_s": round(first * 60 - warmup_s, 3),
            "metres_per_second": round(_speed(seen, first, drivers), 3),
        }
        for first in range(started, minutes, _SLICE_MIN)
    ]
    return {
        "population": population,
        "passages_per_hour": passages,
        "counted_for_s": round(counted_s),
        "motor_traffic_per_hour": {"asked": round(requested, 1), "driven": round(driven, 1)},
        "carried_share_of_motor_traffic": None if share is None else round(share, 3),
        "held_up": ""
        if share is None or share >= _MIN_CARRIED_SHARE
        else bottleneck(roads, inside).because,
        "share_of_guess": None if demand.bound.share is None else round(demand.bound.share, 3),
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
