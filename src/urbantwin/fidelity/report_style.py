"""The common style of a report's pictures: colours, axes, points from above."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "COLOURS",
    "FAINT",
    "INK",
    "LABELS",
    "LOST",
    "blank",
    "from_above",
    "legend",
    "plain",
    "save",
]

INK, FAINT, LOST = "#1d2733", "#d5dbe2", "#d11f3a"
COLOURS = {"real": "#7b8794", "synthetic": "#1769e0", "arbitrary": "#e8710a"}
LABELS = {
    "real": "real against the next real",
    "synthetic": "twin against real",
    "arbitrary": "arbitrary site against real",
}
#: Cells per edge of a picture from above.
_CELLS = 440


def blank(width: float, height: float) -> Figure:
    """Return an empty figure of a size in hundreds of pixels."""
    figure = Figure(figsize=(width, height), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write a PNG; the same figure gives the same bytes."""
    figure.savefig(path, metadata={"Software": None})


def plain(axes: Axes, title: str) -> None:
    """Set the title of axes and reduce their decoration."""
    axes.set_title(title, loc="left", fontsize=10, color=INK, weight="bold")
    axes.tick_params(colors=INK, labelsize=8, length=3)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(FAINT)
    axes.grid(visible=True, axis="y", color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)


def legend(figure: Figure, entries: Sequence[tuple[str, str]], x: float, y: float) -> None:
    """Draw a legend of colours in one line."""
    handles = [Line2D([], [], color=c, marker="s", linestyle="", label=t) for t, c in entries]
    figure.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=(x, y),
        ncols=len(entries),
        frameon=False,
        fontsize=10,
        handletextpad=0.2,
        borderpad=0.0,
    )


def from_above(
    axes: Axes,
    title: str,
    middle: NDArray[np.float64],
    reach: float,
    layers: Sequence[tuple[NDArray[np.float64], ArrayLike]],
) -> None:
    """Draw points from above.

    Args:
        axes: the axes.
        title: their title.
        middle: (3,) position of the sensor, marked by a cross.
        reach: half the edge of the square, metres.
        layers: points (N, 3), and a colour (3,) of all or (N, 3) of each, 0..1; later layers and
            higher points hide others.
    """
    picture = np.ones((_CELLS, _CELLS, 3))
    for points, colour in layers:
        shades = np.broadcast_to(np.asarray(colour, np.float64), (len(points), 3))
        cell = np.floor((points[:, :2] - middle[:2] + reach) / (2 * reach) * _CELLS)
        inside = np.flatnonzero(((cell >= 0) & (cell < _CELLS)).all(axis=1))
        inside = inside[np.argsort(points[inside, 2], kind="stable")]
        column, row = cell[inside].astype(np.int64).T
        picture[row, column] = shades[inside]
    axes.set_title(title, loc="left", fontsize=11, color=INK, weight="bold")
    x, y = middle[:2]
    axes.imshow(
        picture,
        origin="lower",
        extent=(x - reach, x + reach, y - reach, y + reach),
        interpolation="nearest",
    )
    axes.autoscale(False)
    axes.plot(x, y, marker="+", color=INK, markersize=10)
    axes.tick_params(labelsize=8)
    for spine in axes.spines.values():
        spine.set_color(FAINT)
