"""Pictures of all boxes of a dataset: points by range, sizes, boxes per frame, positions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, LogNorm, to_hex
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from urbantwin.dataset.card.page import PICTURE_OF_SPLIT
from urbantwin.dataset.card.statistics import BoxStatistics
from urbantwin.drawing import style
from urbantwin.taxonomy import BOX_SEMANTICS

__all__ = [
    "box_sizes_figure",
    "objects_per_frame_figure",
    "picture_of_split",
    "pictures_of_boxes",
    "places_figure",
    "points_by_range_figure",
]

#: Width of a range bin for a median, metres, and its minimum number of boxes.
_BIN_M, _LEAST = 5.0, 5
#: Maximum number of dots per class; of more boxes an even selection is drawn.
_DOTS = 4000
#: Side of a cell of the map, metres.
_CELL_M = 1.0
_SIDES = ("length, m", "width, m", "height, m")


def pictures_of_boxes(
    statistics: BoxStatistics,
    splits: Mapping[str, Sequence[str]],
    out: Path,
    attribution: str | Iterable[str] = (),
) -> list[Path]:
    """Draw statistics of all boxes of a dataset into a folder.

    Args:
        statistics: statistics of the boxes.
        splits: names of the frames of each split.
        out: the folder; pictures with these names are replaced.
        attribution: sources of the data.
    """
    drawings: dict[str, Callable[[], Figure]] = {
        "points_by_range.png": lambda: points_by_range_figure(statistics, attribution),
        "box_sizes.png": lambda: box_sizes_figure(statistics, attribution),
        PICTURE_OF_SPLIT: lambda: objects_per_frame_figure(statistics, splits, attribution),
        "places.png": lambda: places_figure(statistics, attribution),
    }
    out.mkdir(parents=True, exist_ok=True)
    return [style.save(draw(), out / name) for name, draw in drawings.items()]


def picture_of_split(
    statistics: BoxStatistics,
    splits: Mapping[str, Sequence[str]],
    file: Path,
    attribution: str | Iterable[str] = (),
) -> Path:
    """Draw the picture of a split; see `objects_per_frame_figure`."""
    return style.save(objects_per_frame_figure(statistics, splits, attribution), file)


def points_by_range_figure(
    statistics: BoxStatistics, attribution: str | Iterable[str] = ()
) -> Figure:
    """Draw points on boxes against their distance: a dot each, and medians of each class."""
    figure = style.new_figure(12, 7)
    seen = statistics.seen & np.isfinite(statistics.range_m)
    below = f"{int(seen.sum()):,} boxes with points; lines: medians of {_BIN_M:g} m"
    style.title(figure, "Points on a box by its distance", below)
    axes = _axes(figure, (0.075, 0.1, 0.9, 0.74))
    axes.set_yscale("log")
    axes.minorticks_off()  # they would not be visible, but take half of the time
    furthest, most, colours = 10.0, 10.0, _colours(statistics.names)
    for name in statistics.names:
        mine = np.flatnonzero(seen & (statistics.kind == name))
        if not len(mine):
            continue
        away, points = statistics.range_m[mine], statistics.points[mine]
        furthest, most = max(furthest, float(away.max())), max(most, float(points.max()))
        colour = colours[name]
        some = slice(None, None, -(-len(mine) // _DOTS))
        axes.scatter(away[some], points[some], s=4, color=colour, alpha=0.25, linewidths=0)
        bins = (away // _BIN_M).astype(int)
        kept = [one for one in np.unique(bins) if (bins == one).sum() >= _LEAST]
        medians = [float(np.median(points[bins == one])) for one in kept]
        middle = [(one + 0.5) * _BIN_M for one in kept]
        axes.plot(middle, medians, color=colour, linewidth=2, label=name, marker="o", ms=3)
    axes.set_xlim(0, furthest * 1.03)
    axes.set_ylim(0.8, most * 1.6)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
    axes.set_xlabel("distance in plan from the nearest sensor, m", color=style.MUTED)
    axes.set_ylabel("points", color=style.MUTED)
    _legend(axes)
    style.written_attribution(figure, attribution)
    return figure


def box_sizes_figure(statistics: BoxStatistics, attribution: str | Iterable[str] = ()) -> Figure:
    """Draw length, width and height of the actors of each class, one value for each track."""
    figure = style.new_figure(12, 2.1 + 0.5 * max(len(statistics.names), 2))
    inch, colours = 1.0 / figure.get_figheight(), _colours(statistics.names)
    below = "Each actor once: middle half (box), 5 to 95 % (line), median (mark)"
    style.title(figure, "Sizes of the actors", below)
    for side, heading in enumerate(_SIDES):
        bottom, top = 0.75 * inch, 1.0 - 1.0 * inch
        axes = _axes(figure, (0.11 + 0.298 * side, bottom, 0.26, top - bottom))
        axes.set_xlabel(heading, color=style.MUTED)
        axes.set_ylim(len(statistics.names) - 0.4, -0.6)
        names = statistics.names if side == 0 else [""] * len(statistics.names)
        axes.set_yticks(range(len(statistics.names)), names)
        axes.tick_params(axis="y", colors=style.INK, labelsize=11, length=0)
        largest = 0.0
        for row, name in enumerate(statistics.names):
            values = statistics.track_sizes(name)[:, side]
            low, quarter, middle, third, high = np.percentile(values, [5, 25, 50, 75, 95])
            largest = max(largest, float(high))
            colour = colours[name]
            axes.plot([low, high], [row, row], color=colour, linewidth=1.5)
            axes.barh(row, third - quarter, left=quarter, height=0.5, color=colour, alpha=0.6)
            axes.plot([middle, middle], [row - 0.25, row + 0.25], color=style.INK, linewidth=2)
        axes.set_xlim(0, max(largest, 1.0) * 1.08)
    style.written_attribution(figure, attribution)
    return figure


def objects_per_frame_figure(
    statistics: BoxStatistics,
    splits: Mapping[str, Sequence[str]],
    attribution: str | Iterable[str] = (),
) -> Figure:
    """Draw the number of boxes with points in each frame, by class, and its split."""
    figure = style.new_figure(12, 6)
    count = len(statistics.frames)
    mean = statistics.seen.sum() / max(count, 1)
    below = f"{count:,} frames; {mean:.1f} boxes with points in the mean frame"
    style.title(figure, "Boxes with points in each frame", below)
    axes = _axes(figure, (0.075, 0.16, 0.9, 0.66))
    names = list(reversed(statistics.names))
    rows = np.array(
        [
            np.bincount(
                statistics.frame[statistics.seen & (statistics.kind == name)], minlength=count
            )
            for name in names
        ]
    ).reshape(len(names), count)
    shown = [k for k, row in enumerate(rows) if row.any()]
    colours = _colours(statistics.names)
    if shown:
        # A step for each frame: there are no values between two frames.
        edges = np.arange(count + 1)
        heights = np.hstack([rows[shown], rows[shown][:, -1:]])
        axes.stackplot(
            edges,
            heights,
            step="post",
            colors=[to_hex(tuple(colours[names[k]].tolist())) for k in shown],
            labels=[names[k] for k in shown],
        )
    top = float(rows.sum(axis=0).max(initial=1)) * 1.08
    axes.set_ylim(-0.055 * top, top)
    axes.set_xlim(0, max(count, 1))
    axes.set_xlabel("frame, in the order of time; the bar below: its split", color=style.MUTED)
    axes.set_ylabel("boxes", color=style.MUTED)
    number = {name: k for k, name in enumerate(statistics.frames)}
    tones = (style.MUTED, style.ACCENT, "#6db3f2", "#e0729d", "#8fd694")
    for place, (split, frames) in reversed(list(enumerate(splits.items()))):
        tone = tones[place % len(tones)]
        spans = [(number[one], 1) for one in frames if one in number]
        axes.broken_barh(spans, (-0.05 * top, 0.04 * top), color=tone, linewidth=0, label=split)
    _legend(axes, reverse=True)
    style.written_attribution(figure, attribution)
    return figure


def places_figure(statistics: BoxStatistics, attribution: str | Iterable[str] = ()) -> Figure:
    """Draw the number of boxes with points in each square metre of the site, from above."""
    figure = style.new_figure(10, 9.4)
    seen = np.flatnonzero(statistics.seen)
    below = f"{len(seen):,} boxes with points, by square metre; north is up"
    style.title(figure, "Where road users are", below)
    axes = _axes(figure, (0.08, 0.075, 0.78, 0.8))
    axes.set_aspect("equal")
    axes.grid(visible=False)
    xy = statistics.site_xy[seen]
    low = np.floor(xy.min(axis=0, initial=-10)) - 3
    high = np.ceil(xy.max(axis=0, initial=10)) + 3
    edges = [np.arange(low[k], high[k] + _CELL_M, _CELL_M) for k in range(2)]
    counts = np.histogram2d(xy[:, 0], xy[:, 1], bins=edges)[0]
    shades = LinearSegmentedColormap.from_list(
        "places", ["#1d3247", "#2f6f9f", "#69c3c9", style.ACCENT, "#ffffff"]
    )
    drawn = axes.pcolormesh(
        edges[0],
        edges[1],
        np.ma.masked_less(counts.T, 1),
        cmap=shades,
        norm=LogNorm(1, max(counts.max(initial=1.0), 2.0)),
    )
    axes.set_xlabel("east, m", color=style.MUTED)
    axes.set_ylabel("north, m", color=style.MUTED)
    bar = figure.colorbar(drawn, cax=figure.add_axes((0.88, 0.075, 0.02, 0.8)))
    bar.set_label("boxes", color=style.MUTED)
    bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
    bar.ax.tick_params(colors=style.MUTED, labelsize=9)
    bar.outline.set_visible(False)
    style.written_attribution(figure, attribution)
    return figure


def _axes(figure: Figure, place: tuple[float, float, float, float]) -> Axes:
    axes = figure.add_axes(place)
    axes.set_facecolor(style.PAPER)
    axes.tick_params(colors=style.MUTED, labelsize=9, which="both", length=0)
    axes.grid(visible=True, color=style.FAINT, linewidth=0.8)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_visible(False)
    return axes


def _legend(axes: Axes, *, reverse: bool = False) -> None:
    """Draw the legend of the colours above the axes, on the right."""
    handles, _ = axes.get_legend_handles_labels()
    if handles:
        axes.legend(
            loc="lower right",
            bbox_to_anchor=(1.0, 1.0),
            ncols=-(-len(handles) // 2),
            frameon=False,
            labelcolor=style.INK,
            fontsize=10,
            reverse=reverse,
        )


def _colours(names: Sequence[str]) -> dict[str, NDArray[np.float64]]:
    """Return a colour for each class: the taxonomy's, or a lighter one if it is already used."""
    found: dict[str, NDArray[np.float64]] = {}
    for name in names:
        known = name in BOX_SEMANTICS
        colour = style.actor_colour(name) if known else np.array([0.6, 0.65, 0.7])
        while any(np.allclose(colour, one) for one in found.values()):
            colour = colour + 0.45 * (1.0 - colour)
        found[name] = colour
    return found
