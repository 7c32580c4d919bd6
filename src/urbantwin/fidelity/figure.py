"""The report as one picture."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from urbantwin.fidelity import histograms as bins
from urbantwin.fidelity.definitions import MEASURES
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.report import Aggregate, FrameFigures, Report

__all__ = ["draw_report"]

_PAPER, _INK, _FAINT = "#ffffff", "#1d2733", "#d5dbe2"
_COLOURS = {"real": "#7b8794", "synthetic": "#1769e0", "arbitrary": "#e8710a"}
_LABELS = {
    "real": "real against the next real",
    "synthetic": "twin against real",
    "arbitrary": "arbitrary site against real",
}
_DISTANCES = ("hausdorff_p95_m", "point_to_mesh_mean_m", "point_to_mesh_p95_m")
_DIVERGENCES = ("js_occupancy", "js_range", "js_height", "js_intensity", "js_density", "js_mean")
_OVERLAY_CELLS = 260


def draw_report(
    report: Report,
    pooled: Mapping[str, Mapping[str, NDArray[np.float64]]],
    sample: Mapping[str, Frame],
    path: Path,
) -> None:
    """Write the picture.

    Args:
        report: the figures.
        pooled: histograms summed over frames, by side ("real", "synthetic", "arbitrary") and name.
        sample: the clouds of the first pair, by side.
        path: the PNG to write; the same report gives the same bytes.
    """
    figure = Figure(figsize=(16, 11.6), dpi=100, facecolor=_PAPER)
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        3, 12, left=0.05, right=0.98, top=0.885, bottom=0.055, hspace=0.42, wspace=1.6
    )
    _head(figure, report)
    _bars(figure.add_subplot(grid[0, :4]), report, _DISTANCES, "Distances, mean over frames", "m")
    _bars(
        figure.add_subplot(grid[0, 4:]),
        report,
        _DIVERGENCES,
        "Jensen-Shannon divergence, mean over frames (0 equal, 1 disjoint)",
        "",
    )
    _course(figure.add_subplot(grid[1, :4]), report.frames, "hausdorff_p95_m")
    _course(figure.add_subplot(grid[1, 4:8]), report.frames, "point_to_mesh_mean_m")
    _course(figure.add_subplot(grid[1, 8:]), report.frames, "js_mean")
    edges = {
        "range": (bins.RANGE_EDGES_M, "distance from the sensor, m"),
        "height": (bins.HEIGHT_EDGES_M, "height in the clouds' frame, m"),
        "intensity": (bins.INTENSITY_EDGES, "intensity, share of full scale"),
    }
    shown = [name for name in edges if any(name in mine for mine in pooled.values())]
    lower = grid[2, :].subgridspec(1, len(shown) + 1, wspace=0.22)
    for place, name in enumerate(shown):
        _overlaid(figure.add_subplot(lower[0, place]), pooled, name, *edges[name])
    _overlay(figure.add_subplot(lower[0, len(shown)]), sample)
    figure.savefig(path, metadata={"Software": None})


def _head(figure: Figure, report: Report) -> None:
    names = report.folders
    title = f"{names['synthetic']['name']} against {names['real']['name']}"
    figure.text(0.05, 0.965, f"Fidelity: {title}", color=_INK, fontsize=19, weight="bold")
    said = [f"{len(report.frames)} pairs of frames"]
    for name, unit in (("hausdorff_p95_m", " m"), ("js_mean", ""), ("point_to_mesh_mean_m", " m")):
        found = report.twin[name]
        if found is not None:
            text = f"{MEASURES[name].title} {found.mean:.3g}{unit}"
            less = (report.reduction_percent or {}).get(name)
            if less is not None:
                text += f" ({abs(less):.0f} % {'less' if less >= 0 else 'more'} than arbitrary)"
            said.append(text)
    figure.text(0.05, 0.938, "     ".join(said), color=_INK, fontsize=12)
    x = 0.98
    for side in ("arbitrary", "synthetic", "real"):
        if _of(report, side) is None:
            continue
        figure.text(
            x, 0.968, _LABELS[side], color=_COLOURS[side], fontsize=12, ha="right", weight="bold"
        )
        x -= 0.0068 * len(_LABELS[side]) + 0.015


def _of(report: Report, side: str) -> dict[str, Aggregate | None] | None:
    return {
        "real": report.real_against_real,
        "synthetic": report.twin,
        "arbitrary": report.arbitrary,
    }[side]


def _plain(axes: Axes, title: str) -> None:
    axes.set_facecolor(_PAPER)
    axes.set_title(title, loc="left", fontsize=11, color=_INK, weight="bold")
    axes.tick_params(colors=_INK, labelsize=9, length=3)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(_FAINT)
    axes.grid(visible=True, axis="y", color=_FAINT, linewidth=0.6)
    axes.set_axisbelow(True)


def _bars(axes: Axes, report: Report, names: tuple[str, ...], title: str, unit: str) -> None:
    _plain(axes, title)
    sides = [(s, found) for s in _COLOURS if (found := _of(report, s)) is not None]
    width = 0.8 / len(sides)
    for number, (side, found) in enumerate(sides):
        for place, name in enumerate(names):
            value = found[name]
            x = place - 0.4 + width * (number + 0.5)
            if value is None:
                axes.text(x, 0, "none", ha="center", va="bottom", fontsize=8, color=_COLOURS[side])
                continue
            axes.bar(x, value.mean, width * 0.92, color=_COLOURS[side])
            top = value.mean
            if value.mean_ci95 is not None:
                low, top = value.mean_ci95
                axes.plot([x, x], [low, top], color=_INK, linewidth=1)
            axes.annotate(
                f"{value.mean:.2f}" if value.mean >= 0.01 or value.mean == 0 else "<0.01",
                (x, max(top, value.mean)),
                xytext=(0, 2),
                textcoords="offset points",
                ha="center",
                fontsize=8,
                color=_INK,
            )
    labels = [MEASURES[name].title.replace("JS ", "").replace(", ", ",\n") for name in names]
    axes.set_xticks(range(len(names)), labels)
    axes.set_ylabel(unit, color=_INK, rotation=0, labelpad=8)
    axes.margins(y=0.12)
    axes.set_ylim(bottom=0)


def _course(axes: Axes, frames: list[FrameFigures], name: str) -> None:
    measure = MEASURES[name]
    _plain(
        axes, f"{measure.title}, frame by frame" + (f" ({measure.unit})" if measure.unit else "")
    )
    series: dict[str, list[dict[str, float | None] | None]] = {
        "real": [frame.real_figures for frame in frames],
        "synthetic": [frame.twin_figures for frame in frames],
        "arbitrary": [frame.arbitrary_figures for frame in frames],
    }
    marker = "o" if len(frames) < 60 else ""
    for side, found in series.items():
        given = [(i, f[name]) for i, f in enumerate(found) if f is not None and f[name] is not None]
        if given:
            x, y = np.array(given, np.float64).T
            axes.plot(x, y, color=_COLOURS[side], marker=marker, markersize=4, linewidth=1.4)
    axes.set_xlabel("pair", fontsize=9, color=_INK)
    axes.set_xlim(-0.5, len(frames) - 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_ylim(bottom=0)


def _overlaid(
    axes: Axes,
    pooled: Mapping[str, Mapping[str, NDArray[np.float64]]],
    name: str,
    edges: NDArray[np.float64],
    label: str,
) -> None:
    _plain(axes, f"{name.capitalize()}, share of points")
    held = np.zeros(len(edges) - 1)
    for side, mine in pooled.items():
        if name not in mine or not mine[name].sum():
            continue
        share = mine[name] / mine[name].sum()
        held += share
        axes.stairs(
            share,
            edges,
            color=_COLOURS[side],
            fill=side == "real",
            alpha=0.55 if side == "real" else 1.0,
            linewidth=1.5,
        )
    # The bins that hold all but the last thousandth of the points.
    sums = np.cumsum(held) / held.sum()
    low, high = np.searchsorted(sums, [0.0005, 0.9995])
    axes.set_xlim(edges[low], edges[min(high + 1, len(edges) - 1)])
    axes.set_ylim(bottom=0)
    axes.set_xlabel(label, fontsize=9, color=_INK)


def _overlay(axes: Axes, sample: Mapping[str, Frame]) -> None:
    """Draw cells from above: seen by both, by the real sensor alone, by the twin alone."""
    _plain(axes, "First pair from above (m)")
    axes.grid(visible=False)
    real, synthetic = sample["real"].points, sample["synthetic"].points
    middle = (np.percentile(real[:, :2], 2, axis=0) + np.percentile(real[:, :2], 98, axis=0)) / 2
    reach = float(np.percentile(np.abs(real[:, :2] - middle).max(axis=1), 97))
    edges = np.linspace(-reach, reach, _OVERLAY_CELLS + 1)
    seen = [
        np.histogram2d(p[:, 1] - middle[1], p[:, 0] - middle[0], (edges, edges))[0] > 0
        for p in (real, synthetic)
    ]
    picture = np.ones((*seen[0].shape, 3))
    picture[seen[0] & ~seen[1]] = to_rgb(_COLOURS["real"])
    picture[seen[1] & ~seen[0]] = to_rgb(_COLOURS["synthetic"])
    picture[seen[0] & seen[1]] = to_rgb(_INK)
    x, y = middle
    axes.imshow(
        picture,
        origin="lower",
        extent=(x - reach, x + reach, y - reach, y + reach),
        interpolation="nearest",
    )
    for place, (text, colour) in enumerate(
        (("both", _INK), ("real alone", _COLOURS["real"]), ("twin alone", _COLOURS["synthetic"]))
    ):
        axes.text(
            (0.0, 0.24, 0.62)[place],
            -0.13,
            f"■ {text}",
            transform=axes.transAxes,
            color=colour,
            fontsize=9,
            va="top",
        )
