"""Requested and driven traffic of each row of counts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads import RoadNetwork
from urbantwin.traffic.demand.count_rates import rates_of, wanted_of
from urbantwin.traffic.demand.demand import CountedRow, Demand
from urbantwin.traffic.flow.bottleneck import bottleneck
from urbantwin.traffic.sumo.simulation import Simulated

__all__ = ["SHORT", "arrivals", "counted_report"]

#: Relative shortfall above which the report gives a reason.
SHORT = 0.1


def counted_report(
    counts: Sequence[Mapping[str, Any]],
    per_hour: Mapping[str, float],
    demand: Demand,
    simulated: Simulated,
    roads: RoadNetwork,
    *,
    steps: int,
    step_s: float,
) -> list[dict[str, Any]]:
    """Return requested and driven actors per hour of each row of counts.

    Driven are those that entered the exit road (the road, the crossing) during the motion.

    Args:
        counts: ``traffic.counts`` of the site.
        per_hour: composition of motor traffic that is counted without a class.
        demand: the trips.
        simulated: SUMO's output; their `arrivals` suffice.
        roads: the lanes, with the signal programs used.
        steps: number of steps of the motion.
        step_s: time between steps, seconds.
    """
    duration_s = steps * step_s
    edge_of_lane = np.array([lane.rpartition("_")[0] for lane in simulated.lanes], object)
    rows = []
    for row, planned in zip(counts, demand.counted, strict=True):
        rates = rates_of(row, per_hour, "").values()
        requested = sum(
            count for quarters in rates for _, _, count in wanted_of(quarters, 0.0, duration_s)
        )
        first_steps = _first_steps(
            simulated, np.flatnonzero(edge_of_lane == planned.leaving), planned
        )
        driven = int(((first_steps >= 0) & (first_steps < steps)).sum())
        where = {name: row[name] for name in _PLACE_FIELDS if row.get(name)}
        kind = "pedestrian" if row.get("crossing") else "motor traffic"
        entry = {
            **where,
            "class": row.get("actor_class") or kind,
            "has_way": bool(planned.trips) or requested < 1,
            "asked_per_hour": round(requested * 3600 / duration_s, 1),
            "driven_per_hour": round(driven * 3600 / duration_s, 1),
        }
        if planned.trips and driven < (1 - SHORT) * requested:
            entry["held_up"] = _queue_cause(planned, simulated, roads)
        rows.append(entry)
    return rows


#: Fields that give the place of a count.
_PLACE_FIELDS = ("junction", "approach", "turn", "road", "crossing")


def arrivals(simulated: Simulated, demand: Demand) -> Simulated:
    """Return only the rows in which a counted trip first enters each lane."""
    trips = [trip for planned in demand.counted for trip in planned.trips]
    rows = np.flatnonzero(np.isin(simulated.trip, trips))
    order = np.lexsort([simulated.step[rows], simulated.lane[rows], simulated.trip[rows]])
    rows = rows[order]
    new = np.diff(simulated.trip[rows], prepend=-1) != 0
    new |= np.diff(simulated.lane[rows], prepend=-1) != 0
    return simulated.only(np.sort(rows[new]))


def _first_steps(
    simulated: Simulated, lanes: NDArray[np.integer], planned: CountedRow
) -> NDArray[np.int32]:
    """Return the first step of each planned trip on some lanes."""
    is_counted = np.isin(simulated.lane, lanes) & np.isin(simulated.trip, planned.trips)
    # The first step may precede the motion.
    order = np.lexsort([simulated.step[is_counted], simulated.trip[is_counted]])
    _, first = np.unique(simulated.trip[is_counted][order], return_index=True)
    return np.asarray(simulated.step[is_counted][order][first])


def _queue_cause(planned: CountedRow, simulated: Simulated, roads: RoadNetwork) -> str:
    """Return where the queue of an approach begins, and why."""
    minutes = max(len(simulated.observed.samples), 1)
    standing = {lane: sum_s / (60 * minutes) for lane, sum_s in simulated.observed.queued.items()}
    return bottleneck(roads, standing, road=planned.approach).because
