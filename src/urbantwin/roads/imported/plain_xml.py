"""SUMO's plain XML of a lane model: nodes, edges and connections exactly as in the map."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from lxml import etree
from numpy.typing import NDArray

from urbantwin.geometry import area_union
from urbantwin.roads.imported.crosswalks import Crosswalk
from urbantwin.roads.imported.edges import Edge, Nodes
from urbantwin.roads.imported.lane_links import VEHICLE_CLASSES, LaneLink, Place, allowed, speed
from urbantwin.roads.junctions.plain import shape_text
from urbantwin.roads.model import LaneModel, ModelRoad, SectionLane

__all__ = ["OUTER", "PlainNetwork", "junction_outline", "origin_of", "write_plain"]

#: ``ways`` of outer roads, which the map does not have, until they are named.
OUTER = (0,)
#: What stands for a road whose id is 0, as many maps' first road is.
NUMBER_OF_ZERO = 2**31 - 1
#: Right of way by class of the street; netconvert compares these numbers.
PRIORITY = {
    "motorway": 14, "motorway_link": 13, "trunk": 12, "trunk_link": 11, "primary": 10,
    "primary_link": 9, "secondary": 8, "secondary_link": 7, "tertiary": 6, "tertiary_link": 5,
    "unclassified": 4, "residential": 3, "living_street": 2, "service": 1,
}  # fmt: skip
#: Length of a mere border between two lanes, the least that SUMO knows, metres.
BORDER_M = 0.1
#: Lanes that are linked and no farther apart than this meet, metres.
MEET_M = 2.0
#: Acceleration to the side that drivers accept in turns, m/s^2 (netconvert's own default).
TURN_MS2 = 5.5
#: Fewer streets only follow each other.
JUNCTION_ARMS = 3
#: Largest distance of a chord from a lane's middle, metres, and step where it is curved.
CHORD_M, STEP_M = 0.01, 0.5


@dataclass(frozen=True)
class PlainNetwork:
    """The content of the plain XML.

    Attributes:
        model: the lane model.
        edges: its edges.
        nodes: where they meet.
        links: which lane leads to which.
        lights: node -> id of the traffic light there.
        crosswalks: where people cross, by the map.
        outlines: junction -> its outline (M, 2); empty where nothing is known.
    """

    model: LaneModel
    edges: tuple[Edge, ...]
    nodes: Nodes
    links: list[LaneLink]
    lights: Mapping[str, str]
    crosswalks: list[Crosswalk]
    outlines: Mapping[int, NDArray[np.float64]]


def write_plain(folder: Path, plain: PlainNetwork) -> list[str]:
    """Write ``map.nod.xml``, ``map.edg.xml`` and ``map.con.xml``; return netconvert's options."""
    for kind, root in (
        ("nod", _nodes(plain)),
        ("edg", _edges(plain)),
        ("con", _connections(plain)),
    ):
        etree.ElementTree(root).write(str(folder / f"map.{kind}.xml"), encoding="utf-8")
    return [
        *("--node-files", str(folder / "map.nod.xml")),
        *("--edge-files", str(folder / "map.edg.xml")),
        *("--connection-files", str(folder / "map.con.xml")),
    ]


def lane_line(road: ModelRoad, number: int, lane: SectionLane) -> NDArray[np.float64]:
    """Return the middle of a lane in one section (N, 2), in the order of the reference line."""
    start, end = road.sections[number].s, road.section_ends[number]
    s = np.linspace(start, end, max(2, int((end - start) / STEP_M) + 2))
    xy = road.place(s, road.middle(road.sections[number], lane, s))[:, :2]
    line = shapely.simplify(shapely.LineString(xy), CHORD_M)
    return np.asarray(shapely.get_coordinates(line))


def edge_lane_line(edge: Edge, index: int) -> NDArray[np.float64]:
    """Return the middle of an edge's lane (N, 2), in the order of travel."""
    parts = [
        lane_line(edge.road, number, edge.road.sections[number].by_id[lane])
        for number, lane in zip(edge.sections, edge.lanes[index], strict=True)
    ]
    line = _chained(parts)
    return line if edge.forward else line[::-1]


def path_line(model: LaneModel, path: tuple[Place, ...]) -> NDArray[np.float64]:
    """Return the middle of a way through a junction (N, 2), in the order of travel."""
    parts = []
    for identity, number, lane in path:
        road = model.road_by_id[identity]
        found = road.sections[number].by_id[lane]
        line = lane_line(road, number, found)
        parts.append(line if found.forward else line[::-1])
    return _chained(parts)


