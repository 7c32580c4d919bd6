"""Small roundabouts mapped as rings: each is one junction around a raised central island.

The arms of a small ring are closer together than a junction is wide. Separate junctions would cover
the whole ring, including its centre. Paths lead around the centre instead: an entry curve, the ring
itself, and an exit curve.
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

#: Values of ``junction`` of circular streets (``yes`` is a way within a junction).
RINGS = ("roundabout", "circular")
#: SUMO's type of junctions where entering traffic yields to traffic from the left (mirrored in
#: left-hand traffic).
CIRCULATING = "left_before_right"
#: Largest inscribed circle of a small roundabout, metres (CD 116, 2.5: mini-roundabouts have at
#: most 28 m; FHWA, Roundabouts: An Informational Guide, exhibit 1-9: 45 to 90 ft).
INSCRIBED_M = 28.0
#: Maximum deviation of a ring from a circle, as a share of its radius.
ROUND = 0.15
#: Maximum and minimum radius of entry and exit curves, metres.
GENTLE_M, TIGHT_M = 12.0, 3.0
#: Shorter pieces of a path are left out, metres.
SHORT_M = 1e-3


@dataclass(frozen=True, eq=False)
class Ring:
    """A small roundabout.

    Attributes:
        edges: ids of its edges.
        centre: x, y (2,), site frame, metres.
        radius: radius of its lane's centre line, metres.
        width: width of its carriageway, metres.
    """

    edges: frozenset[str]
    centre: NDArray[np.float64]
    radius: float
    width: float

    @property
    def island_radius(self) -> float:
        """Radius of the central island, metres."""
        return self.radius - self.width / 2

    @property
    def island(self) -> shapely.Polygon:
        """The central island inside the carriageway."""
        return shapely.Point(self.centre).buffer(self.island_radius)


def small_rings(pieces: Sequence[WayPiece], segments: Sequence[MappedSegment]) -> list[Ring]:
    """Return the closed, circular, single-lane rings that are small enough.

    Args:
        pieces: the segments of streets.
        segments: the same with their cross sections.
    """
    onward: dict[int, list[int]] = defaultdict(list)
    of_rings = [k for k, piece in enumerate(pieces) if piece.tags.get("junction") in RINGS]
    for k in of_rings:
        onward[pieces[k].nodes[0]].append(k)
    rings, seen = [], set[int]()
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
                rings.append(ring)
    return rings


def _ring(pieces: Sequence[WayPiece], segments: Sequence[MappedSegment]) -> Ring | None:
    """Return a closed chain of pieces as a ring; ``None`` if it is not a small circle."""
    lanes = [segment.section.forward + segment.section.backward for segment in segments]
    driven = [[lane for lane in row if lane.kind != "bicycle"] for row in lanes]
    if any(len(row) != 1 for row in driven):
        return None
    line = shapely.LineString(np.vstack([piece.points for piece in pieces]))
    points = shapely.get_coordinates(line.segmentize(1.0))
    # Least squares: |p|^2 = 2 c p + (r^2 - |c|^2).
    rows = np.column_stack([2 * points, np.ones(len(points))])
    x, y, rest = np.linalg.lstsq(rows, (points**2).sum(axis=1), rcond=None)[0]
    centre = np.array([x, y])
    radius = float(np.sqrt(max(rest + x * x + y * y, 0.0)))
    deviation_m = np.abs(np.linalg.norm(points - centre, axis=1) - radius).max()
    width = max(segment.section.width for segment in segments)
    if deviation_m > ROUND * radius or 2 * radius + width > INSCRIBED_M or 2 * radius <= width:
        return None
    edges = frozenset(f"{sign}{piece.id}" for piece in pieces for sign in ("", "-"))
    return Ring(edges, centre, radius, width)


def circulating(plain: PlainNetwork, rings: Sequence[Ring], minis: Collection[str]) -> PlainNetwork:
    """Return a network where traffic that enters a roundabout yields to traffic on it.

    Args:
        plain: the network.
        rings: its small roundabouts.
        minis: nodes that are mini-roundabouts.
    """
    edges = [plain.edges[name] for ring in rings for name in ring.edges & plain.edges.keys()]
    names = {*minis, *(node for edge in edges for node in (edge.start, edge.end))}
    nodes = dict(plain.nodes)
    for name in names & nodes.keys():
        attributes = nodes[name].attributes
        if not attributes.get("type", "").startswith("traffic_light"):
            nodes[name] = replace(nodes[name], attributes={**attributes, "type": CIRCULATING})
    return replace(plain, nodes=nodes)


def is_mini_roundabout(tags: Mapping[str, str]) -> bool:
    """Return whether a node is a mini-roundabout with a traversable island (OSM wiki)."""
    return tags.get("highway") == "mini_roundabout"


def ring_of(edges: Iterable[str], rings: Sequence[Ring]) -> Ring | None:
    """Return the ring that contains some of the edges; ``None`` if there is none."""
    names = set(edges)
    return next((ring for ring in rings if ring.edges & names), None)


def round_ring(ends: NDArray[np.float64], ring: Ring, along: float, side: int) -> Curve | None:
    """Return a path between two poses around a ring's centre, made of straight lines and arcs.

    Args:
        ends: x, y, heading (2, 3) of its start and end.
        ring: the ring.
        along: length of the map's path on the ring, metres.
        side: 1 for counter-clockwise circulation (right-hand traffic), else -1.

    Returns:
        The path; ``None`` where the ends leave no room for its curves, or where entry and exit meet
            before the ring, as between adjacent arms.
    """
    # The exit is an entry driven backwards, around the ring in the other direction.
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
    """An entry into a ring: straight length, curve to the outside, and place where it joins.

    ``ahead`` and ``radius`` in metres, ``turn`` in radians, ``at`` as angle around the ring's
    centre.
    """

    ahead: float
    radius: float
    turn: float
    at: float


def _entry(pose: NDArray[np.float64], ring: Ring, side: int) -> _Entry | None:
    """Return the entry from a pose (3,) into a ring; ``None`` if there is no room."""
    ahead = np.array([np.cos(pose[2]), np.sin(pose[2])])
    inward = side * np.array([-ahead[1], ahead[0]])
    gap = ring.centre - pose[:2]
    room, beside = float(gap @ ahead), float(gap @ inward)
    if abs(beside) > ring.radius - SHORT_M or room <= 0.0:
        return None
    # The curve's centre is ``radius`` beside the path, and both radii from the ring's centre.
    across = ring.radius - beside
    radius = min(GENTLE_M, (room * room / across - ring.radius - beside) / 2)
    if radius < TIGHT_M:
        return None
    before = float(np.sqrt(across * (ring.radius + beside + 2 * radius)))
    towards = -before * ahead - (radius + beside) * inward
    turn = float(np.arctan2(before, radius + beside))
    return _Entry(room - before, radius, turn, float(np.arctan2(towards[1], towards[0])))
