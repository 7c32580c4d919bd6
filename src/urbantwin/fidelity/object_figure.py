"""A picture of labelled objects: how many, how large, how many points each has, and where."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from urbantwin.fidelity.report_style import COLOURS, blank, legend, plain, save

__all__ = ["draw_objects"]

_SIDES = {"real": "real", "synthetic": "twin", "arbitrary": "arbitrary site"}
#: Classes whose points a box are drawn: the most frequent.
_DRAWN = 3
#: Half the edge of the maps, metres, at most.
_FARTHEST_M = 120.0


def draw_objects(objects: Mapping[str, Any], path: Path) -> None:
    """Write the picture.

    Args:
        objects: as ``report.json`` has them.
        path: the PNG to write.
    """
    sides = [side for side in COLOURS if side in objects]
    names = sorted({name for side in sides for name in objects[side]["classes"]})
    figure = blank(15, 10.6)
    grid = figure.add_gridspec(
        3,
        12,
        height_ratios=(1, 1, 1.7),
        left=0.04,
        right=0.99,
        top=0.93,
        bottom=0.045,
        hspace=0.42,
        wspace=1.1,
    )
    legend(figure, [(_SIDES[side], COLOURS[side]) for side in sides], 0.035, 0.995)
    shown = {"Boxes a frame": "", "Mean length, m": "length_m"}
    shown |= {"Mean width, m": "width_m", "Mean height, m": "height_m"}
    for place, (title, size) in enumerate(shown.items()):
        axes = figure.add_subplot(grid[0, 3 * place : 3 * place + 3])
        plain(axes, title)
        width = 0.8 / len(sides)
        for number, side in enumerate(sides):
            heights = [_bar(objects[side]["classes"].get(name), size) for name in names]
            left = np.arange(len(names)) - 0.4 + width * (number + 0.5)
            axes.bar(left, heights, width * 0.92, color=COLOURS[side])
        axes.set_xticks(range(len(names)), names, rotation=25, ha="right")
    commonest = sorted(names, key=lambda name: -_count(objects["real"], name))[:_DRAWN]
    for place, name in enumerate(commonest):
        axes = figure.add_subplot(grid[1, 4 * place : 4 * place + 4])
        _points_a_box(axes, objects, sides, name)
    there = [side for side in sides if objects[side]["heat_map"]["x_y_boxes"]]
    reach = max((_reach(objects[side]["heat_map"]) for side in there), default=1.0)
    for place, side in enumerate(there):
        axes = figure.add_subplot(grid[2, 4 * place : 4 * place + 4])
        _heat_map(axes, objects[side]["heat_map"], objects[side]["frames"], reach)
        title = f"Boxes a frame in 2 m cells, {_SIDES[side]}"
        axes.set_title(title, loc="left", fontsize=10, weight="bold")
    save(figure, path)


def _points_a_box(axes: Axes, objects: Mapping[str, Any], sides: list[str], name: str) -> None:
    plain(axes, f"Points a box, {name}, by m: median, P20 to P80")
    for side in sides:
        rows = objects[side]["classes"].get(name, {"points_per_box": []})["points_per_box"]
        if rows:
            middle = [(row["from_m"] + row["to_m"]) / 2 for row in rows]
            axes.plot(middle, [row["median"] for row in rows], marker="o", color=COLOURS[side])
            axes.fill_between(
                middle,
                [row["p20"] for row in rows],
                [row["p80"] for row in rows],
                color=COLOURS[side],
                alpha=0.15,
                linewidth=0,
            )
    axes.set_yscale("symlog", linthresh=1)
    axes.set_ylim(bottom=0)
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")


def _heat_map(axes: Axes, heat: Mapping[str, Any], frames: int, reach: float) -> None:
    x, y, count = np.array(heat["x_y_boxes"], np.float64).T
    cells = int(np.ceil(reach / heat["cell_m"]))
    image: NDArray[np.float64] = np.full((2 * cells, 2 * cells), np.nan)
    column = np.rint(x / heat["cell_m"]).astype(int) + cells
    row = np.rint(y / heat["cell_m"]).astype(int) + cells
    inside = (np.minimum(row, column) >= 0) & (np.maximum(row, column) < 2 * cells)
    image[row[inside], column[inside]] = count[inside] / frames
    half = cells * heat["cell_m"]
    axes.set_facecolor("#f2f5f8")
    axes.imshow(
        image,
        origin="lower",
        extent=(-half, half, -half, half),
        cmap="inferno_r",
        vmin=0,
        vmax=1,
        interpolation="nearest",
    )
    axes.tick_params(labelsize=8)


def _reach(heat: Mapping[str, Any]) -> float:
    x, y, _ = np.array(heat["x_y_boxes"], np.float64).T
    return float(min(np.abs([x, y]).max() + 2 * heat["cell_m"], _FARTHEST_M))


def _bar(one: Mapping[str, Any] | None, size: str) -> float:
    if one is None:
        return 0.0
    return float(one["dimensions"][size]["mean"] if size else one["per_frame"])


def _count(side: Mapping[str, Any], name: str) -> int:
    return int(side["classes"].get(name, {"boxes": 0})["boxes"])
