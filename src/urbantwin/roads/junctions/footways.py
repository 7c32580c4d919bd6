"""Pedestrian edges: mapped footways, and waiting areas at crossings.

A footway beside a street's sidewalk is that sidewalk. The remaining parts become edges that join
streets at crossings. The end of a crossing that nothing leads to gets a short edge as waiting area,
without which netconvert makes no crossing.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import SiteFrame, area_union
from urbantwin.roads.cross_section.lane_tags import metres
from urbantwin.roads.junctions.mapped_crossings import WALKED
from urbantwin.roads.junctions.plain import (
    PlainCrossing,
    PlainEdge,
    PlainLane,
    PlainNetwork,
    PlainNode,
)
from urbantwin.roads.junctions.round_node import RoundNode
from urbantwin.roads.junctions.strip import Strip
from urbantwin.site.access import is_walked
from urbantwin.site.extract import Extract, Way

__all__ = ["mapped_footways", "with_footways"]

#: A footway within this distance of a street with a sidewalk is that sidewalk, metres.
BESIDE_M = 3.0
#: Maximum distance between joined ends of footways, crossings and sidewalks, metres.
MEETS_M = 6.0
#: Straight extension of sidewalks towards waiting areas, metres.
ONWARD_M = 8.0
#: Minimum length of a footway, and of one between two crossings, metres.
SHORTEST_M, REFUGE_M = 3.0, 0.6
#: Shorter remainders of a street's own sidewalk that lead nowhere are dropped, metres.
SCRAP_M = 15.0
#: Candidate lengths of a waiting area, and its width, metres.
PLACES_M, PLACE_WIDTH_M = (3.0, 8.0, 20.0), 2.0
#: Candidate directions of a waiting area, as angles from the street, and its minimum angle from
#: carriageways as netconvert sees it, radians.
TURNS, APART = tuple(np.radians([0.0, 30.0, 60.0, 90.0])), np.radians(3.0)
#: Distance between the kerb and the start of an edge, metres.
KERB_M = 0.3
#: Search distance for a junction's outline, metres.
RAY_M = 40.0
ON_FOOT = {"allow": "pedestrian"}
#: Default width of footways, as in the scene, and bounds of mapped widths, metres.
WIDTH_M, NARROWEST_M, WIDEST_M = 2.0, 1.0, 6.0


@dataclass(frozen=True, eq=False)
class _Kerb:
    """An end of a crossing: its node, the gap between carriageways, and its position."""

    node: str
    gap: int
    xy: NDArray[np.float64]
    along: NDArray[np.float64]  # along the street, away from the node


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of a footway that does not run beside streets; its ends are names of nodes."""

    points: NDArray[np.float64]
    ends: tuple[str, str]
    footway: MappedFootway

    @property
    def length(self) -> float:
        return float(shapely.LineString(self.points).length)


@dataclass(frozen=True, eq=False)
class MappedFootway:
    """A part of a mapped way without other ways between its ends.

    Attributes:
        way: id of the way.
        nodes: ids of its nodes, one per point.
        points: (N, 2) site frame.
        width: metres.
        kind: value of ``highway``.
        is_sidewalk: whether it is mapped as the sidewalk of a street.
    """

    way: int
    nodes: tuple[int, ...]
    points: NDArray[np.float64]
    width: float
    kind: str
    is_sidewalk: bool


