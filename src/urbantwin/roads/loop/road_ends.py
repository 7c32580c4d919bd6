"""Loose ends of streets: cut by the region's border, or dead ends of the map."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads.cross_section import cross_section
from urbantwin.site import WayPiece
from urbantwin.site.access import CYCLE_TRACK, is_driven

__all__ = ["LooseEnd", "loose_ends", "motor_lanes", "outward"]

#: Length at an end over which its heading is measured, metres.
HEADING_M = 8.0


@dataclass(frozen=True, eq=False)
class LooseEnd:
    """An end of a piece of a way, at a node without other ways.

    Attributes:
        piece: the piece.
        node: the node.
        at_start: whether it is the piece's first node, else its last.
        point: (2,) its position, site frame.
        heading: from the street outwards, radians.
        leaves: number of lanes out of the street here.
        enters: number of lanes into the street here.
        lane_m: width of the widest of these lanes, metres.
        cut: whether the region's border cut it, so that the street continues in the map.
    """

    piece: WayPiece
    node: int
    at_start: bool
    point: NDArray[np.float64]
    heading: float
    leaves: int
    enters: int
    lane_m: float
    cut: bool

    @property
    def ahead(self) -> NDArray[np.float64]:
        """Unit vector (2,) outwards."""
        return np.array([math.cos(self.heading), math.sin(self.heading)])


def motor_lanes(
    tags: Mapping[str, str], side: str, country: str
) -> tuple[list[float], list[float]]:
    """Return the widths of the motor traffic lanes along a way and against it, metres.

    For a cycle track they are those of its bicycle lanes.

    Args:
        tags: the way's tags, including ``sidewalk``.
        side: driving side, ``right`` or ``left``.
        country: ISO 3166-1 alpha-2; empty if unknown.
    """
    walks = tags.get("sidewalk", "no")
    section = cross_section(tags, driving_side=side, sidewalks=walks, country=country)
    track = tags.get("highway") == CYCLE_TRACK
    forward, backward = (
        [lane.width for lane in lanes if (track or lane.kind != "bicycle") and not lane.both_ways]
        for lanes in (section.forward, section.backward)
    )
    return forward, backward


def loose_ends(
    pieces: Sequence[WayPiece],
    known: Iterable[int],
    lanes: Sequence[tuple[list[float], list[float]]],
) -> list[LooseEnd]:
    """Return the ends at nodes without other pieces, in the order of the pieces.

    If several one-way streets begin or end at one node without continuation, it is the end of the
    widest. Streets closed to motor traffic have none, nor have one-way cycle tracks, which no road
    for cars continues.

    Args:
        pieces: the ways of the network, cut to the region.
        known: ids of the nodes of the map; others are where the border cut a way.
        lanes: widths of the lanes of each piece along it and against it, metres.
    """
    arms: dict[int, int] = defaultdict(int)
    for piece in pieces:
        for k, node in enumerate(piece.nodes):
            arms[node] += 1 if k in (0, len(piece.nodes) - 1) else 2
    of_map = frozenset(known)
    ends: dict[int, list[LooseEnd]] = defaultdict(list)
    for piece, (along, against) in zip(pieces, lanes, strict=True):
        ridden = piece.tags.get("highway") == CYCLE_TRACK and along and against
        if not ridden and not is_driven(piece.tags):
            continue
        for at_start in (True, False):
            node = piece.nodes[0 if at_start else -1]
            points = piece.points if at_start else piece.points[::-1]
            leaves, enters = (against, along) if at_start else (along, against)
            ends[node].append(
                LooseEnd(
                    piece,
                    node,
                    at_start,
                    points[0],
                    outward(points),
                    len(leaves),
                    len(enters),
                    max((*leaves, *enters), default=0.0),
                    node not in of_map,
                )
            )
    loose = []
    for node, group in ends.items():
        one_sided = not any(end.leaves for end in group) or not any(end.enters for end in group)
        if arms[node] == len(group) and (len(group) == 1 or one_sided):
            loose.append(max(group, key=lambda end: end.leaves + end.enters))
    order = {id(piece): k for k, piece in enumerate(pieces)}
    return sorted(loose, key=lambda end: (order[id(end.piece)], not end.at_start))


def outward(points: NDArray[np.float64]) -> float:
    """Return the heading from inside a polyline to its first point, radians."""
    distance_m = np.linalg.norm(points - points[0], axis=1)
    far_index = np.flatnonzero(distance_m >= HEADING_M)
    other = points[far_index[0]] if len(far_index) else points[int(np.argmax(distance_m))]
    dx, dy = points[0] - other
    return math.atan2(dy, dx)
