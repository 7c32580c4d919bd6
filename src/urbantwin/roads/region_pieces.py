"""The streets of a region as pieces of ways: the main component, and what only tunnels join to it.

Tunnels are no part of the network. A road that leads only into one would be cut off with it,
though it lies open up to the portal: it stands, and where the loop is closed nobody drives on it,
for nothing leads on.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from urbantwin.geometry import SiteFrame
from urbantwin.roads.cross_section.lane_tags import one_way
from urbantwin.roads.loop.road_ends import outward
from urbantwin.roads.loop.turnaround import near_pairs
from urbantwin.site.access import is_driven
from urbantwin.site.extract import Extract, Way, WayPiece
from urbantwin.site.junction_proposal import way_lanes

__all__ = ["LeftOut", "Part", "RegionPieces", "main_component", "region_pieces"]

#: Half the width that a lane takes with its share of shoulders, metres.
HALF_LANE_M = 2.0
Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True, eq=False)
class CutEnd:
    """Where the border cuts a one-way street: id of the piece, place (2,), heading outwards."""

    piece: int
    point: NDArray[np.float64]
    heading: float


@dataclass(frozen=True)
class RegionPieces:
    """What of a map becomes roads.

    Attributes:
        joined: the main component, and what crosses over or under it.
        before_portals: what only tunnels join to that.
        left_out: what nothing joins.
    """

    joined: tuple[WayPiece, ...]
    before_portals: tuple[WayPiece, ...]
    left_out: tuple[LeftOut, ...]

    def with_others(self, pieces: Sequence[WayPiece]) -> tuple[WayPiece, ...]:
        """Return the roads before portals behind other pieces, with ids that those do not have."""
        unused = max((piece.id for piece in (*pieces, *self.before_portals)), default=0) + 1
        own = (replace(piece, id=unused + k) for k, piece in enumerate(self.before_portals))
        return (*pieces, *own)

    @property
    def ground_before_portals(self) -> list[shapely.Geometry]:
        """About the ground that roads before portals take."""
        return [
            shapely.LineString(piece.points).buffer(
                HALF_LANE_M * way_lanes(Way(piece.id, piece.nodes, piece.tags)), cap_style="flat"
            )
            for piece in self.before_portals
        ]


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


def region_pieces(
    extract: Extract,
    frame: SiteFrame,
    region: shapely.Polygon,
    ways: Sequence[Way],
    tunnels: Sequence[Way],
) -> RegionPieces:
    """Return the streets of a region.

    Args:
        extract: the map.
        frame: the site frame.
        region: where streets are cut, site frame.
        ways: the streets.
        tunnels: those that lie in tunnels.
    """
    below = {way.id for way in tunnels}
    pieces = extract.clipped(frame, region, [*ways, *tunnels])
    open_pieces = [piece for piece in pieces if piece.way not in below]
    kept, left_out = main_component(_parts(open_pieces, extract.nodes))
    if tunnels and left_out:
        more, _ = main_component(_parts(pieces, extract.nodes))
        portals = {piece.id for piece in open_pieces if piece.id in more} - kept
        others = [piece for piece in open_pieces if piece.id not in portals]
        rest = _parts(others, extract.nodes)
        _, left_out = main_component(rest)
    else:
        portals = set()
    return RegionPieces(
        tuple(piece for piece in open_pieces if piece.id in kept),
        tuple(piece for piece in open_pieces if piece.id in portals),
        tuple(left_out),
    )


def _parts(pieces: Sequence[WayPiece], known: Collection[int]) -> dict[int, Part]:
    beside = _carriageways(pieces, known)
    return {
        piece.id: Part(
            piece.tags.get("name", ""),
            shapely.LineString(piece.points),
            way_lanes(Way(piece.id, piece.nodes, piece.tags)) if is_driven(piece.tags) else 0.0,
            frozenset((*piece.nodes, *beside[piece.id])),
        )
        for piece in pieces
    }


def _carriageways(
    pieces: Iterable[WayPiece], known: Collection[int]
) -> defaultdict[int, list[Hashable]]:
    """Return what joins the two carriageways of a street where the border cuts them, by piece.

    Nothing within the region may: it lies between two junctions, or people cross there.
    """
    exits: list[CutEnd] = []
    entries: list[CutEnd] = []
    for piece in pieces:
        way = one_way(piece.tags)
        if way == "both" or not is_driven(piece.tags):
            continue
        points = piece.points if way == "forward" else piece.points[::-1]
        nodes = piece.nodes if way == "forward" else piece.nodes[::-1]
        if nodes[0] not in known:
            entries.append(CutEnd(piece.id, points[0], outward(points)))
        if nodes[-1] not in known:
            exits.append(CutEnd(piece.id, points[-1], outward(points[::-1])))
    found = defaultdict[int, list[Hashable]](list)
    for a, b in near_pairs(exits, entries):
        for one in (a, b):
            found[one.piece].append(("beside", a.piece, b.piece))
    return found


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
