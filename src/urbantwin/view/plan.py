"""A plan of the lane network, with what stands around it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection, PolyCollection
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.roads import Lane, RoadNetwork
from urbantwin.taxonomy import semantic_id
from urbantwin.view import style

__all__ = ["plan", "zebra"]

_GROUND = "#18202a"
_BUILDING, _GREEN = "#34404d", "#2f5a41"
_FILLS = {
    "driving": "#79838f",
    "bus": "#8d7a52",
    "bicycle": "#5b8071",
    "connection": "#6b747f",
    "sidewalk": "#b9b3a6",
    "walkingarea": "#b9b3a6",
}
_NAMES = {
    "driving": "lane",
    "bus": "bus lane",
    "bicycle": "bicycle lane",
    "sidewalk": "sidewalk",
}
_JUNCTION = "#626b76"
#: Stripes of a zebra crossing, metres: painted, and from one to the next.
_STRIPE_M, _PERIOD_M = 0.5, 1.0
#: A direction arrow at least every so many metres.
_ARROW_EVERY_M = 30.0


def plan(
    network: RoadNetwork,
    region: shapely.Polygon,
    path: Path,
    *,
    mesh: LabelledMesh | None = None,
    sensors: Iterable[tuple[str, float, float]] = (),
    title: str = "Lane network",
    attribution: str | Iterable[str] = (),
) -> Path:
    """Draw the lane network from above, north up.

    Lanes by kind with arrows of their direction, crossings as zebras, junctions, signals with the
    heading that they govern, street names, a scale and the region's border.

    Args:
        network: the lanes.
        region: the region of interest, site frame, metres.
        path: the PNG to write.
        mesh: the static world: its buildings and trees are drawn behind.
        sensors: name, x and y of each, site frame, metres.
        title: of the picture.
        attribution: whose data it shows.
    """
    figure = style.new_figure(12, 12.6)
    axes = figure.add_axes((0, 0, 1, 1))
    style.bare(axes)
    # The region fills the width but for a margin, below the title; what is around it goes on.
    x0, y0, x1, y1 = region.bounds
    width = 1.1 * max(x1 - x0, y1 - y0)
    left, bottom = (x0 + x1 - width) / 2, (y0 + y1) / 2 - 0.485 * 1.05 * width
    axes.set_xlim(left, left + width)
    axes.set_ylim(bottom, bottom + 1.05 * width)
    axes.set_aspect("equal")
    fill(axes, [region], _GROUND, zorder=0)
    if mesh is not None:
        _footprints(axes, mesh)
    for level in network.levels:
        _draw_level(axes, network, level, zorder=10 + 5 * level)
    _arrows(axes, [lane for lane in network.lanes if lane.kind in ("driving", "bus", "bicycle")])
    _signals(axes, network)
    _street_names(axes, network, region)
    for name, east, north in sensors:
        axes.plot(east, north, "o", color=style.ACCENT, markersize=11, zorder=45)
        axes.plot(east, north, "o", color=style.PAPER, markersize=4, zorder=46)
        axes.annotate(
            name,
            (east, north),
            xytext=(9, 6),
            textcoords="offset points",
            color=style.ACCENT,
            fontsize=10,
            weight="bold",
            zorder=46,
        )
    fill(axes, [region], "none", zorder=40, edgecolor=style.MUTED, linewidth=1, linestyle="--")
    style.scale_bar(axes)
    style.north_arrow(axes)
    style.title(figure, title, _counted(network))
    _legend(axes, network, sensors=bool(list(sensors)))
    style.written_attribution(figure, attribution)
    return style.save(figure, path)


def fill(
    axes: Axes,
    shapes: Iterable[shapely.Geometry],
    colour: str,
    **kwargs: Any,  # noqa: ANN401 - matplotlib's own keywords
) -> None:
    """Fill polygons and multipolygons, holes left open."""
    patches = []
    for shape in shapes:
        for part in shapely.get_parts(shape):
            if part.geom_type != "Polygon" or part.is_empty:
                continue
            rings = [part.exterior, *part.interiors]
            outline = Outline.make_compound_path(
                *[Outline(np.asarray(ring.coords)[:, :2], closed=True) for ring in rings]
            )
            patches.append(PathPatch(outline))
    if patches:
        given: dict[str, Any] = {"facecolor": colour, "edgecolor": "none", "linewidth": 0}
        given.update(kwargs)
        axes.add_collection(PatchCollection(patches, **given), autolim=False)


def zebra(lane: Lane) -> list[NDArray[np.float64]]:
    """Return the stripes of a crossing, (4, 2) corners each, site frame, metres."""
    line = shapely.LineString(lane.centre[:, :2])
    if line.length < _STRIPE_M:
        return []
    count = int((line.length + _PERIOD_M - _STRIPE_M) // _PERIOD_M)
    margin = (line.length - (count - 1) * _PERIOD_M - _STRIPE_M) / 2
    stripes = []
    for number in range(count):
        at = margin + number * _PERIOD_M
        a, b = (np.array(line.interpolate(d).coords[0]) for d in (at, at + _STRIPE_M))
        across = np.array([a[1] - b[1], b[0] - a[0]])
        across *= lane.width / 2 / np.linalg.norm(across)
        stripes.append(np.array([a - across, b - across, b + across, a + across]))
    return stripes


def _footprints(axes: Axes, mesh: LabelledMesh) -> None:
    """Draw buildings and trees as the triangles that look up."""
    up = mesh.normals()[:, 2] > 0.05
    triangles = mesh.triangles()[:, :, :2]
    for name, colour, zorder in (("vegetation", _GREEN, 2), ("building", _BUILDING, 3)):
        chosen = up & (mesh.semantic == semantic_id(name))
        # Outlined in their own colour: the borders between triangles would shine through.
        axes.add_collection(
            PolyCollection(
                list(triangles[chosen]),
                facecolor=colour,
                edgecolor=colour,
                linewidth=1.0,
                joinstyle="round",
                zorder=zorder,
            ),
            autolim=False,
        )


def _draw_level(axes: Axes, network: RoadNetwork, level: int, zorder: float) -> None:
    lanes = [lane for lane in network.lanes if lane.level == level]
    if level:  # a deck hides what runs under it
        shadow = [lane.polygon.buffer(0.8) for lane in lanes if lane.kind in _FILLS]
        fill(axes, shadow, style.PAPER, zorder=zorder)
    fill(axes, [network.footway(level)], _FILLS["sidewalk"], zorder=zorder + 0.2)
    fill(axes, [network.carriageway(level)], _JUNCTION, zorder=zorder + 0.4)
    for kind in ("driving", "bus", "bicycle"):
        fill(
            axes,
            [lane.polygon for lane in lanes if lane.kind == kind],
            _FILLS[kind],
            zorder=zorder + 0.6,
            edgecolor="#c9d0d8",
            linewidth=0.5,
        )
    stripes = [stripe for lane in lanes if lane.kind == "crossing" for stripe in zebra(lane)]
    axes.add_collection(
        PolyCollection(stripes, facecolor="#ffffff", linewidth=0, zorder=zorder + 0.8),
        autolim=False,
    )


def _arrows(axes: Axes, lanes: list[Lane]) -> None:
    shapes = []
    for lane in lanes:
        line = shapely.LineString(lane.centre[:, :2])
        if line.length < 8:
            continue
        count = max(1, int(line.length // _ARROW_EVERY_M))
        size = min(lane.width, 3.0) / 3.0
        arrow = np.array(
            [[2.2, 0], [0.6, 0.75], [0.6, 0.22], [-2.2, 0.22]]
            + [[-2.2, -0.22], [0.6, -0.22], [0.6, -0.75]]
        )
        for number in range(count):
            at = line.length * (number + 0.5) / count
            a, b = (np.array(line.interpolate(at + d).coords[0]) for d in (-0.5, 0.5))
            along = (b - a) / np.linalg.norm(b - a)
            turn = np.array([along, [-along[1], along[0]]])
            shapes.append(arrow * size @ turn + (a + b) / 2)
    axes.add_collection(
        PolyCollection(shapes, facecolor="#f2f5f8", linewidth=0, zorder=30), autolim=False
    )


def _signals(axes: Axes, network: RoadNetwork) -> None:
    for head in network.signals:
        along = np.array([np.cos(head.yaw), np.sin(head.yaw)])
        across = np.array([-along[1], along[0]])
        # A bar over the stop line and a spot, so that the head shows at any scale.
        lane = network.lane_by_id.get(head.lane)
        half = (lane.width if lane else 3.0) / 2
        if lane is None or lane.kind != "crossing":
            ends = np.array([head.x, head.y]) + np.outer([-half, half], across)
            axes.plot(*ends.T, color="#ff5a4f", linewidth=2.2, zorder=37, solid_capstyle="butt")
        axes.plot(
            head.x,
            head.y,
            "o",
            color="#ff5a4f",
            markersize=4.5,
            markeredgecolor=style.PAPER,
            markeredgewidth=0.7,
            zorder=38,
        )


def _street_names(axes: Axes, network: RoadNetwork, region: shapely.Polygon) -> None:
    """Write each street's name once per 180 m of it, along its longest lanes in the region."""
    lanes = network.lane_by_id
    named: dict[str, list[shapely.LineString]] = {}
    for road in network.roads:
        if road.lanes and road.name and style.legible(road.name) == road.name:
            line = shapely.LineString(lanes[road.lanes[-1]].centre[:, :2])
            inside = shapely.intersection(line, region.buffer(-4))
            parts = [p for p in shapely.get_parts(inside) if p.geom_type == "LineString"]
            named.setdefault(road.name, []).extend(p for p in parts if p.length > 12)
    written: list[tuple[str, float, float]] = []
    for name, lines in named.items():
        for line in sorted(lines, key=lambda one: -one.length):
            a, b = (np.array(line.interpolate(s, normalized=True).coords[0]) for s in (0.4, 0.6))
            x, y = (a + b) / 2
            if any(n == name and np.hypot(x - u, y - v) < 180 for n, u, v in written):
                continue
            angle = np.degrees(np.arctan2(b[1] - a[1], b[0] - a[0]))
            angle = (angle + 90) % 180 - 90
            axes.text(
                x,
                y,
                name,
                color=style.INK,
                fontsize=9.5,
                rotation=angle,
                rotation_mode="anchor",
                ha="center",
                va="center",
                zorder=44,
                clip_on=True,
                bbox={
                    "boxstyle": "round,pad=0.25",
                    "facecolor": style.PAPER,
                    "alpha": 0.72,
                    "lw": 0,
                },
            )
            written.append((name, x, y))


