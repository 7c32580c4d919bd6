"""Mapped crossings of streets, each placed at a junction or at a new node.

A crossing near a junction lies between the junction and one arm, which is cut back for it. Other
crossings split their street, whose lanes continue straight across.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import area_union
from urbantwin.roads.junctions.mapped_crossings import MappedCrossing
from urbantwin.roads.junctions.plain import (
    INTO_M,
    PlainCrossing,
    PlainEdge,
    PlainLane,
    PlainLink,
    PlainNetwork,
    PlainNode,
    points_of_text,
    shape_text,
)
from urbantwin.roads.junctions.round_node import is_driven
from urbantwin.roads.junctions.strip import Strip, cut, split_edges
from urbantwin.roads.model.curve import aside

__all__ = ["with_crossings"]

#: Maximum distance between a junction's edge ends and its crossings, metres; the second for
#: signalised crossings of signalised junctions.
NEAR_M, NEAR_AT_SIGNALS_M = 12.0, 20.0
#: Maximum distance of a crossing beyond an edge's end, if edges end before their junction, metres.
BEYOND_M = 20.0
#: A crossing within this distance of a node on a single street lies on the node, metres.
ON_NODE_M = 3.0
#: Tolerances for matching a crossing to a strip: lateral distance, metres, and angle.
OFF_M, SKEW = 2.0, np.radians(40.0)
#: Lateral tolerance for a strip of the street that the crossing is mapped on, metres.
ASIDE_M = 20.0
#: Distance from a stop line to the crossing, and from the crossing to the exit, metres (RiLSA 2015,
#: 4.1: 1 m; US MUTCD 3B.16: 4 ft).
BEFORE_M, BEHIND_M = 1.2, 0.3
#: Minimum remaining length of an edge, metres.
SHORTEST_M = 5.0
#: Maximum length of a crossing of one carriageway, and of gaps between directions that are no
#: island, metres.
WIDEST_M, SEAM_M = 60.0, 0.6
#: Shorter lengths are not cut off, metres.
CUT_M = 0.3


@dataclass(frozen=True)
class _Hit:
    """An edge that a crossing lies on: station in metres, and whether it runs ahead."""

    strip: Strip
    station: float
    ahead: bool

    @property
    def length(self) -> float:
        return float(self.strip.edge.line.length)

    @property
    def to_end(self) -> float:
        """Distance to the edge's end, metres; negative beyond it."""
        return self.length - self.station


@dataclass(frozen=True)
class _Arm:
    """The crossed edges on one side of a node, and the edges on its other side."""

    node: str
    hits: tuple[_Hit, ...]
    beyond: tuple[_Hit, ...]
    is_before: bool  # whether the node lies ahead of the arm, along the crossing's ``ahead``


def with_crossings(
    plain: PlainNetwork, mapped: Iterable[MappedCrossing], *, driving_side: str
) -> PlainNetwork:
    """Return the network with all mapped crossings of its edges.

    Args:
        plain: edges that end at the outlines of their junctions, or at their nodes.
        mapped: crossings of the map, in the order of placement.
        driving_side: ``right`` or ``left``.
    """
    outward = 1 if driving_side == "left" else -1
    arm_crossings = (
        arm_crossing
        for crossing in mapped
        for arm_crossing in (_at_each_arm(plain, crossing) if crossing.on_every_arm else [crossing])
    )
    for crossing in arm_crossings:
        strips = [Strip(edge, outward) for edge in plain.edges.values() if is_driven(edge)]
        hits = _hits(crossing, strips)
        if not hits:
            continue
        arm = _arm_at_junction(plain, crossing, hits)
        if arm is None:
            hits = [hit for hit in hits if min(hit.station, hit.to_end) > ON_NODE_M]
            if not hits:
                continue
            plain, arm = _at_new_node(plain, crossing, hits)
        plain = _with_signals(plain, crossing, arm)
        line = _kerb_to_kerb(crossing, [hit.strip for hit in arm.hits])
        if line is None:
            continue
        plain = _without_walkers(_cut_back(plain, crossing, arm), arm)
        new = PlainCrossing(
            arm.node,
            tuple(hit.strip.edge.id for hit in arm.hits),
            crossing.width,
            crossing.has_priority or _is_signalised(plain, arm.node),
            _as_netconvert(crossing, line, arm, outward),
            crossing.marking,
        )
        plain = replace(plain, crossings=(*plain.crossings, new))
    return plain


