"""Fates of the objects of recordings that differ in one factor, as bars."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from urbantwin.drawing import style

__all__ = ["fates_figure"]

_COLOURS = {
    "seen": "#5fd38d",
    "hidden": "#ff8f4d",
    "dropped": "#c76bd6",
    "out of view": "#5b6b7a",
    "turn lost": "#e8e36a",
}


def fates_figure(rows: Sequence[dict[str, Any]], factor: str) -> Figure:
    """Draw a bar for each recording: shares of its objects by their fate.

    Args:
        rows: ``name`` and ``fates`` (counts by fate) of each.
        factor: the factor that differs.
    """
    figure = style.new_figure(10.0, 1.9 + 0.55 * len(rows))
    height = figure.get_figheight()
    axes = figure.add_axes((0.24, 0.75 / height, 0.72, 1 - 1.75 / height))
    style.bare(axes)
    left = np.zeros(len(rows))
    places = np.arange(len(rows))[::-1]
    for fate, colour in _COLOURS.items():
        counts = np.array([row["fates"].get(fate, 0) for row in rows], float)
        total = np.array([max(sum(row["fates"].values()), 1) for row in rows], float)
        axes.barh(places, counts / total, left=left, color=colour, height=0.7, label=fate)
        for place, start, count, whole in zip(places, left, counts, total, strict=True):
            if count / whole > 0.06:
                at = start + count / whole / 2
                axes.text(at, place, f"{count:.0f}", ha="center", va="center", color=style.PAPER)
        left += counts / total
    axes.set_xlim(0, 1)
    axes.set_yticks(places, [style.legible(row["name"]) for row in rows], color=style.INK)
    axes.tick_params(left=False)
    style.title(figure, "What became of every object", f"{factor}   objects in all frames")
    figure.legend(
        loc="lower center", ncols=len(_COLOURS), frameon=False, labelcolor=style.INK, fontsize=10
    )
    return figure
