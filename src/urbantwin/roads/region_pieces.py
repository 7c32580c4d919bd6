"""The streets of a region as pieces of ways: the main component, and what only tunnels join to it.

Tunnels are no part of the network. A road that leads only into one would be cut off with it,
though it lies open up to the portal: it stands, and where the loop is closed nobody drives on it,
for nothing leads on.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Hashable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import SiteFrame
from urbantwin.roads.cross_section.direction import one_way
from urbantwin.roads.loop.road_ends import outward
from urbantwin.roads.loop.turnaround import near_pairs
from urbantwin.roads.main_component import LeftOut, Part, main_component
from urbantwin.site.access import is_driven
from urbantwin.site.extract import Extract, Way, WayPiece
from urbantwin.site.junction_proposal import way_lanes

__all__ = ["RegionPieces", "region_pieces"]

#: Half the width that a lane takes with its share of shoulders, metres.
HALF_LANE_M = 2.0


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