def _at_each_arm(plain: PlainNetwork, crossing: MappedCrossing) -> list[MappedCrossing]:
    """Return one crossing for each arm of the junction that a crossing is mapped on."""
    place = shapely.Point(crossing.xy)
    arm_crossings: list[MappedCrossing] = []
    for node in plain.nodes.values():
        outline = shapely.Polygon(node.outline) if len(node.outline) else shapely.Point(node.xy)
        if outline.distance(place) > ON_NODE_M:
            continue
        arms = [(edge, True) for edge in plain.arriving[node.id] if is_driven(edge)]
        arms += [(edge, False) for edge in plain.leaving[node.id] if is_driven(edge)]
        poses = [_pose(e.line, e.line.length if arrives else 0.0) for e, arrives in arms]
        for (edge, arrives), (x, y, heading) in zip(arms, poses, strict=True):
            # Edges that end at the node itself start inside the widths of the streets beside them.
            beside = [
                other.width / (2 if other.centred else 1)
                for (other, _), pose in zip(arms, poses, strict=True)
                if not len(node.outline) and abs(np.sin(pose[2] - heading)) > np.sin(SKEW)
            ]
            distance_m = max(beside, default=0.0) + crossing.width / 2 + BEHIND_M
            ahead = np.array([np.cos(heading), np.sin(heading)])
            placed = replace(
                crossing,
                name=f"{crossing.name}_{len(arm_crossings)}",
                xy=np.array([x, y]) - (distance_m if arrives else -distance_m) * ahead,
                ahead=ahead,
                across=np.array([-ahead[1], ahead[0]]),
                pieces=frozenset(_pieces(edge)),
            )
            if not any(_is_one_arm(placed, other) for other in arm_crossings):
                arm_crossings.append(placed)
    return arm_crossings


def _is_one_arm(crossing: MappedCrossing, other: MappedCrossing) -> bool:
    gap = other.xy - crossing.xy
    return bool(
        crossing.pieces & other.pieces
        and abs(float(crossing.ahead @ other.ahead)) > np.cos(SKEW)
        and abs(float(gap @ crossing.ahead)) < crossing.width
    )


def _with_signals(plain: PlainNetwork, crossing: MappedCrossing, arm: _Arm) -> PlainNetwork:
    """Return the network with signals at the node of a signalised crossing.

    The node stays without signals if other traffic reaches it too.
    """
    node = plain.nodes[arm.node]
    if not crossing.signalised or _is_signalised(plain, node.id):
        return plain
    crossed = {hit.strip.edge.id for hit in (*arm.hits, *arm.beyond)}
    if not {edge.id for edge in plain.arriving[node.id] if is_driven(edge)} <= crossed:
        return plain
    attributes = {**node.attributes, "type": "traffic_light", "tl": node.id}
    return replace(plain, nodes={**plain.nodes, node.id: replace(node, attributes=attributes)})


def _is_signalised(plain: PlainNetwork, node: str) -> bool:
    return plain.nodes[node].attributes.get("type") == "traffic_light"


def _as_netconvert(
    crossing: MappedCrossing, line: NDArray[np.float64], arm: _Arm, outward: int
) -> NDArray[np.float64]:
    """Return the line in netconvert's direction: round its node, as traffic circulates."""
    ahead, step = crossing.ahead, line[1] - line[0]
    to_left = float(ahead[0] * step[1] - ahead[1] * step[0]) > 0
    return line if to_left == (arm.is_before == (outward > 0)) else line[::-1]


