"""Which nodes are one junction.

Where carriageways are mapped apart, one junction is many nodes with short edges between them. An
edge on which the map has a stop line or a crossing is a road between two junctions, however short;
any other short edge lies within one.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
import shapely

from urbantwin.roads.junctions.mapped_crossings import Marks
from urbantwin.roads.junctions.plain import PlainEdge, PlainNetwork

__all__ = [
    "Chain",
    "chains_of",
    "clusters_of",
    "flat_nodes",
    "is_marked",
    "is_signalised",
    "meeting_nodes",
]

#: The longest edge that makes one junction of its ends, metres: where both have signals, where one
#: has, between carriageways mapped apart, and else (netconvert's ``junctions.join-dist`` is 10 m).
BOTH_M, ONE_M, CARRIAGEWAYS_M, ELSE_M = 40.0, 28.0, 18.0, 12.0
#: Ways between nodes of one junction that are longer leave it and come back, metres.
ROAD_M = 60.0
#: A junction of one node is near a wide one if the road between is shorter, metres.
NEAR_M = 45.0
#: Both ends of a marked road that is shorter, or of one that is one edge, are never one junction.
APART_M = 150.0


@dataclass(frozen=True, eq=False)
class Chain:
    """Edges one after the other, from one node where streets meet to the next."""

    edges: tuple[PlainEdge, ...]

    @property
    def start(self) -> str:
        """The node that it starts from."""
        return self.edges[0].start

    @property
    def end(self) -> str:
        """The node that it leads to."""
        return self.edges[-1].end

    @cached_property
    def length(self) -> float:
        """Metres."""
        return float(sum(edge.line.length for edge in self.edges))

    @cached_property
    def line(self) -> shapely.LineString:
        """Its course."""
        return shapely.LineString(
            np.vstack([shapely.get_coordinates(edge.line) for edge in self.edges])
        )

    @property
    def nodes(self) -> tuple[str, ...]:
        """All nodes along it, its ends included."""
        return (self.start, *(edge.end for edge in self.edges))

    @property
    def within(self) -> frozenset[str]:
        """The nodes between its ends."""
        return frozenset(edge.end for edge in self.edges[:-1])

    def stations(self, shares: Mapping[str, tuple[float, ...]]) -> list[float]:
        """Return where marks lie along the chain, metres from its start."""
        found, before = [], 0.0
        for edge in self.edges:
            length = float(edge.line.length)
            found += [before + share * length for share in shares.get(edge.id, ())]
            before += length
        return sorted(found)


def is_signalised(plain: PlainNetwork, node: str) -> bool:
    """Whether a node has signals."""
    return plain.nodes[node].attributes.get("type", "").startswith("traffic_light")


def driven_edges(plain: PlainNetwork) -> list[PlainEdge]:
    """Return the edges that are open to more than people on foot."""
    return [edge for edge in plain.edges.values() if edge.is_street]


def meeting_nodes(plain: PlainNetwork, within: Collection[str] = ()) -> set[str]:
    """Return the nodes where streets of three or more directions meet.

    So do those where edges ``within`` a junction begin and end.
    """
    beside: dict[str, set[str]] = defaultdict(set)
    inside: dict[str, set[bool]] = defaultdict(set)
    for edge in driven_edges(plain):
        beside[edge.start].add(edge.end)
        beside[edge.end].add(edge.start)
        for node in (edge.start, edge.end):
            inside[node].add(edge.id in within)
    return {node for node, others in beside.items() if len(others) > 2 or len(inside[node]) > 1}


def chains_of(plain: PlainNetwork, meeting: Collection[str]) -> list[Chain]:
    """Return the edges of vehicles as chains between nodes where streets meet, and dead ends."""
    onward: dict[str, list[PlainEdge]] = defaultdict(list)
    arriving: dict[str, int] = defaultdict(int)
    for edge in driven_edges(plain):
        onward[edge.start].append(edge)
        arriving[edge.end] += 1
    found = []
    for first in driven_edges(plain):
        if first.start not in meeting and _before(plain, first):
            continue
        edges = [first]
        seen = {first.start}
        while edges[-1].end not in meeting and edges[-1].end not in seen:
            seen.add(edges[-1].end)
            ahead = [e for e in onward[edges[-1].end] if e.end != edges[-1].start]
            if len(ahead) != 1:
                break
            edges.append(ahead[0])
        found.append(Chain(tuple(edges)))
    return found


def _before(plain: PlainNetwork, edge: PlainEdge) -> bool:
    """Whether traffic comes to an edge from another street than its own other direction."""
    return any(e.start != edge.end and e.is_street for e in plain.arriving[edge.start])


def clusters_of(
    plain: PlainNetwork,
    chains: Collection[Chain],
    meeting: Collection[str],
    marks: Marks,
    apart: Collection[str],
    within: Collection[str] = (),
) -> list[tuple[str, ...]]:
    """Return the nodes of every junction of two or more, sorted.

    Chains are taken shortest first, and both ends of a chain that is a road are never united, so
    that the result does not hang on the exact limit.

    Args:
        plain: the network.
        chains: its chains.
        meeting: the nodes where streets meet.
        marks: the map's stop lines and crossings.
        apart: edges that are no part of a junction: bridges, roundabouts, outer roads.
        within: edges that lie within one, as the map says, up to `ROAD_M`; those that cross each
            other lie within the same one.
    """
    top: dict[str, str] = {node: node for node in sorted(meeting)}

    def find(node: str) -> str:
        while top[node] != node:
            node = top[node]
        return node

    parted: dict[str, set[str]] = defaultdict(set)

    def unite(one: str, other: str) -> None:
        a, b = sorted((find(one), find(other)))
        if a == b or any(find(node) == b for node in parted[a]):
            return
        top[b] = a
        parted[a] |= parted[b]

    between = [c for c in chains if c.start in top and c.end in top and c.start != c.end]
    marked = {chain: is_marked(chain, marks, apart) for chain in between}
    inner = [c for c in between if not marked[c] and c.length <= _limit(plain, c, within)]
    roads = [
        c
        for c in between
        if (len(c.edges) == 1 and (marked[c] or c.length > ROAD_M))
        or (c.length <= APART_M and is_marked(c, marks, ()))
    ]
    for chain in roads:
        parted[chain.start].add(chain.end)
        parted[chain.end].add(chain.start)
    for chain in sorted(inner, key=lambda c: (round(c.length, 3), c.edges[0].id)):
        unite(chain.start, chain.end)
    said = [c for c in inner if all(edge.id in within for edge in c.edges)]
    for one, other in combinations(said, 2):
        if one.line.crosses(other.line):
            unite(one.start, other.start)
    groups: dict[str, list[str]] = defaultdict(list)
    for node in top:
        groups[find(node)].append(node)
    return [tuple(sorted(group)) for group in groups.values() if len(group) > 1]


def flat_nodes(
    chains: Collection[Chain], meeting: Collection[str], wide: Collection[Collection[str]]
) -> list[tuple[str, ...]]:
    """Return single nodes whose junctions netconvert would draw too large, sorted.

    It cuts arms back until they no longer overlap: where carriageways part or merge at a small
    angle, far along both; and where a wide junction is near, nothing of the road to it is left.

    Args:
        chains: the chains of the network.
        meeting: the nodes where streets meet.
        wide: the nodes of junctions of several.
    """
    within = {node for group in wide for node in group}
    touching: dict[str, list[Chain]] = defaultdict(list)
    for chain in chains:
        for node in {chain.start, chain.end}:
            touching[node].append(chain)
    found: list[tuple[str, ...]] = []
    for node in sorted(set(meeting) - within):
        mine = touching[node]
        parting = len(mine) == 3 and {len([c for c in mine if c.end == node])} <= {1, 2}
        near = any(c.length < NEAR_M and {c.start, c.end} & within for c in mine)
        if parting or near:
            found.append((node,))
    return found


def is_marked(chain: Chain, marks: Marks, apart: Collection[str]) -> bool:
    """Whether the map has something on a chain that makes it a road."""
    return any(
        edge.id in apart or marks.stop_lines.get(edge.id) or marks.crossings.get(edge.id)
        for edge in chain.edges
    )


def _limit(plain: PlainNetwork, chain: Chain, within: Collection[str]) -> float:
    if all(edge.id in within for edge in chain.edges):
        return ROAD_M
    signals = sum(is_signalised(plain, node) for node in (chain.start, chain.end))
    if signals:
        return BOTH_M if signals == 2 else ONE_M
    back = any(edge.end == chain.edges[0].start for edge in plain.leaving[chain.edges[0].end])
    return ELSE_M if back else CARRIAGEWAYS_M
