"""The picture of all figures: precision over recall, and what is found at which range."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from urbantwin.evaluation.criterion import near
from urbantwin.evaluation.evaluate import Figures
from urbantwin.fidelity.report_style import blank, legend, plain, save

__all__ = ["CLASS_COLOURS", "draw_figures"]

#: Of every class that is judged, apart for people who see no red or no green (Okabe and Ito).
CLASS_COLOURS = {
    "car": "#0072b2",
    "truck": "#e69f00",
    "bus": "#d55e00",
    "motorcycle": "#cc79a7",
    "bicycle": "#009e73",
    "pedestrian": "#56b4e9",
    "large": "#1d2733",
}


def draw_figures(figures: Figures, path: Path) -> None:
    """Write the picture as a PNG."""
    figure = blank(15, 4.6)
    grid = figure.add_gridspec(1, 3, left=0.045, right=0.985, top=0.8, bottom=0.12, wspace=0.18)
    legend(
        figure,
        [
            (f"{name} ({one.figures['objects']})", CLASS_COLOURS[name])
            for name, one in figures.classes.items()
        ],
        0.035,
        0.99,
    )
    _curves(figure.add_subplot(grid[0]), figures)
    _by(figure.add_subplot(grid[1]), figures, "range", "Found, by range, %")
    _by(figure.add_subplot(grid[2]), figures, "points", "Found, by points in the box, %")
    save(figure, path)


def _curves(axes: Axes, figures: Figures) -> None:
    plain(axes, "Precision over recall, by distance of centres, %")
    for name, one in figures.classes.items():
        if not one.found.total or not len(one.found.detection):
            continue
        hits = np.cumsum(one.found.right)
        precision = hits / np.arange(1, len(hits) + 1)
        recall = hits / one.found.total
        limit = f"{name}: {near(name).limit:g} m"
        axes.plot(100 * recall, 100 * precision, color=CLASS_COLOURS[name], lw=1.5, label=limit)
    axes.set(xlim=(0, 101), ylim=(0, 102))
    if axes.lines:
        axes.legend(fontsize=8, frameon=False, loc="lower left")


def _by(axes: Axes, figures: Figures, kind: str, title: str) -> None:
    """Draw the share that is found at the best threshold, a line for each class."""
    plain(axes, title)
    bins = list(
        dict.fromkeys(
            row["bin"]
            for one in figures.classes.values()
            for row in one.figures["by"]
            if row["by"] == kind
        )
    )
    bins.sort(key=lambda text: float(text.split()[0]))
    for name, one in figures.classes.items():
        rows = [row for row in one.figures["by"] if row["by"] == kind]
        at = [bins.index(row["bin"]) for row in rows]
        axes.plot(at, [100 * row["found"] for row in rows], "o-", color=CLASS_COLOURS[name], ms=4)
    short = [one.replace(" and more", "+").replace(" to ", "–") for one in bins]
    axes.set_xticks(range(len(bins)), [one.removesuffix(" points") for one in short], fontsize=7.5)
    axes.set_ylim(0, 102)
