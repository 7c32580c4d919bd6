"""Circuits: endless routes for actors that never leave a closed network.

A *passage* leads from one gate to the next. The next gate is drawn by its traffic, reduced for
detours. Actors return to their last gate only if there is no other route.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from numpy.typing import NDArray

from urbantwin.roads.assignment.routing_graph import WayGraph

__all__ = ["Circuit"]

#: Penalty for a route over another gate, seconds.
_DETOUR_S = 1000.0
#: Number of passages that is equivalent to infinitely many; minimum share that counts.
_ROUNDS, _MIN_SHARE = 400, 1e-9
#: Minimum length of streets inside the region for a separate part of the network to be used,
#: metres.
_PART_M = 60.0
#: Maximum number of balancing iterations of `lowered`, and its relative tolerance.
_BALANCING, _BALANCED = 500, 1e-6


@dataclass(frozen=True, eq=False)
class Circuit:
    """The passages available to a class of actors.

    Attributes:
        graph: the routing graph.
        starts: (K,) states at gates, from which passages begin.
        part: (K,) part of the network of each start, such as the streets under a motorway on a
            bridge; no passage leads from one part to another.
        gates: (G,) numbers of the gates in use.
        target: (K, G) state at which a passage from a start to a gate ends; -1 for none.
        chance: (K, G) probability that a passage from a start leads to a gate; rows sum to 1.
        load: (K,) relative number of passages that begin at each start.
        room_m: total length of its edges, metres; each edge counts once.
    """

    graph: WayGraph
    starts: NDArray[np.int64]
    part: NDArray[np.int64]
    gates: NDArray[np.int64]
    target: NDArray[np.int64]
    chance: NDArray[np.float64]
    load: NDArray[np.float64]
    room_m: float
    _before: NDArray[np.int32]
    _row: dict[int, int]

    @classmethod
    def of(cls, graph: WayGraph) -> Circuit | None:
        """Return the circuit of a graph; ``None`` if it has none.

        Separate parts without a route back (the streets under a motorway on a bridge, cycle tracks)
        have their own traffic, in proportion to that of their gates.
        """
        at_gate = np.flatnonzero(graph.gate >= 0)
        if not len(at_gate):
            return None
        _, part = scipy.sparse.csgraph.connected_components(graph.seconds, connection="strong")
        size = np.bincount(part)
        load = np.bincount(part[at_gate], graph.weight[graph.gate[at_gate]], len(size))
        load[size < 2] = 0.0  # a single state leads nowhere
        load[np.bincount(part[~graph.outer], minlength=len(size)) == 0] = 0.0  # never inside
        tracks = np.bincount(part[~graph.own_way], minlength=len(size)) == 0
        inside_m = np.bincount(part, np.where(graph.outer, 0.0, graph.length_m), len(size))
        used = (load > 0) & (tracks | (inside_m >= _PART_M))
        main = int(np.where(tracks, 0.0, load).argmax())
        used[main] |= load[main] > 0
        if not used.any():
            return None
        starts = at_gate[used[part[at_gate]]]
        gates = np.unique(graph.gate[starts])
        cost, before = _fastest_routes(graph, starts)
        target = np.full((len(starts), len(gates)), -1, np.int64)
        weight = np.zeros((len(starts), len(gates)))
        for column, gate in enumerate(gates):
            states = starts[graph.gate[starts] == gate]
            nearest = states[cost[:, states].argmin(axis=1)]
            seconds = cost[np.arange(len(starts)), nearest]
            reached = np.isfinite(seconds) & (part[nearest] == part[starts])
            target[reached, column] = nearest[reached]
            straight = np.linalg.norm(graph.place[starts] - graph.place[nearest], axis=1)
            direct = np.clip(straight / np.maximum(seconds * graph.speed, 1.0), 0.1, 1.0) ** 2
            weight[:, column] = np.where(reached, graph.weight[gate] * direct, 0.0)
        home = graph.gate[starts][:, None] == gates[None]
        elsewhere = np.where(home, 0.0, weight)
        weight = np.where((elsewhere.sum(axis=1) > 0)[:, None], elsewhere, weight)
        chance = weight / weight.sum(axis=1, keepdims=True)
        row = {int(state): k for k, state in enumerate(starts)}
        in_use = np.flatnonzero(used[part])
        length = dict(zip((graph.edges[n] for n in in_use), graph.length_m[in_use], strict=True))
        room_m = float(sum(length.values()))
        load = graph.weight[graph.gate[starts]]
        return cls(graph, starts, part[starts], gates, target, chance, load, room_m, before, row)

    def passage(self, start: int, random: np.random.Generator) -> list[int]:
        """Draw a passage: the states after ``start``, the last one at a gate again."""
        row = self._row[start]
        column = int(np.searchsorted(np.cumsum(self.chance[row]), random.random(), side="right"))
        return self._way(row, int(self.target[row, min(column, len(self.gates) - 1)]))

    def _way(self, row: int, last: int) -> list[int]:
        """Return the states after a start, up to the end of a passage."""
        states = [last]
        while (before := int(self._before[row, states[-1]])) != self.starts[row]:
            states.append(before)
        return states[::-1]

    def begin(self, share: float) -> int:
        """Return a start for a share between 0 and 1, in proportion to the gates' traffic.

        A part of the network with longer passages has proportionally more actors.
        """
        total = np.cumsum(self.load * self._seconds_of_part())
        return int(self.starts[np.searchsorted(total, share * total[-1], side="right")])

    def _seconds_of_part(self) -> NDArray[np.float64]:
        """Return the mean time of a passage in the part of each start (K,), s; 1 for one part."""
        seconds = np.ones(len(self.starts))
        parts = np.unique(self.part)
        if len(parts) < 2:
            return seconds
        often = self._visits()[:, None] * self.chance
        total = np.zeros_like(often)
        for row, column in np.argwhere(often > _MIN_SHARE).tolist():
            route = self._whole_way(row, column)
            total[row, column] = sum(float(self.graph.seconds[pair]) for pair in pairwise(route))
        for number in parts:
            in_part = self.part == number
            share = max(float(often[in_part].sum()), _MIN_SHARE)
            seconds[in_part] = float((often * total)[in_part].sum()) / share
        return seconds

    def usual(self) -> tuple[float, float]:
        """Return the free travel time (s) and the length (m) of the mean round trip.

        A round trip leads from one entry into the region to the next; for actors that stay inside,
        from one gate to the next.
        """
        flows = self.flows()
        pairs = tuple(np.array(list(flows)).T)
        share = np.array(list(flows.values()))
        seconds, metres = (np.asarray(x[pairs]) for x in (self.graph.seconds, self.graph.metres))
        return float(share @ seconds), float(share @ metres)

    def flows(self, states: int = 2) -> dict[tuple[int, ...], float]:
        """Return the long-run frequency of each sequence of states per entry.

        ``states`` is the length of the sequences; those at the end of a passage are padded with -1.
        """
        frequency: dict[tuple[int, ...], float] = defaultdict(float)
        often = self._visits()[:, None] * self.chance
        for row, column in np.argwhere(often > _MIN_SHARE).tolist():
            route = self._whole_way(row, column)
            padded = [*route, *[-1] * (states - 2)]
            for first in range(len(route) - 1):
                frequency[tuple(padded[first : first + states])] += float(often[row, column])
        entries = max(self._entries(often), _MIN_SHARE)
        return {part: share / entries for part, share in frequency.items()}

    def lowered(self, share: Mapping[tuple[str, str], float]) -> tuple[Circuit, float]:
        """Return it with fewer passages over some movements, and the remaining share of entries.

        The remaining share of a passage is that of its most reduced movement. Then the numbers of
        passages that begin and end at each start are balanced, since no actor is removed from the
        network. Of all such flows this is the one with the least relative entropy to the remaining
        flows: each is the remaining flow times a factor of its start and one of its end (M. H.
        Schneider and S. A. Zenios, Operations Research 38, 1990, matrix balancing).

        Args:
            share: (edge, next edge) -> remaining share, above 0.
        """
        often = self._visits()[:, None] * self.chance
        remaining = often.copy()
        edges = self.graph.edges
        for row, column in np.argwhere(often > _MIN_SHARE).tolist():
            seq = self._whole_way(row, column)
            remaining[row, column] *= min(
                share.get((edges[a], edges[b]), 1.0) for a, b in pairwise(seq)
            )
        end = np.array([[self._row.get(int(state), 0) for state in row] for row in self.target])
        for _ in range(_BALANCING):
            begins = remaining.sum(axis=1)
            ends = np.bincount(end.ravel(), remaining.ravel(), len(begins))
            if np.abs(begins - ends).max() <= _BALANCED * begins.sum():
                break
            # Starts without beginning or ending passages have no flow.
            has_flow = (begins > 0) & (ends > 0)
            ratio = np.sqrt(np.where(has_flow, ends, 0.0) / np.where(has_flow, begins, 1.0))
            remaining *= ratio[:, None]
            remaining *= np.divide(1.0, ratio, out=np.zeros_like(ratio), where=ratio > 0)[end]
        begins = remaining.sum(axis=1)
        chance = np.where(
            begins[:, None] > 0, remaining / np.maximum(begins, 1e-300)[:, None], self.chance
        )
        remaining_share = self._entries(remaining) / max(self._entries(often), _MIN_SHARE)
        return replace(self, chance=chance, load=begins), remaining_share

    def _whole_way(self, row: int, column: int) -> list[int]:
        """Return the states of a passage, including its start."""
        return [int(self.starts[row]), *self._way(row, int(self.target[row, column]))]

    def _entries(self, often: NDArray[np.float64]) -> float:
        """Return the number of entries into the region for given frequencies of passages (K, G)."""
        outer, entries = self.graph.outer, 0.0
        for row, column in np.argwhere(often > _MIN_SHARE).tolist():
            route = self._whole_way(row, column)
            entered = sum(bool(outer[a] and not outer[b]) for a, b in pairwise(route))
            entries += float(often[row, column]) * (entered or not outer[route].any())
        return entries

    def _visits(self) -> NDArray[np.float64]:
        """Return the long-run share of passages that begin at each start (K,); the sum is 1."""
        onward = np.zeros((len(self.starts), len(self.starts)))
        for k, targets in enumerate(self.target):
            for column in np.flatnonzero(self.chance[k]):
                onward[k, self._row[int(targets[column])]] += self.chance[k, column]
        visits = self.load / self.load.sum()
        for _ in range(_ROUNDS):
            # Half of them stay in place, to avoid oscillation between two gates.
            visits = 0.5 * (visits + visits @ onward)
        return np.asarray(visits)


def _fastest_routes(
    graph: WayGraph, starts: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return cost (K, S) and predecessor (K, S) of the fastest non-empty routes.

    Other gates are avoided. The cost from a state to itself is that of a round trip.
    """
    arcs = scipy.sparse.coo_array(graph.seconds + graph.shunned)
    at_gate = graph.gate >= 0
    cost = arcs.data + np.where(at_gate[arcs.row], _DETOUR_S, 0.0)
    shape = arcs.shape
    matrix = scipy.sparse.csr_array((cost, (arcs.row, arcs.col)), shape=shape)
    seconds, before = scipy.sparse.csgraph.dijkstra(
        matrix, indices=starts, return_predecessors=True
    )
    into = scipy.sparse.csc_array(matrix)
    for row, state in enumerate(starts):
        first, last = into.indptr[state], into.indptr[state + 1]
        rounds = seconds[row, into.indices[first:last]] + into.data[first:last]
        seconds[row, state] = np.inf
        if len(rounds) and np.isfinite(rounds.min()):
            seconds[row, state] = rounds.min()
            before[row, state] = into.indices[first:last][rounds.argmin()]
    seconds -= np.where(np.isfinite(seconds), _DETOUR_S, 0.0)
    return np.asarray(seconds), np.asarray(before)
