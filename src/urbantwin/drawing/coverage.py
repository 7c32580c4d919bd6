"""Maps of a rig's coverage, from above."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import matplotlib as mpl
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure

from urbantwin.drawing import style
from urbantwin.drawing.footprint import footprints
from urbantwin.drawing.plan_ground import draw_ground, fill
from urbantwin.drawing.plan_style import DARK
from urbantwin.geometry import LabelledMesh
from urbantwin.lidar.sight import BAND_M, LAYERS, LEVEL_M, REFLECTIVITY, Coverage
from urbantwin.roads import RoadNetwork

__all__ = ["coverage_figure", "coverage_picture"]

#: Title and explanation of each map.
_MAPS = {
    "ground": ("On the ground", "what road, sidewalk and terrain return"),
    "lying": (
        f"{LEVEL_M:g} m above it, lying",
        f"a level surface of {100 * REFLECTIVITY:g} % reflectivity",
    ),
    "facing": (
        f"{LEVEL_M:g} m above it, facing the sensor",
        f"an upright one, {LEVEL_M - BAND_M / 2:g} to {LEVEL_M + BAND_M / 2:g} m above the ground",
    ),
}
#: Points per frame and square metre from the darkest colour to the lightest.
_LEAST, _MOST = 1.0, 1000.0
#: Margin around the covered area, metres.
_MARGIN_M = 8.0
#: Size of the sheet, inches.
_SIDE, _GAP, _ABOVE, _BELOW = 5.9, 0.2, 1.5, 0.85


def coverage_picture(
    coverage: Coverage,
    path: Path,
    *,
    sensors: Iterable[tuple[str, float, float]] = (),
    mesh: LabelledMesh | None = None,
    roads: RoadNetwork | None = None,
    region: shapely.Polygon | None = None,
    title: str = "",
    attribution: str | Iterable[str] = (),
) -> Path:
    """Draw the maps of a coverage side by side, north up.

    Args:
        coverage: the coverage.
        path: the PNG to write.
        sensors: name, x and y of each, site frame, metres.
        mesh: the static scene: its buildings and plants are drawn.
        roads: the lanes: edges of carriageways are drawn.
        region: the region of interest, site frame.
        title: title of the picture.
        attribution: sources of the data.
    """
    figure = coverage_figure(
        coverage,
        sensors=sensors,
        mesh=mesh,
        roads=roads,
        region=region,
        title=title,
        attribution=attribution,
    )
    return style.save(figure, path)


def coverage_figure(
    coverage: Coverage,
    *,
    sensors: Iterable[tuple[str, float, float]] = (),
    mesh: LabelledMesh | None = None,
    roads: RoadNetwork | None = None,
    region: shapely.Polygon | None = None,
    title: str = "",
    attribution: str | Iterable[str] = (),
) -> Figure:
    """Return the figure of ``coverage_picture``."""
    width = len(LAYERS) * (_SIDE + _GAP) + _GAP
    height = _ABOVE + _SIDE + _BELOW
    figure = style.new_figure(width, height)
    shown = _shown(coverage)
    places = list(sensors)
    # Without its darkest part, which would be similar to the ground.
    colours = ListedColormap(mpl.colormaps["viridis"](np.linspace(0.12, 1.0, 256))).with_extremes(
        bad=(0, 0, 0, 0), under=(0, 0, 0, 0)
    )
    drawn = None
    for number, layer in enumerate(LAYERS):
        left = _GAP + number * (_SIDE + _GAP)
        box = (left / width, _BELOW / height, _SIDE / width, _SIDE / height)
        axes = figure.add_axes(box)
        style.bare(axes)
        axes.set_xlim(shown[0], shown[2])
        axes.set_ylim(shown[1], shown[3])
        axes.set_aspect("equal")
        density = coverage.per_frame(layer)
        _base(axes, coverage, region, mesh)
        drawn = axes.imshow(
            density,
            cmap=colours,
            norm=LogNorm(_LEAST, _MOST),
            origin="lower",
            extent=_extent(coverage),
            interpolation="nearest",
            zorder=4,
        )
        _lines(axes, roads, mesh)
        _sensors(axes, places)
        if number == 0:
            style.scale_bar(axes)
        style.north_arrow(axes)
        name, below = _MAPS[layer]
        top = (_BELOW + _SIDE + 0.42) / height
        figure.text(left / width, top, name, color=style.INK, fontsize=13, weight="bold")
        figure.text(left / width, top - 0.24 / height, below, color=style.MUTED, fontsize=10)
    assert drawn is not None
    _bar(figure, drawn, width, height)
    names = ", ".join(coverage.sensors)
    below = f"points per square metre and frame, {coverage.rate_hz:g} frames per second   {names}"
    style.title(figure, title or "Coverage", below, x=_GAP / width, top=1 - 0.2 / height)
    style.written_attribution(figure, attribution)
    return figure


def _shown(coverage: Coverage) -> tuple[float, float, float, float]:
    """Return a square around the covered area, within the grid."""
    cells = coverage.cells
    rows, columns = cells.shape
    far = (cells.x0 + columns * cells.size_m, cells.y0 + rows * cells.size_m)
    some = np.any([coverage.per_frame(layer) >= _LEAST for layer in LAYERS], axis=0)
    row, column = np.nonzero(some)
    if not len(row):
        row, column = np.array([0, rows - 1]), np.array([0, columns - 1])
    low = np.array([cells.x0, cells.y0]) + cells.size_m * np.array([column.min(), row.min()])
    high = np.array([cells.x0, cells.y0]) + cells.size_m * np.array(
        [column.max() + 1, row.max() + 1]
    )
    middle = (low + high) / 2
    half = min((high - low).max() / 2 + _MARGIN_M, max(far[0] - cells.x0, far[1] - cells.y0) / 2)
    x, y = (
        float(np.clip(middle[k], near + half, max(end - half, near + half)))
        for k, (near, end) in enumerate(((cells.x0, far[0]), (cells.y0, far[1])))
    )
    return x - half, y - half, x + half, y + half


def _extent(coverage: Coverage) -> tuple[float, float, float, float]:
    cells = coverage.cells
    rows, columns = cells.shape
    return cells.x0, cells.x0 + columns * cells.size_m, cells.y0, cells.y0 + rows * cells.size_m


def _base(
    axes: Axes, coverage: Coverage, region: shapely.Polygon | None, mesh: LabelledMesh | None
) -> None:
    """Draw the background of the map."""
    west, east, south, north = _extent(coverage)
    draw_ground(axes, region or shapely.box(west, south, east, north), mesh, DARK)


def _lines(axes: Axes, roads: RoadNetwork | None, mesh: LabelledMesh | None) -> None:
    """Draw the edges of carriageways and, above areas behind walls, buildings."""
    if mesh is not None:
        fill(
            axes,
            footprints(mesh, "building").values(),
            DARK.building,
            zorder=6,
            edgecolor=DARK.edge,
            linewidth=0.5,
        )
    if roads is None:
        return
    lines = [
        shapely.get_coordinates(part)
        for level in roads.levels
        for part in shapely.get_parts(shapely.boundary(roads.carriageway(level)))
    ]
    axes.add_collection(
        LineCollection(lines, colors=DARK.curb, linewidths=0.6, alpha=0.55, zorder=7),
        autolim=False,
    )


def _sensors(axes: Axes, places: list[tuple[str, float, float]]) -> None:
    for name, east, north in places:
        axes.plot(east, north, "o", color=style.ACCENT, markersize=9, zorder=45)
        axes.plot(east, north, "o", color=style.PAPER, markersize=3.5, zorder=46)
        axes.annotate(
            style.legible(name),
            (east, north),
            xytext=(8, 5),
            textcoords="offset points",
            color=style.ACCENT,
            fontsize=9,
            weight="bold",
            zorder=46,
            bbox={"boxstyle": "round,pad=0.15", "facecolor": style.PAPER, "alpha": 0.75, "lw": 0},
        )


def _bar(figure: Figure, drawn: mpl.cm.ScalarMappable, width: float, height: float) -> None:
    """Explain the colours below the maps."""
    axes = figure.add_axes((_GAP / width, 0.48 / height, 4.6 / width, 0.16 / height))
    bar = figure.colorbar(drawn, cax=axes, orientation="horizontal", extend="max")
    ticks = [1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0]
    bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    bar.ax.tick_params(colors=style.MUTED, labelsize=9, which="both")
    bar.ax.minorticks_off()
    bar.outline.set_visible(False)
    figure.text(
        5.1 / width, 0.5 / height, "points per m²; none or less than 1: not coloured",
        color=style.MUTED, fontsize=9.5,
    )  # fmt: skip
