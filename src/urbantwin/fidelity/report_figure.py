"""The report's values as one picture."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from urbantwin.fidelity import histograms as bins
from urbantwin.fidelity.definitions import HEADLINE, MEASURES, PUBLISHED
from urbantwin.fidelity.report import Aggregate, Anchored, FrameFigures, Report
from urbantwin.fidelity.report_style import COLOURS, INK, LABELS, blank, legend, plain, save

__all__ = ["draw_report"]

_HISTOGRAMS = {
    "range": (
        bins.RANGE_EDGES_M,
        "Range: share of points (grey: real)",
        "distance from the sensor, m",
    ),
    "height": (
        bins.HEIGHT_EDGES_M,
        "Height: share of points (grey: real)",
        "z in the clouds' frame, m",
    ),
    "intensity": (
        bins.INTENSITY_EDGES,
        "Intensity: share of points (grey: real)",
        "share of full scale",
    ),
    "density": (bins.DENSITY_EDGES_M, "Density: share of the sum", "distance, m"),
}
_PUBLISHED = "published,\nother data"
#: Maximum share of the control on the axis, percent; larger shares are cut off.
_MOST_SHARE = 200.0


def draw_report(
    report: Report, pooled: Mapping[str, Mapping[str, NDArray[np.float64]]], path: Path
) -> None:
    """Draw the report.

    Args:
        report: the report.
        pooled: histograms summed over frames, by side ("real", "synthetic", "arbitrary") and name.
        path: the PNG to write; the same report gives the same bytes.
    """
    course = len(report.frames) > 1
    ratios = (1.25, 1.5, 0.8, 0.9) if course else (1.25, 1.5, 0.9)
    figure = blank(15, 3.1 * sum(ratios))
    grid = figure.add_gridspec(
        len(ratios),
        12,
        height_ratios=ratios,
        left=0.045,
        right=0.99,
        top=0.94,
        bottom=0.045,
        hspace=0.42,
        wspace=1.4,
    )
    sides = [side for side in COLOURS if _of(report.whole, side) is not None]
    legend(figure, [(LABELS[side], COLOURS[side]) for side in sides], 0.04, 0.995)
    said = "means over frames; black: their 95 % intervals"
    figure.text(0.99, 0.991, said, ha="right", va="top", fontsize=10, color=INK)
    for place, name in enumerate(HEADLINE):
        _headline(figure.add_subplot(grid[0, 4 * place : 4 * place + 4]), report, name)
    _divergences(figure.add_subplot(grid[1, :6]), report)
    _shares(figure.add_subplot(grid[1, 7:]), report)
    if course:
        for place, name in enumerate(HEADLINE):
            _course(figure.add_subplot(grid[2, 4 * place : 4 * place + 4]), report.frames, name)
    _distributions(figure, grid, len(ratios) - 1, pooled)
    save(figure, path)


def _of(found: Anchored, side: str) -> dict[str, Aggregate | None] | None:
    return {
        "real": found.real_against_real,
        "synthetic": found.twin,
        "arbitrary": found.arbitrary,
    }[side]


def _headline(axes: Axes, report: Report, name: str) -> None:
    measure = MEASURES[name]
    plain(axes, measure.title + (f" ({measure.unit})" if measure.unit else ""))
    parts = {"whole": report.whole, **report.parts}
    for place, found in enumerate(parts.values()):
        for side in COLOURS:
            value = (_of(found, side) or {}).get(name)
            if value is not None:
                _bar(axes, place, side, value.mean, value.mean_ci95)
    for side, figure in zip(("synthetic", "arbitrary"), PUBLISHED[name][:2], strict=True):
        _bar(axes, len(parts), side, figure, None, faint=True)
    axes.set_xticks(range(len(parts) + 1), [*parts, _PUBLISHED])
    axes.margins(y=0.14)
    axes.set_ylim(bottom=0)


def _bar(
    axes: Axes,
    place: int,
    side: str,
    value: float,
    interval: tuple[float, float] | None,
    *,
    faint: bool = False,
) -> None:
    width = 0.8 / len(COLOURS)
    x = place - 0.4 + width * (list(COLOURS).index(side) + 0.5)
    axes.bar(x, value, width * 0.92, color=COLOURS[side], alpha=0.35 if faint else 1.0)
    top = value
    if interval is not None:
        low, top = interval
        axes.plot([x, x], [low, top], color=INK, linewidth=1)
    axes.annotate(
        f"{value:.3g}" if value >= 0.01 or value == 0 else "<0.01",
        (x, max(top, value)),
        xytext=(0, 2),
        textcoords="offset points",
        ha="center",
        fontsize=7,
        color=INK,
    )


def _divergences(axes: Axes, report: Report) -> None:
    plain(axes, "Jensen-Shannon divergence by histogram (0 equal, 1 disjoint)")
    names = [name for name in MEASURES if name.startswith("js_")]
    for place, name in enumerate(names):
        for side in COLOURS:
            value = (_of(report.whole, side) or {}).get(name)
            if value is not None:
                _bar(axes, place, side, value.mean, value.mean_ci95)
    axes.set_xticks(range(len(names)), [MEASURES[name].title.removeprefix("JS ") for name in names])
    axes.margins(y=0.12)
    axes.set_ylim(bottom=0)


def _shares(axes: Axes, report: Report) -> None:
    """Draw every measure relative to the control; without a control, relative to real to real."""
    control, real = report.arbitrary, report.real_against_real
    below, title, most = control, "Every measure, percent of the arbitrary site's", _MOST_SHARE
    shown = ["real", "synthetic"]
    if control is None:
        below, title, most = real, "Every measure, percent of real against real", 1e9
        shown = ["synthetic"]
    plain(axes, title)
    axes.grid(visible=True, axis="x", color="#d5dbe2", linewidth=0.6)
    rows = []
    for name in MEASURES:
        base = (below or {}).get(name)
        if base is not None and base.mean > 0 and report.twin.get(name) is not None:
            rows.append((name, base.mean))
    shares = [
        (100 * value.mean / mean, place, side)
        for place, (name, mean) in enumerate(rows)
        for side in shown
        if (value := (_of(report.whole, side) or {}).get(name)) is not None
    ]
    seen = [100.0, *(share for share, *_ in shares if share > 0)]
    # a logarithmic axis has no 0, so zeros point towards it
    least = min(seen) / 1.5 if control is None else -np.inf
    for share, place, side in shares:
        marker = "<" if share < least else "o" if share <= most else ">"
        axes.plot(
            np.clip(share, least, most), -place, marker=marker, color=COLOURS[side], markersize=6,
            clip_on=False,
        )  # fmt: skip
    axes.axvline(100, color=COLOURS["arbitrary" if control is not None else "real"], linewidth=1.5)
    axes.set_yticks([-place for place in range(len(rows))], [MEASURES[n].title for n, _ in rows])
    axes.set_ylim(-max(len(rows), 1) + 0.5, 0.5)
    if control is None:
        axes.set_xscale("log")
        axes.set_xlim(least, min(max(seen), most) * 1.5)
    else:
        axes.set_xlim(left=-2)


def _course(axes: Axes, frames: list[FrameFigures], name: str) -> None:
    plain(axes, f"{MEASURES[name].title}, pair by pair")
    series: dict[str, list[dict[str, float | None] | None]] = {
        "real": [frame.real_figures for frame in frames],
        "synthetic": [frame.twin_figures for frame in frames],
        "arbitrary": [frame.arbitrary_figures for frame in frames],
    }
    marker = "o" if len(frames) < 60 else ""
    for side, found in series.items():
        given = [
            (i, f[name]) for i, f in enumerate(found) if f is not None and f.get(name) is not None
        ]
        if given:
            x, y = np.array(given, np.float64).T
            axes.plot(x, y, color=COLOURS[side], marker=marker, markersize=4, linewidth=1.4)
    axes.set_xlim(-0.5, len(frames) - 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_ylim(bottom=0)


def _distributions(
    figure: Figure,
    grid: GridSpec,
    row: int,
    pooled: Mapping[str, Mapping[str, NDArray[np.float64]]],
) -> None:
    shown = [name for name in _HISTOGRAMS if any(name in mine for mine in pooled.values())]
    lower: Any = grid[row, :].subgridspec(1, len(shown), wspace=0.2)
    for place, name in enumerate(shown):
        axes = figure.add_subplot(lower[0, place])
        edges, title, label = _HISTOGRAMS[name]
        plain(axes, title)
        _overlaid(axes, pooled, name, edges)
        axes.set_xlabel(label, fontsize=9, color=INK)


def _overlaid(
    axes: Axes,
    pooled: Mapping[str, Mapping[str, NDArray[np.float64]]],
    name: str,
    edges: NDArray[np.float64],
) -> None:
    held = np.zeros(len(edges) - 1)
    for side, mine in pooled.items():
        if name not in mine or not mine[name].sum():
            continue
        share = mine[name] / mine[name].sum()
        held += share
        axes.stairs(
            share,
            edges,
            color=COLOURS[side],
            fill=side == "real",
            alpha=0.55 if side == "real" else 1.0,
            linewidth=1.5,
        )
    # bins with all but the last thousandth of the points
    sums = np.cumsum(held) / max(held.sum(), 1e-300)
    low, high = np.searchsorted(sums, [0.0005, 0.9995])
    axes.set_xlim(edges[low], edges[min(high + 1, len(edges) - 1)])
    axes.set_ylim(bottom=0)
