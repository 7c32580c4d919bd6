"""The page of a placement and its pictures: the front, and its layouts from above."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.lines import Line2D

from urbantwin.fidelity.report_style import FAINT, INK, LOST, blank, plain, save
from urbantwin.pages import write_page
from urbantwin.studies.placement.measure import MEASURES
from urbantwin.studies.placement.place import Placed
from urbantwin.taxonomy import semantic_id
from urbantwin.twin import Twin

__all__ = ["write_report"]

#: Colours of models, distinguishable with colour blindness (Okabe and Ito 2008).
_MODELS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9")
_ROAD, _CROSSING, _BUILDING = "#e9edf1", "#cfd8e3", "#b9c1ca"
#: Number of layouts drawn from above, evenly spread over the front.
_DRAWN = 8
#: Most unseen actors listed on the page per layout; the table lists all.
_HIDDEN_LISTED = 40
#: Smallest half edge of a plan, and its margin around the sensors, metres.
_REACH_M, _AROUND_M = 45.0, 20.0


def write_report(folder: Path, placed: Placed, manifest: Mapping[str, Any]) -> None:
    """Write ``report.html`` and ``pictures/``; the same placement gives the same bytes.

    Args:
        folder: folder of the placement.
        placed: result of the search.
        manifest: content of ``placement.json``.
    """
    pictures = folder / "pictures"
    pictures.mkdir(exist_ok=True)
    _draw_front(placed, pictures / "front.png")
    _draw_layouts(placed, pictures / "layouts.png")
    write_page(
        folder / "report.html",
        "studies/placement/page.html.j2",
        name=placed.question.twin.manifest["name"],
        manifest=manifest,
        doubts=[f"{one['about']}: {one['problem']}" for one in manifest["warnings"]],
        measures=MEASURES,
        views=placed.question.views,
        front=[(placed.found[one.number], one) for one in placed.explained],
        pictures=pictures,
        listed=_HIDDEN_LISTED,
    )


def _draw_front(placed: Placed, path: Path) -> None:
    """Draw all layouts by cost and each other objective, with the front on top."""
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
                axes.vlines(costs[k], *bounds, color=INK, linewidth=0.6, alpha=0.4, zorder=2)
        best = axes.scatter(costs[front], figures[front], s=22, color=INK, zorder=3)
        if not number:
            labels = ("on the front, 95 % over actors", "other layouts")
            axes.legend((best, others), labels, frameon=False, fontsize=8, labelcolor=INK)
    figure.subplots_adjust(left=0.08 / len(names) + 0.02, right=0.98, top=0.9, bottom=0.1)
    save(figure, path)


def _draw_layouts(placed: Placed, path: Path) -> None:
    """Draw layouts of the front from above, from the cheapest to the most expensive."""
    spec, count = placed.question.spec, min(_DRAWN, len(placed.explained))
    chosen = np.linspace(0, len(placed.explained) - 1, count).round().astype(int).tolist()
    rows = 1 if count <= 4 else 2
    across = -(-count // rows)
    figure = blank(3.6 * across, 3.9 * rows + 0.3)
    reach_m = max(spec.candidates.within_m, _REACH_M) + _AROUND_M
    for number, k in enumerate(chosen):
        axes = figure.add_subplot(rows, across, number + 1)
        _draw_site(axes, placed.question.twin)
        _draw_layout(axes, placed, k)
        x, y = spec.middle_m
        axes.set(xlim=(x - reach_m, x + reach_m), ylim=(y - reach_m, y + reach_m))
        axes.set(aspect="equal", xticks=[], yticks=[])
        for spine in axes.spines.values():
            spine.set_color(FAINT)
    keys = [(_colour(k), Path(one.model).name) for k, one in enumerate(spec.models)]
    figure.legend(
        handles=[
            Line2D([], [], color=colour, marker="o", linestyle="", label=text)
            for colour, text in (*keys, (LOST, "an actor with fewer than 5 points"))
        ],
        loc="lower left",
        ncols=4,
        frameon=False,
        fontsize=8,
    )
    figure.subplots_adjust(left=0.01, right=0.99, top=0.9, bottom=0.08, hspace=0.22, wspace=0.04)
    save(figure, path)


def _colour(model: int) -> str:
    return _MODELS[model % len(_MODELS)]


def _draw_site(axes: Axes, twin: Twin) -> None:
    """Draw carriageways, crossings and buildings."""
    network = twin.roads
    roads = [network.carriageway(level) for level in network.levels]
    crossings = [lane.polygon for lane in network.lanes if lane.kind == "crossing"]
    roofs = twin.mesh.select(twin.mesh.semantic == semantic_id("building")).triangles()[:, :, :2]
    for areas, colour in ((roads, _ROAD), (crossings, _CROSSING)):
        for part in shapely.get_parts(shapely.union_all(areas)):
            for ring, fill in (
                (part.exterior, colour),
                *((one, "white") for one in part.interiors),
            ):
                axes.fill(*shapely.get_coordinates(ring).T, facecolor=fill, edgecolor="none")
    axes.add_collection(PolyCollection(list(roofs), facecolor=_BUILDING, edgecolor=_BUILDING))


def _draw_layout(axes: Axes, placed: Placed, number: int) -> None:
    """Draw the sensors of a layout of the front, and the actors that it does not see."""
    views, explained = placed.question.views, placed.explained[number]
    found = placed.found[explained.number]
    if explained.hidden:
        x, y = np.array([one.middle for one in explained.hidden]).T
        axes.scatter(x, y, s=6, color=LOST, zorder=3)
    for chosen in found.layout:
        view = views.every[chosen]
        mount = views.mounts[view.mount]
        at = (mount.east_m, mount.north_m)
        axes.scatter(*at, s=46, color=_colour(view.model), edgecolor="white", zorder=4)
    values = found.verdict.values
    axes.set_title(
        f"layout {explained.number}: cost {values['cost']:,.0f}\n"
        f"20 points: {100 * values['seen_20']:.0f} %; 5, one failed: "
        f"{100 * values['seen_5_one_failed']:.0f} %",
        fontsize=8,
        color=INK,
        loc="left",
    )
