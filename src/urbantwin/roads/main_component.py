"""The main component of a network that a border has cut up, and what is left out."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

__all__ = ["LeftOut", "Part", "main_component"]

Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True)
class Part:
    """A piece of a road, as a node of the graph of connected roads.

    Attributes:
        name: of the street; empty if it has none.
        line: its middle, site frame.
        lanes: how many lanes of motor traffic it has, both directions together.
        joints: what it shares with the parts that it is joined to: nodes, ends of roads.
    """

    name: str
    line: shapely.LineString
    lanes: float
    joints: frozenset[Hashable]


@dataclass(frozen=True)
class LeftOut:
    """A component that was left out: how many roads, their length, and the streets' names."""

    roads: int
    metres: float
    names: tuple[str, ...]

    def as_note(self) -> dict[str, object]:
        """Return it as it stands in a twin's notes."""
        return {
            "roads": self.roads,
            "metres": round(self.metres, 1),
            "names": ", ".join(self.names) or "without a name",
        }


def main_component(parts: Mapping[Key, Part]) -> tuple[set[Key], list[LeftOut]]:
    """Return the parts of the main component, and what is left out, the longest first.

    The main component is the one with the most metres of lanes for motor traffic. What crosses
    over or under it without being joined to it stays: it is part of the place, and has an end and
    a beginning of its own at the border. What carries no motor traffic stays too.

    Args:
        parts: the roads by their ids.
    """
    keys = sorted(parts, key=str)
    numbers = _components([parts[key] for key in keys])
    weight = np.bincount(
        numbers, weights=[parts[key].lanes * parts[key].line.length for key in keys]
    )
    if not len(weight):
        return set(), []
    kept = {int(np.argmax(weight))} | {k for k, lanes in enumerate(weight) if lanes == 0.0}
    lines = {k: shapely.MultiLineString([parts[key].line for key, n in
             zip(keys, numbers, strict=True) if n == k]) for k in range(len(weight))}  # fmt: skip
    grown = {int(np.argmax(weight))}
    while grown:
        near = shapely.union_all([lines[k] for k in sorted(grown)])
        grown = {k for k in lines if k not in kept and shapely.crosses(lines[k], near)}
        kept |= grown
    left = []
    for k in sorted(set(range(len(weight))) - kept):
        mine = [parts[key] for key, n in zip(keys, numbers, strict=True) if n == k]
        names = tuple(dict.fromkeys(part.name for part in mine if part.name))
        left.append(LeftOut(len(mine), float(sum(part.line.length for part in mine)), names))
    left.sort(key=lambda item: (-item.metres, item.names))
    return {key for key, n in zip(keys, numbers, strict=True) if n in kept}, left


def _components(parts: list[Part]) -> list[int]:
    """Return the number of the component of each part."""
    joints = {joint: k for k, joint in enumerate({j: 0 for part in parts for j in part.joints})}
    pairs = np.array(
        [(n, len(parts) + joints[j]) for n, part in enumerate(parts) for j in part.joints],
        np.int64,
    ).reshape(-1, 2)
    size = len(parts) + len(joints)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(size, size))
    numbers = connected_components(graph, directed=False)[1][: len(parts)]
    return [int(n) for n in np.unique(numbers, return_inverse=True)[1]]
