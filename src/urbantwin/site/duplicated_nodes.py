"""Nodes that a street has twice at one place, as editors leave them: they are one node.

A way from one to the other has no length, so that what meets the one never met the other.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

from urbantwin.site.extract import Extract, Relation, Way

__all__ = ["without_duplicated_nodes"]


def without_duplicated_nodes(extract: Extract) -> Extract:
    """Return a map whose streets have no two nodes at one place one after the other.

    The first of them stays, with the tags of all; where they disagree, its own.
    """
    kept: dict[int, int] = {}

    def first(node: int) -> int:
        while node in kept:
            node = kept[node]
        return node

    position = extract.nodes.get
    for way in extract.highways():
        for a, b in pairwise(way.nodes):
            if a != b and position(a) == position(b) and position(a) and first(a) != first(b):
                kept[first(b)] = first(a)
    again = [w for w in extract.highways() if any(a == b for a, b in pairwise(w.nodes))]
    if not (kept or again):
        return extract
    found = {node: first(node) for node in kept}
    ways = dict(extract.ways)
    for way in extract.ways.values():
        nodes = [found.get(node, node) for node in way.nodes]
        once = tuple(b for k, b in enumerate(nodes) if not k or b != nodes[k - 1])
        if once != way.nodes:
            ways[way.id] = Way(way.id, once, way.tags)
    relations = {
        identity: Relation(
            identity,
            tuple((t, found.get(n, n) if t == "n" else n, role) for t, n, role in one.members),
            one.tags,
        )
        for identity, one in extract.relations.items()
    }
    tags = {node: told for node, told in extract.node_tags.items() if node not in found}
    for node, into in found.items():
        if node in extract.node_tags:
            tags[into] = {**extract.node_tags[node], **tags.get(into, {})}
    nodes_left = {node: at for node, at in extract.nodes.items() if node not in found}
    return replace(extract, nodes=nodes_left, node_tags=tags, ways=ways, relations=relations)
