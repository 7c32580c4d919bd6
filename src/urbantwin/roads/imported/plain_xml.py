"""Input of netconvert from a lane model, with lanes exactly as in the map."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import area_union
from urbantwin.roads.imported.crosswalks import Crosswalk
from urbantwin.roads.imported.edges import Edge, Nodes
from urbantwin.roads.imported.lane_links import VEHICLE_CLASSES, LaneLink, Place, allowed, speed
from urbantwin.roads.junctions.plain import (
    PlainCrossing,
    PlainEdge,
    PlainLane,
    PlainLink,
    PlainNetwork,
    PlainNode,
    shape_text,
)
from urbantwin.roads.model import LaneModel, ModelRoad, SectionLane

__all__ = ["OUTER", "MapTopology", "junction_outline", "origin_of", "plain_network"]

#: ``ways`` of outer roads, which are not in the map, until lanes are named.
OUTER = (0,)
#: Substitute for the road id 0, which many maps use for their first road.
NUMBER_OF_ZERO = 2**31 - 1
#: Right of way by class of street, as netconvert's priority.
PRIORITY = {
    "motorway": 14, "motorway_link": 13, "trunk": 12, "trunk_link": 11, "primary": 10,
    "primary_link": 9, "secondary": 8, "secondary_link": 7, "tertiary": 6, "tertiary_link": 5,
    "unclassified": 4, "residential": 3, "living_street": 2, "service": 1,
}  # fmt: skip
#: Length of a transition between two adjacent lanes, the minimum in SUMO, metres.
BORDER_M = 0.1
#: Maximum distance between linked lanes that are adjacent, metres.
MEET_M = 2.0
#: Lateral acceleration in turns, m/s^2 (netconvert's own default).
TURN_MS2 = 5.5
#: Minimum number of streets at a junction.
JUNCTION_ARMS = 3
#: Maximum distance of a chord from a lane's centre line, and sampling step in curves, metres.
CHORD_M, STEP_M = 0.01, 0.5


@dataclass(frozen=True)
class MapTopology:
    """The edges of a lane model and their nodes.

    Attributes:
        model: the lane model.
        edges: its edges.
        nodes: the nodes of the edges.
        links: lane-to-lane links.
        lights: node -> id of its traffic light.
        crosswalks: crosswalks of the map.
        outlines: junction -> its outline (M, 2), empty if unknown.
    """

    model: LaneModel
    edges: tuple[Edge, ...]
    nodes: Nodes
    links: list[LaneLink]
    lights: Mapping[str, str]
    crosswalks: list[Crosswalk]
    outlines: Mapping[int, NDArray[np.float64]]


def plain_network(topology: MapTopology) -> PlainNetwork:
    """Return netconvert's input for a map, with lanes exactly as in the map."""
    # netconvert requires crossings counter-clockwise around the node in right-hand traffic.
    order = 1 if topology.model.driving_side == "right" else -1
    crossings = tuple(
        PlainCrossing(
            item.node,
            item.edges,
            item.width,
            priority=True,
            line=item.line[::order],
            marking=item.marking,
        )
        for item in topology.crosswalks
    )
    crossed = {item.node for item in topology.crosswalks}
    return PlainNetwork(
        nodes={node.id: node for node in _nodes(topology)},
        edges={edge.id: _edge(edge, *topology.nodes.of_edge(edge)) for edge in topology.edges},
        links=tuple(_link(topology.model, link) for link in topology.links),
        crossings=crossings,
        not_crossed=tuple(node for node in _joints(topology) if node not in crossed),
    )


def lane_line(road: ModelRoad, number: int, lane: SectionLane) -> NDArray[np.float64]:
    """Return a lane's centre line in one section (N, 2), in the order of the reference line."""
    start, end = road.sections[number].s, road.section_ends[number]
    s = np.linspace(start, end, max(2, int((end - start) / STEP_M) + 2))
    xy = road.place(s, road.middle(road.sections[number], lane, s))[:, :2]
    line = shapely.simplify(shapely.LineString(xy), CHORD_M)
    return np.asarray(shapely.get_coordinates(line))


def edge_lane_line(edge: Edge, index: int) -> NDArray[np.float64]:
    """Return the centre line of an edge's lane (N, 2), in the order of travel."""
    parts = [
        lane_line(edge.road, number, edge.road.sections[number].by_id[lane])
        for number, lane in zip(edge.sections, edge.lanes[index], strict=True)
    ]
    line = _chained(parts)
    return line if edge.forward else line[::-1]


