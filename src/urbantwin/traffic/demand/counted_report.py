"""Asked and driven, side by side, of what was counted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads import RoadNetwork
from urbantwin.traffic.demand.counts import rates_of, wanted_of
from urbantwin.traffic.demand.demand import CountedRow, Demand
from urbantwin.traffic.flow.bottleneck import bottleneck
from urbantwin.traffic.sumo.simulation import Simulated

__all__ = ["SHORT", "arrivals", "counted_report"]

#: Who is short by more than this share is told why.
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
    """Return what was asked and what was driven, row by row, actors an hour.

    Driven are those who came onto the exit (the road, the crossing) while the motion lasted.

    Args:
        counts: ``traffic.counts`` of the site.
        per_hour: by which motor traffic without a class is shared out.
        demand: the trips.
        simulated: what SUMO saw of them; their `arrivals` will do.
        roads: the lanes, with the programs that were shown.
        steps: how many steps the motion has.
        step_s: time between them.
    """
    duration_s = steps * step_s
    edge_of_lane = np.array([lane.rpartition("_")[0] for lane in simulated.lanes], object)
    told = []
    for row, planned in zip(counts, demand.counted, strict=True):
        rates = rates_of(row, per_hour, "").values()
        asked = sum(count for one in rates for _, _, count in wanted_of(one, 0.0, duration_s))
        came = _came(simulated, np.flatnonzero(edge_of_lane == planned.leaving), planned)
        driven = int(((came >= 0) & (came < steps)).sum())
        where = {name: row[name] for name in _WHERE if row.get(name)}
        kind = "pedestrian" if row.get("crossing") else "motor traffic"
        found = {
            **where,
            "class": row.get("actor_class") or kind,
            "has_way": bool(planned.trips) or asked < 1,
            "asked_per_hour": round(asked * 3600 / duration_s, 1),
            "driven_per_hour": round(driven * 3600 / duration_s, 1),
        }
        if planned.trips and driven < (1 - SHORT) * asked:
            found["held_up"] = _held_up(planned, simulated, roads)
        told.append(found)
    return told


#: What says where was counted.
_WHERE = ("junction", "approach", "turn", "road", "crossing")


def arrivals(simulated: Simulated, demand: Demand) -> Simulated:
    """Return the rows in which who was counted comes onto each lane first, and no other."""
    trips = [trip for planned in demand.counted for trip in planned.trips]
    rows = np.flatnonzero(np.isin(simulated.trip, trips))
    order = np.lexsort([simulated.step[rows], simulated.lane[rows], simulated.trip[rows]])
    rows = rows[order]
    new = np.diff(simulated.trip[rows], prepend=-1) != 0
    new |= np.diff(simulated.lane[rows], prepend=-1) != 0
    return simulated.only(np.sort(rows[new]))


def _came(
    simulated: Simulated, lanes: NDArray[np.integer], planned: CountedRow
) -> NDArray[np.int32]:
    """Return the first step on some lanes of each trip that was planned."""
    there = np.isin(simulated.lane, lanes) & np.isin(simulated.trip, planned.trips)
    # Those of before the motion were there already.
    order = np.lexsort([simulated.step[there], simulated.trip[there]])
    _, first = np.unique(simulated.trip[there][order], return_index=True)
    return np.asarray(simulated.step[there][order][first])


def _held_up(planned: CountedRow, simulated: Simulated, roads: RoadNetwork) -> str:
    """Return where the queue of those who come by an approach begins, and why."""
    minutes = max(len(simulated.observed.samples), 1)
    standing = {lane: sum_s / (60 * minutes) for lane, sum_s in simulated.observed.queued.items()}
    return bottleneck(roads, standing, road=planned.approach).because
