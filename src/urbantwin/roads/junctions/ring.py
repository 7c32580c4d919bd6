"""Small roundabouts mapped as rings: each is one junction round a raised central island.

The arms of a small ring lie closer together than a junction is wide, so that a ring of single
junctions would be covered by their areas, its middle too. Ways through lead round the middle
instead: a curve to the outside where they enter, the ring itself, and a curve out of it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.cross_section import MappedSegment
from urbantwin.roads.junctions.plain import PlainNetwork
from urbantwin.roads.model.curve import Curve, Piece
from urbantwin.site.extract import WayPiece

__all__ = [
    "CIRCULATING",
    "RINGS",
    "Ring",
    "circulating",
    "is_mini_roundabout",
    "ring_of",
    "round_ring",
    "small_rings",
]

#: Values of ``junction`` of streets that lead round a middle (``yes`` is a way within a junction).
RINGS = ("roundabout", "circular")
#: SUMO's type of junctions where those who enter give way to those who come round from the left
#: (in left-hand traffic, which it mirrors, from the right).
CIRCULATING = "left_before_right"
#: Largest inscribed circle of a small roundabout, metres (CD 116, 2.5: mini-roundabouts have at
#: most 28 m; FHWA, Roundabouts: An Informational Guide, exhibit 1-9: 45 to 90 ft).
INSCRIBED_M = 28.0
#: A ring is a circle where no point is further off than this share of its radius.
ROUND = 0.15
#: Entry and exit curves: the gentlest that are drawn, and the tightest that cars drive, metres.
GENTLE_M, TIGHT_M = 12.0, 3.0
#: Shorter pieces of a way are left out, metres.
SHORT_M = 1e-3


@dataclass(frozen=True, eq=False)
class Ring:
    """A small roundabout.

    Attributes:
        edges: ids of the edges that it consists of.
        centre: x, y (2,), site frame, metres.
        radius: of the middle of its lane, metres.
        width: of its carriageway, metres.
    """

    edges: frozenset[str]
    centre: NDArray[np.float64]
    radius: float
    width: float

    @property
    def island_radius(self) -> float:
        """Of what the carriageway leaves in its middle, metres."""
        return self.radius - self.width / 2

    @property
    def island(self) -> shapely.Polygon:
        """What the carriageway leaves in its middle."""
        return shapely.Point(self.centre).buffer(self.island_radius)


def small_rings(pieces: Sequence[WayPiece], segments: Sequence[MappedSegment]) -> list[Ring]:
    """Return the closed, circular rings of one lane that are small enough.

    Args:
        pieces: the segments of streets.
        segments: the same with their cross sections.
    """
    onward: dict[int, list[int]] = defaultdict(list)
    of_rings = [k for k, piece in enumerate(pieces) if piece.tags.get("junction") in RINGS]
    for k in of_rings:
        onward[pieces[k].nodes[0]].append(k)
    found, seen = [], set[int]()
    for first in of_rings:
        members: list[int] = []
        k = first
        while k not in seen:
            seen.add(k)
            members.append(k)
            following = onward[pieces[k].nodes[-1]]
            if len(following) != 1:
                break
            k = following[0]
        if members and pieces[members[-1]].nodes[-1] == pieces[first].nodes[0]:
            ring = _ring([pieces[k] for k in members], [segments[k] for k in members])
            if ring is not None:
                found.append(ring)
    return found


def _ring(pieces: Sequence[WayPiece], segments: Sequence[MappedSegment]) -> Ring | None:
    """Return a closed chain of pieces as a ring; ``None`` where it is no small circle."""
    lanes = [one.section.forward + one.section.backward for one in segments]
    driven = [[lane for lane in each if lane.kind != "bicycle"] for each in lanes]
    if any(len(each) != 1 for each in driven):
        return None
    line = shapely.LineString(np.vstack([piece.points for piece in pieces]))
    points = shapely.get_coordinates(line.segmentize(1.0))
    # Least squares: |p|^2 = 2 c p + (r^2 - |c|^2).
    rows = np.column_stack([2 * points, np.ones(len(points))])
    x, y, rest = np.linalg.lstsq(rows, (points**2).sum(axis=1), rcond=None)[0]
    centre = np.array([x, y])
    radius = float(np.sqrt(max(rest + x * x + y * y, 0.0)))
    off = np.abs(np.linalg.norm(points - centre, axis=1) - radius).max()
    width = max(one.section.width for one in segments)
    if off > ROUND * radius or 2 * radius + width > INSCRIBED_M or 2 * radius <= width:
        return None
    edges = frozenset(f"{sign}{piece.id}" for piece in pieces for sign in ("", "-"))
    return Ring(edges, centre, radius, width)


def circulating(plain: PlainNetwork, rings: Sequence[Ring], minis: Collection[str]) -> PlainNetwork:
    """Return a network where those who enter a roundabout give way to those within it.

    Args:
        plain: the network.
        rings: its small roundabouts.
        minis: nodes that are one.
    """
    edges = [plain.edges[name] for ring in rings for name in ring.edges & plain.edges.keys()]
    names = {*minis, *(node for edge in edges for node in (edge.start, edge.end))}
    nodes = dict(plain.nodes)
    for name in names & nodes.keys():
        told = nodes[name].attributes
        if not told.get("type", "").startswith("traffic_light"):
            nodes[name] = replace(nodes[name], attributes={**told, "type": CIRCULATING})
    return replace(plain, nodes=nodes)


def is_mini_roundabout(tags: Mapping[str, str]) -> bool:
    """Whether a node is a roundabout whose island is driven over (OSM wiki, its own tag)."""
    return tags.get("highway") == "mini_roundabout"


def ring_of(edges: Iterable[str], rings: Sequence[Ring]) -> Ring | None:
    """Return the ring that some of the edges belong to."""
    names = set(edges)
    return next((ring for ring in rings if ring.edges & names), None)


def round_ring(ends: NDArray[np.float64], ring: Ring, along: float, side: int) -> Curve | None:
    """Return a way from pose to pose round the middle of a ring: straight lines and arcs.

    Args:
        ends: x, y, heading (2, 3) where it begins and ends.
        ring: the ring.
        along: how much of the ring the map's way has, metres.
        side: 1 where traffic runs round it counter-clockwise (right-hand traffic), else -1.

    Returns:
        The way; ``None`` where the ends leave no room for its curves, or where they meet before
        they reach the ring, as on the way to the next arm.
    """
    # The exit is an entry that is driven backwards, round the ring the other way.
    back = np.array([*ends[1, :2], ends[1, 2] + np.pi])
    first, last = _entry(ends[0], ring, side), _entry(back, ring, -side)
    if first is None or last is None:
        return None
    sweep = side * (last.at - first.at) % (2 * np.pi)
    if sweep > np.pi + along / ring.radius:
        return None
    x, y, heading = ends[0].tolist()
    pieces: list[Piece] = []
    for length, curvature in (
        (first.ahead, 0.0),
        (first.radius * first.turn, -side / first.radius),
        (ring.radius * sweep, side / ring.radius),
        (last.radius * last.turn, -side / last.radius),
        (last.ahead, 0.0),
    ):
        if length > SHORT_M:
            pieces.append(Piece(x, y, heading, length, curvature))
            x, y, heading = pieces[-1].at(length)
    return Curve(tuple(pieces))


@dataclass(frozen=True)
class _Entry:
    """A way into a ring: metres straight ahead, the curve to the outside, where it joins.

    ``radius`` metres, ``turn`` radians, ``at`` the angle seen from the ring's centre.
    """

    ahead: float
    radius: float
    turn: float
    at: float


def _entry(pose: NDArray[np.float64], ring: Ring, side: int) -> _Entry | None:
    """Return how a way from a pose (3,) joins a ring; ``None`` where there is no room."""
    ahead = np.array([np.cos(pose[2]), np.sin(pose[2])])
    inward = side * np.array([-ahead[1], ahead[0]])
    gap = ring.centre - pose[:2]
    room, beside = float(gap @ ahead), float(gap @ inward)
    if abs(beside) > ring.radius - SHORT_M or room <= 0.0:
        return None
    # The curve's centre is ``radius`` beside the way, and both radii from the ring's centre.
    across = ring.radius - beside
    radius = min(GENTLE_M, (room * room / across - ring.radius - beside) / 2)
    if radius < TIGHT_M:
        return None
    before = float(np.sqrt(across * (ring.radius + beside + 2 * radius)))
    towards = -before * ahead - (radius + beside) * inward
    turn = float(np.arctan2(before, radius + beside))
    return _Entry(room - before, radius, turn, float(np.arctan2(towards[1], towards[0])))
