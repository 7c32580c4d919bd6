"""Passages through a junction of several nodes, from each incoming to the outgoing edges."""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from urbantwin.geometry import wrapped
from urbantwin.roads.junctions.plain import PlainEdge, PlainNetwork
from urbantwin.roads.junctions.strip import Strip, heading_of

__all__ = ["Passage", "passages_of"]

#: Minimum turn of a U-turn, and of one between separate carriageways, radians.
BACK, BACK_BETWEEN = np.radians(150.0), np.radians(120.0)
#: Maximum number of search steps per incoming edge.
MOST_STEPS = 4000


@dataclass(frozen=True)
class Passage:
    """A path through a junction.

    Attributes:
        path: the edges, the first leading in, the last leading out.
        turn: change of heading from the first to the last, radians, positive to the left.
    """

    path: tuple[PlainEdge, ...]
    turn: float

    @property
    def entry(self) -> PlainEdge:
        """The incoming edge."""
        return self.path[0]

    @property
    def exit(self) -> PlainEdge:
        """The outgoing edge."""
        return self.path[-1]


def passages_of(
    plain: PlainNetwork,
    nodes: Collection[str],
    inner: Mapping[str, PlainEdge],
    strips: Mapping[str, Strip],
    forbidden: Sequence[tuple[tuple[str, ...], bool]] = (),
) -> list[Passage]:
    """Return the shortest path from each incoming edge of a junction to each outgoing edge.

    Paths follow the edge-to-edge links of the map. U-turns are excluded unless there is no other
    passage or the map has a separate way for them.

    Args:
        plain: the network.
        nodes: the nodes of the junction.
        inner: its inner edges by id.
        strips: the edges' strips.
        forbidden: restricted sequences of edges (restrictions with a via way), and whether the last
            edge is the only one allowed after the others.
    """
    onward: dict[str, list[str]] = defaultdict(list)
    for link in plain.links:
        if link.end and link.end not in onward[link.start]:
            onward[link.start].append(link.end)
    entries = [
        edge
        for node in sorted(nodes)
        for edge in plain.arriving[node]
        if edge.id not in inner and edge.is_street
    ]
    passages: list[Passage] = []
    for entry in entries:
        best: dict[str, tuple[PlainEdge, ...]] = {}
        for path in _paths(plain, entry, inner, onward):
            if not _is_forbidden([edge.id for edge in path], forbidden):
                best.setdefault(path[-1].id, path)
        from_entry = []
        for path in best.values():
            first = heading_of(strips[path[0].id].middle, at_end=True)
            last = heading_of(strips[path[-1].id].middle, at_end=False)
            from_entry.append(Passage(path, float(wrapped(last - first))))
        onward_passages = [item for item in from_entry if not _turns_back(item)]
        passages += onward_passages or from_entry
    return passages


def _paths(
    plain: PlainNetwork,
    entry: PlainEdge,
    inner: Mapping[str, PlainEdge],
    onward: Mapping[str, Sequence[str]],
) -> Iterable[tuple[PlainEdge, ...]]:
    """Yield paths from an edge to edges out of the junction, shortest first."""
    waiting: list[tuple[float, tuple[str, ...]]] = [(0.0, (entry.id,))]
    for _ in range(MOST_STEPS):
        if not waiting:
            return
        length, names = heapq.heappop(waiting)
        path = tuple(plain.edges[name] for name in names)
        if len(names) > 1 and names[-1] not in inner:
            yield path
            continue
        for name in onward.get(names[-1], ()):
            edge = plain.edges[name]
            if not edge.is_street:
                continue
            if name not in inner:
                heapq.heappush(waiting, (length, (*names, name)))
            elif all(edge.end not in (e.start, e.end) for e in path):
                longer = round(length + float(edge.line.length), 3)
                heapq.heappush(waiting, (longer, (*names, name)))


def _turns_back(passage: Passage) -> bool:
    """Return whether a passage is a U-turn into the street that it came from."""
    entry, way_out = passage.entry, passage.exit
    # Where carriageways of one street part, at their end, U-turns have a smaller angle.
    parting = len(passage.path) == 2 and entry.start != way_out.end
    if abs(passage.turn) < (BACK_BETWEEN if parting else BACK):
        return False
    if entry.start == way_out.end or entry.id.lstrip("-") == way_out.id.lstrip("-"):
        return True
    names = entry.attributes.get("name", ""), way_out.attributes.get("name", "")
    return names[0] == names[1]


def _is_forbidden(path: Sequence[str], forbidden: Sequence[tuple[tuple[str, ...], bool]]) -> bool:
    for edges, only in forbidden:
        size = len(edges)
        for k in range(len(path) - size + 1):
            part = tuple(path[k : k + size])
            if not only and part == edges:
                return True
            if only and part[:-1] == edges[:-1] and part[-1] != edges[-1]:
                return True
    return False