def _hits(crossing: MappedCrossing, strips: Sequence[Strip]) -> list[_Hit]:
    """Return the edges that a crossing lies on, directly or on their straight extension."""
    hits: list[_Hit] = []
    point = shapely.Point(crossing.xy)
    is_near = shapely.dwithin([s.edge.line for s in strips], point, BEYOND_M + WIDEST_M / 2)
    for strip in compress(strips, is_near):
        line = _drawn_out(strip.middle, BEYOND_M)
        along = float(line.project(point))
        x, y, heading = _pose(line, along)
        step = np.array([np.cos(heading), np.sin(heading)])
        cosine = float(step @ crossing.ahead)
        if abs(cosine) < np.cos(SKEW):
            continue
        gap = crossing.xy - [x, y]
        offset_m = float(step[0] * gap[1] - step[1] * gap[0])
        low, high = strip.driven()
        # A crossing of a street crosses both directions, wherever their middle is drawn.
        tolerance_m = ASIDE_M if _pieces(strip.edge) & crossing.pieces else OFF_M
        if (
            np.linalg.norm(gap) - abs(offset_m) > 1.0
            or not low - tolerance_m < offset_m < high + tolerance_m
        ):
            continue
        # The strip's middle and the edge's shape differ in length in bends.
        scale = strip.edge.line.length / max(strip.middle.length, 1e-9)
        station = (along - BEYOND_M) * (scale if 0 < along - BEYOND_M < strip.middle.length else 1)
        hits.append(_Hit(strip, station, cosine > 0))
    same_way = [hit for hit in hits if _pieces(hit.strip.edge) & crossing.pieces]
    return same_way or hits


def _arm_at_junction(
    plain: PlainNetwork, crossing: MappedCrossing, hits: Sequence[_Hit]
) -> _Arm | None:
    """Return the nearest arm of a junction that a crossing lies on; ``None`` if mid-block."""
    arms: dict[tuple[str, bool], list[tuple[float, _Hit]]] = defaultdict(list)
    for hit in hits:
        edge = hit.strip.edge
        arms[edge.end, hit.ahead].append((hit.to_end, hit))
        arms[edge.start, not hit.ahead].append((hit.station, hit))
    candidates = []
    for (node, is_before), rows in arms.items():
        beyond, reach = _reach(plain, crossing, node)
        near_hits = [(distance, hit) for distance, hit in rows if -beyond <= distance <= reach]
        names = {hit.strip.edge.id for _, hit in near_hits}
        if near_hits and not any(c.node == node and names & set(c.edges) for c in plain.crossings):
            nearest = min((abs(distance), -distance) for distance, _ in near_hits)
            hit_by = tuple(hit for _, hit in near_hits)
            other_hits = _other_edges(plain, node, hit_by) if reach == ON_NODE_M else ()
            arm = _Arm(node, hit_by, other_hits, is_before)
            candidates.append((tuple(np.round(nearest, 1)), not is_before, node, arm))
    return min(candidates, key=lambda row: row[:3])[3] if candidates else None


def _other_edges(plain: PlainNetwork, node: str, arm: Sequence[_Hit]) -> tuple[_Hit, ...]:
    """Return the edges through a node of a single street that are not part of an arm."""
    arm_edges = {hit.strip.edge.id for hit in arm}
    return tuple(
        _Hit(
            Strip(edge, arm[0].strip.outward), float(edge.line.length) if arrives else 0.0, arrives
        )
        for edges, arrives in ((plain.arriving[node], True), (plain.leaving[node], False))
        for edge in edges
        if edge.id not in arm_edges and is_driven(edge)
    )


def _reach(plain: PlainNetwork, crossing: MappedCrossing, name: str) -> tuple[float, float]:
    """Return the distances beyond and before edge ends of a node's crossings, metres."""
    node = plain.nodes[name]
    before_m = NEAR_AT_SIGNALS_M if crossing.signalised and _is_signalised(plain, name) else NEAR_M
    if len(node.outline):
        return BEYOND_M, before_m
    neighbours = {edge.end for edge in plain.leaving[name]} | {
        e.start for e in plain.arriving[name]
    }
    if len(neighbours) < 3:
        return ON_NODE_M, ON_NODE_M
    return ON_NODE_M, before_m


