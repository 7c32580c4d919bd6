"""Corner cutting: vehicles that bend, whose further bodies would run into somebody or something.

A trailer runs inside of the way of what pulls it, by metres in a bend. SUMO knows nothing of that:
whoever waits beside the bend, or stands at its kerb, is in the way. Drivers of such vehicles do not
turn there; so that the streets still carry as many, a rigid vehicle drives in its place.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.traffic.assets import Asset
from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.paths.bending import vehicles
from urbantwin.traffic.paths.box_plan import PlanBoxes, meetings, near_pairs
from urbantwin.traffic.paths.outlines import Outlines

__all__ = ["corner_cutters", "with_rigid"]

#: Boxes that lie in each other by less have touched, metres.
_TOUCH_M = 0.05
#: Further bodies that go where they will, or on rails.
_NOT_TOWED = ("tram", "animal")


def corner_cutters(
    columns: dict[str, NDArray[Any]],
    trips: Sequence[Trip],
    who: NDArray[np.int64],
    blocks: PlanBoxes,
    level: NDArray[np.integer],
    asset: Callable[[str], Asset],
) -> frozenset[int]:
    """Return the trips of vehicles that bend of which a towed body runs into anybody else.

    Args:
        columns: poses by trip and step, vehicles that bend being their bodies (`with_bodies`).
        trips: whose they are.
        who: who is who.
        blocks: what stands in the way, at whatever step.
        level: (N,) of the road that each row is on.
        asset: an asset by name.
    """
    behind = who != vehicles(who)
    towed = behind & np.array([trip.actor_class not in _NOT_TOWED for trip in trips], np.bool_)
    if not towed.any():
        return frozenset()
    meshes = [asset(trip.asset) for trip in trips]
    half = np.array([[mesh.length, mesh.width] for mesh in meshes])[columns["trip"]] / 2
    boxes = PlanBoxes(columns["step"], columns["xy"], columns["yaw"], half)
    rows = np.flatnonzero(towed[columns["trip"]])
    # Who is near any towed body, at its step.
    near = np.isin(columns["step"], columns["step"][rows])
    there = np.flatnonzero(near)
    pairs = there[near_pairs(boxes.take(there), 0.0)]
    row_towed, vehicle = towed[columns["trip"]], vehicles(who)[columns["trip"]]
    one, other = pairs.T
    kept = (row_towed[one] | row_towed[other]) & (vehicle[one] != vehicle[other])
    pairs = pairs[kept & (level[one] == level[other])]
    deep, _ = meetings(boxes, pairs)
    hit = pairs[deep > _TOUCH_M].ravel()
    row, block = Outlines(blocks.polygons).beside(boxes.take(rows))
    both = PlanBoxes.joined([boxes.take(rows), blocks])
    deep, _ = meetings(both, np.column_stack([row, block + len(rows)]))
    hit = np.concatenate([hit, rows[row[deep > _TOUCH_M]]])
    return frozenset(vehicle[hit[row_towed[hit]]].tolist())


def with_rigid(demand: Demand, numbers: frozenset[int], asset: Callable[[str], Asset]) -> Demand:
    """Return a demand in which the vehicles of some trips do not bend.

    Args:
        demand: the trips.
        numbers: which of them.
        asset: an asset by name.
    """
    trips = list(demand.trips)
    for number in numbers:
        trips[number] = replace(trips[number], asset=asset(trips[number].asset).rigid)
    return replace(demand, trips=tuple(trips))
