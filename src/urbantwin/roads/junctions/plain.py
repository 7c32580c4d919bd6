"""SUMO's plain XML as typed records: the nodes, edges and links of netconvert's input and output.

Lanes are counted from the kerb inwards. Unnamed XML attributes are kept in ``attributes`` (SUMO's
documentation, "Networks/PlainXML").
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import shapely
from lxml import etree
from numpy.typing import NDArray

__all__ = [
    "CYCLE_TRACK_TYPE",
    "INTO_M",
    "PlainCrossing",
    "PlainEdge",
    "PlainLane",
    "PlainLink",
    "PlainNetwork",
    "PlainNode",
    "points_of_text",
    "read_plain",
    "shape_text",
    "write_plain",
]

#: Extension of edges into a junction's own outline, where netconvert cuts them, metres.
INTO_M = 1.5
#: SUMO's type of edges for bicycles only.
CYCLE_TRACK_TYPE = "highway.cycleway"
#: SUMO's default lane width, metres.
DEFAULT_WIDTH_M = 3.2


@dataclass(frozen=True, eq=False)
class PlainNode:
    """A node; ``outline`` (M, 2) is empty if netconvert determines the junction's shape."""

    id: str
    xy: NDArray[np.float64]
    attributes: Mapping[str, str]
    outline: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))


@dataclass(frozen=True, eq=False)
class PlainLane:
    """One lane of an edge: its permissions (``allow`` or ``disallow``) and its width."""

    attributes: Mapping[str, str]
    origin: str

    @property
    def width(self) -> float:
        """Width, metres."""
        return float(self.attributes.get("width", DEFAULT_WIDTH_M))

    @property
    def is_sidewalk(self) -> bool:
        """Whether it is open to pedestrians and closed to cars."""
        return self.admits("pedestrian") and not self.admits("passenger")

    def admits(self, vehicle_class: str) -> bool:
        """Return whether a vehicle class of SUMO may use the lane."""
        if "allow" in self.attributes:
            words = self.attributes["allow"].split()
            return vehicle_class in words or "all" in words
        words = self.attributes.get("disallow", "").split()
        return vehicle_class not in words and "all" not in words


@dataclass(frozen=True, eq=False)
class PlainEdge:
    """One direction of a street between two nodes; lanes lie along ``shape`` (N, 2)."""

    id: str
    start: str
    end: str
    shape: NDArray[np.float64]
    lanes: tuple[PlainLane, ...]
    attributes: Mapping[str, str]
    params: Mapping[str, str]

    @cached_property
    def line(self) -> shapely.LineString:
        """The shape as a line."""
        return shapely.LineString(self.shape)

    @property
    def width(self) -> float:
        """Width of all lanes, metres."""
        return sum(lane.width for lane in self.lanes)

    @property
    def centred(self) -> bool:
        """Whether lanes are centred on the shape; else they lie to one side of it."""
        return self.attributes.get("spreadType") == "center"

    @property
    def is_street(self) -> bool:
        """Whether it is open to cars or buses, or is a separate cycle track."""
        return self.admits("passenger") or self.admits("bus") or self.is_cycle_track

    @property
    def is_cycle_track(self) -> bool:
        """Whether it is a separate cycle track, not the cycle lane of a street."""
        return self.attributes.get("type") == CYCLE_TRACK_TYPE

    def admits(self, vehicle_class: str) -> bool:
        """Return whether a vehicle class of SUMO may use any lane."""
        return any(lane.admits(vehicle_class) for lane in self.lanes)


@dataclass(frozen=True)
class PlainLink:
    """A link from a lane's end to a lane's start; ``end`` is empty where an edge leads nowhere.

    ``followed`` means that its shape is kept: it was drawn, or it avoids an obstacle.
    """

    start: str
    end: str
    start_lane: int
    end_lane: int
    attributes: Mapping[str, str] = field(default_factory=dict)
    followed: bool = False