def path_line(model: LaneModel, path: tuple[Place, ...]) -> NDArray[np.float64]:
    """Return the centre line of a path through a junction (N, 2), in the order of travel."""
    parts = []
    for identity, number, lane in path:
        road = model.road_by_id[identity]
        section_lane = road.sections[number].by_id[lane]
        line = lane_line(road, number, section_lane)
        parts.append(line if section_lane.forward else line[::-1])
    return _chained(parts)


def _chained(parts: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    points = np.vstack(parts)
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.asarray(points[np.concatenate([[True], step > 1e-3])])


def _nodes(topology: MapTopology) -> Iterator[PlainNode]:
    """Yield nodes at the centre of their lanes' ends, with outlines."""
    ends: dict[str, list[NDArray[np.float64]]] = defaultdict(list)
    meeting: dict[str, list[tuple[Edge, int]]] = defaultdict(list)
    for edge in topology.edges:
        start, end = topology.nodes.of_edge(edge)
        meeting[start].append((edge, 0))
        meeting[end].append((edge, -1))
        for index in range(len(edge.lanes)):
            line = edge_lane_line(edge, index)
            ends[start].append(line[0])
            ends[end].append(line[-1])
    for node, points in sorted(ends.items()):
        junction = topology.nodes.junctions.get(node)
        outline = topology.outlines[junction] if junction is not None else np.zeros((0, 2))
        if len(outline) <= 2:
            streets = {(edge.road.id, edge.sections) for edge, _ in meeting[node]}
            outline = _across(meeting[node]) if len(streets) > 1 else np.zeros((0, 2))
        attributes = {"type": "priority"}
        if node in topology.lights:
            attributes = {"type": "traffic_light", "tl": topology.lights[node]}
        yield PlainNode(node, np.mean(points, axis=0), attributes, outline)


def junction_outline(model: LaneModel, identity: int) -> NDArray[np.float64]:
    """Return a junction's outline (M, 2): the map's, else the area of its connecting roads."""
    junction = model.junction_by_id[identity]
    if len(junction.outline) > 2:
        return np.asarray(junction.outline)
    areas = []
    for connection in junction.connections:
        road = model.road_by_id.get(connection.connecting)
        if road is not None and road.junction >= 0:
            areas += [_covered(road, number) for number in range(len(road.sections))]
    area = area_union(areas)
    # A sliver between two turns is part of the junction.
    area = area.buffer(0.5, join_style="mitre").buffer(-0.5, join_style="mitre")
    if area.geom_type != "Polygon":
        area = shapely.convex_hull(area)
    if area.is_empty or area.geom_type != "Polygon":
        return np.zeros((0, 2))
    return np.asarray(shapely.get_coordinates(shapely.simplify(area.exterior, 0.02))[:-1])


def _covered(road: ModelRoad, number: int) -> shapely.Geometry:
    section = road.sections[number]
    driven = [
        lane for lane in section.lanes if lane.kind in ("driving", "bus", "bicycle", "shoulder")
    ]
    if not driven:
        return shapely.Polygon()
    start, end = section.s, road.section_ends[number]
    s = np.linspace(start, end, max(2, int(end - start) + 2))
    borders = np.array(
        [road.border(section, lane, s, outer=outer) for lane in driven for outer in (False, True)]
    )
    left, right = (road.place(s, t)[:, :2] for t in (borders.max(axis=0), borders.min(axis=0)))
    return shapely.make_valid(shapely.Polygon(np.vstack([left, right[::-1]])))


def _edge(edge: Edge, start: str, end: str) -> PlainEdge:
    lanes = [edge.lane(index) for index in range(len(edge.lanes))]
    lines = [edge_lane_line(edge, index) for index in range(len(lanes))]
    attributes = {"priority": str(_priority(edge, lanes)), "spreadType": "center"}
    if edge.road.name:
        attributes["name"] = edge.road.name
    if edge.road.kind:
        attributes["type"] = f"highway.{edge.road.kind}"
    origin = str(origin_of(edge.road))
    rows = tuple(
        PlainLane(
            {
                "speed": f"{speed(lane):.2f}",
                "width": f"{_width(edge, index):.2f}",
                "allow": " ".join(VEHICLE_CLASSES[name] for name in allowed(lane)),
                "shape": shape_text(line),
            },
            origin,
        )
        for index, (lane, line) in enumerate(zip(lanes, lines, strict=True))
    )
    return PlainEdge(edge.id, start, end, _middle(lines), rows, attributes, {})


def origin_of(road: ModelRoad) -> int:
    """Return the number that identifies a road in ``Road.ways``: 0 is reserved for outer roads."""
    return 0 if road.ways == OUTER else road.id or NUMBER_OF_ZERO


def _priority(edge: Edge, lanes: list[SectionLane]) -> int:
    if edge.road.kind in PRIORITY:
        return PRIORITY[edge.road.kind]
    driven = [lane for lane in lanes if lane.kind in ("driving", "bus")]
    # Without classes, more lanes and higher speeds have priority.
    return len(driven) + round(max((speed(lane) for lane in driven), default=0.0) / 5.0)


def _width(edge: Edge, index: int) -> float:
    """Return the median width of a lane along an edge, metres."""
    widths = []
    for number, identity in zip(edge.sections, edge.lanes[index], strict=True):
        length = edge.road.section_ends[number] - edge.road.sections[number].s
        lane = edge.road.sections[number].by_id[identity]
        widths += [lane.width.at(np.linspace(0.0, length, max(2, int(length) + 1)))]
    return max(float(np.median(np.concatenate(widths))), 0.5)


def _middle(lines: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the line midway between the outer lanes of several."""
    share = np.linspace(0.0, 1.0, max(len(line) for line in lines) * 2)
    first, last = (
        shapely.get_coordinates(
            shapely.line_interpolate_point(shapely.LineString(line), share, normalized=True)
        )
        for line in (lines[0], lines[-1])
    )
    middle = shapely.simplify(shapely.LineString((first + last) / 2), CHORD_M)
    return np.asarray(shapely.get_coordinates(middle))


def _link(model: LaneModel, link: LaneLink) -> PlainLink:
    (start, i), (end, j) = link.start, link.end
    attributes = {}
    if link.path:
        line = path_line(model, link.path)
        attributes["shape"] = shape_text(line)
        road, number, lane = link.path[0]
        limit = model.road_by_id[road].sections[number].by_id[lane].speed_limit
        if 0.0 < limit < speed(start.lane(i, -1)):
            # Without a speed, netconvert reduces the speed of turns; a given speed is used
            # unchanged.
            attributes["speed"] = f"{min(limit, _turn_speed(line)):.2f}"
    elif (border := _border_line(start, i, end, j)) is not None:
        attributes["shape"] = shape_text(border)
    return PlainLink(start.id, end.id, i, j, attributes)


def _joints(topology: MapTopology) -> list[str]:
    """Return nodes that are no junctions: without traffic light, with fewer than three streets."""
    arms: dict[str, set[tuple[int, str]]] = defaultdict(set)
    nodes = {node for edge in topology.edges for node in topology.nodes.of_edge(edge)}
    roads = {edge.road.id for edge in topology.edges}
    for (road, end), node in topology.nodes.of_end.items():
        if road in roads:
            arms[node].add((road, end))
    return sorted(n for n in nodes if len(arms[n]) < JUNCTION_ARMS and n not in topology.lights)


def _border_line(start: Edge, i: int, end: Edge, j: int) -> NDArray[np.float64] | None:
    """Return the path between two adjacent lanes (2, 2), as short as SUMO permits.

    By default netconvert makes a junction of some metres there, over the ends of the lanes.
    ``None`` if the lanes are not adjacent.
    """
    before, after = edge_lane_line(start, i), edge_lane_line(end, j)
    a, b = before[-1], after[0]
    gap = float(np.linalg.norm(b - a))
    if gap >= BORDER_M:
        return np.array([a, b]) if gap < MEET_M else None
    leg = before[-1] - before[-2]
    half = leg / max(float(np.linalg.norm(leg)), 1e-9) * BORDER_M / 2
    return np.array([a - half, a + half])


def _across(edges: list[tuple[Edge, int]]) -> NDArray[np.float64]:
    """Return the outline (M, 2) of a transition across edges, at their first or last points."""
    corners = []
    for edge, end in edges:
        for index in range(len(edge.lanes)):
            line = edge_lane_line(edge, index)
            leg = line[1] - line[0] if end == 0 else line[-1] - line[-2]
            leg = leg / max(float(np.linalg.norm(leg)), 1e-9)
            normal = np.array([-leg[1], leg[0]]) * _width(edge, index) / 2
            corners += [line[end] + u + v for u in (normal, -normal)
                        for v in (leg * BORDER_M / 2, -leg * BORDER_M / 2)]  # fmt: skip
    hull = shapely.convex_hull(shapely.MultiPoint(np.array(corners)))
    return np.asarray(shapely.get_coordinates(hull)[:-1])


def _turn_speed(line: NDArray[np.float64]) -> float:
    """Return the speed of comfortable driving on a path through a junction, m/s."""
    leg = np.diff(line, axis=0)
    heading = np.unwrap(np.arctan2(leg[:, 1], leg[:, 0]))
    length = float(np.linalg.norm(leg, axis=1).sum())
    turn = max(abs(float(heading[-1] - heading[0])), 1e-6)
    return float(np.sqrt(TURN_MS2 * length / turn))
