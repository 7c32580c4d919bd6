"""Pictures of a placement: the front, and its layouts from above."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from urbantwin.fidelity.report_style import FAINT, INK, LOST, blank, plain, save
from urbantwin.studies.placement.measure import MEASURES
from urbantwin.studies.placement.place import Placed
from urbantwin.studies.placement.site_plan import Rings

__all__ = ["MODEL_COLOURS", "draw_front", "draw_layouts"]

#: Of models, apart for people who see no red or no green (Okabe and Ito 2008).
MODEL_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9")
_GROUND = {"road": "#e9edf1", "crossing": "#cfd8e3", "building": "#b9c1ca"}
#: So many layouts are drawn, evenly spread over the front.
_DRAWN = 8


def draw_front(placed: Placed, path: Path) -> None:
    """Draw all layouts by cost and each other objective, the front above them."""
    names = [name for name in placed.question.spec.objectives if name != "cost"] or ["seen_20"]
    figure = blank(5.2 * len(names), 4.2)
    front = list(placed.front)
    for number, name in enumerate(names):
        axes = figure.add_subplot(1, len(names), number + 1)
        measure = MEASURES[name]
        plain(axes, f"{name}{f', {measure.unit}' if measure.unit else ''}, over cost")
        values = [(one.verdict.values["cost"], one.verdict.values[name]) for one in placed.found]
        costs, figures = np.array(values).T
        others = axes.scatter(costs, figures, s=9, color=FAINT, zorder=1)
        for k in front:
            bounds = placed.found[k].verdict.intervals.get(name)
            if bounds is not None:
                axes.plot(
                    [costs[k], costs[k]], bounds, color=INK, linewidth=0.6, alpha=0.4, zorder=2
                )
        best = axes.scatter(costs[front], figures[front], s=22, color=INK, zorder=3)
        if not number:
            told = ("on the front, 95 % over actors", "other layouts")
            axes.legend((best, others), told, frameon=False, fontsize=8, labelcolor=INK)
    figure.subplots_adjust(left=0.08 / len(names) + 0.02, right=0.98, top=0.9, bottom=0.1)
    save(figure, path)


def draw_layouts(placed: Placed, plan: Mapping[str, Rings], reach_m: float, path: Path) -> None:
    """Draw layouts of the front from above, from the cheapest to the dearest."""
    front = list(placed.front)
    count = min(_DRAWN, len(front))
    chosen = [front[round(k * (len(front) - 1) / max(count - 1, 1))] for k in range(count)]
    chosen = list(dict.fromkeys(chosen))
    rows = 1 if len(chosen) <= 4 else 2
    across = -(-len(chosen) // rows)
    figure = blank(3.6 * across, 3.9 * rows)
    for number, k in enumerate(chosen):
        axes = figure.add_subplot(rows, across, number + 1)
        _layout(axes, placed, k, plan, reach_m)
    figure.subplots_adjust(left=0.01, right=0.99, top=0.9, bottom=0.02, hspace=0.22, wspace=0.04)
    save(figure, path)


def _layout(
    axes: Axes, placed: Placed, number: int, plan: Mapping[str, Rings], reach_m: float
) -> None:
    views, verdict = placed.question.views, placed.found[number].verdict
    for name, colour in _GROUND.items():
        axes.add_collection(PolyCollection(plan[name], facecolor=colour, edgecolor="none"))
    hidden = next(one.hidden for one in placed.explained if one.number == number)
    if hidden:
        x, y = np.array([one.middle for one in hidden]).T
        axes.scatter(x, y, s=6, color=LOST)
    for chosen in placed.found[number].layout:
        view = views.every[chosen]
        mount = views.mounts[view.mount]
        colour = MODEL_COLOURS[view.model % len(MODEL_COLOURS)]
        axes.scatter(mount.east_m, mount.north_m, s=46, color=colour, edgecolor="white", zorder=4)
    middle = placed.question.spec.middle_m
    axes.set(
        xlim=(middle[0] - reach_m, middle[0] + reach_m),
        ylim=(middle[1] - reach_m, middle[1] + reach_m),
        aspect="equal",
        xticks=[],
        yticks=[],
    )
    for spine in axes.spines.values():
        spine.set_color(FAINT)
    values = verdict.values
    axes.set_title(
        f"layout {number}: cost {values['cost']:,.0f}\n"
        f"20 points: {100 * values['seen_20']:.0f} %; 5, one failed: "
        f"{100 * values['seen_5_one_failed']:.0f} %",
        fontsize=8,
        color=INK,
        loc="left",
    )
