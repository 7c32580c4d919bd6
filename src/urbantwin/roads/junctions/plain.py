"""SUMO's plain XML as typed rows: the nodes, edges and links that netconvert reads and writes.

Lanes are counted from the kerb inwards. What a row does not name is kept as it is in
``attributes`` (SUMO's documentation, "Networks/PlainXML").
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

#: How far edges reach into a junction's own outline, where netconvert cuts them, metres.
INTO_M = 1.5
#: SUMO's type of edges that are ways for bicycles alone.
CYCLE_TRACK_TYPE = "highway.cycleway"
#: What SUMO takes for a lane's width where none is told, metres.
DEFAULT_WIDTH_M = 3.2


@dataclass(frozen=True, eq=False)
class PlainNode:
    """Where edges meet; ``outline`` (M, 2) is empty where netconvert finds the junction's shape."""

    id: str
    xy: NDArray[np.float64]
    attributes: Mapping[str, str]
    outline: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))


@dataclass(frozen=True, eq=False)
class PlainLane:
    """One lane of an edge: who may use it (``allow`` or ``disallow``), and how wide it is."""

    attributes: Mapping[str, str]
    origin: str

    @property
    def width(self) -> float:
        """Metres."""
        return float(self.attributes.get("width", DEFAULT_WIDTH_M))

    @property
    def is_sidewalk(self) -> bool:
        """Whether it is for people on foot and not for cars."""
        return self.admits("pedestrian") and not self.admits("passenger")

    def admits(self, vehicle_class: str) -> bool:
        """Whether a class of SUMO may use the lane."""
        if "allow" in self.attributes:
            words = self.attributes["allow"].split()
            return vehicle_class in words or "all" in words
        words = self.attributes.get("disallow", "").split()
        return vehicle_class not in words and "all" not in words


@dataclass(frozen=True, eq=False)
class PlainEdge:
    """One direction of a street between two nodes; ``shape`` (N, 2) is what lanes lie along."""

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
        """Metres over all lanes."""
        return sum(lane.width for lane in self.lanes)

    @property
    def centred(self) -> bool:
        """Whether lanes lie about the shape; else they lie to one side of it."""
        return self.attributes.get("spreadType") == "center"

    @property
    def is_street(self) -> bool:
        """Whether cars or buses use it, or it is a cycle track of its own."""
        return self.admits("passenger") or self.admits("bus") or self.is_cycle_track

    @property
    def is_cycle_track(self) -> bool:
        """Whether it is a way for bicycles of its own, not the cycle lane of a street."""
        return self.attributes.get("type") == CYCLE_TRACK_TYPE

    def admits(self, vehicle_class: str) -> bool:
        """Whether a class of SUMO may use any lane."""
        return any(lane.admits(vehicle_class) for lane in self.lanes)


@dataclass(frozen=True)
class PlainLink:
    """A way from a lane's end to a lane's start; ``end`` is empty where an edge leads nowhere.

    ``followed`` tells that its shape is kept: somebody drew it, or it leads round what stands.
    """

    start: str
    end: str
    start_lane: int
    end_lane: int
    attributes: Mapping[str, str] = field(default_factory=dict)
    followed: bool = False


@dataclass(frozen=True, eq=False)
class PlainCrossing:
    """Where people cross edges at a node, metres wide; ``line`` (N, 2) empty: netconvert's own.

    ``marking`` tells what is painted there, as ``MappedCrossing`` does.
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
        nodes, edges: by their ids.
        links: which lane leads to which.
        crossings: where people cross.
        location: what netconvert says of the projection.
        not_crossed: nodes where netconvert must not guess crossings.
    """

    nodes: Mapping[str, PlainNode]
    edges: Mapping[str, PlainEdge]
    links: tuple[PlainLink, ...]
    crossings: tuple[PlainCrossing, ...] = ()
    location: Mapping[str, str] = field(default_factory=dict)
    not_crossed: tuple[str, ...] = ()

    @cached_property
    def arriving(self) -> Mapping[str, list[PlainEdge]]:
        """Node -> the edges that end there."""
        found: dict[str, list[PlainEdge]] = defaultdict(list)
        for edge in self.edges.values():
            found[edge.end].append(edge)
        return found

    @cached_property
    def leaving(self) -> Mapping[str, list[PlainEdge]]:
        """Node -> the edges that start there."""
        found: dict[str, list[PlainEdge]] = defaultdict(list)
        for edge in self.edges.values():
            found[edge.start].append(edge)
        return found

    @cached_property
    def links_from(self) -> Mapping[str, list[PlainLink]]:
        """Edge -> the links from its lanes."""
        found: dict[str, list[PlainLink]] = defaultdict(list)
        for link in self.links:
            found[link.start].append(link)
        return found


