"""Markings and furniture of a plan: lane marks, stop lines, zebras, arrows, signals, signs."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Circle, Polygon
from numpy.typing import NDArray

from urbantwin.drawing.plan_ground import fill
from urbantwin.drawing.plan_style import Look
from urbantwin.drawing.road_furniture import Sign, heads, signs
from urbantwin.roads import Lane, RoadNetwork
from urbantwin.roads.marking import (
    ARROW_M,
    GIVE_WAY,
    PAINT_KINDS,
    arrow_at,
    guide_lines,
    lane_marks,
    lines_through,
    painted,
    stop_lines,
    strokes,
    turn_arrow,
)
from urbantwin.roads.model import LaneModel

__all__ = ["draw_marks", "draw_signals"]

#: Drawn widths of lines, metres: painted ones are 0.12 to 0.25 m wide.
_LINE_M, _STOP_M = 0.2, 0.5
#: Minimum distance between arrows for the direction of a lane, and their length, metres.
_DIRECTION_EVERY_M, _DIRECTION_M = 45.0, 3.2
#: Numbers of the stop sign in the catalogues of Germany, the USA and Australia, and in Vienna's.
STOP = frozenset({"206", "R1-1", "B2a", "B2"})
_DRIVEN = ("driving", "bus", "bicycle")


def draw_marks(axes: Axes, network: RoadNetwork, model: LaneModel | None, look: Look) -> None:
    """Draw the road markings."""
    across = [*guide_lines(model), *lines_through(network, model)] if model else []
    for line in [*lane_marks(network, model), *across]:
        if line.kind == "curb":
            continue
        ribbons = [_ribbon(points, _LINE_M) for points in strokes(line)]
        fill(axes, ribbons, look.paint, zorder=11.0 + 10 * line.level)
    for line in stop_lines(network, model):
        fill(axes, [_ribbon(line.points, _STOP_M)], look.paint, zorder=11.2 + 10 * line.level)
    for lane in network.lanes:
        if lane.kind == "crossing" and lane.marking in ("lines", "dashes", "dots"):
            # Studs are smaller than the plan can show.
            fill(axes, [lane.polygon], look.paint, zorder=11.05 + 10 * lane.level, alpha=0.35)
    paint = painted(network, model)
    rest = paint.of("teeth", "bay", "disc")
    axes.add_collection(
        PolyCollection(list(rest), facecolor=look.paint, linewidth=0, zorder=11.2), autolim=False
    )
    crossings = np.isin(paint.kind, [PAINT_KINDS.index(kind) for kind in ("zebra", "crossing")])
    for level in np.unique(paint.level[crossings]).tolist():
        quads = shapely.polygons(paint.quads[crossings & (paint.level == level)])
        # The corners of a crossing at an angle to the street are beyond the kerb.
        within = shapely.intersection(quads, network.carriageway(level))
        fill(axes, within, look.paint, zorder=11.1 + 10 * level)
    for lane in network.lanes:
        if lane.kind in _DRIVEN and not lane.junction:
            _draw_arrows(axes, network, lane, look)


def draw_signals(
    axes: Axes, network: RoadNetwork, model: LaneModel | None, look: Look, *, size_m: float
) -> list[shapely.Geometry]:
    """Draw heads of signals, facing their traffic, and signs.

    Returns the covered areas.

    Args:
        axes: axes of the plan.
        network: the lanes.
        model: the lane model, if there is one.
        look: colours.
        size_m: the size of a symbol, metres.
    """
    taken: list[shapely.Geometry] = []
    for x, y, yaw in _heads(network, model):
        ahead = np.array([np.cos(yaw), np.sin(yaw)])
        across = np.array([-ahead[1], ahead[0]])
        at = np.array([x, y])
        # A lamp with its face: the flat side faces the traffic.
        face = [at - 0.45 * size_m * ahead + k * 0.42 * size_m * across for k in (-1, 1)]
        axes.add_patch(
            Circle(
                (x, y), 0.42 * size_m, facecolor=look.signal, edgecolor=look.page, lw=0.5, zorder=38
            )
        )
        ends = np.array(face).T
        axes.plot(*ends, color=look.signal, lw=1.5, solid_capstyle="butt", zorder=37)
        taken.append(shapely.Point(x, y).buffer(0.5 * size_m))
    for sign in signs(model):
        place = shapely.Point(sign.x, sign.y)
        if not any(place.distance(other) < 0.5 * size_m for other in taken):
            _draw_sign(axes, sign, size_m, look)
            taken.append(place.buffer(size_m))
    return taken


def _draw_sign(axes: Axes, sign: Sign, size_m: float, look: Look) -> None:
    """Draw a speed limit, a stop sign, a give-way sign or, for any other, a diamond."""
    at = np.array([sign.x, sign.y])
    edged: dict[str, Any] = {"facecolor": "#ffffff", "edgecolor": look.signal, "zorder": 39}
    if np.isfinite(sign.value) and sign.unit in ("km/h", "mph", "m/s"):
        if sign.plate == "upright":
            edged |= {"edgecolor": "#16191d"}
            corners = at + size_m * np.array([[-0.8, -1.0], [0.8, -1.0], [0.8, 1.0], [-0.8, 1.0]])
            axes.add_patch(Polygon(corners, lw=1.0, **edged))
        else:
            axes.add_patch(Circle((sign.x, sign.y), 0.95 * size_m, lw=1.3, **edged))
        axes.text(
            sign.x, sign.y, f"{sign.value:.0f}", color="#16191d", fontsize=5.5, weight="bold",
            ha="center", va="center_baseline", zorder=40, clip_on=True,
        )  # fmt: skip
    elif sign.type in STOP:
        edged |= {"facecolor": look.signal, "edgecolor": "#ffffff"}
        around = np.radians(22.5 + 45.0 * np.arange(8))
        corners = at + 0.8 * size_m * np.column_stack([np.cos(around), np.sin(around)])
        axes.add_patch(Polygon(corners, lw=0.8, **edged))
    elif sign.type in GIVE_WAY:
        corners = at + 0.9 * size_m * np.array([[-1, 0.6], [1, 0.6], [0, -1]])
        axes.add_patch(Polygon(corners, lw=1.3, **edged))
    else:
        corners = at + 0.6 * size_m * np.array([[0, 1], [1, 0], [0, -1], [-1, 0]])
        axes.add_patch(Polygon(corners, lw=1.0, **edged))


def _heads(network: RoadNetwork, model: LaneModel | None) -> list[tuple[float, float, float]]:
    """Return position and traffic heading of every head; heads at the same position once."""
    found: dict[tuple[int, int, int], tuple[float, float, float]] = {}
    for head in heads(network, model):
        key = round(head.x * 2), round(head.y * 2), round(float(np.cos(head.yaw)) * 2)
        found.setdefault(key, (head.x, head.y, head.yaw))
    return list(found.values())


def _draw_arrows(axes: Axes, network: RoadNetwork, lane: Lane, look: Look) -> None:
    zorder = 11.3 + 10 * lane.level
    end = lane.length
    shape = turn_arrow(network, lane)
    if shape is not None:
        fill(axes, [shape], look.paint, zorder=zorder)
        end -= ARROW_M + 8.0
    count = int((end - 6.0) // _DIRECTION_EVERY_M) + (end > 14.0)
    marks = [
        arrow_at(("through",), lane, end * (k + 0.5) / count, _DIRECTION_M)
        for k in range(max(count, 0))
    ]
    fill(axes, marks, look.direction, zorder=zorder)


def _ribbon(points: NDArray[np.float64], width: float) -> shapely.Geometry:
    return shapely.LineString(points).buffer(width / 2, cap_style="flat", join_style="mitre")