def _at_new_node(
    plain: PlainNetwork, crossing: MappedCrossing, hits: Sequence[_Hit]
) -> tuple[PlainNetwork, _Arm]:
    """Split the crossed edges at a new node; return the network and the arm before that node."""
    name = f"crossing{crossing.name}"
    kind = {"type": "traffic_light", "tl": name} if crossing.signalised else {"type": "priority"}
    stations = {hit.strip.edge.id: hit.station for hit in hits}
    node = PlainNode(name, crossing.xy, kind)
    plain, before = split_edges(plain, node, stations)
    arm, beyond = [], []
    for hit in hits:
        name = hit.strip.edge.id
        first, last = plain.edges[before[name]], plain.edges[name]
        to_node = _Hit(Strip(first, hit.strip.outward), float(first.line.length), hit.ahead)
        from_node = _Hit(Strip(last, hit.strip.outward), 0.0, hit.ahead)
        arm.append(to_node if hit.ahead else from_node)
        beyond.append(from_node if hit.ahead else to_node)
    return plain, _Arm(node.id, tuple(arm), tuple(beyond), is_before=True)


def _kerb_to_kerb(crossing: MappedCrossing, strips: Sequence[Strip]) -> NDArray[np.float64] | None:
    """Return the line (2, 2) of the crossing from kerb to kerb; ``None`` if there is none."""
    reach = crossing.across * WIDEST_M / 2
    walked = shapely.LineString([crossing.xy - reach, crossing.xy + reach])
    driven = []
    for strip in strips:
        low, high = strip.driven()
        line = _drawn_out(strip.middle, BEYOND_M)
        station_m = float(line.project(shapely.Point(crossing.xy)))
        x, y, heading = _pose(line, station_m)
        left = np.array([-np.sin(heading), np.cos(heading)])
        corners = [
            [x, y] + along * np.array([left[1], -left[0]]) + lateral_m * left
            for along, lateral_m in (
                (-15.0, low - SEAM_M / 2),
                (15.0, low - SEAM_M / 2),
                (15.0, high + SEAM_M / 2),
                (-15.0, high + SEAM_M / 2),
            )
        ]
        driven.append(shapely.Polygon(corners))
    parts = shapely.get_parts(shapely.intersection(walked, area_union(driven)))
    lines = [part for part in parts if part.geom_type == "LineString" and part.length > 1.0]
    if not lines:
        return None
    nearest = min(lines, key=lambda part: float(part.distance(shapely.Point(crossing.xy))))
    ends = np.asarray(shapely.get_coordinates(nearest)[[0, -1]])
    # The seam that joins both directions does not extend the line beyond the kerbs.
    (a, b), (c, d) = crossing.ahead, crossing.across
    beyond = SEAM_M / 2 / max(abs(float(a * d - b * c)), float(np.cos(SKEW))) * crossing.across
    if (ends[1] - ends[0]) @ crossing.across < 0:
        beyond = -beyond
    return np.asarray(ends + np.array([beyond, -beyond]))


def _cut_back(plain: PlainNetwork, crossing: MappedCrossing, arm: _Arm) -> PlainNetwork:
    """Return the network with edges cut to end before the crossing and begin behind it."""
    edges, node = dict(plain.edges), plain.nodes[arm.node]
    cut_edges: dict[str, _CutOff] = {}
    # Edges extend into a junction's own outline, where netconvert cuts them.
    into = INTO_M if len(node.outline) else 0.0
    skew = abs(float(crossing.across @ crossing.ahead))
    outline = [shapely.Polygon(node.outline)] if len(node.outline) else []
    for hit in (*arm.hits, *arm.beyond):
        edge = hit.strip.edge
        half = crossing.width / 2 + skew * edge.width / 2
        length = float(edge.line.length)
        least = min(SHORTEST_M, length)
        if edge.end == arm.node:
            first, last = 0.0, hit.station - half - BEFORE_M + into
            cut_span = (last := max(last, least), length)
        else:
            first, last = hit.station + half + BEHIND_M - into, length
            cut_span = (0.0, first := min(first, length - least))
        if cut_span[1] - cut_span[0] < CUT_M:
            continue
        cut_edges[edge.id] = _CutOff(hit.strip, cut_span)
        edges[edge.id] = replace(edge, shape=cut(edge.line, first, last))
        outline.append(shapely.buffer(hit.strip.area(*cut_span), 0.05, join_style="mitre"))
    if not cut_edges:
        return plain
    if not len(node.outline):
        return replace(plain, edges=edges)
    area = max(shapely.get_parts(area_union(outline)), key=lambda part: float(part.area))
    ring = shapely.get_coordinates(area.exterior)[:-1]
    nodes = {**plain.nodes, node.id: replace(node, outline=ring)}
    links = tuple(
        _extended_link(link, cut_edges) if {link.start, link.end} & cut_edges.keys() else link
        for link in plain.links
    )
    return replace(plain, nodes=nodes, edges=edges, links=links)