def read_plain(prefix: Path, net: Path) -> PlainNetwork:
    """Read what netconvert wrote with ``--plain-output-prefix``.

    Args:
        prefix: of the plain XML.
        net: the network that it wrote in the same run: in the plain XML it leaves out the lanes'
            width where all lanes of an edge are alike.
    """
    widths = {
        lane.get("id"): lane.get("width")
        for _, lane in etree.iterparse(net, tag="lane")
        if lane.get("width")
    }
    nodes = {}
    for item in _root(prefix, "nod").findall("node"):
        rest = _rest(item, "id", "x", "y", "shape")
        xy = np.array([float(item.get("x")), float(item.get("y"))])
        nodes[item.get("id")] = PlainNode(
            item.get("id"), xy, rest, points_of_text(item.get("shape"))
        )
    edges = {}
    for item in _root(prefix, "edg").findall("edge"):
        rest = _rest(item, "id", "from", "to", "shape", "numLanes")
        start, end = item.get("from"), item.get("to")
        shape = points_of_text(item.get("shape"))
        if len(shape) < 2:
            shape = np.array([nodes[start].xy, nodes[end].xy])
        edges[item.get("id")] = PlainEdge(
            item.get("id"), start, end, shape, _lanes(item, rest, widths), rest, _params(item)
        )
    links = tuple(
        PlainLink(
            item.get("from"),
            item.get("to", ""),
            int(item.get("fromLane", -1)),
            int(item.get("toLane", -1)),
            _rest(item, "from", "to", "fromLane", "toLane"),
        )
        for item in _root(prefix, "con").findall("connection")
    )
    location = _root(prefix, "nod").find("location")
    return PlainNetwork(nodes, edges, links, location=dict(location.attrib))


def write_plain(prefix: Path, plain: PlainNetwork) -> list[str]:
    """Write a network as plain XML; return the options that make netconvert read it."""
    nodes, edges = etree.Element("nodes"), etree.Element("edges")
    if plain.location:
        etree.SubElement(nodes, "location", dict(plain.location))
    for node in plain.nodes.values():
        x, y = (f"{v:.3f}" for v in node.xy)
        item = etree.SubElement(nodes, "node", {"id": node.id, "x": x, "y": y, **node.attributes})
        if len(node.outline):
            item.set("shape", shape_text(node.outline))
    for edge in plain.edges.values():
        named = {"id": edge.id, "from": edge.start, "to": edge.end, "shape": shape_text(edge.shape)}
        number = {"numLanes": str(len(edge.lanes))}
        item = etree.SubElement(edges, "edge", {**named, **edge.attributes, **number})
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
        # Without this, netconvert guesses where the edge leads.
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


def _rest(item: etree._Element, *named: str) -> dict[str, str]:
    return {str(key): str(value) for key, value in item.items() if key not in named}


def _params(item: etree._Element) -> dict[str, str]:
    return {row.get("key"): row.get("value") for row in item.findall("param")}


def _lanes(
    item: etree._Element, edge: dict[str, str], widths: Mapping[str, str]
) -> tuple[PlainLane, ...]:
    """Return an edge's lanes; what is said of all lanes at once is moved from the edge to each."""
    every = ("allow", "disallow", "width")
    common: dict[str, str] = {key: edge.pop(key) for key in every if key in edge}
    lanes = []
    for row in item.findall("lane"):
        own = _rest(row, "index")
        if {"allow", "disallow"} & own.keys():
            told = {key: value for key, value in common.items() if key == "width"}
        else:
            told = common
        if width := widths.get(f"{item.get('id')}_{row.get('index')}"):
            own["width"] = width
        lanes.append(PlainLane({**told, **own}, _params(row).get("origId", "")))
    return tuple(lanes)


def points_of_text(text: str | None) -> NDArray[np.float64]:
    """Return the points (N, 2) of a shape as SUMO writes it; heights are left out."""
    rows = [[float(v) for v in point.split(",")[:2]] for point in (text or "").split()]
    return np.array(rows).reshape(-1, 2)


def shape_text(points: NDArray[np.float64]) -> str:
    """Return points (N, 2) as SUMO writes a shape, metres to the millimetre."""
    return " ".join(f"{x:.3f},{y:.3f}" for x, y in points)
