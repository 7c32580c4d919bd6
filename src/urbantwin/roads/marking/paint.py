"""All road markings as quadrilaterals in plan.

Widths of lines follow German RMS 1 and US MUTCD 3A.06 and 3B.16 as defaults: lane marks 0.15 m,
stop lines 0.4 m, give-way teeth 0.5 m wide and 0.7 m long.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
import shapely.ops
from numpy.typing import NDArray

from urbantwin.geometry import moved_left
from urbantwin.roads.marking.give_way import parking_bays, teeth
from urbantwin.roads.marking.line_through import guide_lines, lines_through
from urbantwin.roads.marking.lines import (
    DASH_M,
    GAP_M,
    MOTOR,
    lane_marks,
    placed,
    stop_lines,
    strokes,
)
from urbantwin.roads.marking.turn_arrow import turn_arrow
from urbantwin.roads.model import MINI_ROUNDABOUT, LaneModel, RoadArea
from urbantwin.roads.network import Lane, RoadNetwork

__all__ = ["PAINT_KINDS", "Paint", "painted", "zebra"]

#: Kinds of markings; ``zebra`` are stripes, ``crossing`` other markings of crossings.
PAINT_KINDS = ("zebra", "crossing", "line", "stop", "arrow", "teeth", "bay", "disc")
#: Widths of lane marks, of stop lines and of the lines between parking bays, metres.
LINE_M, STOP_LINE_M, BAY_LINE_M = 0.15, 0.4, 0.12
Quad = NDArray[np.float64]
#: Painted width and spacing of the stripes of a zebra crossing, metres.
STRIPE_M, PERIOD_M = 0.5, 1.0
#: Width, length and spacing of marks, metres. Lines: US MUTCD 3B.18 (6 to 24 inches); dashes:
#: German RMS 1 (0.12 m, 0.5 m painted, 0.2 m bare); dots: UK TSRGD, schedule 14 (studs of about 0.1
#: m, 0.25 to 0.72 m apart).
BORDERS = {"lines": (0.3, 0.0, 0.0), "dashes": (0.12, 0.5, 0.7), "dots": (0.1, 0.1, 0.5)}


@dataclass(frozen=True, eq=False)
class Paint:
    """Painted quadrilaterals.

    Attributes:
        quads: (N, 4, 2) corners, site frame, metres; a triangle repeats its last corner.
        kind: (N,) uint8, index into ``PAINT_KINDS``.
        level: (N,) int, 0 on the ground, 1, 2, ... above other roads.
    """

    quads: NDArray[np.float64]
    kind: NDArray[np.uint8]
    level: NDArray[np.int64]

    def of(self, *kinds: str) -> NDArray[np.float64]:
        """Return the quadrilaterals (M, 4, 2) of some kinds."""
        return self.quads[np.isin(self.kind, [PAINT_KINDS.index(kind) for kind in kinds])]


def painted(network: RoadNetwork, model: LaneModel | None = None) -> Paint:
    """Return all markings.

    Args:
        network: the lanes.
        model: the lane model, for lane marks, stop lines, give-way lines, parking bays and arrows;
            without it only crossings, dashes between lanes and stop lines of signals are painted.
    """
    marks: list[tuple[str, int, Sequence[Quad]]] = [
        (kind, lane.level, quads)
        for lane in network.lanes
        if lane.kind == "crossing"
        for kind, quads in [crossing_marks(lane)]
    ]
    if model is None:
        marks += [("line", level, quads) for level, quads in _borders(network)]
        marks += [("stop", level, [quad]) for level, quad in _stop_lines(network)]
    else:
        through = lines_through(network, model)
        for line in [*lane_marks(network, model), *guide_lines(model), *through]:
            if line.kind != "curb":
                quads = [quad for points in strokes(line) for quad in _ribbon(points, LINE_M)]
                marks.append(("line", line.level, quads))
        marks += [
            ("stop", line.level, _ribbon(line.points, STOP_LINE_M))
            for line in stop_lines(network, model)
        ]
        marks += [("arrow", level, quads) for level, quads in _arrows(network)]
        marks += [
            ("zebra", model.road_by_id[area.road].level, zebra_of_area(model, area))
            for area in model.areas
            if area.kind == "crosswalk" and not area.strip
        ]
        marks += [
            ("disc", model.road_by_id[area.road].level, _triangles(model, area))
            for area in model.areas
            if area.name == MINI_ROUNDABOUT and len(area.corners) > 2
        ]
        marks += [("teeth", level, quads) for level, quads in teeth(model)]
        marks += [("bay", level, _ribbon(ends, BAY_LINE_M)) for level, ends in parking_bays(model)]
    marks = [(kind, level, quads) for kind, level, quads in marks if len(quads)]
    if not marks:
        return Paint(np.zeros((0, 4, 2)), np.zeros(0, np.uint8), np.zeros(0, np.int64))
    counts = [len(quads) for _, _, quads in marks]
    return Paint(
        np.concatenate([np.asarray(quads, np.float64) for _, _, quads in marks]),
        np.repeat([PAINT_KINDS.index(kind) for kind, _, _ in marks], counts).astype(np.uint8),
        np.repeat([level for _, level, _ in marks], counts),
    )


def _ribbon(points: NDArray[np.float64], width: float) -> list[Quad]:
    """Return a line of some width as one quad per segment, mitred at bends."""
    leg = np.diff(points, axis=0)
    leg = leg / np.maximum(np.linalg.norm(leg, axis=1, keepdims=True), 1e-9)
    along = np.vstack([leg[:1], leg[:-1] + leg[1:], leg[-1:]])
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    side = np.column_stack([-along[:, 1], along[:, 0]]) * width / 2
    low, high = points - side, points + side
    quads = np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1)
    return list(quads[np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6])


def _triangles(model: LaneModel, area: RoadArea) -> list[Quad]:
    """Return a convex area as triangles, each with its last corner repeated."""
    ring = placed(model, area.road, area.s, area.corners)[:, :2]
    return [ring[[0, k, k + 1, k + 1]] for k in range(1, len(ring) - 1)]


def _arrows(network: RoadNetwork) -> Iterator[tuple[int, list[Quad]]]:
    """Yield turn arrows as triangles, each with its last corner repeated."""
    for lane in network.lanes:
        shape = None if lane.junction or lane.kind not in MOTOR else turn_arrow(network, lane)
        if shape is not None:
            pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(shape))
            rings = [shapely.get_coordinates(shapely.orient_polygons(piece)) for piece in pieces]
            yield lane.level, [ring[[0, 1, 2, 2]] for ring in rings]


def _borders(network: RoadNetwork) -> Iterator[tuple[int, list[Quad]]]:
    """Yield dashes between adjacent lanes of one direction."""
    side = 1.0 if network.driving_side == "right" else -1.0
    for road in network.roads:
        lanes = [network.lane_by_id[name] for name in road.lanes if name in network.lane_by_id]
        for lane, inner in pairwise(lanes):
            if lane.kind in MOTOR and inner.kind in MOTOR:
                yield lane.level, _dashes_beside(lane, side)


def _dashes_beside(lane: Lane, side: float) -> list[Quad]:
    line = shapely.LineString(lane.centre[:, :2])
    quads = []
    for start_m in np.arange(GAP_M / 2, line.length - DASH_M, DASH_M + GAP_M):
        a, b = (np.array(line.interpolate(d).coords[0]) for d in (start_m, start_m + DASH_M))
        along = (b - a) / np.linalg.norm(b - a)
        across = np.array([-along[1], along[0]])
        middle = side * lane.width / 2
        low, high = (middle - LINE_M / 2) * across, (middle + LINE_M / 2) * across
        quads.append(np.array([a + low, b + low, b + high, a + high]))
    return quads


def _stop_lines(network: RoadNetwork) -> Iterator[tuple[int, Quad]]:
    for head in network.signals:
        lane = network.lane_by_id.get(head.lane)
        if lane is None or lane.kind == "crossing":
            continue
        along = np.array([np.cos(head.yaw), np.sin(head.yaw)])
        across = np.array([-along[1], along[0]]) * lane.width / 2
        front = np.array([head.x, head.y]) - 0.1 * along
        back = front - STOP_LINE_M * along
        yield lane.level, np.array([back - across, front - across, front + across, back + across])


def zebra(lane: Lane) -> list[NDArray[np.float64]]:
    """Return the stripes of a crossing, (4, 2) corners each, site frame, metres."""
    return _stripes(shapely.LineString(lane.centre[:, :2]), lane.width)


def zebra_of_area(model: LaneModel, area: RoadArea) -> list[NDArray[np.float64]]:
    """Return the stripes of a mapped crosswalk without sidewalks, as ``zebra`` does.

    The crossing direction is along the longer side of its bounding rectangle.
    """
    corners = shapely.MultiPoint(placed(model, area.road, area.s, area.corners))
    around = shapely.minimum_rotated_rectangle(corners)
    if not isinstance(around, shapely.Polygon):
        return []
    ring = shapely.get_coordinates(around)[:4]
    sides = np.linalg.norm(ring - np.roll(ring, -1, axis=0), axis=1)
    k = int(np.argmin(sides[:2]))
    ends = [(ring[k] + ring[k + 1]) / 2, (ring[k + 2] + ring[(k + 3) % 4]) / 2]
    return _stripes(shapely.LineString(ends), float(sides[k]))


def _stripes(line: shapely.LineString, width: float) -> list[NDArray[np.float64]]:
    if line.length < STRIPE_M:
        return []
    count = int((line.length + PERIOD_M - STRIPE_M) // PERIOD_M)
    margin = (line.length - (count - 1) * PERIOD_M - STRIPE_M) / 2
    stripes = []
    for number in range(count):
        start_m = margin + number * PERIOD_M
        a, b = (np.array(line.interpolate(d).coords[0]) for d in (start_m, start_m + STRIPE_M))
        across = np.array([a[1] - b[1], b[0] - a[0]])
        across *= width / 2 / np.linalg.norm(across)
        stripes.append(np.array([a - across, b - across, b + across, a + across]))
    return stripes


def crossing_marks(lane: Lane) -> tuple[str, list[NDArray[np.float64]]]:
    """Return the kind of paint of a crossing, and its quadrilaterals, (4, 2) each, site frame.

    A crossing of unknown marking has stripes.
    """
    if lane.marking == "none":
        return "crossing", []
    if lane.marking not in BORDERS:
        return "zebra", zebra(lane)
    width, mark, period = BORDERS[lane.marking]
    quads = []
    for side in (-1, 1):
        border = shapely.LineString(moved_left(lane.centre[:, :2], side * (lane.width - width) / 2))
        count = int((border.length + period - mark) // period) if period else 1
        margin = (border.length - (count - 1) * period - mark) / 2 if period else 0.0
        for number in range(count):
            start_m = margin + number * period
            piece = shapely.ops.substring(border, start_m, start_m + (mark or border.length))
            points = shapely.get_coordinates(piece)
            for a, b in pairwise(points):
                across = np.array([a[1] - b[1], b[0] - a[0]])
                across *= width / 2 / max(float(np.linalg.norm(across)), 1e-9)
                quads.append(np.array([a - across, b - across, b + across, a + across]))
    return "crossing", quads