def _chained(parts: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    points = np.vstack(parts)
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.asarray(points[np.concatenate([[True], step > 1e-3])])


def _nodes(plain: PlainNetwork) -> etree._Element:
    """A node lies amid the ends of its lanes; a junction's outline is what its ways cover."""
    ends: dict[str, list[NDArray[np.float64]]] = defaultdict(list)
    meeting: dict[str, list[tuple[Edge, int]]] = defaultdict(list)
    for edge in plain.edges:
        start, end = plain.nodes.of_edge(edge)
        meeting[start].append((edge, 0))
        meeting[end].append((edge, -1))
        for index in range(len(edge.lanes)):
            line = edge_lane_line(edge, index)
            ends[start].append(line[0])
            ends[end].append(line[-1])
    root = etree.Element("nodes")
    for node, points in sorted(ends.items()):
        x, y = np.mean(points, axis=0)
        item = etree.SubElement(root, "node", id=node, x=f"{x:.3f}", y=f"{y:.3f}")
        junction = plain.nodes.junctions.get(node)
        outline = plain.outlines[junction] if junction is not None else np.zeros((0, 2))
        if len(outline) > 2:
            item.set("shape", shape_text(outline))
        elif len({(edge.road.id, edge.sections) for edge, _ in meeting[node]}) > 1:
            item.set("shape", shape_text(_across(meeting[node])))
        item.set("type", "traffic_light" if node in plain.lights else "priority")
        if node in plain.lights:
            item.set("tl", plain.lights[node])
    return root


def junction_outline(model: LaneModel, identity: int) -> NDArray[np.float64]:
    """Return a junction's outline (M, 2): as the map has it, else what its roads cover."""
    junction = model.junction_by_id[identity]
    if len(junction.outline) > 2:
        return junction.outline
    areas = []
    for connection in junction.connections:
        road = model.road_by_id.get(connection.connecting)
        if road is not None and road.junction >= 0:
            areas += [_covered(road, number) for number in range(len(road.sections))]
    whole = area_union(areas)
    # A sliver between two turns does not belong to the outside.
    whole = whole.buffer(0.5, join_style="mitre").buffer(-0.5, join_style="mitre")
    if whole.geom_type != "Polygon":
        whole = shapely.convex_hull(whole)
    if whole.is_empty or whole.geom_type != "Polygon":
        return np.zeros((0, 2))
    return np.asarray(shapely.get_coordinates(shapely.simplify(whole.exterior, 0.02))[:-1])


def _covered(road: ModelRoad, number: int) -> shapely.Geometry:
    section = road.sections[number]
    driven = [x for x in section.lanes if x.kind in ("driving", "bus", "bicycle", "shoulder")]
    if not driven:
        return shapely.Polygon()
    start, end = section.s, road.section_ends[number]
    s = np.linspace(start, end, max(2, int(end - start) + 2))
    borders = np.array(
        [road.border(section, x, s, outer=outer) for x in driven for outer in (False, True)]
    )
    left, right = (road.place(s, t)[:, :2] for t in (borders.max(axis=0), borders.min(axis=0)))
    return shapely.make_valid(shapely.Polygon(np.vstack([left, right[::-1]])))


def _edges(plain: PlainNetwork) -> etree._Element:
    root = etree.Element("edges")
    for edge in plain.edges:
        start, end = plain.nodes.of_edge(edge)
        lanes = [edge.lane(index) for index in range(len(edge.lanes))]
        lines = [edge_lane_line(edge, index) for index in range(len(lanes))]
        item = etree.SubElement(
            root,
            "edge",
            {
                "id": edge.id,
                "from": start,
                "to": end,
                "numLanes": str(len(lanes)),
                "priority": str(_priority(edge, lanes)),
                "spreadType": "center",
                "shape": shape_text(_middle(lines)),
            },
        )
        if edge.road.name:
            item.set("name", edge.road.name)
        if edge.road.kind:
            item.set("type", f"highway.{edge.road.kind}")
        for index, (lane, line) in enumerate(zip(lanes, lines, strict=True)):
            row = etree.SubElement(
                item,
                "lane",
                index=str(index),
                speed=f"{speed(lane):.2f}",
                width=f"{_width(edge, index):.2f}",
                allow=" ".join(VEHICLE_CLASSES[name] for name in allowed(lane)),
                shape=shape_text(line),
            )
            etree.SubElement(row, "param", key="origId", value=str(origin_of(edge.road)))
    return root


def origin_of(road: ModelRoad) -> int:
    """Return what a road is known by in ``Road.ways``: 0 is kept for outer roads."""
    return 0 if road.ways == OUTER else road.id or NUMBER_OF_ZERO


def _priority(edge: Edge, lanes: list[SectionLane]) -> int:
    if edge.road.kind in PRIORITY:
        return PRIORITY[edge.road.kind]
    driven = [lane for lane in lanes if lane.kind in ("driving", "bus")]
    # Without classes, more lanes and more speed go before fewer and less.
    return len(driven) + round(max((speed(lane) for lane in driven), default=0.0) / 5.0)


def _width(edge: Edge, index: int) -> float:
    """Return a lane's usual width, metres: the median along it."""
    widths = []
    for number, identity in zip(edge.sections, edge.lanes[index], strict=True):
        length = edge.road.section_ends[number] - edge.road.sections[number].s
        lane = edge.road.sections[number].by_id[identity]
        widths += [lane.width.at(np.linspace(0.0, length, max(2, int(length) + 1)))]
    return max(float(np.median(np.concatenate(widths))), 0.5)


def _middle(lines: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the line amid lanes side by side."""
    share = np.linspace(0.0, 1.0, max(len(line) for line in lines) * 2)
    first, last = (
        shapely.get_coordinates(
            shapely.line_interpolate_point(shapely.LineString(line), share, normalized=True)
        )
        for line in (lines[0], lines[-1])
    )
    middle = shapely.simplify(shapely.LineString((first + last) / 2), CHORD_M)
    return np.asarray(shapely.get_coordinates(middle))


def _connections(plain: PlainNetwork) -> etree._Element:
    root = etree.Element("connections")
    lead_on = set()
    for link in plain.links:
        (start, i), (end, j) = link.start, link.end
        lead_on.add(start.id)
        item = etree.SubElement(
            root,
            "connection",
            {"from": start.id, "to": end.id, "fromLane": str(i), "toLane": str(j)},
        )
        if not link.path and (border := _border_line(start, i, end, j)) is not None:
            item.set("shape", shape_text(border))
        if link.path:
            line = path_line(plain.model, link.path)
            item.set("shape", shape_text(line))
            road, number, lane = link.path[0]
            limit = plain.model.road_by_id[road].sections[number].by_id[lane].speed_limit
            if 0.0 < limit < speed(start.lane(i, -1)):
                # Without a speed, netconvert slows turns down; with one, it takes it as it is.
                item.set("speed", f"{min(limit, _turn_speed(line)):.2f}")
    for edge in plain.edges:
        if edge.id not in lead_on:
            # Without this, netconvert guesses connections.
            etree.SubElement(root, "connection", {"from": edge.id})
    # netconvert wants them counter-clockwise about the node where traffic keeps to the right.
    way = 1 if plain.model.driving_side == "right" else -1
    for crosswalk in plain.crosswalks:
        item = etree.SubElement(
            root,
            "crossing",
            {
                "node": crosswalk.node,
                "edges": " ".join(crosswalk.edges),
                "width": f"{crosswalk.width:.2f}",
                "priority": "true",
                "shape": shape_text(crosswalk.line[::way]),
            },
        )
        if crosswalk.marking:
            etree.SubElement(item, "param", key="marking", value=crosswalk.marking)
    crossed = {crosswalk.node for crosswalk in plain.crosswalks}
    for node in _joints(plain):
        if node not in crossed:
            # Without this, netconvert guesses crossings where one road follows another.
            etree.SubElement(root, "crossing", {"node": node, "discard": "true"})
    return root


def _joints(plain: PlainNetwork) -> list[str]:
    """Return nodes without a traffic light where fewer than three streets meet: no junctions."""
    arms: dict[str, set[tuple[int, str]]] = defaultdict(set)
    found = {node for edge in plain.edges for node in plain.nodes.of_edge(edge)}
    roads = {edge.road.id for edge in plain.edges}
    for (road, end), node in plain.nodes.of_end.items():
        if road in roads:
            arms[node].add((road, end))
    return sorted(n for n in found if len(arms[n]) < JUNCTION_ARMS and n not in plain.lights)


def _border_line(start: Edge, i: int, end: Edge, j: int) -> NDArray[np.float64] | None:
    """Return the way over a mere border between two lanes (2, 2): as short as SUMO's lanes may be.

    Left to itself, netconvert makes a junction of some metres there, over the ends of the lanes.
    ``None`` where the lanes do not meet.
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
    """Return the outline of a border across some edges (M, 2), at their first or last points."""
    corners = []
    for edge, at in edges:
        for index in range(len(edge.lanes)):
            line = edge_lane_line(edge, index)
            leg = line[1] - line[0] if at == 0 else line[-1] - line[-2]
            leg = leg / max(float(np.linalg.norm(leg)), 1e-9)
            normal = np.array([-leg[1], leg[0]]) * _width(edge, index) / 2
            corners += [line[at] + u + v for u in (normal, -normal)
                        for v in (leg * BORDER_M / 2, -leg * BORDER_M / 2)]  # fmt: skip
    hull = shapely.convex_hull(shapely.MultiPoint(np.array(corners)))
    return np.asarray(shapely.get_coordinates(hull)[:-1])


def _turn_speed(line: NDArray[np.float64]) -> float:
    """Return the speed at which a way through a junction is driven comfortably, m/s."""
    leg = np.diff(line, axis=0)
    heading = np.unwrap(np.arctan2(leg[:, 1], leg[:, 0]))
    length = float(np.linalg.norm(leg, axis=1).sum())
    turn = max(abs(float(heading[-1] - heading[0])), 1e-6)
    return float(np.sqrt(TURN_MS2 * length / turn))