@dataclass(frozen=True, eq=False)
class PlainCrossing:
    """A crossing of edges at a node; ``line`` (N, 2) is empty if netconvert draws it.

    ``width`` in metres; ``marking`` as in ``MappedCrossing``.
    """

    node: str
    edges: tuple[str, ...]
    width: float
    priority: bool
    line: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    marking: str = ""


@dataclass(frozen=True)
class PlainNetwork:
    """A network before netconvert makes junctions of nodes.

    Attributes:
        nodes, edges: by id.
        links: lane-to-lane links.
        crossings: pedestrian crossings.
        location: netconvert's ``location`` element with the projection.
        not_crossed: nodes without guessed crossings.
    """

    nodes: Mapping[str, PlainNode]
    edges: Mapping[str, PlainEdge]
    links: tuple[PlainLink, ...]
    crossings: tuple[PlainCrossing, ...] = ()
    location: Mapping[str, str] = field(default_factory=dict)
    not_crossed: tuple[str, ...] = ()

    @cached_property
    def arriving(self) -> Mapping[str, list[PlainEdge]]:
        """Edges that end at each node."""
        edges: dict[str, list[PlainEdge]] = defaultdict(list)
        for edge in self.edges.values():
            edges[edge.end].append(edge)
        return edges

    @cached_property
    def leaving(self) -> Mapping[str, list[PlainEdge]]:
        """Edges that start at each node."""
        edges: dict[str, list[PlainEdge]] = defaultdict(list)
        for edge in self.edges.values():
            edges[edge.start].append(edge)
        return edges

    @cached_property
    def links_from(self) -> Mapping[str, list[PlainLink]]:
        """Links from the lanes of each edge."""
        links: dict[str, list[PlainLink]] = defaultdict(list)
        for link in self.links:
            links[link.start].append(link)
        return links


def read_plain(prefix: Path, net: Path) -> PlainNetwork:
    """Read the output of netconvert's ``--plain-output-prefix``.

    Args:
        prefix: of the plain XML.
        net: the network of the same run: the plain XML omits lane widths that are the same for all
            lanes of an edge.
    """
    widths = {
        lane.get("id"): lane.get("width")
        for _, lane in etree.iterparse(net, tag="lane")
        if lane.get("width")
    }
    nodes = {}
    for item in _root(prefix, "nod").findall("node"):
        attributes = _other_attributes(item, "id", "x", "y", "shape")
        xy = np.array([float(item.get("x")), float(item.get("y"))])
        nodes[item.get("id")] = PlainNode(
            item.get("id"), xy, attributes, points_of_text(item.get("shape"))
        )
    edges = {}
    for item in _root(prefix, "edg").findall("edge"):
        attributes = _other_attributes(item, "id", "from", "to", "shape", "numLanes")
        start, end = item.get("from"), item.get("to")
        shape = points_of_text(item.get("shape"))
        if len(shape) < 2:
            shape = np.array([nodes[start].xy, nodes[end].xy])
        edges[item.get("id")] = PlainEdge(
            item.get("id"),
            start,
            end,
            shape,
            _lanes(item, attributes, widths),
            attributes,
            _params(item),
        )
    links = tuple(
        PlainLink(
            item.get("from"),
            item.get("to", ""),
            int(item.get("fromLane", -1)),
            int(item.get("toLane", -1)),
            _other_attributes(item, "from", "to", "fromLane", "toLane"),
        )
        for item in _root(prefix, "con").findall("connection")
    )
    location = _root(prefix, "nod").find("location")
    return PlainNetwork(nodes, edges, links, location=dict(location.attrib))


