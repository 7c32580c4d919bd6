"""Arrivals in platoons: vehicles released by a signal upstream.

An approach has shares of a cycle: the density of unhindered arrivals at its end. The number of
arrivals per cycle is unchanged: within each cycle, times are moved so that their density follows
the shares, in the same order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.roads.assignment.street_network import StreetNetwork
from urbantwin.site.yaml_document import nearest
from urbantwin.traffic.demand.demand import Demand, Trip

__all__ = ["in_platoons", "moved_into"]

_ON_FOOT = ("pedestrian", "animal", "bicycle")


def moved_into(
    times_s: NDArray[np.float64], cycle_s: float, shares: Sequence[float]
) -> NDArray[np.float64]:
    """Return even times (N,) redistributed within their cycles by shares of the cycle, seconds."""
    whole, part = np.divmod(times_s, cycle_s)
    reached = np.concatenate([[0.0], np.cumsum(np.asarray(shares, np.float64))])
    target_s = np.linspace(0.0, cycle_s, len(reached))
    return np.asarray(whole * cycle_s + np.interp(part / cycle_s, reached / reached[-1], target_s))


def in_platoons(
    demand: Demand,
    arrivals: Sequence[Mapping[str, Any]],
    network: StreetNetwork,
    drivers: Mapping[str, Mapping[str, Any]],
) -> Demand:
    """Return a demand whose motor traffic departs so that it arrives in platoons.

    Args:
        demand: demand of counts, without circulation or groups.
        arrivals: ``traffic.arrivals`` of the site.
        network: its streets.
        drivers: ``traffic.drivers``, for the speed of each class.

    Raises:
        InputError: an approach does not exist.
    """
    if not arrivals:
        return demand
    of_approach = {row["approach"]: row for row in arrivals}
    seconds = {
        str(edge.getID()): float(edge.getLength()) / max(float(edge.getSpeed()), 1.0)
        for edge in network.streets
    }
    for number, row in enumerate(arrivals):
        if row["approach"] not in seconds:
            raise InputError(
                f"there is no road {row['approach']!r:.60}",
                place=f"traffic.arrivals[{number}].approach",
                expected=f"a road's id: {nearest(row['approach'], list(seconds))}",
            )
    trips = [_moved(trip, of_approach, seconds, drivers) for trip in demand.trips]
    order = sorted(range(len(trips)), key=lambda k: (trips[k].depart_s, k))
    place = {k: number for number, k in enumerate(order)}
    return replace(
        demand,
        trips=tuple(trips[k] for k in order),
        counted=tuple(
            replace(row, trips=tuple(sorted(place[k] for k in row.trips))) for row in demand.counted
        ),
    )


def _moved(
    trip: Trip,
    of_approach: Mapping[str, Mapping[str, Any]],
    seconds: Mapping[str, float],
    drivers: Mapping[str, Mapping[str, Any]],
) -> Trip:
    """Return a trip with its departure moved to arrive in a platoon."""
    if trip.actor_class in _ON_FOOT:
        return trip
    approach_index = next((k for k, edge in enumerate(trip.edges) if edge in of_approach), None)
    if approach_index is None:
        return trip
    factor = float(drivers.get(trip.actor_class, {}).get("speed_factor") or 1.0)
    takes_s = sum(seconds.get(edge, 0.0) for edge in trip.edges[: approach_index + 1]) / factor
    platoon = of_approach[trip.edges[approach_index]]
    # Even times stay even when shifted by the travel time.
    arrival_s = moved_into(np.array([trip.depart_s]), float(platoon["cycle_s"]), platoon["shares"])[
        0
    ]
    depart = arrival_s - takes_s
    while depart < 0:
        depart += float(platoon["cycle_s"])
    return replace(trip, depart_s=round(float(depart), 2))
