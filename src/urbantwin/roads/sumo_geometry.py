"""SUMO's network with the lane model's geometry; topology and signals stay its own."""

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

#: Parameter of an edge whose vehicles share their lane with those of the edge that it names.
ONE_LANE = "oneLane"
#: The shortest lane that SUMO drives on, metres.
SHORTEST_M = 0.1
#: People walk in a band at least this wide, metres: a stripe of SUMO's model of pedestrians.
BAND_M = 0.65
#: Nobody's middle is nearer to a wall, metres.
CLEAR_M = 0.4
#: How far a band is moved at most, metres, and how much from one metre to the next.
MOST_M, TAPER = 4.0, 0.5
#: Spacing of the places that are looked at, metres.
STEP_M = 0.5
#: Lines may be drawn with this much difference, so that fewer points say them, metres.
SIMPLER_M = 0.02


class Walls:
    """Buildings beside the sidewalks of a network.

    Args:
        buildings: where buildings stand on the ground, site frame.
        driving_side: ``right`` or ``left``.
    """

    def __init__(self, buildings: Sequence[shapely.Polygon], driving_side: str) -> None:
        self._tree = shapely.STRtree([one.buffer(CLEAR_M) for one in buildings])
        self._inwards = 1 if driving_side == "right" else -1

    def walked(self, lane: Lane) -> tuple[NDArray[np.float64], float | None]:
        """Return the middle (N, 2) of the band that people walk in along a sidewalk, and its width.

        Where a wall leaves less than a shoulder, the band is moved towards the carriageway, and
        on to it if need be. Its width is one for the whole lane: that of its narrowest place;
        ``None`` where no wall is near.

        Args:
            lane: the sidewalk.
        """
        line = lane.centre[:, :2]
        near = self._tree.query(shapely.LineString(line), predicate="intersects")
        if not len(near) or lane.level:
            return line, max(float(lane.widths.min()), BAND_M) if len(lane.widths) else None
        taken = shapely.union_all(self._tree.geometries[np.sort(near)])
        points = shapely.get_coordinates(shapely.segmentize(shapely.LineString(line), STEP_M))
        leg = np.diff(points, axis=0)
        leg = np.vstack([leg[:1], leg[:-1] + leg[1:], leg[-1:]])
        inwards = self._inwards * np.column_stack([-leg[:, 1], leg[:, 0]])
        inwards /= np.maximum(np.linalg.norm(inwards, axis=1, keepdims=True), 1e-9)
        across = shapely.linestrings(np.stack([points, points + MOST_M * inwards], axis=1))
        free = shapely.difference(across, taken)
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