def with_footways(
    plain: PlainNetwork, footways: Iterable[MappedFootway], *, driving_side: str
) -> PlainNetwork:
    """Return the network with the footways that lead to its crossings and sidewalks.

    Args:
        plain: streets with their crossings.
        footways: the map's footways.
        driving_side: ``right`` or ``left``.
    """
    outward = 1 if driving_side == "left" else -1
    strips = [Strip(edge, outward) for edge in plain.edges.values()]
    crossed = dict.fromkeys(crossing.node for crossing in plain.crossings)
    around = {name: RoundNode(plain, name, outward) for name in crossed}
    kerbs = _kerbs(plain, around)
    walks = _sidewalks(strips)
    taken_area = _occupied_area(plain, strips, walks)
    parts = [part for footway in footways for part in _parts(footway, taken_area)]
    parts = _joined(parts, kerbs, walks, around)
    nodes, edges = dict(plain.nodes), dict(plain.edges)
    for number, part in enumerate(parts):
        for name, xy in zip(part.ends, part.points[[0, -1]], strict=True):
            nodes.setdefault(name, PlainNode(name, xy, {"type": "priority"}))
        edge = _edge(f"footway{part.footway.way}_{number}", part.points, part.ends, part.footway)
        edges[edge.id] = edge
    network = replace(plain, nodes=nodes, edges=edges)
    network = _with_places_to_stand(network, kerbs, around, parts)
    return replace(network, crossings=_in_order(network.crossings, around))


def _in_order(
    crossings: Sequence[PlainCrossing], around: Mapping[str, RoundNode]
) -> tuple[PlainCrossing, ...]:
    at_node: dict[str, list[PlainCrossing]] = defaultdict(list)
    for crossing in crossings:
        at_node[crossing.node].append(crossing)
    return tuple(
        crossing
        for name, node_crossings in at_node.items()
        for crossing in around[name].ordered(node_crossings)
    )


def _kerbs(plain: PlainNetwork, around: Mapping[str, RoundNode]) -> list[_Kerb]:
    kerbs = []
    for crossing in plain.crossings:
        round_node = around[crossing.node]
        edge = plain.edges[crossing.edges[0]]
        points = edge.shape if edge.start == crossing.node else edge.shape[::-1]
        along = (points[1] - points[0]) / max(float(np.linalg.norm(points[1] - points[0])), 1e-9)
        for gap, xy in zip(round_node.gaps_of(crossing), crossing.line[[0, -1]], strict=True):
            kerbs.append(_Kerb(crossing.node, gap, xy, along))
    return kerbs


def _sidewalks(strips: Sequence[Strip]) -> list[tuple[str, shapely.LineString]]:
    """Return nodes with the lines of sidewalks at them, from the end along both directions."""
    sidewalks = []
    for strip in strips:
        for k, lane in enumerate(strip.edge.lanes):
            if not lane.is_sidewalk:
                continue
            for at_end in (False, True):
                length = float(strip.middle.length)
                x, y, heading = strip.at(length if at_end else 0.0)
                ahead = np.array([np.cos(heading), np.sin(heading)]) * (1 if at_end else -1)
                offset = strip.across(k) * np.array([-np.sin(heading), np.cos(heading)])
                end = np.array([x, y]) + offset
                line = shapely.LineString([end, end + ONWARD_M * ahead, end - ONWARD_M * ahead])
                sidewalks.append((strip.edge.end if at_end else strip.edge.start, line))
    return sidewalks


def _occupied_area(
    plain: PlainNetwork,
    strips: Sequence[Strip],
    walks: Sequence[tuple[str, shapely.LineString]],
) -> shapely.Geometry:
    """Return the area of streets, sidewalks and crossings, with a margin beside sidewalks."""
    areas: list[shapely.Geometry] = []
    for strip in strips:
        beside = any(lane.is_sidewalk for lane in strip.edge.lanes)
        margin = BESIDE_M if beside else KERB_M
        areas.append(strip.middle.buffer(strip.edge.width / 2 + margin, cap_style="flat"))
    areas += [line.buffer(BESIDE_M) for _, line in walks]
    areas += [
        shapely.LineString(crossing.line).buffer(crossing.width / 2 + 1.0, cap_style="flat")
        for crossing in plain.crossings
    ]
    return area_union(areas)


def _parts(footway: MappedFootway, taken: shapely.Geometry) -> list[_Part]:
    line = shapely.LineString(footway.points)
    pieces = shapely.get_parts(shapely.difference(line, taken))
    parts = []
    for number, piece in enumerate(pieces):
        if piece.geom_type != "LineString" or piece.length < REFUGE_M:
            continue
        points = shapely.get_coordinates(piece)
        names = []
        for xy, node, k in (
            (points[0], footway.nodes[0], 0),
            (points[-1], footway.nodes[-1], -1),
        ):
            is_map_end = np.linalg.norm(xy - footway.points[k]) < 1e-6
            names.append(
                f"f{node}" if is_map_end else f"f{footway.way}_{footway.nodes[0]}_{number}_{k}"
            )
        parts.append(_Part(points, (names[0], names[1]), footway))
    return parts


