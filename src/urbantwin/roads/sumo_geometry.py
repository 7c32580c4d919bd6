"""SUMO's network with the lane model's geometry; topology and signals stay its own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from lxml import etree
from numpy.typing import NDArray

from urbantwin.roads.curve_speed import lane_speeds
from urbantwin.roads.network import RoadNetwork
from urbantwin.roads.walking_line import Walls

__all__ = ["ONE_LANE", "redraw_sumo_network"]

#: Parameter of an edge whose vehicles share their lane with those of the edge that it names.
ONE_LANE = "oneLane"
#: The shortest lane that SUMO drives on, metres.
SHORTEST_M = 0.1


def redraw_sumo_network(
    path: Path, network: RoadNetwork, buildings: Sequence[shapely.Polygon] = ()
) -> None:
    """Give every lane of a ``.net.xml`` the shape that the lane model has for it.

    Lengths follow: all lanes of an edge have one, the mean over those that are driven on, as
    netconvert sets it. Crossings and walking areas stay. Along a sidewalk people walk where walls
    leave room; SUMO knows one width of a lane: its narrowest. The speed of a way over a junction
    is what its curve allows where it begins; where it is tighter further on, `traffic.simulation`
    slows down those who drive there.

    Args:
        path: the network, rewritten in place.
        network: the lanes, by their ids in the file.
        buildings: where buildings stand on the ground, site frame.
    """
    walls = Walls(buildings, network.driving_side)
    tree = etree.parse(path, etree.XMLParser(remove_blank_text=False))
    for edge in tree.getroot().iterfind("edge"):
        if edge.get("function") in ("crossing", "walkingarea"):
            continue
        rows = [
            (item, network.lane_by_id.get(item.get("id", ""))) for item in edge.iterfind("lane")
        ]
        lines: dict[str, NDArray[np.float64]] = {}
        for item, lane in rows:
            if lane is None:
                continue
            lines[lane.id] = lane.centre[:, :2]
            if lane.kind == "sidewalk":
                lines[lane.id], width = walls.walked(lane)
                if width is not None:
                    item.set("width", f"{width:.2f}")
            if lane.opposite:
                item.set("width", f"{lane.width:.2f}")
                note = {"key": ONE_LANE, "value": lane.opposite.rsplit("_", 1)[0]}
                edge.append(etree.Element("param", note))
            points = lines[lane.id].tolist()
            item.set("shape", " ".join([f"{x:.3f},{y:.3f}" for x, y in points]))
        drawn = [lane for _, lane in rows if lane is not None]
        driven = [lane for lane in drawn if lane.kind != "sidewalk"] or drawn
        if not driven:
            continue
        lengths = [shapely.LineString(lines[lane.id]).length for lane in driven]
        for item, _ in rows:
            item.set("length", f"{max(float(np.mean(lengths)), SHORTEST_M):.3f}")
        if edge.get("shape"):
            del edge.attrib["shape"]
    speeds = lane_speeds(tree.getroot())
    for item in tree.getroot().iterfind("edge[@function='internal']/lane"):
        allowed = speeds.get(item.get("id", ""))
        if allowed is not None:
            item.set("speed", f"{min(float(item.get('speed', 'inf')), float(allowed[0])):.2f}")
    tree.write(path, encoding="UTF-8", xml_declaration=True)
