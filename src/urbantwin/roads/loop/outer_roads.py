"""Outer roads: beyond the region each exit leads back to an entry.

A two-way street cut by the border is extended by a few metres to a turnaround. One-way exits lead
to one-way entries: the two carriageways of a street directly, others round the region. Outer roads
are ordinary one-way roads with the lanes, cycle lanes and sidewalks of the streets that they join,
so that they are treated like streets.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely

from urbantwin.roads.loop.free_space import band
from urbantwin.roads.loop.layout import Gate, Layout, half_width
from urbantwin.roads.loop.ring_road import WAY_OUT_M, add_ring_roads
from urbantwin.roads.loop.road_ends import LooseEnd, loose_ends
from urbantwin.roads.loop.turnaround import BENDS, add_turnaround, join_carriageways, near_pairs
from urbantwin.roads.sidewalk import sidewalk_sides
from urbantwin.site import WayPiece

__all__ = ["OuterRoads", "close_loop"]

#: Directions of the way out of a one-way street that are tried to avoid buildings, radians.
FINER_BENDS = tuple(math.radians(a) for a in sorted(range(-75, 80, 5), key=lambda a: (abs(a), -a)))


@dataclass(frozen=True, eq=False)
class OuterRoads:
    """The network with outer roads.

    Attributes:
        pieces: all ways: those of the region, some extended, and the outer ones, whose ``way`` is
            0.
        no_turns: forbidden turns: from a way, over a node, to a way.
        nodes: ids of the nodes at which outer roads begin and end.
        notes: numbers of turnarounds, of roads by kind, of cut-back dead ends, of open ends, and of
            outer roads with overlaps.
    """

    pieces: tuple[WayPiece, ...]
    no_turns: tuple[tuple[int, int, int], ...] = ()
    nodes: tuple[int, ...] = ()
    notes: dict[str, int] = field(default_factory=dict)

    @property
    def outer(self) -> tuple[WayPiece, ...]:
        """The outer ways."""
        return tuple(piece for piece in self.pieces if piece.way == 0)


def close_loop(
    pieces: Sequence[WayPiece],
    known: Iterable[int],
    *,
    driving_side: str,
    country: str = "",
    buildings: Sequence[shapely.Geometry] = (),
    standing: Sequence[shapely.Geometry] = (),
    region: shapely.Geometry | None = None,
) -> OuterRoads:
    """Join each end of a street at the region's border to another, or to itself.

    Cul-de-sacs within the region stay: vehicles turn round at their end. A one-way street with a
    dead end within the region is cut back to its last junction.

    Args:
        pieces: the ways of the network, cut to the region.
        known: ids of the nodes of the map; others are where the border cut a way.
        driving_side: ``right`` or ``left``.
        country: ISO 3166-1 alpha-2; empty if unknown.
        buildings: areas of buildings, site frame, which turnarounds avoid if possible.
        standing: areas of buildings in the twin, which reach into the region.
        region: area that roads round it avoid, also where the map ends before its border.
    """
    of_map = frozenset(known)
    about = (of_map, driving_side, country, buildings, standing, region)
    layout = Layout(_with_sidewalks(pieces, driving_side), *about)
    cut_back = 0
    while blind := _blind_ends(layout, of_map):
        layout = Layout(_cut_back(layout.pieces, blind), *about)
        cut_back += len(blind)
    number = {piece.id: k for k, piece in enumerate(layout.pieces)}
    by_node: dict[int, list[int]] = defaultdict(list)
    for piece in layout.pieces:
        by_node[piece.nodes[0]].append(piece.id)
        by_node[piece.nodes[-1]].append(piece.id)
    turning: list[LooseEnd] = []
    exits: list[Gate] = []
    entries: list[Gate] = []
    for end in loose_ends(layout.pieces, of_map, layout.lanes):
        street = number[end.piece.id]
        heading = _way_out(layout, end, street)
        lanes = max(end.leaves, end.enters)
        if end.leaves and end.enters:
            if end.cut or (heading is not None and lanes > 1):
                turning.append(end)
        elif heading is not None:
            gate = Gate(
                end.node,
                end.point,
                heading,
                street,
                end.piece.tags,
                lanes,
                end.lane_m,
                beside=tuple(number[other] for other in by_node[end.node] if other != end.piece.id),
            )
            (exits if end.leaves else entries).append(gate)
    matched = near_pairs(exits, entries)
    exits = [_past_walls(layout, g) for g in exits if all(g is not a for a, _ in matched)]
    entries = [_past_walls(layout, g) for g in entries if all(g is not b for _, b in matched)]
    for gate in (*exits, *entries):
        layout.space.reserve(_ahead(gate))
    for exit_, entry in matched:
        join_carriageways(layout, exit_, entry)
    tips = [add_turnaround(layout, end, number[end.piece.id]) for end in turning]
    routed, still_open = add_ring_roads(layout, exits, entries, tips)
    notes = {
        "turning_drops": len(turning),
        "carriageways_joined": len(matched),
        "roads_round_the_region": routed,
        "dead_ends_cut_back": cut_back,
        "open_ends": still_open,
        "outer_roads_without_room": layout.overlaps,
    }
    tags = {piece.id: piece.tags for piece in pieces}
    streets = [replace(piece, tags=tags[piece.id]) for piece in layout.pieces]
    return OuterRoads(
        (*streets, *layout.outer),
        tuple(layout.no_turns),
        tuple(sorted(set(layout.nodes))),
        notes,
    )


def _with_sidewalks(pieces: Sequence[WayPiece], side: str) -> list[WayPiece]:
    """Return ways whose tag ``sidewalk`` gives the sides with sidewalks."""
    one_way = ("yes", "1", "true")
    oneway_lines = [
        shapely.LineString(piece.points) for piece in pieces if piece.tags.get("oneway") in one_way
    ]
    return [
        replace(
            piece,
            tags={
                **piece.tags,
                "sidewalk": sidewalk_sides(piece.tags, piece.points, oneway_lines, side=side),
            },
        )
        for piece in pieces
    ]


def _blind_ends(layout: Layout, known: frozenset[int]) -> list[LooseEnd]:
    """Return the one-way exits that end within the region, unreachable for outer roads."""
    number = {piece.id: k for k, piece in enumerate(layout.pieces)}
    return [
        end
        for end in loose_ends(layout.pieces, known, layout.lanes)
        if not end.enters and _way_out(layout, end, number[end.piece.id]) is None
    ]


def _way_out(layout: Layout, end: LooseEnd, street: int) -> float | None:
    """Return the heading of a straight way out from an end; ``None`` if there is none."""
    headings = (end.heading + bend for bend in BENDS)
    free = (h for h in headings if layout.space.leads_out(street, end.point, h))
    return next(free, None)


def _past_walls(layout: Layout, gate: Gate) -> Gate:
    """Return a gate whose way out has the least overlap with buildings in the twin."""
    turned = [replace(gate, heading=gate.heading + bend) for bend in FINER_BENDS]
    free = [g for g in turned if layout.space.leads_out(g.street, g.point, g.heading)]
    return min(free, key=lambda g: layout.space.walls_on(_ahead(g)), default=gate)


def _ahead(gate: Gate) -> shapely.Polygon:
    """Return the straight way out of a gate as an area."""
    line = np.array([gate.point + gate.ahead, gate.point + gate.ahead * WAY_OUT_M])
    return band(line, half_width(gate.lanes * gate.lane_m, gate.tags))


def _cut_back(pieces: Sequence[WayPiece], ends: Sequence[LooseEnd]) -> list[WayPiece]:
    """Return the ways without the parts between some ends and the last junction before each."""
    uses = Counter(node for piece in pieces for node in piece.nodes)
    remaining = {piece.id: piece for piece in pieces}
    for end in ends:
        piece = remaining.pop(end.piece.id, None)
        if piece is None:
            continue
        shared = [k for k, node in enumerate(piece.nodes) if uses[node] > 1]
        if end.at_start:
            part = slice(shared[0], None) if shared else slice(0)
        else:
            part = slice(0, shared[-1] + 1) if shared else slice(0)
        if len(piece.nodes[part]) > 1:
            remaining[piece.id] = replace(piece, nodes=piece.nodes[part], points=piece.points[part])
    return [remaining[piece.id] for piece in pieces if piece.id in remaining]
