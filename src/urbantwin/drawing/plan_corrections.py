"""Corrections on a plan: their numbers at their positions, and a list of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from urbantwin.drawing import style
from urbantwin.drawing.plan_style import Look
from urbantwin.twin import Corrected

__all__ = ["draw_corrections", "list_corrections", "list_height"]

#: Columns and maximum number of rows of the list; the list refers to the manifest for the others.
COLUMNS, MOST = 2, 40
#: Height of a row and of the list's title, inches; sizes of text, points.
ROW, TITLE = 0.2, 0.3
TEXT, NUMBER = 8.0, 8.0
LONGEST = 88


def draw_corrections(
    axes: Axes, corrections: Sequence[Corrected], look: Look, metre_per_point: float
) -> list[shapely.Geometry]:
    """Draw lines and points of corrections with their numbers; return the covered areas.

    Corrections that were not applied are dashed and hollow.
    """
    taken = []
    for one in corrections:
        colour = look.correction
        for points in one.at_m:
            xy = np.asarray(points, np.float64)
            if len(xy) > 1:
                axes.plot(
                    *xy.T, color=colour, linewidth=2.0, zorder=47,
                    linestyle="-" if one.applied else (0, (2, 2)),
                    path_effects=[withStroke(linewidth=3.6, foreground=look.halo)],
                )  # fmt: skip
            else:
                face = colour if one.applied else "none"
                axes.plot(
                    *xy.T, "s", markerfacecolor=face, markeredgecolor=colour, markersize=5,
                    markeredgewidth=1.4, zorder=47,
                )  # fmt: skip
        if one.at_m:
            first = np.asarray(one.at_m[0], np.float64)
            # The number of a line is in its middle, so that it hides no end.
            place = first[0]
            if len(first) > 1:
                line = shapely.LineString(first)
                place = shapely.get_coordinates(line.interpolate(0.5, normalized=True))[0]
            taken.append(_number(axes, one, place, look, metre_per_point))
    return taken


def _number(
    axes: Axes, one: Corrected, at: NDArray[np.float64], look: Look, metre_per_point: float
) -> shapely.Geometry:
    """Write a number in a round label beside a place."""
    axes.annotate(
        str(one.number),
        (float(at[0]), float(at[1])),
        xytext=(9, 9),
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=NUMBER,
        weight="bold",
        color=look.page if one.applied else look.correction,
        zorder=48,
        annotation_clip=True,
        bbox={
            "boxstyle": "circle,pad=0.22",
            "facecolor": look.correction if one.applied else look.page,
            "edgecolor": look.correction,
            "linewidth": 1.2,
        },
    )
    middle = at + 9 * metre_per_point
    return shapely.Point(middle).buffer(9 * metre_per_point)


def list_height(corrections: Sequence[Corrected]) -> float:
    """Return the height of the list, inches."""
    rows = -(-min(len(corrections), MOST + 1) // COLUMNS)
    return TITLE + ROW * rows if corrections else 0.0


def list_corrections(
    figure: Figure, corrections: Sequence[Corrected], look: Look, *, left: float, top: float
) -> None:
    """Write the description of each number, in columns from ``top`` downwards.

    Args:
        figure: the sheet.
        corrections: the corrections.
        look: colours.
        left: left border of the list, inches.
        top: position of its title, inches from the bottom.
    """
    width, height = figure.get_figwidth(), figure.get_figheight()
    done = sum(one.applied for one in corrections)
    title = f"corrections: {done} applied"
    if done < len(corrections):
        title += f", {len(corrections) - done} not (dashed)"
    figure.text(left / width, top / height, title, color=look.ink, fontsize=9, va="top")
    texts = [
        f"{one.number}  {one.what}: {'' if one.applied else 'NOT APPLIED, '}{one.told}"
        for one in corrections[:MOST]
    ]
    if len(corrections) > MOST:
        texts.append(f"and {len(corrections) - MOST} more, in twin.json")
    rows = -(-len(texts) // COLUMNS)
    for k, text in enumerate(texts):
        column, row = divmod(k, rows)
        short = style.legible(" ".join(text.split()))
        short = short if len(short) <= LONGEST else short[: LONGEST - 3] + "..."
        figure.text(
            (left + column * (width - 2 * left) / COLUMNS) / width,
            (top - TITLE + 0.06 - row * ROW) / height,
            short,
            color=look.correction if k >= len(corrections) or corrections[k].applied else look.ink,
            fontsize=TEXT,
            va="top",
            parse_math=False,  # tags are a stranger's text
        )
