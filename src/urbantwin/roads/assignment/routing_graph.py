"""The routing graph of a closed network: edges for vehicles, directed edges for pedestrians.

Its *gates* are outer roads (``roads.loop``), over which actors leave and re-enter the region.
Cul-de-sacs, where vehicles turn round, are gates too, as are ends of sidewalks for pedestrians.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Set
from dataclasses import dataclass

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from numpy.typing import NDArray

from urbantwin.roads.assignment.street_network import (
    Edge,
    StreetNetwork,
    has_walkway,
    is_cycle_track,
)

__all__ = ["WALKING_MS", "WayGraph", "driven_graph", "walked_graph"]

_TURNING_MS = 7.0  # usual speed over a junction
CYCLING_MS = 5.0  # free-riding mean (Parkin and Rotheram, Transport Policy 17, 2010)
WALKING_MS = 1.34  # mean free walking speed (Weidmann, ETH IVT 90, 1993)
#: Traffic of a cul-de-sac, relative to that of a street that leaves the region.
_DEAD_END_SHARE = 0.1
#: Penalty for bicycles that turn across a signalised junction from a lane of their own, seconds:
#: they use another route if there is one.
_ACROSS_S = 5000.0
#: Penalty for buses on streets without bus lines, seconds, and the relative traffic of gates there.
_OFF_LINE_S, _OFF_LINE_SHARE = 300.0, 0.001
#: Penalty for pedestrians that turn back, seconds.
_TURN_BACK_S = 300.0
#: Maximum distance between linked walking areas of one junction, metres.
_CORNER_M = 200.0


@dataclass(frozen=True, eq=False)
class WayGraph:
    """The possible states of an actor on its route, and their successors.

    Attributes:
        edges: (S,) id of the edge of each state.
        length_m: (S,) its length, metres.
        metres: (S, S) sparse, distance from the start of a state to the start of the next.
        place: (S, 2) position, site frame.
        seconds: (S, S) sparse, time from the start of a state to the start of the next.
        shunned: (S, S) sparse, penalty for such a step, seconds.
        outer: (S,) whether the edge is an outer road.
        gate: (S,) number of the gate of the state; -1 for none.
        weight: (G,) relative traffic of the gates.
        apart: (S,) whether this class has lanes that are closed to cars.
        own_way: (S,) whether it is for this class only: a cycle track.
    """

    edges: tuple[str, ...]
    length_m: NDArray[np.float64]
    metres: scipy.sparse.csr_array
    place: NDArray[np.float64]
    seconds: scipy.sparse.csr_array
    shunned: scipy.sparse.csr_array
    outer: NDArray[np.bool_]
    gate: NDArray[np.int64]
    weight: NDArray[np.float64]
    apart: NDArray[np.bool_]
    own_way: NDArray[np.bool_]

    @property
    def speed(self) -> float:
        """Mean free speed, m/s."""
        return float(self.metres.sum() / max(float(self.seconds.sum()), 1e-9))


def driven_graph(
    network: StreetNetwork, vclass: str, outer: Set[str], preferred: Set[str] = frozenset()
) -> WayGraph | None:
    """Return the routing graph of a SUMO vehicle class; ``None`` if it may drive nowhere.

    Args:
        network: the streets.
        vclass: SUMO's vehicle class.
        outer: ids of the edges of outer roads.
        preferred: ids of preferred edges; if there are any, other streets get a penalty, and gates
            there have little traffic.
    """
    edges = network.allowing(vclass)
    if not edges:
        return None
    index = {edge.getID(): number for number, edge in enumerate(edges)}
    fastest = CYCLING_MS if vclass == "bicycle" else np.inf
    arcs: dict[tuple[int, int], float] = {}
    metres: dict[tuple[int, int], float] = {}
    shunned: dict[tuple[int, int], float] = {}
    gate = np.full(len(edges), -1, np.int64)
    weight: list[float] = []
    for number, edge in enumerate(edges):
        next_edges = [
            following for following in edge.getAllowedOutgoing(vclass) if following.getID() in index
        ]
        for following in next_edges:
            pair = number, index[following.getID()]
            between_m = network.way_over(edge, following)
            metres[pair] = edge.getLength() + between_m
            arcs[pair] = edge.getLength() / min(edge.getSpeed(), fastest) + between_m / _TURNING_MS
            if vclass == "bicycle" and _turns_across(edge, following):
                shunned[pair] = _ACROSS_S
            if preferred and following.getID() not in preferred | outer:
                shunned[pair] = _OFF_LINE_S
        rank = network.rank(edge, vclass)
        leads_to = {edge.getID(), *(following.getID() for following in next_edges)}
        if preferred and not leads_to & preferred:
            rank *= _OFF_LINE_SHARE
        if edge.getID() in outer:
            if any(following.getID() not in outer for following in next_edges):
                gate[number] = len(weight)
                weight.append(rank)
        elif next_edges and all(
            following.getToNode() is edge.getFromNode() for following in next_edges
        ):
            gate[number] = len(weight)
            weight.append(rank * _DEAD_END_SHARE)
    return WayGraph(
        tuple(index),
        _lengths(edges),
        _matrix(metres, len(edges)),
        _places(edges),
        _matrix(arcs, len(edges)),
        _matrix(shunned, len(edges)),
        np.array([edge.getID() in outer for edge in edges]),
        gate,
        np.array(weight),
        np.array([vclass == "bicycle" and _has_own_lane(edge) for edge in edges]),
        np.array([is_cycle_track(edge) for edge in edges]),
    )


def walked_graph(network: StreetNetwork, outer: Set[str]) -> WayGraph | None:
    """Return the routing graph of pedestrians; ``None`` where walking is impossible.

    State 2k is edge k in its own direction, state 2k + 1 the opposite direction. Connected
    sidewalks of outer roads are one gate. If all of them form one gate, each street inside is a
    gate instead. Without outer roads, each end of a sidewalk is a gate.

    Args:
        network: the streets.
        outer: ids of the edges of outer roads.
    """
    streets = [edge for edge in network.streets if has_walkway(edge)]
    if not streets:
        return None
    corners = network.corners
    number = {edge.getID(): k for k, edge in enumerate(corners)}
    at_start, at_end, links = _corners_of_edges(streets, corners, number)
    seconds = scipy.sparse.csgraph.dijkstra(
        _matrix(links, len(corners)), directed=False, limit=_CORNER_M
    )
    count = len(streets)
    # From each end of a street (its walking areas) to each street that begins there.
    runs_into = [at_end, at_start]
    begins_at = [at_start, at_end]
    arcs: dict[tuple[int, int], float] = {}
    states_at: dict[int, list[int]] = defaultdict(list)
    for k in range(count):
        for back in (0, 1):
            for corner in begins_at[back][k]:
                states_at[corner].append(2 * k + back)
    for k, edge in enumerate(streets):
        street_s = edge.getLength() / WALKING_MS
        for back in (0, 1):
            for corner in runs_into[back][k]:
                for other in np.flatnonzero(np.isfinite(seconds[corner])):
                    for state in states_at[int(other)]:
                        if state // 2 == k:
                            continue
                        cost = street_s + float(seconds[corner, other]) / WALKING_MS
                        key = (2 * k + back, state)
                        arcs[key] = min(arcs.get(key, np.inf), cost)
    gate, weight = _walkers_gates(network, streets, outer, arcs)
    shunned: dict[tuple[int, int], float] = {}
    for state in np.flatnonzero(gate >= 0).tolist():
        # At a gate an actor may turn back if there is no better route.
        pair = (state, state ^ 1)
        if pair not in arcs:
            arcs[pair] = float(streets[state // 2].getLength()) / WALKING_MS
            shunned[pair] = _TURN_BACK_S
    edge_of_state = np.repeat(np.arange(count), 2)
    return WayGraph(
        tuple(streets[k].getID() for k in edge_of_state),
        _lengths(streets)[edge_of_state],
        _matrix(arcs, 2 * count) * WALKING_MS,
        _places(streets)[edge_of_state],
        _matrix(arcs, 2 * count),
        _matrix(shunned, 2 * count),
        np.array([streets[k].getID() in outer for k in edge_of_state]),
        gate,
        weight,
        np.ones(2 * count, bool),
        np.zeros(2 * count, bool),
    )


def _has_own_lane(edge: Edge) -> bool:
    """Return whether an edge has a lane for bicycles only."""
    return any(lane.allows("bicycle") and not lane.allows("passenger") for lane in edge.getLanes())


def _turns_across(edge: Edge, following: Edge) -> bool:
    """Return whether cyclists turn from their own lane across a signalised junction.

    Two opposite ones would block each other forever in SUMO. Cyclists with their own lanes usually
    make such turns in two stages. A separate cycle track continues without a turn, however it
    bends.
    """
    if is_cycle_track(edge) and is_cycle_track(following):
        return False
    return any(
        item.getDirection() in ("l", "L")
        and item.getTLSID() != ""
        and item.getFromLane().allows("bicycle")
        and not item.getFromLane().allows("passenger")
        for item in edge.getOutgoing().get(following, [])
    )


def _corners_of_edges(
    streets: list[Edge], corners: list[Edge], number: dict[str, int]
) -> tuple[list[set[int]], list[set[int]], dict[tuple[int, int], float]]:
    """Return the walking areas at the start and the end of each street, and their links."""
    index = {edge.getID(): k for k, edge in enumerate(streets)}
    at_start: list[set[int]] = [set() for _ in streets]
    at_end: list[set[int]] = [set() for _ in streets]
    links: dict[tuple[int, int], float] = {}
    for k, edge in enumerate(streets):
        at_end[k] |= {
            number[following.getID()]
            for following in edge.getOutgoing()
            if following.getID() in number
        }
    for c, corner in enumerate(corners):
        for following in corner.getOutgoing():
            name = following.getID()
            if name in index:
                at_start[index[name]].add(c)
            elif name in number:
                half = (corner.getLength() + following.getLength()) / 2
                links[c, number[name]] = max(half, 0.1)
    return at_start, at_end, links


def _walkers_gates(
    network: StreetNetwork,
    streets: list[Edge],
    outer: Set[str],
    arcs: dict[tuple[int, int], float],
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the gate of each state (-1 for none) and the gates' traffic."""
    gate = np.full(2 * len(streets), -1, np.int64)
    rank = np.sqrt([network.rank(edge, "pedestrian") for edge in streets])
    outside = np.array([edge.getID() in outer for edge in streets])
    if outside.any():
        pairs = np.array([(a // 2, b // 2) for a, b in arcs], np.int64).reshape(-1, 2)
        pairs = pairs[outside[pairs].all(axis=1)]
        graph = _matrix({(int(a), int(b)): 1.0 for a, b in pairs}, len(streets))
        _, part = scipy.sparse.csgraph.connected_components(graph, directed=False)
        # A route from one gate to itself never enters the region: if all outer sidewalks of a place
        # are one gate, each street inside is a gate instead.
        links = _matrix({(a // 2, b // 2): 1.0 for a, b in arcs}, len(streets))
        _, place = scipy.sparse.csgraph.connected_components(links, directed=False)
        at_gate = outside.copy()
        for component in np.unique(place[outside]):
            outer_part, inside = outside & (place == component), ~outside & (place == component)
            if len(np.unique(part[outer_part])) == 1 and inside.any():
                at_gate = (at_gate & ~outer_part) | inside
        names, number = np.unique(part[at_gate], return_inverse=True)
        gate[np.repeat(at_gate, 2)] = np.repeat(number, 2)
        return gate, np.array([rank[at_gate][number == k].max() for k in range(len(names))])
    leads_on = {a for a, _ in arcs}
    ends = [state for state in range(len(gate)) if state not in leads_on]
    gate[ends] = np.arange(len(ends))
    return gate, rank[np.array(ends, np.int64) // 2]


def _lengths(edges: list[Edge]) -> NDArray[np.float64]:
    return np.array([float(edge.getLength()) for edge in edges])


def _places(edges: list[Edge]) -> NDArray[np.float64]:
    shapes = [np.array(edge.getShape())[:, :2] for edge in edges]
    return np.array([shape[len(shape) // 2] for shape in shapes], np.float64)


def _matrix(arcs: dict[tuple[int, int], float], count: int) -> scipy.sparse.csr_array:
    pairs = np.array(list(arcs), np.int64).reshape(-1, 2)
    cost = np.array(list(arcs.values()), np.float64)
    return scipy.sparse.csr_array((cost, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
