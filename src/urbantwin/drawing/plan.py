"""A plan of the lane network with its surroundings."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon, Rectangle

from urbantwin.drawing import style
from urbantwin.drawing.plan_corrections import draw_corrections, list_corrections, list_height
from urbantwin.drawing.plan_ground import draw_ground, draw_surfaces, fill
from urbantwin.drawing.plan_labels import draw_labels, street_labels
from urbantwin.drawing.plan_marks import draw_marks, draw_signals
from urbantwin.drawing.plan_style import DARK, LANE_NAMES, Look
from urbantwin.drawing.road_furniture import islands, signs
from urbantwin.geometry import LabelledMesh
from urbantwin.roads import RoadNetwork
from urbantwin.roads.marking import stop_lines
from urbantwin.roads.model import LaneModel
from urbantwin.twin import Corrected

__all__ = ["plan", "plan_figure"]

#: Size of the sheet, inches: title above the map, legend below it.
WIDTH, TITLE, LEGEND = 12.0, 0.95, 0.75
MARGIN = 0.35
#: Streets with less than this share of the region are shown with this margin around them, metres.
FILLED, AROUND_M = 0.75, 20.0
#: Sizes of text, points.
NAMES, NOTES = 9.0, 9.0
INCH_PER_POINT = 1 / 72


def plan(
    network: RoadNetwork,
    region: shapely.Polygon,
    path: Path,
    *,
    model: LaneModel | None = None,
    mesh: LabelledMesh | None = None,
    sensors: Iterable[tuple[str, float, float]] = (),
    title: str = "Lane network",
    attribution: str | Iterable[str] = (),
) -> Path:
    """Draw the lane network from above, north up, as PNG or, by the file's name, as SVG.

    The plan shows lanes by kind with their markings, the permitted turns at stop lines, zebra
    crossings, islands, curbs, signals with their direction, signs and street names. It has a north
    arrow, a scale, a legend and the region's border. The same twin gives the same bytes.

    Args:
        network: the lanes.
        region: the region of interest, site frame, metres.
        path: the ``.png`` or ``.svg`` to write.
        model: the lane model, with markings, islands, heads and signs.
        mesh: the static scene: its buildings and plants are drawn in the background.
        sensors: name, x and y of each, site frame, metres.
        title: title of the picture.
        attribution: sources of the data.
    """
    figure = plan_figure(
        network,
        region,
        model=model,
        mesh=mesh,
        sensors=sensors,
        title=title,
        attribution=attribution,
    )
    return style.save(figure, path)


def plan_figure(  # noqa: PLR0913 - all that a plan shows
    network: RoadNetwork,
    region: shapely.Polygon,
    *,
    model: LaneModel | None = None,
    mesh: LabelledMesh | None = None,
    sensors: Iterable[tuple[str, float, float]] = (),
    corrections: Sequence[Corrected] = (),
    title: str = "Lane network",
    attribution: str | Iterable[str] = (),
    look: Look = DARK,
) -> Figure:
    """Return a plan as a figure, in colours for a screen or for print; see ``plan``."""
    side = WIDTH - 2 * MARGIN
    below = LEGEND + list_height(corrections)
    height = TITLE + side + below
    figure = style.new_figure(WIDTH, height, dpi=150, colour=look.page)
    box = (MARGIN / WIDTH, below / height, side / WIDTH, side / height)
    axes = figure.add_axes(box)
    axes.set_facecolor(look.page)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set(color=look.muted, linewidth=0.8, zorder=70)
    x0, y0, x1, y1 = _shown(network, region)
    width = 1.06 * max(x1 - x0, y1 - y0)
    axes.set_xlim((x0 + x1 - width) / 2, (x0 + x1 + width) / 2)
    axes.set_ylim((y0 + y1 - width) / 2, (y0 + y1 + width) / 2)
    axes.set_aspect("equal")
    metre_per_point = width / side * INCH_PER_POINT

    draw_ground(axes, region, mesh, look)
    draw_surfaces(axes, network, model, look)
    draw_marks(axes, network, model, look)
    size_m = max(1.8, 6.0 * metre_per_point)
    taken = draw_signals(axes, network, model, look, size_m=size_m)
    fill(axes, [region], "none", zorder=35, edgecolor=look.muted, linewidth=0.9, linestyle="--")
    taken += _north_and_scale(axes, look, metre_per_point)
    sensors = list(sensors)
    taken += _sensors(axes, sensors, look, metre_per_point)
    taken += draw_corrections(axes, corrections, look, metre_per_point)
    labels = street_labels(
        network,
        shapely.box(*_bounds(axes)).buffer(-2 * metre_per_point),
        taken,
        letter_m=NAMES * metre_per_point,
    )
    draw_labels(axes, labels, look, fontsize=NAMES)

    top = 1 - 0.32 / height
    figure.text(
        MARGIN / WIDTH,
        top,
        style.legible(title),
        color=look.ink,
        fontsize=16,
        weight="bold",
        va="top",
    )
    figure.text(
        MARGIN / WIDTH,
        top - 0.3 / height,
        _counted(network),
        color=look.muted,
        fontsize=10,
        va="top",
    )
    _legend(figure, axes, network, model, look, below=below, sensors=bool(sensors))
    if corrections:
        list_corrections(figure, corrections, look, left=MARGIN, top=below - LEGEND + 0.3)
    figure.text(
        1 - MARGIN / WIDTH,
        0.1 / height,
        style.joined(attribution),
        color=look.muted,
        fontsize=7.5,
        ha="right",
        va="bottom",
    )
    return figure


def _shown(network: RoadNetwork, region: shapely.Polygon) -> tuple[float, float, float, float]:
    """Return the bounds of the region, or of its streets if they fill little of it."""
    lines = [shapely.LineString(lane.centre[:, :2]) for lane in network.lanes]
    streets = shapely.intersection(shapely.MultiLineString(lines), region)
    whole: tuple[float, float, float, float] = region.bounds
    if streets.is_empty:
        return whole
    x0, y0, x1, y1 = np.array(streets.bounds) + AROUND_M * np.array([-1, -1, 1, 1])
    side = max(x1 - x0, y1 - y0)
    return (
        whole if side > FILLED * max(whole[2] - whole[0], whole[3] - whole[1]) else (x0, y0, x1, y1)
    )


def _bounds(axes: Axes) -> tuple[float, float, float, float]:
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    return x0, y0, x1, y1


def _north_and_scale(axes: Axes, look: Look, metre_per_point: float) -> list[shapely.Geometry]:
    """Draw an arrow to the north and a bar of a round length; return the covered areas."""
    x0, y0, x1, y1 = _bounds(axes)
    unit = metre_per_point
    round_lengths = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
    length = max(m for m in round_lengths if m <= (x1 - x0) / 6 or m == 1)
    ground: dict[str, Any] = {
        "facecolor": look.page,
        "edgecolor": look.muted,
        "linewidth": 0.6,
        "zorder": 60,
    }
    # The bar, on its own background at the lower left.
    left, low = x0 + 14 * unit, y0 + 14 * unit
    wide = length + 30 * unit
    axes.add_patch(Rectangle((x0 + 6 * unit, y0 + 6 * unit), wide, 30 * unit, **ground))
    for k in range(4):
        face = look.ink if k % 2 == 0 else look.page
        axes.add_patch(
            Rectangle(
                (left + k * length / 4, low), length / 4, 4 * unit,
                facecolor=face, edgecolor=look.ink, linewidth=0.7, zorder=61,
            )
        )  # fmt: skip
    for at, text in ((0.0, "0"), (length / 2, f"{length / 2:g}"), (length, f"{length} m")):
        axes.text(
            left + at, low + 7 * unit, text, color=look.ink, fontsize=8,
            ha="center", va="bottom", zorder=61,
        )  # fmt: skip
    # The arrow at the upper right.
    size = 9 * unit
    right, top = x1 - 6 * unit, y1 - 6 * unit
    axes.add_patch(Rectangle((right - 30 * unit, top - 44 * unit), 30 * unit, 44 * unit, **ground))
    shape = np.array([[0, 1.3], [0.55, -0.9], [0, -0.45], [-0.55, -0.9]]) * size
    centre = np.array([right - 15 * unit, top - 30 * unit])
    axes.add_patch(Polygon(shape + centre, facecolor=look.ink, linewidth=0, zorder=61))
    axes.text(
        centre[0], top - 9 * unit, "N", color=look.ink, fontsize=10, weight="bold",
        ha="center", va="center", zorder=61,
    )  # fmt: skip
    return [
        shapely.box(x0, y0, x0 + wide + 10 * unit, y0 + 40 * unit),
        shapely.box(right - 34 * unit, top - 48 * unit, x1, y1),
    ]


def _sensors(
    axes: Axes, sensors: list[tuple[str, float, float]], look: Look, metre_per_point: float
) -> list[shapely.Geometry]:
    """Draw sensors with their names; return the covered areas."""
    taken = []
    for name, east, north in sensors:
        axes.plot(east, north, "o", color=look.sensor, markersize=9, zorder=45)
        axes.plot(east, north, "o", color=look.page, markersize=3.5, zorder=46)
        axes.annotate(
            style.legible(name),
            (east, north),
            xytext=(8, 5),
            textcoords="offset points",
            color=look.sensor,
            fontsize=NOTES,
            weight="bold",
            zorder=46,
            bbox={"boxstyle": "round,pad=0.15", "facecolor": look.halo, "alpha": 0.75, "lw": 0},
        )
        reach = (14 + 7 * len(name)) * metre_per_point
        up = 18 * metre_per_point
        taken.append(shapely.box(east - up / 2, north - up / 2, east + reach, north + up))
    return taken


def _counted(network: RoadNetwork) -> str:
    lanes = [lane for lane in network.lanes if lane.kind in ("driving", "bus")]
    crossings = sum(lane.kind == "crossing" for lane in network.lanes)
    counts = (
        (len({lane.road for lane in lanes}), "road"),
        (len(lanes), "lane"),
        (len(network.programs), "signalised junction"),
        (crossings, "crossing"),
    )
    parts = [f"{count} {what}{'' if count == 1 else 's'}" for count, what in counts]
    return "   ".join([*parts, f"traffic on the {network.driving_side}"])


def _legend(
    figure: Figure,
    axes: Axes,
    network: RoadNetwork,
    model: LaneModel | None,
    look: Look,
    *,
    below: float,
    sensors: bool,
) -> None:
    """Draw the legend of this plan, below the map."""
    kinds = {lane.kind for lane in network.lanes} | {kind for kind, _ in islands(network, model)}
    rows: list[tuple[object, str]] = [
        (Patch(facecolor=look.lanes[kind], edgecolor=look.curb, linewidth=0.5), name)
        for kind, name in LANE_NAMES.items()
        if kind in kinds
    ]
    if kinds & {"sidewalk", "walkingarea", "median", "island"}:
        rows.append((Line2D([], [], color=look.curb, linewidth=1.2), "curb"))
    road = Patch(facecolor=look.lanes["driving"])
    if "crossing" in kinds:
        stripes = Line2D([], [], color=look.paint, linewidth=5, linestyle=(0, (0.5, 0.5)))
        rows.append(((road, stripes), "crossing"))
    if stop_lines(network, model):
        bar = Line2D([], [], color=look.paint, marker="|", markersize=9, markeredgewidth=3, ls="")
        rows.append(((road, bar), "stop line"))
    if network.signals:
        lamp = Line2D([], [], marker="o", ls="", color=look.signal, markersize=6)
        rows.append((lamp, "signal"))
    if signs(model):
        plate = Line2D([], [], marker="o", ls="", markerfacecolor="#ffffff", markersize=7)
        plate.set(markeredgecolor=look.signal, markeredgewidth=1.3)
        rows.append((plate, "sign"))
    if sensors:
        rows.append((Line2D([], [], marker="o", ls="", color=look.sensor, markersize=7), "sensor"))
    height = figure.get_figheight()
    legend = figure.legend(
        handles=[handle for handle, _ in rows],
        labels=[name for _, name in rows],
        loc="upper left",
        bbox_to_anchor=(MARGIN / WIDTH, (below - 0.08) / height),
        borderaxespad=0.0,
        borderpad=0.0,
        ncols=len(rows),
        frameon=False,
        fontsize=9,
        labelcolor=look.ink,
        handletextpad=0.5,
        columnspacing=1.3,
        handlelength=1.8,
        numpoints=1,
        handler_map={tuple: HandlerTuple(ndivide=1, pad=0.0)},
    )
    legend.set_zorder(60)
