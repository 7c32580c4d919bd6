"""Effects as a picture: of every level the difference to the base, with its interval."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from urbantwin.fidelity.report_style import COLOURS, FAINT, INK, LOST, blank, plain, save

__all__ = ["draw_effects", "draw_levels"]

#: Figures that are drawn, with the factor that tells them in their unit, and their title.
_SHOWN: Mapping[str, tuple[float, str]] = {
    "ap": (100, "average precision, %"),
    "hota": (100, "HOTA, %"),
    "idf1": (100, "IDF1, %"),
    "mota": (100, "MOTA, %"),
    "points": (1, "points on an object"),
    "seen": (100, "objects with 5 points, %"),
    "in_box": (100, "points in their boxes, %"),
}
_COLUMNS = 3


def _shown(effects: Sequence[Mapping[str, Any]], name: str) -> list[str]:
    there = {row["figure"] for row in effects if row["class"] == name}
    return [one for one in _SHOWN if one in there]


def draw_effects(effects: Sequence[Mapping[str, Any]], name: str, path: Path) -> None:
    """Draw the main effects on a class: a panel for every figure, a line for every level.

    Args:
        effects: of `effects.main_effects_of`; at least one of the class.
        name: of the class.
        path: the PNG to write.
    """
    figures = _shown(effects, name)
    labels = list(
        dict.fromkeys(
            f"{row['factor']} = {row['level']}" for row in effects if row["class"] == name
        )
    )
    columns = min(_COLUMNS, len(figures))
    rows = -(-len(figures) // columns)
    height = 0.7 + rows * (1.2 + 0.26 * len(labels))
    figure = blank(13, height)
    grid = figure.add_gridspec(
        rows,
        columns,
        left=0.2,
        right=0.985,
        bottom=0.4 / height,
        top=1 - 0.75 / height,
        hspace=0.4,
        wspace=0.08,
    )
    title = f"Difference to the base level: {name}"
    figure.text(0.012, 1 - 0.22 / height, title, color=INK, fontsize=12, weight="bold", va="center")
    for number, key in enumerate(figures):
        axes = figure.add_subplot(grid[number // columns, number % columns])
        mine = {
            f"{row['factor']} = {row['level']}": row
            for row in effects
            if row["class"] == name and row["figure"] == key
        }
        _forest(axes, labels, mine, key, named=number % columns == 0)
    save(figure, path)


def _forest(
    axes: Axes,
    labels: Sequence[str],
    rows: Mapping[str, Mapping[str, Any]],
    key: str,
    *,
    named: bool,
) -> None:
    times, title = _SHOWN[key]
    worse = -1.0  # more of every figure that is drawn is better
    for place, label in enumerate(labels):
        row = rows.get(label)
        if row is None:
            continue
        middle = times * row["difference"]
        sure = row["low"] is not None and not row["low"] <= 0 <= row["high"]
        colour = (
            COLOURS["real"] if not sure else LOST if middle * worse > 0 else COLOURS["synthetic"]
        )
        if row["low"] is not None:
            axes.plot([times * row["low"], times * row["high"]], [place, place], color=colour, lw=2)
        axes.plot(middle, place, "o", color=colour, markersize=5)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    plain(axes, title)
    axes.grid(visible=True, axis="x", color=FAINT, linewidth=0.6)
    axes.set_ylim(len(labels) - 0.5, -0.5)
    axes.set_yticks(range(len(labels)), list(labels) if named else [""] * len(labels))


def draw_levels(
    measured: Sequence[tuple[str, str, int, Mapping[str, float]]], name: str, path: Path
) -> None:
    """Draw the figures of a class over the levels of each factor, a line for every seed.

    Args:
        measured: factor, level, seed and figures, the base level of each factor first; not empty.
        name: of the class.
        path: the PNG to write.
    """
    factors = list(dict.fromkeys(factor for factor, *_ in measured))
    figures = [one for one in _SHOWN if any(one in row for *_, row in measured)]
    width, height = 1.2 + 2.4 * len(factors), 1.1 + 1.9 * len(figures)
    figure = blank(width, height)
    grid = figure.add_gridspec(
        len(figures),
        len(factors),
        left=0.9 / width,
        right=1 - 0.2 / width,
        bottom=0.4 / height,
        top=1 - 0.75 / height,
        hspace=0.35,
        wspace=0.12,
    )
    title = f"Levels, a line for every seed: {name}"
    figure.text(
        0.15 / width, 1 - 0.22 / height, title, color=INK, fontsize=12, weight="bold", va="center"
    )
    for row, key in enumerate(figures):
        times, title = _SHOWN[key]
        first: Axes | None = None
        for column, factor in enumerate(factors):
            axes = figure.add_subplot(grid[row, column], sharey=first)
            first = first or axes
            mine = [one for one in measured if one[0] == factor]
            levels = list(dict.fromkeys(level for _, level, *_ in mine))
            for seed in dict.fromkeys(one[2] for one in mine):
                places = [
                    (levels.index(level), times * told[key])
                    for _, level, its, told in mine
                    if its == seed and key in told
                ]
                axes.plot(*zip(*places, strict=True), "o-", lw=1, ms=3, color=COLOURS["synthetic"],
                          alpha=0.6)  # fmt: skip
            plain(axes, factor if row == 0 else "")
            axes.set_xticks(range(len(levels)), levels if row == len(figures) - 1 else [])
            # Names of levels at the edges of neighbours stay apart.
            axes.set_xlim(-0.35, len(levels) - 0.65)
            axes.tick_params(labelleft=column == 0)
            if column == 0:
                axes.set_ylabel(title, fontsize=8, color=INK)
    save(figure, path)
