"""The streets of a region as pieces of ways: the main component, and parts linked only by tunnels.

Tunnels are not part of the network. A road that leads only into a tunnel is kept, because it is
visible up to the portal. Without a continuation it has no traffic in a closed loop.
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

#: Half the width of a lane with its share of shoulders, metres.
HALF_LANE_M = 2.0
Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True, eq=False)
class CutEnd:
    """A one-way street cut at the border: id of the piece, position (2,), heading outwards."""

    piece: int
    point: NDArray[np.float64]
    heading: float


@dataclass(frozen=True)
class RegionPieces:
    """The parts of a map that become roads.

    Attributes:
        joined: the main component, and roads that cross over or under it.
        before_portals: roads that only tunnels link to it.
        left_out: components that are not linked.
    """

    joined: tuple[WayPiece, ...]
    before_portals: tuple[WayPiece, ...]
    left_out: tuple[LeftOut, ...]

    def with_others(self, pieces: Sequence[WayPiece]) -> tuple[WayPiece, ...]:
        """Return other pieces followed by the roads before portals, with unique ids."""
        unused = max((piece.id for piece in (*pieces, *self.before_portals)), default=0) + 1
        renumbered = (replace(piece, id=unused + k) for k, piece in enumerate(self.before_portals))
        return (*pieces, *renumbered)

    @property
    def ground_before_portals(self) -> list[shapely.Geometry]:
        """Approximate ground area of the roads before portals."""
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
        name: name of the street; empty if it has none.
        line: its centre line, site frame.
        lanes: number of lanes of motor traffic in both directions.
        joints: keys that it shares with the parts linked to it: nodes, ends of roads.
    """

    name: str
    line: shapely.LineString
    lanes: float
    joints: frozenset[Hashable]


@dataclass(frozen=True)
class LeftOut:
    """A component that was left out: number of roads, their length in metres, and street names."""

    roads: int
    metres: float
    names: tuple[str, ...]

    def as_note(self) -> dict[str, object]:
        """Return the entry for a twin's notes."""
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
        region: region at whose border streets are cut, site frame.
        ways: the streets.
        tunnels: streets in tunnels.
    """
    below = {osm_way.id for osm_way in tunnels}
    pieces = extract.clipped(frame, region, [*ways, *tunnels])
    open_pieces = [piece for piece in pieces if piece.way not in below]
    main, left_out = main_component(_parts(open_pieces, extract.nodes))
    if tunnels and left_out:
        more, _ = main_component(_parts(pieces, extract.nodes))
        portals = {piece.id for piece in open_pieces if piece.id in more} - main
        linked = [piece for piece in open_pieces if piece.id not in portals]
        other_parts = _parts(linked, extract.nodes)
        _, left_out = main_component(other_parts)
    else:
        portals = set()
    return RegionPieces(
        tuple(piece for piece in open_pieces if piece.id in main),
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
    """Return keys that link the two carriageways of a street cut by the border, by piece.

    Inside the region, nothing may link them: they end between two junctions or at a crossing.
    """
    exits: list[CutEnd] = []
    entries: list[CutEnd] = []
    for piece in pieces:
        oneway = one_way(piece.tags)
        if oneway == "both" or not is_driven(piece.tags):
            continue
        points = piece.points if oneway == "forward" else piece.points[::-1]
        nodes = piece.nodes if oneway == "forward" else piece.nodes[::-1]
        if nodes[0] not in known:
            entries.append(CutEnd(piece.id, points[0], outward(points)))
        if nodes[-1] not in known:
            exits.append(CutEnd(piece.id, points[-1], outward(points[::-1])))
    links = defaultdict[int, list[Hashable]](list)
    for a, b in near_pairs(exits, entries):
        for end in (a, b):
            links[end.piece].append(("beside", a.piece, b.piece))
    return links


def main_component(parts: Mapping[Key, Part]) -> tuple[set[Key], list[LeftOut]]:
    """Return the parts of the main component, and the other components, the longest first.

    The main component has the most metres of lanes for motor traffic. Roads that cross over or
    under it without a link are kept: they are part of the place and have their own ends at the
    border. Components without motor traffic are kept too.

    Args:
        parts: the roads by id.
    """
    keys = sorted(parts, key=str)
    numbers = _components([parts[key] for key in keys])
    weight = np.bincount(
        numbers, weights=[parts[key].lanes * parts[key].line.length for key in keys]
    )
    if not len(weight):
        return set(), []
    kept_ids = {int(np.argmax(weight))} | {k for k, lanes in enumerate(weight) if lanes == 0.0}
    lines = {k: shapely.MultiLineString([parts[key].line for key, n in
             zip(keys, numbers, strict=True) if n == k]) for k in range(len(weight))}  # fmt: skip
    grown = {int(np.argmax(weight))}
    while grown:
        network = shapely.union_all([lines[k] for k in sorted(grown)])
        grown = {k for k in lines if k not in kept_ids and shapely.crosses(lines[k], network)}
        kept_ids |= grown
    left_out = []
    for k in sorted(set(range(len(weight))) - kept_ids):
        members = [parts[key] for key, n in zip(keys, numbers, strict=True) if n == k]
        names = tuple(dict.fromkeys(part.name for part in members if part.name))
        left_out.append(
            LeftOut(len(members), float(sum(part.line.length for part in members)), names)
        )
    left_out.sort(key=lambda item: (-item.metres, item.names))
    return {key for key, n in zip(keys, numbers, strict=True) if n in kept_ids}, left_out


def _components(parts: list[Part]) -> list[int]:
    """Return the component index of each part."""
    joints = {joint: k for k, joint in enumerate({j: 0 for part in parts for j in part.joints})}
    pairs = np.array(
        [(n, len(parts) + joints[j]) for n, part in enumerate(parts) for j in part.joints],
        np.int64,
    ).reshape(-1, 2)
    size = len(parts) + len(joints)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(size, size))
    numbers = connected_components(graph, directed=False)[1][: len(parts)]
    return [int(n) for n in np.unique(numbers, return_inverse=True)[1]]
