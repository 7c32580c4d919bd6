"""SUMO's network of a lane model, made by netconvert, with its lane names."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from urbantwin.roads.imported.crop import with_border
from urbantwin.roads.imported.crosswalks import Crosswalk, crosswalks_of_model
from urbantwin.roads.imported.edges import Nodes, edges_of_model, loops
from urbantwin.roads.imported.lane_links import Lanes, Place, lane_links
from urbantwin.roads.imported.plain_xml import OUTER, MapTopology, junction_outline, plain_network
from urbantwin.roads.imported.signal_programs import (
    lights_of_model,
    lights_of_places,
    with_programs,
)
from urbantwin.roads.junctions.plain import write_plain
from urbantwin.roads.model import LaneModel, ModelRoad
from urbantwin.roads.netconvert import run_netconvert, write_network
from urbantwin.roads.signals.default_programs import set_default_programs

__all__ = ["SumoNetwork", "sumo_network_of_model"]

OPTIONS = {
    "offset.disable-normalization": "true",  # keep the site frame
    "precision": "3",
    "geometry.max-grade": "1000",  # heights are the lane model's; netconvert's network is flat
    "roundabouts.guess": "true",
    "tls.default-type": "actuated",
    "tls.left-green.time": "12",
    "walkingareas": "true",
    "no-turnarounds": "true",
    "output.street-names": "true",
}


@dataclass(frozen=True)
class SumoNetwork:
    """Result of netconvert for a lane model.

    Attributes:
        model: the lane model, with the names of lanes, junctions and crossings in the network.
        warnings: netconvert's warnings.
        notes: counts.
    """

    model: LaneModel
    warnings: list[str]
    notes: dict[str, object]


def sumo_network_of_model(
    model: LaneModel, out: Path, *, lit: Sequence[NDArray[np.float64]] = ()
) -> SumoNetwork:
    """Run netconvert on a lane model and write its network.

    Args:
        model: the lane model, site frame.
        out: the ``.net.xml`` to write.
        lit: places (2,) of signalised junctions that have no signals in the map.

    Raises:
        StageError: netconvert failed.
    """
    model, borders = _without_loops(model)
    nodes = Nodes(model)
    edges = edges_of_model(model, borders)
    links = lane_links(Lanes(model, edges))
    crosswalks = crosswalks_of_model(model, edges, nodes)
    outlines = {junction.id: junction_outline(model, junction.id) for junction in model.junctions}
    lights = {**lights_of_places(nodes, outlines, lit), **lights_of_model(model, nodes)}
    topology = MapTopology(model, edges, nodes, links, lights, crosswalks, outlines)
    mapped = any(area.kind == "crosswalk" for area in model.areas)
    options = {
        **OPTIONS,
        "lefthand": "true" if model.driving_side == "left" else "false",
        "crossings.guess": "false" if mapped else "true",
    }
    with tempfile.TemporaryDirectory(prefix="netconvert-", dir=out.parent) as scratch:
        raw = Path(scratch) / "raw.net.xml"
        files = write_plain(Path(scratch) / "map", plain_network(topology))
        settings = [text for key, value in options.items() for text in (f"--{key}", value)]
        warnings = run_netconvert([*files, *settings], raw)
        _without_outlines(raw)
        write_network(raw, out)
    set_default_programs(out)
    root = etree.parse(out).getroot()
    named_model, programs = with_programs(_named(topology, root), nodes, lights, out)
    notes: dict[str, object] = {
        "edges": len(edges),
        "connections": len(links),
        "traffic_lights": len(set(lights.values())),
        "crosswalks": len({item.area for item in crosswalks}),
        **programs,
    }
    return SumoNetwork(named_model, warnings, notes)


def _without_outlines(net: Path) -> None:
    """Remove the outlines of crossings with a given shape, which netconvert gets wrong.

    In left-hand traffic they lie on the wrong side of the x axis (SUMO 1.24). Without an outline,
    SUMO uses the crossing's line and width.
    """
    tree = etree.parse(net)
    for edge in tree.getroot().iterfind("edge"):
        if edge.get("function") == "crossing":
            for lane in edge.iterfind("lane"):
                lane.attrib.pop("outlineShape", None)
    tree.write(str(net))


def _named(topology: MapTopology, root: etree._Element) -> LaneModel:
    """Return the model with netconvert's names."""
    strips: dict[Place, str] = {
        (edge.road.id, number, lane): edge.strip(index)
        for edge in topology.edges
        for index, lanes in enumerate(edge.lanes)
        for number, lane in zip(edge.sections, lanes, strict=True)
    }
    lanes_between = _lanes_between(root)
    for link in topology.links:
        (start, i), (end, j) = link.start, link.end
        for place in link.path:
            strips.setdefault(place, lanes_between.get((start.strip(i), end.strip(j)), ""))
    junctions = tuple(
        dataclasses.replace(
            junction, name=node, members=(node,), outline=topology.outlines[junction.id]
        )
        if (node := _node(topology.nodes, junction.id))
        else junction
        for junction in topology.model.junctions
    )
    crossings = _crossings(root)
    of_area = {item.area: item for item in reversed(topology.crosswalks)}
    areas = tuple(
        dataclasses.replace(area, strip=_crossing(of_area.get(area.id), crossings))
        for area in topology.model.areas
    )
    roads = tuple(_with_strips(road, strips) for road in topology.model.roads)
    return dataclasses.replace(topology.model, roads=roads, junctions=junctions, areas=areas)