def _joined(
    parts: Sequence[_Part],
    kerbs: Sequence[_Kerb],
    walks: Sequence[tuple[str, shapely.LineString]],
    around: Mapping[str, RoundNode],
) -> list[_Part]:
    """Return the parts connected to streets, with their ends replaced by the streets' nodes."""
    joints = [(kerb.node, kerb.gap, kerb.xy) for kerb in kerbs]
    joints += [(node, -1, shapely.get_coordinates(line)[0]) for node, line in walks]
    places = np.array([xy for _, _, xy in joints]).reshape(-1, 2)
    joined = []
    for part in parts:
        ends = []
        for name, points in zip(part.ends, (part.points, part.points[::-1]), strict=True):
            distance = np.linalg.norm(places - points[0], axis=1)
            for k in np.argsort(distance, kind="stable"):
                node, gap, _ = joints[k]
                if distance[k] > MEETS_M:
                    continue
                round_node = around.get(node)
                seen = None if round_node is None else round_node.gap_at(round_node.angle(points))
                if gap < 0 or seen == gap:
                    ends.append(node)
                    break
            else:
                ends.append(name)
        shortest = REFUGE_M if set(ends) <= around.keys() else SHORTEST_M
        if ends[0] != ends[1] and part.length >= shortest:
            joined.append(replace(part, ends=(ends[0], ends[1])))
    return _leading(joined, {node for node, _, _ in joints})


def _leading(parts: Sequence[_Part], streets: set[str]) -> list[_Part]:
    """Return the parts that are connected to a street, without scraps.

    A scrap is a short dead end, or a remainder of a street's own sidewalk that is mapped farther
    out.
    """
    reached, connected = set(streets), list[_Part]()
    waiting = list(parts)
    while reachable := [part for part in waiting if set(part.ends) & reached]:
        connected += reachable
        reached |= {name for part in reachable for name in part.ends}
        waiting = [part for part in waiting if part not in reachable]
    while True:
        uses = Counter(name for part in connected for name in part.ends)
        remaining = [
            part
            for part in connected
            if all(uses[name] > 1 or name in streets for name in part.ends)
            or part.length > (SCRAP_M if part.footway.is_sidewalk else SHORTEST_M)
        ]
        if len(remaining) == len(connected):
            return [part for part in parts if part in connected]
        connected = remaining


def _edge(
    name: str, points: NDArray[np.float64], ends: tuple[str, str], footway: MappedFootway | None
) -> PlainEdge:
    kind = "footway" if footway is None else footway.kind
    width = PLACE_WIDTH_M if footway is None else footway.width
    lane = PlainLane({**ON_FOOT, "width": f"{width:.2f}"}, str(footway.way) if footway else "")
    attributes = {
        "priority": "1",
        "type": f"highway.{kind}",
        "speed": "2.778",
        "spreadType": "center",
    }
    return PlainEdge(name, ends[0], ends[1], points, (lane,), attributes, {})


def _with_places_to_stand(
    plain: PlainNetwork,
    kerbs: Sequence[_Kerb],
    around: Mapping[str, RoundNode],
    parts: Sequence[_Part],
) -> PlainNetwork:
    """Return the network with waiting areas at crossing ends that nothing leads to.

    Where the ends of two crossings meet between carriageways, netconvert makes a refuge itself.
    """
    nodes, edges = dict(plain.nodes), dict(plain.edges)
    stood = {
        (name, gap) for name, round_node in around.items() for gap in round_node.sidewalk_gaps()
    }
    for part in parts:
        for name, points in zip(part.ends, (part.points, part.points[::-1]), strict=True):
            if name in around:
                stood.add((name, around[name].gap_at(around[name].angle(points))))
    meeting = Counter((kerb.node, kerb.gap) for kerb in kerbs)
    for number, kerb in enumerate(kerbs):
        if (kerb.node, kerb.gap) in stood or meeting[kerb.node, kerb.gap] > 1:
            continue
        stood.add((kerb.node, kerb.gap))
        name = f"stand{kerb.node}_{number}"
        points = _place_to_stand(kerb, around[kerb.node])
        nodes[name] = PlainNode(name, points[1], {"type": "priority"})
        edges[name] = _edge(name, points, (kerb.node, name), None)
    return replace(plain, nodes=nodes, edges=edges)