def _counted(network: RoadNetwork) -> str:
    lanes = sum(lane.kind in ("driving", "bus") for lane in network.lanes)
    crossings = sum(lane.kind == "crossing" for lane in network.lanes)
    counts = (
        (len(network.roads), "road"),
        (lanes, "lane"),
        (len(network.programs), "signalised junction"),
        (crossings, "crossing"),
    )
    parts = [f"{count} {what}{'' if count == 1 else 's'}" for count, what in counts]
    return "   ".join([*parts, f"traffic on the {network.driving_side}"])


def _legend(axes: Axes, network: RoadNetwork, *, sensors: bool) -> None:
    kinds = {lane.kind for lane in network.lanes}
    rows = [(_NAMES[kind], _FILLS[kind], "s") for kind in _NAMES if kind in kinds]
    if network.signals:
        rows.append(("signal", "#ff5a4f", "o"))
    if sensors:
        rows.append(("sensor", style.ACCENT, "o"))
    handles = [
        axes.plot([], [], marker, color=colour, markersize=9, label=name)[0]
        for name, colour, marker in rows
    ]
    legend = axes.legend(
        handles=handles,
        loc="lower right",
        bbox_to_anchor=(0.99, 0.025),
        ncols=len(handles),
        frameon=True,
        fontsize=10,
        labelcolor=style.INK,
        facecolor=style.PAPER,
        edgecolor="none",
        handletextpad=0.3,
        columnspacing=1.2,
    )
    legend.set_zorder(60)
