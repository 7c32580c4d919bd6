"""The picture of objects in real boxes: points, shape, codes, losses, and some of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from urbantwin.fidelity.objects.measure import ObjectSeen
from urbantwin.fidelity.report_style import COLOURS, FAINT, INK, blank, legend, plain, save

__all__ = ["draw_objects_seen"]

#: So many objects are drawn.
_SHOWN = 8
_REAL, _OURS = COLOURS["real"], COLOURS["synthetic"]


def draw_objects_seen(
    seen: Sequence[ObjectSeen], rows: Sequence[dict[str, Any]], path: Path
) -> None:
    """Write the picture.

    Args:
        seen: the objects.
        rows: their figures.
        path: the PNG to write.
    """
    figure = blank(15, 12.0)
    grid = figure.add_gridspec(
        4, 4, left=0.05, right=0.99, top=0.94, bottom=0.04, hspace=0.45, wspace=0.25
    )
    legend(figure, [("real", _REAL), ("ours", _OURS)], 0.035, 0.995)
    whole = [row for row in rows if (row["from_m"], row["to_m"]) == (0.0, 80.0)]
    names = [row["class"] for row in whole]
    _spread(figure.add_subplot(grid[0, :2]), seen, names)
    _chamfers(figure.add_subplot(grid[0, 2:]), seen, names)
    for place, (key, title) in enumerate(
        (
            ("lost_opaque", "Rays lost on opaque parts, %"),
            ("lost_panes", "Rays lost at panes, %"),
            ("through_panes", "Points seen through panes, %"),
            ("code", "Median intensity, % of full scale"),
        )
    ):
        axes = figure.add_subplot(grid[1, place])
        plain(axes, title)
        for side, colour, shift in (("real", _REAL, -0.2), ("ours", _OURS, 0.2)):
            heights = [(row[key] or {}).get(side, 0.0) for row in whole]
            axes.bar(np.arange(len(names)) + shift, heights, 0.38, color=colour)
        axes.set_xticks(range(len(names)), names, rotation=25, ha="right")
    shown = sorted(seen, key=lambda one: -one.counts["real"])
    by_class = [next(one for one in shown if one.class_name == name) for name in names]
    picked = (by_class + [one for one in shown if one not in by_class])[:_SHOWN]
    for place, one in enumerate(picked):
        _from_the_side(figure.add_subplot(grid[2 + place // 4, place % 4]), one)
    save(figure, path)


def _spread(axes: Axes, seen: Sequence[ObjectSeen], names: Sequence[str]) -> None:
    plain(axes, "Our points over real ones, mended boxes (a dot is an object, the line its median)")
    for place, name in enumerate(names):
        found = [
            one.counts["mended"] / one.counts["real"] for one in seen if one.class_name == name
        ]
        away = np.linspace(-0.3, 0.3, len(found)) if len(found) > 1 else np.zeros(1)
        axes.plot(place + away, np.clip(found, 0, 3), ".", color=_OURS, markersize=3)
        middle = float(np.median(found))
        axes.plot([place - 0.35, place + 0.35], [middle] * 2, color=INK, linewidth=1.5)
    axes.axhline(1.0, color=FAINT, linewidth=1)
    axes.set_xticks(range(len(names)), names)


def _chamfers(axes: Axes, seen: Sequence[ObjectSeen], names: Sequence[str]) -> None:
    plain(axes, "Symmetric Chamfer distance, cm: boxes as annotated (grey), mended (blue)")
    for side, colour, shift in (("annotated", _REAL, -0.18), ("mended", _OURS, 0.18)):
        for place, name in enumerate(names):
            found = [one.chamfer_m[side] for one in seen if one.class_name == name]
            known = [100 * one for one in found if one is not None]
            if known:
                low, middle, high = np.percentile(known, [20, 50, 80])
                axes.plot([place + shift] * 2, [low, high], color=colour, linewidth=2)
                axes.plot(place + shift, middle, "o", color=colour)
    axes.set_xticks(range(len(names)), names)
    axes.set_ylim(bottom=0)


def _from_the_side(axes: Axes, one: ObjectSeen) -> None:
    """Draw an object from its left side."""
    axes.set_title(
        f"{one.class_name} at {one.distance_m:.0f} m: {one.counts['real']} points, "
        f"ours {one.counts['mended']}",
        loc="left",
        fontsize=9,
        color=INK,
    )
    box = one.mended_box
    ahead = np.array([np.cos(box[6]), np.sin(box[6]), 0.0])
    for points, colour in ((one.real, _REAL), (one.ours, _OURS)):
        few = points[:: -(-len(points) // 1500) or 1] - box[:3]
        axes.plot(few @ ahead, few[:, 2], ".", color=colour, markersize=2)
    axes.set_aspect("equal")
    axes.tick_params(labelsize=7)
    for spine in axes.spines.values():
        spine.set_color(FAINT)
