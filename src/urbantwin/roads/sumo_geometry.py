"""SUMO's network with the lane model's geometry; topology and signals stay its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from urbantwin.geometry import stations_of_points
from urbantwin.roads.curve_speed import lane_speeds
from urbantwin.roads.network import Lane, RoadNetwork

__all__ = ["redraw_sumo_network"]

#: People walk in a band at least this wide, metres: a stripe of SUMO's model of pedestrians.
WALKED_M = 0.65
#: The shortest lane that SUMO drives on, metres.
SHORTEST_M = 0.1


def redraw_sumo_network(path: Path, network: RoadNetwork) -> None:
    """Give every lane of a ``.net.xml`` the shape that the lane model has for it.

    Lengths follow: all lanes of an edge have one, the mean over those that are driven on, as
    netconvert sets it. Crossings and walking areas stay. Where a sidewalk is narrow because a wall
    stands beside it, people walk in a band that ends at the wall, if need be on the carriageway.
    SUMO knows one width of a lane: its narrowest. The speed of a way over a junction is what its
    curve allows where it begins; where it is tighter further on, `traffic.simulation` slows down
    those who drive there.

    Args:
        path: the network, rewritten in place.
        network: the lanes, by their ids in the file.
    """
    tree = etree.parse(path, etree.XMLParser(remove_blank_text=False))
    inwards = 1 if network.driving_side == "right" else -1
    for edge in tree.getroot().iterfind("edge"):
        if edge.get("function") in ("crossing", "walkingarea"):
            continue
        rows = [
            (item, network.lane_by_id.get(item.get("id", ""))) for item in edge.iterfind("lane")
        ]
        lines = {lane.id: _drawn(lane, inwards) for _, lane in rows if lane is not None}
        if not lines:
            continue
        driven = [lane.id for _, lane in rows if lane is not None and lane.kind != "sidewalk"]
        lengths = [stations_of_points(lines[name])[-1] for name in driven or lines]
        length = max(float(np.mean(lengths)), SHORTEST_M)
        if edge.get("shape"):
            del edge.attrib["shape"]
        for item, lane in rows:
            item.set("length", f"{length:.3f}")
            if lane is not None:
                if lane.kind == "sidewalk" and len(lane.widths):
                    item.set("width", f"{max(float(lane.widths.min()), WALKED_M):.2f}")
                shape = lines[lane.id].tolist()
                item.set("shape", " ".join([f"{x:.3f},{y:.3f}" for x, y in shape]))
    speeds = lane_speeds(tree.getroot())
    for item in tree.getroot().iterfind("edge[@function='internal']/lane"):
        allowed = speeds.get(item.get("id", ""))
        if allowed is not None:
            item.set("speed", f"{min(float(item.get('speed', 'inf')), float(allowed[0])):.2f}")
    tree.write(path, encoding="UTF-8", xml_declaration=True)


def _drawn(lane: Lane, inwards: int) -> NDArray[np.float64]:
    """Return a lane's line (N, 2); of a sidewalk, the middle of the band that people walk in.

    Args:
        lane: the lane, with its widths.
        inwards: 1 where the carriageway is to a sidewalk's left, -1 where it is to its right.
    """
    line = lane.centre[:, :2]
    if lane.kind != "sidewalk" or not len(lane.widths):
        return line
    leg = np.diff(line, axis=0)
    left = np.column_stack([-leg[:, 1], leg[:, 0]])
    left /= np.maximum(np.linalg.norm(left, axis=1, keepdims=True), 1e-9)
    left = np.vstack([left[:1], left[:-1] + left[1:], left[-1:]])
    left /= np.maximum(np.linalg.norm(left, axis=1, keepdims=True), 1e-9)
    missing = np.maximum(WALKED_M - lane.widths, 0.0) / 2
    return np.asarray(line + inwards * missing[:, None] * left)
