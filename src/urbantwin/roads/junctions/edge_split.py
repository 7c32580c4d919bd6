"""Cutting plain edges in two, lanes and ways on as they were."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

from urbantwin.roads.junctions.plain import PlainEdge, PlainLink, PlainNetwork, PlainNode
from urbantwin.roads.junctions.strip import cut

__all__ = ["split_edges"]


def split_edges(
    plain: PlainNetwork, node: PlainNode, stations: Mapping[str, float]
) -> tuple[PlainNetwork, dict[str, str]]:
    """Cut edges at a new node; every lane leads on to itself.

    The part that leads to where the edge led keeps its name, and with it the turns from there.

    Args:
        plain: the network.
        node: the new node.
        stations: edge -> where it is cut, metres along its shape.

    Returns:
        The network, and edge -> the name of the part that leads to the new node.
    """
    edges: dict[str, PlainEdge] = {}
    before: dict[str, str] = {}
    for name in stations:
        before[name] = _unused(name, {*plain.edges, *before.values()})
    links = [
        replace(link, end=before[link.end]) if link.end in before else link for link in plain.links
    ]
    for name, edge in plain.edges.items():
        if name not in stations:
            edges[name] = edge
            continue
        at, first = stations[name], before[name]
        shapes = cut(edge.line, 0.0, at), cut(edge.line, at, edge.line.length)
        edges[first] = replace(edge, id=first, end=node.id, shape=shapes[0])
        edges[name] = replace(edge, start=node.id, shape=shapes[1])
        links += [
            PlainLink(first, name, k, k)
            for k, lane in enumerate(edge.lanes)
            if lane.admits("passenger") or lane.admits("bus") or lane.admits("bicycle")
        ]
    nodes = {**plain.nodes, node.id: node}
    crossings = tuple(
        replace(one, edges=tuple(_at(one.node, name, before, edges) for name in one.edges))
        for one in plain.crossings
    )
    split = replace(plain, nodes=nodes, edges=edges, links=tuple(links), crossings=crossings)
    return split, before


def _at(node: str, name: str, before: Mapping[str, str], edges: Mapping[str, PlainEdge]) -> str:
    """Return the part of an edge that meets a node."""
    first = before.get(name, name)
    return first if edges[first].start == node else name


def _unused(name: str, used: Collection[str]) -> str:
    """Return a name for the first part of an edge, numbered as netconvert numbers parts."""
    whole, number = name.partition("#")[0], 1
    while f"{whole}#{number}" in used:
        number += 1
    return f"{whole}#{number}"
