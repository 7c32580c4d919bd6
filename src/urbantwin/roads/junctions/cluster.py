"""Clustering of nodes into junctions.

Where carriageways are mapped separately, one junction has many nodes with short edges between them.
An edge with a mapped stop line or crossing is a road between two junctions, however short; other
short edges are inside one junction.
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

#: Maximum length of an edge inside a junction, metres: with signals at both ends, at one end,
#: between separately mapped carriageways, and else (netconvert's ``junctions.join-dist`` is 10 m).
BOTH_M, ONE_M, CARRIAGEWAYS_M, ELSE_M = 40.0, 28.0, 18.0, 12.0
#: Longer chains between nodes of one junction are loops outside it, metres.
ROAD_M = 60.0
#: Maximum length of the road between a single-node junction and a wide one near it, metres.
NEAR_M = 45.0
#: The ends of a marked road up to this length, or of one with a single edge, are always in
#: different junctions, metres.
APART_M = 150.0


@dataclass(frozen=True, eq=False)
class Chain:
    """Consecutive edges from one node where streets meet to the next."""

    edges: tuple[PlainEdge, ...]

    @property
    def start(self) -> str:
        """Its first node."""
        return self.edges[0].start

    @property
    def end(self) -> str:
        """Its last node."""
        return self.edges[-1].end

    @cached_property
    def length(self) -> float:
        """Length, metres."""
        return float(sum(edge.line.length for edge in self.edges))

    @cached_property
    def line(self) -> shapely.LineString:
        """Its line, site frame."""
        return shapely.LineString(
            np.vstack([shapely.get_coordinates(edge.line) for edge in self.edges])
        )

    @property
    def nodes(self) -> tuple[str, ...]:
        """All nodes along it, including its ends."""
        return (self.start, *(edge.end for edge in self.edges))

    @property
    def within(self) -> frozenset[str]:
        """The nodes between its ends."""
        return frozenset(edge.end for edge in self.edges[:-1])

    def stations(self, shares: Mapping[str, tuple[float, ...]]) -> list[float]:
        """Return the stations of marks along the chain, metres from its start."""
        stations, before = [], 0.0
        for edge in self.edges:
            length = float(edge.line.length)
            stations += [before + share * length for share in shares.get(edge.id, ())]
            before += length
        return sorted(stations)


def is_signalised(plain: PlainNetwork, node: str) -> bool:
    """Return whether a node has signals."""
    return plain.nodes[node].attributes.get("type", "").startswith("traffic_light")


def driven_edges(plain: PlainNetwork) -> list[PlainEdge]:
    """Return the edges that are not for pedestrians only."""
    return [edge for edge in plain.edges.values() if edge.is_street]


def meeting_nodes(plain: PlainNetwork, within: Collection[str] = ()) -> set[str]:
    """Return the nodes where streets of three or more directions meet.

    Nodes where edges ``within`` a junction begin or end are included.
    """
    beside: dict[str, set[str]] = defaultdict(set)
    inside: dict[str, set[bool]] = defaultdict(set)
    for edge in driven_edges(plain):
        beside[edge.start].add(edge.end)
        beside[edge.end].add(edge.start)
        for node in (edge.start, edge.end):
            inside[node].add(edge.id in within)
    return {node for node, ends in beside.items() if len(ends) > 2 or len(inside[node]) > 1}


def chains_of(plain: PlainNetwork, meeting: Collection[str]) -> list[Chain]:
    """Return the edges for vehicles as chains between nodes where streets meet, and dead ends."""
    onward: dict[str, list[PlainEdge]] = defaultdict(list)
    arriving: dict[str, int] = defaultdict(int)
    for edge in driven_edges(plain):
        onward[edge.start].append(edge)
        arriving[edge.end] += 1
    chains = []
    for first in driven_edges(plain):
        if first.start not in meeting and _has_traffic_before(plain, first):
            continue
        edges = [first]
        seen = {first.start}
        while edges[-1].end not in meeting and edges[-1].end not in seen:
            seen.add(edges[-1].end)
            ahead = [e for e in onward[edges[-1].end] if e.end != edges[-1].start]
            if len(ahead) != 1:
                break
            edges.append(ahead[0])
        chains.append(Chain(tuple(edges)))
    return chains


def _has_traffic_before(plain: PlainNetwork, edge: PlainEdge) -> bool:
    """Return whether an edge has traffic from more than its own opposite direction."""
    return any(e.start != edge.end and e.is_street for e in plain.arriving[edge.start])


def clusters_of(
    plain: PlainNetwork,
    chains: Collection[Chain],
    meeting: Collection[str],
    marks: Marks,
    apart: Collection[str],
    within: Collection[str] = (),
) -> list[tuple[str, ...]]:
    """Return the nodes of each junction of two or more nodes, sorted.

    Chains are merged shortest first, and the ends of a chain that is a road are never merged. The
    result therefore depends little on the exact limits.

    Args:
        plain: the network.
        chains: its chains.
        meeting: the nodes where streets meet.
        marks: the map's stop lines and crossings.
        apart: edges that are never part of a junction: bridges, roundabouts, outer roads.
        within: edges mapped as part of a junction, up to `ROAD_M`; those that cross each other are
            part of the same one.
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
    mapped = [c for c in inner if all(edge.id in within for edge in c.edges)]
    for first, other in combinations(mapped, 2):
        if first.line.crosses(other.line):
            unite(first.start, other.start)
    groups: dict[str, list[str]] = defaultdict(list)
    for node in top:
        groups[find(node)].append(node)
    return [tuple(sorted(group)) for group in groups.values() if len(group) > 1]


def flat_nodes(
    chains: Collection[Chain], meeting: Collection[str], wide: Collection[Collection[str]]
) -> list[tuple[str, ...]]:
    """Return single nodes whose junctions netconvert would make too large, sorted.

    netconvert cuts arms back until they no longer overlap. Carriageways that part or merge at a
    small angle are cut far back, and a short road to a wide junction is lost.

    Args:
        chains: the chains of the network.
        meeting: the nodes where streets meet.
        wide: the nodes of junctions of several nodes.
    """
    within = {node for group in wide for node in group}
    touching: dict[str, list[Chain]] = defaultdict(list)
    for chain in chains:
        for node in {chain.start, chain.end}:
            touching[node].append(chain)
    nodes: list[tuple[str, ...]] = []
    for node in sorted(set(meeting) - within):
        arms = touching[node]
        parting = len(arms) == 3 and {len([c for c in arms if c.end == node])} <= {1, 2}
        is_near = any(c.length < NEAR_M and {c.start, c.end} & within for c in arms)
        if parting or is_near:
            nodes.append((node,))
    return nodes


def is_marked(chain: Chain, marks: Marks, apart: Collection[str]) -> bool:
    """Return whether a chain has a stop line, a crossing, or an edge outside every junction."""
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
