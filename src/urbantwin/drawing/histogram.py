"""Number of points and objects of each class in a dataset."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from urbantwin.drawing import style
from urbantwin.taxonomy import ACTOR_CLASSES, semantic_classes

__all__ = ["histogram", "histogram_figure"]

#: Width of a character of the numbers beside bars, inches.
_CHARACTER_IN = 0.09


def histogram(
    points_by_class: Mapping[str, int],
    boxes: Mapping[str, int],
    boxes_with_points: Mapping[str, int],
    path: Path,
    *,
    title: str = "",
    below: str = "",
    attribution: str | Iterable[str] = (),
) -> Path:
    """Draw points per semantic class and boxes per class of actors, on logarithmic scales.

    Args:
        points_by_class: number of points by name of ``taxonomy.semantic_classes``.
        boxes: number of boxes by name of ``taxonomy.ACTOR_CLASSES``, over all frames.
        boxes_with_points: number of boxes with at least one return.
        path: the PNG to write.
        title: title of the picture.
        below: a line under the title.
        attribution: sources of the data.
    """
    figure = histogram_figure(
        points_by_class,
        boxes,
        boxes_with_points,
        title=title,
        below=below,
        attribution=attribution,
    )
    return style.save(figure, path)


def histogram_figure(
    points_by_class: Mapping[str, int],
    boxes: Mapping[str, int],
    boxes_with_points: Mapping[str, int],
    *,
    title: str = "",
    below: str = "",
    attribution: str | Iterable[str] = (),
) -> Figure:
    """Return the figure of ``histogram``."""
    figure = style.new_figure(14, 7.6)
    style.title(figure, title or "Points and boxes per class", below)
    left = figure.add_axes((0.115, 0.11, 0.45, 0.72))
    known = semantic_classes()
    rows = sorted(
        ((count, name) for name, count in points_by_class.items() if count > 0), reverse=True
    )
    numbers = [known[name].id if name in known else 0 for _, name in rows]
    _bars(
        left,
        [name for _, name in rows],
        [count for count, _ in rows],
        style.class_colours(numbers) if rows else np.zeros((0, 3)),
        "Points per class",
    )
    right = figure.add_axes((0.685, 0.11, 0.285, 0.72))
    names = list(ACTOR_CLASSES)
    totals = [int(boxes.get(name, 0)) for name in names]
    seen = [int(boxes_with_points.get(name, 0)) for name in names]
    colours = np.array([style.actor_colour(name) for name in names])
    _bars(right, names, totals, colours, "Boxes per class (with points)", within=seen)
    style.written_attribution(figure, attribution)
    return figure


def _bars(
    axes: Axes,
    names: list[str],
    counts: list[int],
    colours: NDArray[np.float64],
    heading: str,
    within: list[int] | None = None,
) -> None:
    """Draw horizontal bars, the first on top; ``within`` fills a part of each."""
    axes.set_facecolor(style.PAPER)
    axes.set_title(heading, loc="left", color=style.INK, fontsize=13, weight="bold", pad=12)
    axes.set_xscale("log")
    axes.minorticks_off()  # they would not be visible, but take half of the time
    texts = [f"{count:,}" for count in counts]
    if within is not None:
        texts = [f"{text} ({part:,})" for text, part in zip(texts, within, strict=True)]
    # The longest bar leaves room for the longest text behind it.
    width_in = axes.get_window_extent().width / axes.figure.dpi
    room = 0.03 + _CHARACTER_IN * max(map(len, texts), default=0) / width_in
    top = max([*counts, 10])
    axes.set_xlim(0.8, max(top * 6.0, 0.8 * (top / 0.8) ** (1 / (1 - room))))
    axes.set_ylim(len(names) - 0.4, -0.6)
    for place, (count, colour, text) in enumerate(zip(counts, colours, texts, strict=True)):
        if within is None:
            axes.barh(place, count, left=0, height=0.72, color=colour)
        else:
            axes.barh(place, count, height=0.72, color=colour, alpha=0.35)
            axes.barh(place, within[place], height=0.72, color=colour)
        axes.text(max(count, 0.8) * 1.12, place, text, color=style.INK, fontsize=10.5, va="center")
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(axis="y", colors=style.INK, labelsize=11, length=0)
    axes.tick_params(axis="x", colors=style.MUTED, labelsize=9, which="both", length=0)
    axes.grid(visible=True, axis="x", color=style.FAINT, linewidth=0.8)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_visible(False)