@dataclass(frozen=True)
class _CutOff:
    """The part cut off an edge: between two stations of its strip, metres."""

    strip: Strip
    given: tuple[float, float]

    def lane(self, number: int) -> NDArray[np.float64]:
        """Return the centre line of a lane in that part (N, 2), from mouth to mouth."""
        first, last = self.given
        # A path ends where its edge reaches into the junction's outline.
        into = -INTO_M if first > 0.0 else INTO_M
        stations = np.linspace(first, last, max(2, round(last - first))) + into
        poses = np.array([self.strip.at(float(station)) for station in stations])
        return aside(poses, self.strip.across(number))


def _extended_link(link: PlainLink, cut_edges: Mapping[str, _CutOff]) -> PlainLink:
    """Return a link without its shape, or with its drawn shape extended by the cut-off parts."""
    attributes = {key: value for key, value in link.attributes.items() if key != "shape"}
    if not link.followed:
        return replace(link, attributes=attributes)
    parts = [points_of_text(link.attributes["shape"])]
    if link.start in cut_edges:
        parts.insert(0, cut_edges[link.start].lane(link.start_lane)[:-1])
    if link.end in cut_edges:
        parts.append(cut_edges[link.end].lane(link.end_lane)[1:])
    return replace(link, attributes=attributes | {"shape": shape_text(np.vstack(parts))})


def _without_walkers(plain: PlainNetwork, arm: _Arm) -> PlainNetwork:
    """Return the network without pedestrians on the carriageways of a crossing.

    Without a sidewalk, pedestrians use the outermost lane, and netconvert makes no crossing over
    it.
    """
    edges = dict(plain.edges)
    for hit in (*arm.hits, *arm.beyond):
        edge = edges[hit.strip.edge.id]
        edges[edge.id] = replace(edge, lanes=tuple(map(_not_walked, edge.lanes)))
    return replace(plain, edges=edges)


def _not_walked(lane: PlainLane) -> PlainLane:
    if not lane.admits("pedestrian") or not lane.admits("passenger"):
        return lane
    attributes = dict(lane.attributes)
    allowed = [word for word in attributes.get("allow", "all").split() if word != "pedestrian"]
    if allowed == ["all"]:
        attributes.pop("allow", None)
        attributes["disallow"] = " ".join([*attributes.get("disallow", "").split(), "pedestrian"])
    else:
        attributes["allow"] = " ".join(allowed)
    return replace(lane, attributes=attributes)


def _drawn_out(line: shapely.LineString, reach: float) -> shapely.LineString:
    """Return a line extended straight at both ends by ``reach`` metres."""
    points = shapely.get_coordinates(line)
    ends = []
    for end, inner in ((points[0], points[1]), (points[-1], points[-2])):
        step = (end - inner) / max(float(np.linalg.norm(end - inner)), 1e-9)
        ends.append(end + reach * step)
    return shapely.LineString([ends[0], *points, ends[1]])


def _pose(line: shapely.LineString, at: float) -> tuple[float, float, float]:
    point = line.interpolate(at)
    a, b = (line.interpolate(float(np.clip(at + d, 0.0, line.length))) for d in (-0.5, 0.5))
    return point.x, point.y, float(np.arctan2(b.y - a.y, b.x - a.x))


def _pieces(edge: PlainEdge) -> set[int]:
    """Return the ids of the pieces that an edge's lanes were made from."""
    words = [word for lane in edge.lanes for word in lane.origin.split()]
    return {abs(int(word)) for word in words if word.lstrip("-").isdigit()}
