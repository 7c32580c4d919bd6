"""SUMO's network with the lane model's geometry, and its own topology and signals."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from lxml import etree
from numpy.typing import NDArray

from urbantwin.roads.curve_speed import lane_speeds
from urbantwin.roads.network import Lane, RoadNetwork

__all__ = ["ONE_LANE", "redraw_sumo_network"]

#: Parameter of an edge whose lane is shared with the edge that it names.
ONE_LANE = "oneLane"
#: Minimum length of a lane in SUMO, metres.
SHORTEST_M = 0.1
#: Minimum width of a pedestrian band: a stripe of SUMO's pedestrian model, metres.
BAND_M = 0.65
#: Minimum distance of a pedestrian's centre from a wall, metres.
CLEAR_M = 0.4
#: Maximum displacement of a band, metres, and its change per metre along the lane.
MOST_M, TAPER = 4.0, 0.5
#: Spacing of the sampled places, metres.
STEP_M = 0.5
#: Tolerance of simplified lines, metres.
SIMPLER_M = 0.02


class Walls:
    """Buildings beside the sidewalks of a network.

    Args:
        buildings: footprints of buildings on the ground, site frame.
        driving_side: ``right`` or ``left``.
    """

    def __init__(self, buildings: Sequence[shapely.Polygon], driving_side: str) -> None:
        self._tree = shapely.STRtree([building.buffer(CLEAR_M) for building in buildings])
        self._inwards = 1 if driving_side == "right" else -1

    def walked(self, lane: Lane) -> tuple[NDArray[np.float64], float | None]:
        """Return the centre line (N, 2) of the pedestrian band along a sidewalk, and its width.

        Where a wall leaves too little room, the band is moved towards the carriageway, and onto it
        if necessary. Its width is constant along the lane: that of its narrowest place; ``None`` if
        it is unchanged.

        Args:
            lane: the sidewalk.
        """
        line = lane.centre[:, :2]
        wall_index = self._tree.query(shapely.LineString(line), predicate="intersects")
        if not len(wall_index) or lane.level:
            return line, max(float(lane.widths.min()), BAND_M) if len(lane.widths) else None
        walls = shapely.union_all(self._tree.geometries[np.sort(wall_index)])
        points = shapely.get_coordinates(shapely.segmentize(shapely.LineString(line), STEP_M))
        leg = np.diff(points, axis=0)
        leg = np.vstack([leg[:1], leg[:-1] + leg[1:], leg[-1:]])
        inwards = self._inwards * np.column_stack([-leg[:, 1], leg[:, 0]])
        inwards /= np.maximum(np.linalg.norm(inwards, axis=1, keepdims=True), 1e-9)
        across = shapely.linestrings(np.stack([points, points + MOST_M * inwards], axis=1))
        free = shapely.difference(across, walls)
        move = np.nan_to_num(shapely.distance(shapely.points(points), free), nan=0.0)
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        ramp = TAPER * along
        ahead = np.maximum.accumulate(move + ramp) - ramp
        back = (np.maximum.accumulate((move - ramp)[::-1]) + ramp[::-1])[::-1]
        moved = points + np.maximum(ahead, back)[:, None] * inwards
        band = shapely.simplify(shapely.LineString(moved), SIMPLER_M)
        return shapely.get_coordinates(band), BAND_M


def redraw_sumo_network(
    path: Path, network: RoadNetwork, buildings: Sequence[shapely.Polygon] = ()
) -> None:
    """Replace the lane shapes of a ``.net.xml`` by those of the lane model.

    All lanes of an edge get one length, the mean of its vehicle lanes, as in netconvert. Crossings
    and walking areas are unchanged. The pedestrian band of a sidewalk avoids walls; SUMO has one
    width per lane, the narrowest. The speed of a connection is the limit from its curvature at its
    start; `traffic.simulation` slows vehicles down where it is tighter further on.

    Args:
        path: the network, rewritten in place.
        network: the lanes, by their ids in the file.
        buildings: footprints of buildings on the ground, site frame.
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