def _place_to_stand(kerb: _Kerb, here: RoundNode) -> NDArray[np.float64]:
    """Return the line (2, 2) of a waiting area, away from the street or along it.

    Edges at a junction with its own outline always begin on the outline.
    """
    low, high = here.bounds(kerb.gap)
    outward = kerb.xy - here.centre
    left = np.array([-kerb.along[1], kerb.along[0]])
    direction = left if left @ outward > 0 else -left
    if here.outline.is_empty:
        return np.array([kerb.xy + d * direction for d in (KERB_M, KERB_M + PLACES_M[0])])
    first = kerb.xy + (PLACE_WIDTH_M / 2 + KERB_M) * direction
    ray = shapely.LineString([first, first + RAY_M * kerb.along])
    border = shapely.boundary(here.outline)
    hits = shapely.get_coordinates(shapely.intersection(ray, border))
    if not len(hits):  # the street's side of the outline lies farther out
        hits = shapely.get_coordinates(shapely.shortest_line(border, shapely.Point(first)))[:1]
    first = hits[np.argmax((hits - first) @ kerb.along)]
    for turn, length in product(TURNS, PLACES_M):
        outwards = np.cos(turn) * kerb.along + np.sin(turn) * direction
        points = np.array([first, first + length * outwards])
        angle = here.angle(points)
        if low + APART < angle < high - APART or low + APART < angle + 2 * np.pi < high - APART:
            return points
    # The street hides it, seen from the centre: place it straight outwards.
    outwards = outward / max(float(np.linalg.norm(outward)), 1e-9)
    return np.array([kerb.xy, kerb.xy + PLACES_M[0] * outwards])


def mapped_footways(
    extract: Extract, frame: SiteFrame, region: shapely.Polygon, streets: Collection[int]
) -> tuple[MappedFootway, ...]:
    """Return the footways on the ground within the region, cut at their junctions.

    Args:
        extract: the map.
        frame: the site frame.
        region: the region, site frame.
        streets: ids of the nodes of streets.
    """
    walked_ways = [osm_way for osm_way in extract.highways() if _is_walked(osm_way)]
    uses = Counter(node for osm_way in walked_ways for node in osm_way.nodes)
    uses.update({node: 2 for node in streets if node in uses})
    footways = []
    for piece in extract.clipped(frame, region, walked_ways):
        inner = range(1, len(piece.nodes) - 1)
        ends = [0, *(k for k in inner if uses[piece.nodes[k]] > 1), len(piece.nodes) - 1]
        width = min(max(metres(piece.tags.get("width")) or WIDTH_M, NARROWEST_M), WIDEST_M)
        beside = "sidewalk" in {piece.tags.get(key) for key in ("footway", "path", "cycleway")}
        for a, b in pairwise(ends):
            nodes, points = piece.nodes[a : b + 1], piece.points[a : b + 1]
            kind = piece.tags["highway"]
            footways.append(MappedFootway(piece.way, nodes, points, width, kind, beside))
    return tuple(footways)


def _is_walked(way: Way) -> bool:
    tags = way.tags
    if tags["highway"] not in WALKED or tags.get("area") == "yes":
        return False
    flat = tags.get("layer", "0") == "0" and tags.get("bridge", "no") == "no"
    inside = tags.get("indoor", "no") != "no" or tags.get("tunnel", "no") != "no"
    return is_walked(tags) and flat and not inside
