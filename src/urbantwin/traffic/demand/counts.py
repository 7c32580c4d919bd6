"""Counted traffic: trips that pass as it was counted, by approach and turn.

A row of counts is a way through: it begins at the region's border where its approach is reached
soonest, goes over the approach and the exit, and ends where the border is soonest reached again.
Two roads that are not neighbours make a row of a table of origins and destinations. Where one
vehicle may be counted in several rows, ways are fitted to all of them (``counted_routes``).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from urbantwin.roads import RoadNetwork
from urbantwin.roads.assignment.street_network import StreetNetwork, Streets
from urbantwin.traffic.demand.counted_places import way_of
from urbantwin.traffic.demand.counted_routes import fitted_demand, way_through
from urbantwin.traffic.demand.counted_volumes import departures_of, rates_of, wanted_of
from urbantwin.traffic.demand.demand import CountedRow, Demand, LeftOut, Trip
from urbantwin.traffic.demand.vehicle_types import ACTOR_KINDS

__all__ = ["counted_demand"]

_MOST_OF_A_ROW = 100_000  # bodies of a row are drawn by numbers of its own
_STREAM = 1000  # of random numbers, after those of the classes


def counted_demand(  # noqa: PLR0913 - counts have as many sides
    counts: Sequence[Mapping[str, Any]],
    roads: RoadNetwork,
    network: StreetNetwork,
    per_hour: Mapping[str, float],
    *,
    warmup_s: float,
    duration_s: float,
    seed: int,
    body: Callable[[str, int], str],
    evenly: bool = True,
) -> Demand:
    """Return the trips that counts ask for, row by row; each row has random numbers of its own.

    Args:
        counts: ``traffic.counts`` of the site.
        roads: the lane network, which knows names and places of roads.
        network: its streets, without outer roads.
        per_hour: by which motor traffic without a class is shared out.
        warmup_s: how long traffic runs before the motion starts.
        duration_s: how long the motion is.
        seed: the same seed gives the same trips.
        body: the asset of the n-th actor of a class.
        evenly: whether each row's traffic is spread over the time (`departures_of`).

    Raises:
        InputError: an approach or a turn is not there; the row is named.
    """
    if _overlap(counts, roads):
        return fitted_demand(
            counts,
            roads,
            network,
            per_hour,
            warmup_s=warmup_s,
            duration_s=duration_s,
            seed=seed,
            body=body,
            evenly=evenly,
        )
    trips: list[tuple[Trip, int]] = []
    left_out: list[LeftOut] = []
    streets: dict[str, Streets | None] = {}
    owed: dict[str, float] = {}
    ways: list[tuple[str, str]] = []
    for number, row in enumerate(counts):
        place = row.get("row") or f"traffic.counts[{number}]"
        way = way_of(row, roads, place)
        ways.append((way.approach.id, way.exit.id))
        for name, rates in rates_of(row, per_hour, place).items():
            vclass = ACTOR_KINDS[name].vclass
            if vclass not in streets:
                streets[vclass] = network.driven_by(vclass)
            found = streets[vclass]
            edges = None if found is None else way_through(found, way.approach.id, way.exit.id)
            random = np.random.Generator(np.random.Philox(key=[seed, _STREAM + number]))
            wanted = wanted_of(rates, warmup_s, duration_s)
            at = departures_of(wanted, owed.get(name, 0.5), random, evenly=evenly)
            owed[name] = (owed.get(name, 0.5) + sum(count for _, _, count in wanted)) % 1.0
            if edges is None:
                if len(at):
                    why = f"no way from {way.approach.id} to {way.exit.id} for it ({place})"
                    left_out.append(LeftOut(name, len(at), why))
                continue
            trips += [
                (
                    Trip(
                        name,
                        body(name, number * _MOST_OF_A_ROW + k),
                        round(float(time_s), 2),
                        edges,
                    ),
                    number,
                )
                for k, time_s in enumerate(at)
            ]
    trips.sort(key=lambda one: (one[0].depart_s, one[1]))
    rows: list[list[int]] = [[] for _ in counts]
    for number, (_, row_number) in enumerate(trips):
        rows[row_number].append(number)
    counted = tuple(CountedRow(*way, tuple(row)) for way, row in zip(ways, rows, strict=True))
    return Demand(tuple(trip for trip, _ in trips), tuple(left_out), counted=counted)


def _overlap(counts: Sequence[Mapping[str, Any]], roads: RoadNetwork) -> bool:
    """Return whether one vehicle may be counted in several rows, or people are counted."""
    places = [row.get("row") or f"traffic.counts[{number}]" for number, row in enumerate(counts)]
    if any(row.get("road") or row.get("crossing") for row in counts):
        return True
    ways = [way_of(row, roads, place) for row, place in zip(counts, places, strict=True)]
    turns = [way for way in ways if way.approach.to_junction == way.exit.from_junction]
    return len({way.approach.to_junction for way in turns}) > 1
