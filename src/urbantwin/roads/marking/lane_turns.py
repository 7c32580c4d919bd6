"""Turns that traffic may take at the end of a lane."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import wrapped
from urbantwin.roads.network import Lane, RoadNetwork

__all__ = ["turns"]

#: Changes of heading up to this go straight on, from ``U_TURN`` they turn round, radians.
STRAIGHT, U_TURN = np.radians(30.0), np.radians(150.0)


def turns(network: RoadNetwork, lane: Lane) -> tuple[str, ...]:
    """Return where traffic of a lane may go at its end: left, through, right, around.

    Nothing for a lane that ends at no junction.
    """
    found = set()
    start = _heading(lane.centre[-2:, :2])
    for name in lane.successors:
        way = network.lane_by_id.get(name)
        if way is None or not way.junction:
            continue
        for last in _ends_of_way(network, way):
            change = wrapped(_heading(last.centre[-2:, :2]) - start)
            if abs(change) <= STRAIGHT:
                found.add("through")
            elif abs(change) >= U_TURN:
                found.add("around")
            else:
                found.add("left" if change > 0 else "right")
    return tuple(name for name in ("left", "through", "right", "around") if name in found)


def _ends_of_way(network: RoadNetwork, way: Lane, depth: int = 6) -> Iterator[Lane]:
    """Yield the last lane within the junction of every way on from one of its lanes."""
    following = [network.lane_by_id.get(name) for name in way.successors]
    inside = [lane for lane in following if lane and lane.junction == way.junction]
    if not inside or depth == 0:
        yield way
    else:
        for lane in inside:
            yield from _ends_of_way(network, lane, depth - 1)


def _heading(ends: NDArray[np.float64]) -> float:
    return float(np.arctan2(*(ends[1] - ends[0])[::-1]))