def write_plain(prefix: Path, plain: PlainNetwork) -> list[str]:
    """Write a network as plain XML and return netconvert's options to read it."""
    nodes, edges = etree.Element("nodes"), etree.Element("edges")
    if plain.location:
        etree.SubElement(nodes, "location", dict(plain.location))
    for node in plain.nodes.values():
        x, y = (f"{v:.3f}" for v in node.xy)
        item = etree.SubElement(nodes, "node", {"id": node.id, "x": x, "y": y, **node.attributes})
        if len(node.outline):
            item.set("shape", shape_text(node.outline))
    for edge in plain.edges.values():
        own_attributes = {
            "id": edge.id,
            "from": edge.start,
            "to": edge.end,
            "shape": shape_text(edge.shape),
        }
        number = {"numLanes": str(len(edge.lanes))}
        item = etree.SubElement(edges, "edge", {**own_attributes, **edge.attributes, **number})
        for index, lane in enumerate(edge.lanes):
            row = etree.SubElement(item, "lane", {"index": str(index), **lane.attributes})
            if lane.origin:
                etree.SubElement(row, "param", key="origId", value=lane.origin)
        for key, value in edge.params.items():
            etree.SubElement(item, "param", key=key, value=value)
    written = {"node": nodes, "edge": edges, "connection": _connections(plain)}
    options = []
    for kind, root in written.items():
        path = prefix.with_name(f"{prefix.name}.{kind[:3]}.xml")
        path.write_bytes(etree.tostring(root))
        options += [f"--{kind}-files", str(path)]
    return options


def _connections(plain: PlainNetwork) -> etree._Element:
    root = etree.Element("connections")
    leads_on = {link.start for link in plain.links}
    for link in plain.links:
        row = {"from": link.start}
        if link.end:
            row |= {"to": link.end}
            row |= {"fromLane": str(link.start_lane), "toLane": str(link.end_lane)}
        etree.SubElement(root, "connection", {**row, **link.attributes})
    for name in [name for name in plain.edges if name not in leads_on]:
        # Without this, netconvert guesses the links of the edge.
        etree.SubElement(root, "connection", {"from": name})
    for crossing in plain.crossings:
        item = etree.SubElement(
            root,
            "crossing",
            {
                "node": crossing.node,
                "edges": " ".join(crossing.edges),
                "width": f"{crossing.width:.2f}",
                "priority": "1" if crossing.priority else "0",
            },
        )
        if len(crossing.line):
            item.set("shape", shape_text(crossing.line))
        if crossing.marking:
            etree.SubElement(item, "param", key="marking", value=crossing.marking)
    for node in plain.not_crossed:
        etree.SubElement(root, "crossing", {"node": node, "discard": "true"})
    return root


def _root(prefix: Path, kind: str) -> etree._Element:
    return etree.parse(prefix.with_name(f"{prefix.name}.{kind}.xml")).getroot()


def _other_attributes(item: etree._Element, *named: str) -> dict[str, str]:
    return {str(key): str(value) for key, value in item.items() if key not in named}


def _params(item: etree._Element) -> dict[str, str]:
    return {row.get("key"): row.get("value") for row in item.findall("param")}


def _lanes(
    item: etree._Element, edge: dict[str, str], widths: Mapping[str, str]
) -> tuple[PlainLane, ...]:
    """Return an edge's lanes; attributes common to all lanes move from the edge to each lane."""
    every = ("allow", "disallow", "width")
    common: dict[str, str] = {key: edge.pop(key) for key in every if key in edge}
    lanes = []
    for row in item.findall("lane"):
        attributes = _other_attributes(row, "index")
        if {"allow", "disallow"} & attributes.keys():
            inherited = {key: value for key, value in common.items() if key == "width"}
        else:
            inherited = common
        if width := widths.get(f"{item.get('id')}_{row.get('index')}"):
            attributes["width"] = width
        lanes.append(PlainLane({**inherited, **attributes}, _params(row).get("origId", "")))
    return tuple(lanes)


def points_of_text(text: str | None) -> NDArray[np.float64]:
    """Return the points (N, 2) of a SUMO shape; heights are dropped."""
    rows = [[float(v) for v in point.split(",")[:2]] for point in (text or "").split()]
    return np.array(rows).reshape(-1, 2)


def shape_text(points: NDArray[np.float64]) -> str:
    """Return points (N, 2) as a SUMO shape, metres with three decimals."""
    return " ".join(f"{x:.3f},{y:.3f}" for x, y in points)