def _node(nodes: Nodes, junction: int) -> str:
    return next((node for node, index in nodes.junctions.items() if index == junction), "")


def _with_strips(road: ModelRoad, strips: Mapping[Place, str]) -> ModelRoad:
    sections = tuple(
        dataclasses.replace(
            section,
            lanes=tuple(
                dataclasses.replace(lane, strip=strips.get((road.id, number, lane.id), ""))
                for lane in section.lanes
            ),
        )
        for number, section in enumerate(road.sections)
    )
    ways = () if road.ways == OUTER else road.ways
    return dataclasses.replace(road, sections=sections, ways=ways)


def _lanes_between(root: etree._Element) -> dict[tuple[str, str], str]:
    """Return (lane, following lane) -> the lanes in between, in order, separated by spaces."""
    onward = {
        f"{item.get('from')}_{item.get('fromLane')}": item.get("via")
        for item in root.iterfind("connection")
        if item.get("from").startswith(":") and item.get("via")
    }
    vias = {}
    for item in root.iterfind("connection"):
        if item.get("from").startswith(":") or not item.get("via"):
            continue
        chain = [item.get("via")]
        while chain[-1] in onward and onward[chain[-1]] not in chain:
            chain.append(onward[chain[-1]])
        start = f"{item.get('from')}_{item.get('fromLane')}"
        vias[start, f"{item.get('to')}_{item.get('toLane')}"] = " ".join(chain)
    return vias


def _crossings(root: etree._Element) -> dict[tuple[str, frozenset[str]], str]:
    """Return (node, crossed edges) -> the crossing's lane."""
    crossings = {}
    for edge in root.iterfind("edge"):
        if edge.get("function") == "crossing":
            node = edge.get("id")[1:].rsplit("_", 1)[0]
            crossed = frozenset(edge.get("crossingEdges", "").split())
            crossings[node, crossed] = edge.find("lane").get("id")
    return crossings


def _crossing(
    crosswalk: Crosswalk | None, crossings: Mapping[tuple[str, frozenset[str]], str]
) -> str:
    if crosswalk is None:
        return ""
    return crossings.get((crosswalk.node, frozenset(crosswalk.edges)), "")


def _without_loops(model: LaneModel) -> tuple[LaneModel, set[tuple[int, int]]]:
    """Return the model with a section boundary in the middle of each loop road.

    SUMO has no edge from a node to itself. The boundaries are returned too: (road, section).
    """
    loop_ids = loops(edges_of_model(model), Nodes(model))
    roads, borders = [], set()
    for road in model.roads:
        changed = road
        if road.id in loop_ids:
            changed, number = with_border(road, road.length / 2)
            borders.add((road.id, number))
        roads.append(changed)
    return model.with_roads(tuple(roads)), borders
