"""Junctions of several nodes replaced by one node with its own outline, before netconvert.

netconvert's own joining misses nodes where parallel roads enter a junction, cuts roads back until
they no longer overlap, and drops stop lines, crossings and arrows between nodes. Here the movements
are determined first, from the map's edges. Arms then end at mapped stop lines and crossings, and
the area swept by traffic between them is the junction.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import area_difference, area_union
from urbantwin.roads.cross_section import SignedTurns
from urbantwin.roads.junctions.cluster import (
    ROAD_M,
    Chain,
    chains_of,
    clusters_of,
    flat_nodes,
    is_marked,
    is_signalised,
    meeting_nodes,
)
from urbantwin.roads.junctions.lane_links import Arrows, lane_links
from urbantwin.roads.junctions.mapped_crossings import Marks
from urbantwin.roads.junctions.mouth import SHORTEST_M, Arm, marks_of_junctions, mouths
from urbantwin.roads.junctions.moved_apart import moved_apart
from urbantwin.roads.junctions.passage import Passage, passages_of
from urbantwin.roads.junctions.plain import (
    INTO_M,
    PlainEdge,
    PlainLink,
    PlainNetwork,
    PlainNode,
    shape_text,
)
from urbantwin.roads.junctions.ring import CIRCULATING, Ring, ring_of
from urbantwin.roads.junctions.strip import Strip, cut
from urbantwin.roads.junctions.ways_through import Way, WaysThrough, ways_through

__all__ = ["consolidated"]

#: Maximum distance of a signal on a slip lane from the junction that controls it, metres.
SLIP_M = 45.0
#: Minimum length of a road between two junctions without marks, and of an arm inside a junction,
#: metres.
ROAD_LEFT_M, LEAST_M = 12.0, 2.0
#: Approximate length that netconvert cuts off a road at other junctions, metres.
OTHERS_M = 6.0
#: Minimum distance of an arm's end from the centre line of a ring, for entry curves, metres.
ENTRY_M = 6.0
#: Shorter remainders of edges between others belong to the junction, metres; shares below the
#: second are zero.
STUMP_M, NOTHING = 5.0, 1e-6
#: Spacing of the points of a path that is passed to netconvert, metres.
STEP_M = 1.0
#: Length of an arm beyond its mouth that is excluded from the outline, metres.
BEYOND_M = 30.0
#: Radius of curves at corners, metres (AASHTO Green Book, 9.6: 3 to 8 m in towns).
CORNER_M = 5.0
#: Half-width of bridges between disconnected parts of a junction, metres.
BRIDGE_M = 1.5


@dataclass(frozen=True, eq=False)
class _Cluster:
    id: str
    nodes: frozenset[str]
    inner: frozenset[str]
    arms: tuple[Arm, ...]


def consolidated(  # noqa: PLR0913 - all that a map says of its junctions
    plain: PlainNetwork,
    marks: Marks,
    arrows: SignedTurns,
    *,
    apart: Collection[str],
    within: Collection[str] = (),
    followed: Mapping[str, NDArray[np.float64]] | None = None,
    rings: Sequence[Ring] = (),
    forbidden: Sequence[tuple[tuple[str, ...], bool]],
    buildings: Sequence[shapely.Polygon],
    standing: Sequence[shapely.Geometry] = (),
    driving_side: str,
) -> PlainNetwork:
    """Return a network in which each junction is one node.

    Args:
        plain: the map's network, as read by netconvert.
        marks: the map's stop lines and crossings.
        arrows: signed turns of lanes.
        apart: edges that lie in no junction.
        within: edges mapped as part of a junction.
        followed: edge within a junction -> its drawn path (N, 2), site frame.
        rings: small roundabouts, each one junction.
        forbidden: turn restrictions over several edges, as in `passages_of`.
        buildings: footprints of buildings on the ground, site frame.
        standing: outlines of posts and islands, which paths avoid, site frame.
        driving_side: ``right`` or ``left``.
    """
    outward = -1 if driving_side == "right" else 1
    within = set(within).union(*(ring.edges for ring in rings))
    strips = {edge.id: Strip(edge, outward) for edge in plain.edges.values()}
    meeting = meeting_nodes(plain, within)
    chains = chains_of(plain, meeting)
    groups = clusters_of(plain, chains, meeting, marks, apart, within)
    single = [
        (node,)
        for (node,) in flat_nodes(chains, meeting, groups)
        if not any(edge.id in apart for edge in [*plain.arriving[node], *plain.leaving[node]])
    ]
    clusters = [_cluster(group, chains, marks, apart) for group in [*groups, *single]]
    signalised = {node for node in meeting if is_signalised(plain, node)}
    cuts = _cuts(clusters, strips, marks, signalised, meeting, rings)
    spans = _spans(plain, chains, cuts)
    # Edges that are entirely cut off an arm belong to the junction at that end.
    clusters = [_grown(cluster, spans) for cluster in clusters]
    home = {node: cluster.id for cluster in clusters for node in cluster.nodes}
    inner = {name for cluster in clusters for name in cluster.inner}
    edges = _edges(plain, spans, home, inner)
    edges = moved_apart(
        edges,
        _drawn(plain, edges, clusters),
        still=apart,
        buildings=buildings,
        driving_side=driving_side,
    )
    new_strips = {edge.id: Strip(edge, outward) for edge in edges.values()}
    nodes = {name: node for name, node in plain.nodes.items() if name not in home}
    links = [
        link
        for link in plain.links
        if link.start in edges
        and (not link.end or link.end in edges)
        and plain.edges[link.start].end not in home
    ]
    signed = arrows.on(edges)
    reached = {node for edge in edges.values() for node in (edge.start, edge.end)}
    if not reached:
        return plain  # Streets are closer to each other than their widths.
    for cluster in clusters:
        if cluster.id not in reached:
            continue
        nodes[cluster.id], junction_links = _junction(
            plain,
            cluster,
            edges,
            new_strips,
            signed,
            forbidden,
            partial(
                ways_through,
                followed=followed or {},
                rings=rings,
                standing=standing,
                driving_side=driving_side,
            ),
            driving_side,
        )
        links += junction_links
    network = PlainNetwork(nodes, edges, tuple(links), location=plain.location)
    combined = {cluster.id for cluster in clusters if cluster.id not in plain.nodes}
    return _with_slip_signals(network, combined, _stopping(marks, spans))


def _drawn(
    plain: PlainNetwork, edges: Mapping[str, PlainEdge], clusters: Sequence[_Cluster]
) -> PlainNetwork:
    """Return edges as a network whose junctions are nodes with a dummy outline."""
    some = np.zeros((3, 2))
    nodes = dict(plain.nodes)
    for cluster in clusters:
        nodes[cluster.id] = PlainNode(cluster.id, np.zeros(2), {}, some)
    return PlainNetwork(nodes, edges, (), location=plain.location)


def _cluster(
    group: Sequence[str], chains: Sequence[Chain], marks: Marks, apart: Collection[str]
) -> _Cluster:
    within = set(group)
    inner, nodes = set[str](), set(group)
    into: dict[tuple[str, ...], Chain] = {}
    outgoing: dict[tuple[str, ...], Chain] = {}
    for chain in chains:
        both = chain.start in within and chain.end in within
        if both and chain.length <= ROAD_M and not is_marked(chain, marks, apart):
            inner |= {edge.id for edge in chain.edges}
            nodes |= chain.within
            continue
        if chain.end in within:
            into[chain.nodes[::-1]] = chain
        if chain.start in within:
            outgoing[chain.nodes] = chain
    arms = tuple(Arm(into.get(key), outgoing.get(key)) for key in dict.fromkeys([*into, *outgoing]))
    if len(group) == 1:
        return _Cluster(group[0], frozenset(nodes), frozenset(inner), arms)
    more_text = f"#{len(group) - 3}more" if len(group) > 4 else ""
    named_nodes = group[:3] if more_text else group
    return _Cluster(
        "cluster_" + "_".join(named_nodes) + more_text, frozenset(nodes), frozenset(inner), arms
    )


def _cuts(
    clusters: Sequence[_Cluster],
    strips: Mapping[str, Strip],
    marks: Marks,
    signalised: Collection[str],
    meeting: Collection[str],
    rings: Sequence[Ring],
) -> dict[tuple[str, ...], list[float]]:
    """Return edges of a chain -> lengths cut off its start and its end, metres."""
    cuts: dict[tuple[str, ...], list[float]] = defaultdict(lambda: [0.0, 0.0])
    spare: dict[tuple[str, ...], list[float]] = defaultdict(lambda: [0.0, 0.0])
    home = {node for cluster in clusters for node in cluster.nodes}
    outside_nodes = set(meeting) - home
    marks_of_cluster = marks_of_junctions(
        [(cluster.arms, bool(cluster.nodes & set(signalised))) for cluster in clusters], marks
    )
    for cluster, cluster_marks in zip(clusters, marks_of_cluster, strict=True):
        arm_mouths = mouths(cluster.arms, strips, cluster_marks)
        least = ENTRY_M if ring_of(cluster.inner, rings) else 0.0
        for arm, (mouth, marked) in zip(cluster.arms, arm_mouths, strict=True):
            reach = max(mouth, min(least, arm.length - SHORTEST_M))
            for chain, index in ((arm.outward, 0), (arm.inward, 1)):
                if chain is not None:
                    names = tuple(edge.id for edge in chain.edges)
                    cuts[names][index] = reach
                    spare[names][index] = 0.0 if marked else max(reach - LEAST_M, 0.0)
    for names, cut_m in cuts.items():
        length = sum(strips[name].edge.line.length for name in names)
        ends = {strips[names[0]].edge.start, strips[names[-1]].edge.end}
        length = max(length - OTHERS_M * len(ends & outside_nodes), 0.5 * length)
        # If little remains of a road between two junctions, cuts without marks are reduced first.
        excess_m = sum(cut_m) - max(length - ROAD_LEFT_M, 0.5 * length)
        if excess_m > 0.0:
            yielding = min(1.0, excess_m / max(sum(spare[names]), 1e-9))
            cut_m[:] = [g - yielding * s for g, s in zip(cut_m, spare[names], strict=True)]
        if (excess_m := sum(cut_m) - max(length - SHORTEST_M, 0.5 * length)) > 0.0:
            cut_m[:] = [g * (1.0 - excess_m / sum(cut_m)) for g in cut_m]
    return cuts


def _spans(
    plain: PlainNetwork,
    chains: Sequence[Chain],
    cuts: Mapping[tuple[str, ...], Sequence[float]],
) -> dict[str, tuple[float, float]]:
    """Return edge -> first and last share of its length that remain.

    Pedestrian edges beside one-way streets are cut like these.
    """
    spans: dict[str, tuple[float, float]] = {}
    for chain in chains:
        names = tuple(edge.id for edge in chain.edges)
        first, last = cuts.get(names, (0.0, 0.0))
        last = chain.length - last
        ends = np.cumsum([edge.line.length for edge in chain.edges])
        starts = ends - [edge.line.length for edge in chain.edges]
        remaining_m = np.maximum(np.minimum(ends, last) - np.maximum(starts, first), 0.0)
        longest = int(remaining_m.argmax())
        for k, edge in enumerate(chain.edges):
            length = float(edge.line.length)
            a, b = (
                float(np.clip((station_m - starts[k]) / length, 0.0, 1.0))
                for station_m in (first, last)
            )
            if k != longest and remaining_m[k] < STUMP_M and b - a < 1.0:
                # A short remainder before the next edge is not kept as a road.
                a = b = 1.0 if k < longest else 0.0
            spans[edge.id] = (a, b)
    for name, (a, b) in tuple(spans.items()):
        # Both directions of a street are cut off together, even if their lengths differ slightly.
        other = spans.get(_opposite_edge(name))
        rest_m = (b - a) * float(plain.edges[name].line.length)
        if other is not None and other[1] - other[0] <= NOTHING and rest_m < 2 * STUMP_M:
            spans[name] = (1.0 - other[1], 1.0 - other[0])
    for name in plain.edges:
        twin = _opposite_edge(name)
        if name not in spans and twin in spans:
            a, b = spans[twin]
            spans[name] = (1.0 - b, 1.0 - a)
    return spans


def _grown(cluster: _Cluster, spans: Mapping[str, tuple[float, float]]) -> _Cluster:
    """Return a cluster with the edges that its arms lost entirely."""
    nodes, inner = set(cluster.nodes), set(cluster.inner)
    for arm in cluster.arms:
        for chain, outwards in ((arm.outward, True), (arm.inward, False)):
            for edge in (chain.edges if outwards else chain.edges[::-1]) if chain else ():
                if not _is_cut_off(edge.id, spans):
                    break
                inner.add(edge.id)
                nodes.add(edge.end if outwards else edge.start)
    return replace(cluster, nodes=frozenset(nodes), inner=frozenset(inner))


def _edges(
    plain: PlainNetwork,
    spans: Mapping[str, tuple[float, float]],
    home: Mapping[str, str],
    inner: set[str],
) -> dict[str, PlainEdge]:
    remaining = {}
    for name, edge in plain.edges.items():
        start, end = home.get(edge.start), home.get(edge.end)
        if {name, _opposite_edge(name)} & inner and (name in inner or not edge.is_street):
            continue
        if _is_cut_off(name, spans) or (start and start == end and not edge.is_street):
            continue
        if start is None and end is None:
            remaining[name] = edge
            continue
        length = float(edge.line.length)
        a, b = (share * length for share in spans.get(name, (0.0, 1.0)))
        points = cut(edge.line, max(a - INTO_M, 0.0), min(b + INTO_M, length))
        if start is not None and a < INTO_M:
            points = _extended(points, INTO_M - a)
        if end is not None and length - b < INTO_M:
            points = _extended(points[::-1], INTO_M - (length - b))[::-1]
        remaining[name] = replace(
            edge, start=start or edge.start, end=end or edge.end, shape=points
        )
    return remaining


def _opposite_edge(name: str) -> str:
    """Return the id of the edge of the opposite direction."""
    return name[1:] if name.startswith("-") else f"-{name}"


def _is_cut_off(name: str, spans: Mapping[str, tuple[float, float]]) -> bool:
    """Return whether an edge, or the street that it runs beside, is cut off entirely."""
    a, b = spans.get(name, (0.0, 1.0))
    return b - a <= NOTHING


def _extended(points: NDArray[np.float64], length: float) -> NDArray[np.float64]:
    """Return a line extended straight at its start by ``length`` metres."""
    leg = points[0] - points[1]
    ahead = points[0] + leg / max(float(np.linalg.norm(leg)), 1e-9) * length
    return np.vstack([ahead, points])


def _junction(
    plain: PlainNetwork,
    cluster: _Cluster,
    edges: Mapping[str, PlainEdge],
    strips: Mapping[str, Strip],
    arrows: Arrows,
    forbidden: Sequence[tuple[tuple[str, ...], bool]],
    in_plan: Callable[[Mapping[Way, Passage], Mapping[str, Strip]], WaysThrough],
    driving_side: str,
) -> tuple[PlainNode, list[PlainLink]]:
    inner = {name: plain.edges[name] for name in sorted(cluster.inner)}
    passages = passages_of(plain, cluster.nodes, inner, strips, forbidden)
    links: list[PlainLink] = []
    swept: list[shapely.Geometry] = []
    by_entry: dict[str, list[Passage]] = defaultdict(list)
    for passage in passages:
        by_entry[passage.entry.id].append(passage)
    movements: dict[Way, Passage] = {}
    for entry_passages in by_entry.values():
        movements |= lane_links(plain, entry_passages, arrows, driving_side=driving_side)
    through = in_plan(movements, strips)
    for start, k, end, j in through.drivable:
        curve = through.curves[start, k, end, j]
        stations = np.linspace(0.0, curve.length, max(3, int(curve.length / STEP_M) + 1))
        line = curve.at(stations)[:, :2]
        is_led = (start, k, end, j) in through.led
        links.append(PlainLink(start, end, k, j, {"shape": shape_text(line)}, is_led))
        width = max(strips[start].edge.lanes[k].width, strips[end].edge.lanes[j].width)
        swept.append(shapely.LineString(line).buffer(width / 2, cap_style="flat"))
    across, outside, ends = [], [], []
    for edge in edges.values():
        for at_end in (False, True):
            if (edge.end if at_end else edge.start) != cluster.id:
                continue
            strip = strips[edge.id]
            length = float(strip.middle.length)
            mouth = length - INTO_M if at_end else INTO_M
            across.append(strip.corners(mouth, driven=True))
            ends.append(strip.area(*((mouth, length) if at_end else (0.0, mouth))))
            first, last = (length - BEYOND_M, mouth) if at_end else (mouth, BEYOND_M)
            outside.append(strip.area(max(first, 0.0), min(last, length)))
    outline = outline_of(swept, across, outside, ends)
    signals = any(is_signalised(plain, node) for node in cluster.nodes)
    attributes = {"type": "traffic_light", "tl": cluster.id} if signals else {"type": "priority"}
    if not signals and any(
        plain.nodes[node].attributes.get("type") == CIRCULATING for node in cluster.nodes
    ):
        attributes = {"type": CIRCULATING}
    middle = shapely.Polygon(outline).centroid
    return PlainNode(cluster.id, np.array([middle.x, middle.y]), attributes, outline), links


def _with_slip_signals(
    plain: PlainNetwork, wide: Collection[str], stopping: Collection[str]
) -> PlainNetwork:
    """Assign signals on a wide junction's slip lanes to its controller.

    Where a slip lane merges, only edges with a stop line are signalised, not traffic from the
    junction.
    """
    nodes, free = dict(plain.nodes), set[str]()
    for edge in plain.edges.values():
        for node, other_node in ((edge.start, edge.end), (edge.end, edge.start)):
            if (
                node in wide
                and other_node not in wide
                and is_signalised(plain, node)
                and is_signalised(plain, other_node)
                and edge.line.length <= SLIP_M
            ):
                attributes = {
                    **nodes[other_node].attributes,
                    "tl": plain.nodes[node].attributes["tl"],
                }
                nodes[other_node] = replace(nodes[other_node], attributes=attributes)
                if edge.end == other_node and edge.id not in stopping:
                    free.add(edge.id)
    links = tuple(
        replace(link, attributes={**link.attributes, "uncontrolled": "1"})
        if link.start in free and link.end
        else link
        for link in plain.links
    )
    return replace(plain, nodes=nodes, links=links)


def _stopping(marks: Marks, spans: Mapping[str, tuple[float, float]]) -> set[str]:
    """Return the edges with a stop line at their end or on the part that remains."""
    edge_ids = set()
    for name, shares in marks.stop_lines.items():
        # A stop line beyond the end of the road is painted at its end.
        first, _ = spans.get(name, (0.0, 1.0))
        if any(first < share for share in shares):
            edge_ids.add(name)
    return edge_ids


def outline_of(
    swept: Sequence[shapely.Geometry],
    mouths: Sequence[NDArray[np.float64]],
    outside: Sequence[shapely.Geometry],
    ends: Sequence[shapely.Geometry] = (),
) -> NDArray[np.float64]:
    """Return the outline (M, 2) of a junction.

    Args:
        swept: areas swept by its traffic.
        mouths: ends (2, 2) of the line across each arm at its mouth.
        outside: areas of the arms beyond their mouths, which are excluded.
        ends: areas of the arms inside their mouths, always included.
    """
    lines = [shapely.LineString(mouth).buffer(0.3, cap_style="flat") for mouth in mouths]
    area = _connected(area_union([*swept, *lines]))
    closed = area.buffer(CORNER_M, quad_segs=8).buffer(-CORNER_M, quad_segs=8)
    closed = area_union([closed, area])
    # If streets are closer than their widths, other arms may cover the whole area.
    outer = area_difference(closed, area_union(list(outside)))
    closed = area if outer.is_empty else outer
    closed = max(shapely.get_parts(closed), key=lambda part: float(part.area))
    closed = _connected(area_union([closed, *ends]))
    closed = max(shapely.get_parts(closed), key=lambda part: float(part.area))
    ring = shapely.simplify(closed.exterior, 0.1)
    return np.asarray(shapely.get_coordinates(shapely.orient_polygons(shapely.Polygon(ring)))[:-1])


def _connected(area: shapely.Geometry) -> shapely.Geometry:
    """Return an area with its parts joined at their nearest points; arms may be unreachable."""
    while len(parts := sorted(shapely.get_parts(area), key=lambda part: -part.area)) > 1:
        other_parts = shapely.union_all(parts[1:])
        bridge = shapely.shortest_line(parts[0], other_parts).buffer(BRIDGE_M)
        area = area_union([area, bridge])
    return area
