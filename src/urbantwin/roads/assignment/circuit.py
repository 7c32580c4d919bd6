"""Circuits: endless routes for actors that never leave a closed network.

A *passage* leads from one gate to the next. Which gate is next is drawn by its traffic, less where
the way is a detour; no actor returns to where it came from while there is another way.
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

#: A way over another gate seems so much longer, seconds.
_DETOUR_S = 1000.0
#: So many passages one after the other are as good as endless; shares below this do not count.
_ROUNDS, _SELDOM = 400, 1e-9
#: A part of the network apart from the others is used if it has streets of this length inside the
#: region, metres.
_PART_M = 60.0
#: Fewer passages over some ways: rounds until as many begin as end at each start, and how near.
_BALANCING, _BALANCED = 500, 1e-6


@dataclass(frozen=True, eq=False)
class Circuit:
    """The passages that a class of actors can make.

    Attributes:
        graph: the ways.
        starts: (K,) states at gates, from which passages begin.
        part: (K,) part of the network that each start lies in, such as the streets under a motorway
            on a bridge; no passage leads from one part to another.
        gates: (G,) numbers of the gates in use.
        target: (K, G) state at which a passage from a start to a gate ends; -1 for none.
        chance: (K, G) chance that a passage from a start leads to a gate; rows sum to 1.
        load: (K,) relative number of passages that begin at each start.
        room_m: length of all its streets, metres, both ways of each taken together.
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
        """Return the circuit of a graph; ``None`` without one.

        Parts that no way leads back from to another (the streets under a motorway on a bridge,
        cycle tracks) have traffic of their own, which stays there: each in proportion to the
        traffic of its gates.
        """
        at_gate = np.flatnonzero(graph.gate >= 0)
        if not len(at_gate):
            return None
        _, part = scipy.sparse.csgraph.connected_components(graph.seconds, connection="strong")
        size = np.bincount(part)
        load = np.bincount(part[at_gate], graph.weight[graph.gate[at_gate]], len(size))
        load[size < 2] = 0.0  # a state by itself leads nowhere
        load[np.bincount(part[~graph.outer], minlength=len(size)) == 0] = 0.0  # never comes in
        tracks = np.bincount(part[~graph.own_way], minlength=len(size)) == 0
        inside_m = np.bincount(part, np.where(graph.outer, 0.0, graph.length_m), len(size))
        used = (load > 0) & (tracks | (inside_m >= _PART_M))
        main = int(np.where(tracks, 0.0, load).argmax())
        used[main] |= load[main] > 0
        if not used.any():
            return None
        starts = at_gate[used[part[at_gate]]]
        gates = np.unique(graph.gate[starts])
        cost, before = _ways(graph, starts)
        target = np.full((len(starts), len(gates)), -1, np.int64)
        weight = np.zeros((len(starts), len(gates)))
        for column, gate in enumerate(gates):
            states = starts[graph.gate[starts] == gate]
            nearest = states[cost[:, states].argmin(axis=1)]
            took = cost[np.arange(len(starts)), nearest]
            reached = np.isfinite(took) & (part[nearest] == part[starts])
            target[reached, column] = nearest[reached]
            straight = np.linalg.norm(graph.place[starts] - graph.place[nearest], axis=1)
            direct = np.clip(straight / np.maximum(took * graph.speed, 1.0), 0.1, 1.0) ** 2
            weight[:, column] = np.where(reached, graph.weight[gate] * direct, 0.0)
        home = graph.gate[starts][:, None] == gates[None]
        elsewhere = np.where(home, 0.0, weight)
        weight = np.where((elsewhere.sum(axis=1) > 0)[:, None], elsewhere, weight)
        chance = weight / weight.sum(axis=1, keepdims=True)
        row = {int(state): k for k, state in enumerate(starts)}
        own = np.flatnonzero(used[part])
        length = dict(zip((graph.edges[n] for n in own), graph.length_m[own], strict=True))
        room_m = float(sum(length.values()))
        load = graph.weight[graph.gate[starts]]
        return cls(graph, starts, part[starts], gates, target, chance, load, room_m, before, row)

    def passage(self, start: int, random: np.random.Generator) -> list[int]:
        """Draw a passage: the states after ``start``, the last at a gate again."""
        row = self._row[start]
        column = int(np.searchsorted(np.cumsum(self.chance[row]), random.random(), side="right"))
        return self._way(row, int(self.target[row, min(column, len(self.gates) - 1)]))

    def _way(self, row: int, last: int) -> list[int]:
        """Return the states after a start, up to one where a passage ends."""
        states = [last]
        while (before := int(self._before[row, states[-1]])) != self.starts[row]:
            states.append(before)
        return states[::-1]

    def begin(self, share: float) -> int:
        """Return a start for a share of 1, in proportion to the gates' traffic.

        A part of the network with longer passages has as many more actors on their way.
        """
        total = np.cumsum(self.load * self._seconds_of_part())
        return int(self.starts[np.searchsorted(total, share * total[-1], side="right")])

    def _seconds_of_part(self) -> NDArray[np.float64]:
        """Return the mean time of a passage in the part of each start (K,); 1 if all are one."""
        seconds = np.ones(len(self.starts))
        parts = np.unique(self.part)
        if len(parts) < 2:
            return seconds
        often = self._visits()[:, None] * self.chance
        total = np.zeros_like(often)
        for row, column in np.argwhere(often > _SELDOM).tolist():
            way = self._whole_way(row, column)
            total[row, column] = sum(float(self.graph.seconds[pair]) for pair in pairwise(way))
        for number in parts:
            mine = self.part == number
            share = max(float(often[mine].sum()), _SELDOM)
            seconds[mine] = float((often * total)[mine].sum()) / share
        return seconds

    def usual(self) -> tuple[float, float]:
        """Return the free travel time and the length of the usual way round.

        The way round is from one entry into the region to the next; of who stays inside, from one
        gate to the next.
        """
        flows = self.flows()
        pairs = tuple(np.array(list(flows)).T)
        share = np.array(list(flows.values()))
        seconds, metres = (np.asarray(x[pairs]) for x in (self.graph.seconds, self.graph.metres))
        return float(share @ seconds), float(share @ metres)

    def flows(self, states: int = 2) -> dict[tuple[int, ...], float]:
        """Return how often it goes through so many states one after the other, for each entry.

        In the long run; the last of a passage are followed by nothing: -1.
        """
        found: dict[tuple[int, ...], float] = defaultdict(float)
        often = self._visits()[:, None] * self.chance
        for row, column in np.argwhere(often > _SELDOM).tolist():
            way = self._whole_way(row, column)
            padded = [*way, *[-1] * (states - 2)]
            for first in range(len(way) - 1):
                found[tuple(padded[first : first + states])] += float(often[row, column])
        entries = max(self._entries(often), _SELDOM)
        return {part: share / entries for part, share in found.items()}

    def lowered(self, share: Mapping[tuple[str, str], float]) -> tuple[Circuit, float]:
        """Return it with fewer passages over some ways, and the share of entries that is left.

        Of a passage as much is left as of the way that is lowered most. Then as many are to end at
        each start as begin there, since nobody is taken off the road: of all such flows those are
        taken that are nearest to what is left by their relative entropy (each is what is left times
        a factor of where it begins and one of where it ends: M. H. Schneider and S. A. Zenios,
        Operations Research 38, 1990, matrix balancing).

        Args:
            share: (edge, next edge) -> share that is left there, above 0.
        """
        often = self._visits()[:, None] * self.chance
        left = often.copy()
        edges = self.graph.edges
        for row, column in np.argwhere(often > _SELDOM).tolist():
            way = self._whole_way(row, column)
            left[row, column] *= min(share.get((edges[a], edges[b]), 1.0) for a, b in pairwise(way))
        end = np.array([[self._row.get(int(state), 0) for state in row] for row in self.target])
        for _ in range(_BALANCING):
            begins = left.sum(axis=1)
            ends = np.bincount(end.ravel(), left.ravel(), len(begins))
            if np.abs(begins - ends).max() <= _BALANCED * begins.sum():
                break
            # Where nothing ends or nothing begins nothing passes.
            through = (begins > 0) & (ends > 0)
            ratio = np.sqrt(np.where(through, ends, 0.0) / np.where(through, begins, 1.0))
            left *= ratio[:, None]
            left *= np.divide(1.0, ratio, out=np.zeros_like(ratio), where=ratio > 0)[end]
        begins = left.sum(axis=1)
        chance = np.where(
            begins[:, None] > 0, left / np.maximum(begins, 1e-300)[:, None], self.chance
        )
        still = self._entries(left) / max(self._entries(often), _SELDOM)
        return replace(self, chance=chance, load=begins), still

    def _whole_way(self, row: int, column: int) -> list[int]:
        """Return the states of a passage, with the one that it starts from."""
        return [int(self.starts[row]), *self._way(row, int(self.target[row, column]))]

    def _entries(self, often: NDArray[np.float64]) -> float:
        """Return how often the region is entered where passages (K, G) are made so often."""
        outer, entries = self.graph.outer, 0.0
        for row, column in np.argwhere(often > _SELDOM).tolist():
            way = self._whole_way(row, column)
            came = sum(bool(outer[a] and not outer[b]) for a, b in pairwise(way))
            entries += float(often[row, column]) * (came or not outer[way].any())
        return entries

    def _visits(self) -> NDArray[np.float64]:
        """Return how often passages begin at each start, in the long run (K,); the sum is 1."""
        onward = np.zeros((len(self.starts), len(self.starts)))
        for k, targets in enumerate(self.target):
            for column in np.flatnonzero(self.chance[k]):
                onward[k, self._row[int(targets[column])]] += self.chance[k, column]
        found = self.load / self.load.sum()
        for _ in range(_ROUNDS):
            # Half stay where they are, or two gates would take turns for ever.
            found = 0.5 * (found + found @ onward)
        return np.asarray(found)


def _ways(
    graph: WayGraph, starts: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return cost (K, S) and predecessor (K, S) of the fastest ways that are not empty.

    Other gates on the way are avoided. The cost of the way from a state to itself is that round.
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
