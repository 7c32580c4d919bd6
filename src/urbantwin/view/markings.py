"""Paint on the carriageway, for pictures and CARLA: zebras, lane marks, stop lines, arrows.

The twin's mesh has no paint; these are thin sheets just above it, laid where the lane model has
its marks.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import DownwardProbe, LabelledMesh
from urbantwin.roads import Lane, RoadNetwork
from urbantwin.roads.model import LaneModel
from urbantwin.taxonomy import material_id, semantic_id
from urbantwin.view.plan_marks import dashes, zebra
from urbantwin.view.road_lines import lane_marks, stop_lines
from urbantwin.view.turn_arrow import turn_arrow

__all__ = ["markings"]

_ABOVE_M = 0.025
#: Painted and bare length of a lane border, and its width, metres.
_DASH_M, _GAP_M, _BORDER_M = 3.0, 6.0, 0.15
_STOP_LINE_M = 0.4
_MOTOR = ("driving", "bus")


def markings(
    network: RoadNetwork, ground: LabelledMesh, model: LaneModel | None = None
) -> LabelledMesh:
    """Return the paint as a mesh in the site frame, metres.

    Args:
        network: the lanes.
        ground: what it lies on: paint where nothing is under it is left out.
        model: the lane model, whose lane marks and stop lines are painted, and arrows before
            them; without it only dashes between lanes and stop lines of signals are known.
    """
    quads = [stripe for lane in network.lanes if lane.kind == "crossing" for stripe in zebra(lane)]
    if model is None:
        quads += _borders(network) + _stop_lines(network)
    else:
        quads += _marks(network, model) + _arrows(network)
    if not quads:
        return LabelledMesh.empty()
    corners = np.array(quads)
    # From 3 m above the lane model, so that a bridge's paint does not fall on the street below.
    heights = _heights(network, corners)
    above = np.column_stack([corners.reshape(-1, 2), heights + 3.0])
    z = DownwardProbe(ground).height_below(above)
    vertices = np.column_stack([corners.reshape(-1, 2), z + _ABOVE_M])
    kept = np.isfinite(z).reshape(-1, 4).all(axis=1)
    kept &= np.ptp(np.nan_to_num(z).reshape(-1, 4), axis=1) < 0.5
    first = np.flatnonzero(kept)[:, None, None] * 4
    faces = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    corners_of = np.nan_to_num(vertices)[faces]
    area = np.cross(corners_of[:, 1] - corners_of[:, 0], corners_of[:, 2] - corners_of[:, 0])
    faces = faces[np.linalg.norm(area, axis=1) > 1e-9]  # an arrow's triangles are half a quad
    paint = LabelledMesh.build(
        np.nan_to_num(vertices), faces, semantic_id("road"), material_id("retroreflector")
    )
    return paint.select(np.ones(len(paint.faces), bool))


def _heights(network: RoadNetwork, corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the height (4 Q,) of the lane centre nearest to each quad."""
    lanes = [lane for lane in network.lanes if len(lane.centre) >= 2]
    tree = shapely.STRtree([shapely.LineString(lane.centre[:, :2]) for lane in lanes])
    nearest = tree.nearest(shapely.points(corners.mean(axis=1)))
    heights = [
        network.height(lanes[number].id, middle)[0]
        for number, middle in zip(nearest, corners.mean(axis=1), strict=True)
    ]
    return np.repeat(heights, 4)


def _marks(network: RoadNetwork, model: LaneModel) -> list[NDArray[np.float64]]:
    quads = []
    for line in lane_marks(network, model):
        if line.kind != "curb":
            strokes = dashes(line.points) if line.kind == "broken" else [line.points]
            quads += [quad for points in strokes for quad in _ribbon(points, _BORDER_M)]
    for line in stop_lines(network, model):
        quads += _ribbon(line.points, _STOP_LINE_M)
    return quads


def _ribbon(points: NDArray[np.float64], width: float) -> list[NDArray[np.float64]]:
    """Return a line of some width as one quad per leg, mitred where it bends."""
    leg = np.diff(points, axis=0)
    leg = leg / np.maximum(np.linalg.norm(leg, axis=1, keepdims=True), 1e-9)
    along = np.vstack([leg[:1], leg[:-1] + leg[1:], leg[-1:]])
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    side = np.column_stack([-along[:, 1], along[:, 0]]) * width / 2
    low, high = points - side, points + side
    return [
        np.array([low[k], low[k + 1], high[k + 1], high[k]])
        for k in range(len(points) - 1)
        if not np.allclose(points[k], points[k + 1])
    ]


def _arrows(network: RoadNetwork) -> list[NDArray[np.float64]]:
    """Return turn arrows as triangles, each with its last corner twice."""
    found = []
    for lane in network.lanes:
        shape = None if lane.junction or lane.kind not in _MOTOR else turn_arrow(network, lane)
        if shape is not None:
            for piece in shapely.get_parts(shapely.constrained_delaunay_triangles(shape)):
                ring = shapely.get_coordinates(shapely.orient_polygons(piece))[:3]
                found.append(ring[[0, 1, 2, 2]])
    return found


def _borders(network: RoadNetwork) -> list[NDArray[np.float64]]:
    side = 1.0 if network.driving_side == "right" else -1.0
    quads = []
    for road in network.roads:
        lanes = [network.lane_by_id[name] for name in road.lanes if name in network.lane_by_id]
        for lane, inner in pairwise(lanes):
            if lane.kind in ("driving", "bus") and inner.kind in ("driving", "bus"):
                quads += _dashes(lane, side)
    return quads


def _dashes(lane: Lane, side: float) -> list[NDArray[np.float64]]:
    line = shapely.LineString(lane.centre[:, :2])
    quads = []
    for at in np.arange(_GAP_M / 2, line.length - _DASH_M, _DASH_M + _GAP_M):
        a, b = (np.array(line.interpolate(d).coords[0]) for d in (at, at + _DASH_M))
        along = (b - a) / np.linalg.norm(b - a)
        across = np.array([-along[1], along[0]])
        middle = side * lane.width / 2
        low, high = (middle - _BORDER_M / 2) * across, (middle + _BORDER_M / 2) * across
        quads.append(np.array([a + low, b + low, b + high, a + high]))
    return quads


def _stop_lines(network: RoadNetwork) -> list[NDArray[np.float64]]:
    quads = []
    for head in network.signals:
        lane = network.lane_by_id.get(head.lane)
        if lane is None or lane.kind == "crossing":
            continue
        along = np.array([np.cos(head.yaw), np.sin(head.yaw)])
        across = np.array([-along[1], along[0]]) * lane.width / 2
        front = np.array([head.x, head.y]) - 0.1 * along
        back = front - _STOP_LINE_M * along
        quads.append(np.array([back - across, front - across, front + across, back + across]))
    return quads
