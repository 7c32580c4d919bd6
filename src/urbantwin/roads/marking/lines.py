"""Painted lines in plan: lane marks and stop lines.

They follow from the lane model. Without one only the lane network is known: adjacent lanes, and
stop lines at signals.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely
import shapely.ops
from numpy.typing import NDArray

from urbantwin.roads.model import LaneModel, ModelRoad
from urbantwin.roads.network import RoadNetwork

__all__ = ["DASH_M", "GAP_M", "MOTOR", "Line", "lane_marks", "placed", "stop_lines", "strokes"]

#: Maximum chord of a line where its road bends or its lanes change, metres.
CHORD_M = 1.0
#: Painted and unpainted length of a broken line, metres (German RMS 1, built-up areas).
DASH_M, GAP_M = 3.0, 6.0
#: The same for guide lines of turns (US MUTCD 3B.08: dotted extensions, 2 ft and 2 to 6 ft).
BROKEN = {"broken": (DASH_M, GAP_M), "guide": (0.6, 1.2)}
#: Lines farther than this inside a lane are not its border, metres.
BORDER_M = 0.5
#: Kinds of lanes with motor traffic.
MOTOR = ("driving", "bus")


@dataclass(frozen=True)
class Line:
    """A line on the road.

    Attributes:
        kind: ``solid``, ``broken``, ``guide``, ``curb`` or ``stop``.
        points: (N, 2), site frame, metres.
        level: 0 on the ground, 1, 2, ... above other roads.
        lane: id of its strip; empty if none.
        signal: id of the signal program that stops traffic there; empty if none.
    """

    kind: str
    points: NDArray[np.float64]
    level: int = 0
    lane: str = ""
    signal: str = ""


def lane_marks(network: RoadNetwork, model: LaneModel | None) -> list[Line]:
    """Return the lines along lanes: painted ones and curbs.

    Where two roads overlap, lines inside the other road's lanes are removed.
    """
    if model is None:
        return list(_marks_of_strips(network))
    lines = [line for road in model.roads if road.junction < 0 for line in _marks_of_road(road)]
    return list(_beside_lanes(lines, network))


def stop_lines(network: RoadNetwork, model: LaneModel | None) -> list[Line]:
    """Return the lines at which traffic stops, across its lane in either direction."""
    lines = []
    stopped = {head.lane: head.program for head in network.signals}
    for area in model.areas if model else ():
        if model is None or area.name != "StopLine" or len(area.corners) < 2:
            continue
        corners = shapely.MultiPoint(placed(model, area.road, area.s, area.corners))
        along = _long_axis(corners)
        if along is not None:
            lines.append(
                Line(
                    "stop",
                    along,
                    model.road_by_id[area.road].level,
                    area.strip,
                    stopped.get(area.strip, ""),
                )
            )
    if lines:
        return lines
    for head in network.signals:
        lane = network.lane_by_id.get(head.lane)
        if lane is not None and lane.kind != "crossing":
            across = np.array([-np.sin(head.yaw), np.cos(head.yaw)]) * lane.width / 2
            middle = np.array([head.x, head.y])
            ends = np.array([middle - across, middle + across])
            lines.append(Line("stop", ends, lane.level, lane.id, head.program))
    return lines


def strokes(line: Line) -> list[NDArray[np.float64]]:
    """Return the painted pieces of a line, evenly spaced from end to end."""
    if line.kind not in BROKEN:
        return [line.points]
    dash, gap = BROKEN[line.kind]
    polyline = shapely.LineString(line.points)
    count = int((polyline.length + gap) // (dash + gap))
    if count < 1:
        return []
    period = polyline.length / count
    pieces = []
    for k in range(count):
        middle = (k + 0.5) * period
        piece = shapely.ops.substring(polyline, middle - dash / 2, middle + dash / 2)
        pieces.append(shapely.get_coordinates(piece))
    return pieces


def placed(
    model: LaneModel, road: int, s: float, corners: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return corners (N, 2) in the site frame, given relative to a station: ahead, left."""
    x, y, heading = model.road_by_id[road].curve.at(s)[0]
    c, sn = np.cos(heading), np.sin(heading)
    return np.asarray(np.array([x, y]) + corners[:, :2] @ np.array([[c, sn], [-sn, c]]))


def _marks_of_road(road: ModelRoad) -> Iterator[Line]:
    for section, end in zip(road.sections, road.section_ends, strict=True):
        count = max(2, int(np.ceil((end - section.s) / CHORD_M)) + 1)
        s = np.linspace(section.s, end, count)
        if section.centre_mark != "none":
            yield Line(
                _kind(section.centre_mark), road.curve.beside(s, road.offset.at(s)), road.level
            )
        for lane in section.lanes:
            if lane.mark != "none":
                t = road.border(section, lane, s, outer=True)
                points = road.place(s, t)[:, :2]
                yield Line(_kind(lane.mark), points, road.level, lane.strip)


def _beside_lanes(lines: Sequence[Line], network: RoadNetwork) -> Iterator[Line]:
    """Yield the parts of lines beside lanes or on their borders."""
    lanes = [lane for lane in network.lanes if lane.kind in MOTOR and not lane.junction]
    inner = shapely.buffer([lane.polygon for lane in lanes], -BORDER_M)
    tree = shapely.STRtree(inner)
    for line in lines:
        polyline = shapely.LineString(line.points)
        hit_lanes = [k for k in tree.query(polyline, "intersects") if lanes[k].level == line.level]
        if not hit_lanes:
            yield line
            continue
        visible = shapely.difference(polyline, shapely.union_all(inner[hit_lanes]))
        for part in shapely.get_parts(visible):
            if part.length > BORDER_M:
                yield replace(line, points=shapely.get_coordinates(part))


def _kind(mark: str) -> str:
    """Return the kind of line for a lane mark of OpenDRIVE."""
    if "curb" in mark:
        return "curb"
    return "broken" if mark.startswith("broken") or mark == "botts dots" else "solid"


def _marks_of_strips(network: RoadNetwork) -> Iterator[Line]:
    """Yield lines between adjacent lanes of one direction."""
    side = 1.0 if network.driving_side == "right" else -1.0
    for road in network.roads:
        lanes = [network.lane_by_id[name] for name in road.lanes if name in network.lane_by_id]
        for lane, inner in pairwise(lanes):
            if "sidewalk" in (lane.kind, inner.kind):
                continue
            both = lane.kind in MOTOR and inner.kind in MOTOR
            line = shapely.LineString(lane.centre[:, :2]).offset_curve(
                side * lane.width / 2, join_style="mitre"
            )
            for part in shapely.get_parts(line):
                points = shapely.get_coordinates(part)
                if len(points) >= 2:
                    yield Line("broken" if both else "solid", points, lane.level, lane.id)


def _long_axis(corners: shapely.MultiPoint) -> NDArray[np.float64] | None:
    """Return the ends (2, 2) of the centre line of a narrow area."""
    frame = shapely.oriented_envelope(corners)
    if frame.geom_type == "LineString":
        return np.asarray(shapely.get_coordinates(frame)[:2])
    if frame.geom_type != "Polygon":
        return None
    ring = shapely.get_coordinates(frame)[:4]
    if np.linalg.norm(ring[1] - ring[0]) < np.linalg.norm(ring[2] - ring[1]):
        ring = np.roll(ring, -1, axis=0)
    return np.array([(ring[0] + ring[3]) / 2, (ring[1] + ring[2]) / 2])
