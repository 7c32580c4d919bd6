"""An event of a motion from above: positions of actors at its main moment, and their paths."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from urbantwin.dataset.motion_interpolation import rows_at
from urbantwin.drawing import style
from urbantwin.drawing.plan_ground import draw_ground, draw_surfaces
from urbantwin.drawing.plan_marks import draw_marks
from urbantwin.drawing.plan_style import DARK
from urbantwin.traffic.motion import Motion
from urbantwin.twin import Twin

__all__ = ["event_figure"]

#: Half of the side of the picture, metres, and duration of the drawn paths, seconds.
_HALF_M, _WAY_S = 32.0, 4.0


def event_figure(
    motion: Motion, twin: Twin, event: dict[str, Any], *, attribution: str | Iterable[str] = ()
) -> Figure:
    """Draw an event at its main moment: of the smallest gap, or of its beginning.

    Args:
        motion: the motion.
        twin: twin of the motion.
        event: a row of the motion's ``events``.
        attribution: sources of the data.
    """
    nearest = event.get("nearest") or {}
    moment = nearest.get("ttc_at_s") or nearest.get("gap_at_s") or event["from_s"]
    if "impact_s" in event:
        moment = event["impact_s"]
    moment = min(max(float(moment), 0.0), float(motion.times()[-1]))
    at = event.get("at") or {"x": 0.0, "y": 0.0}
    figure = style.new_figure(9.0, 9.8)
    axes = figure.add_axes((0.02, 0.05, 0.96, 0.86))
    style.bare(axes)
    axes.set_xlim(at["x"] - _HALF_M, at["x"] + _HALF_M)
    axes.set_ylim(at["y"] - _HALF_M, at["y"] + _HALF_M)
    axes.set_aspect("equal")
    draw_ground(axes, twin.region, twin.mesh, DARK)
    draw_surfaces(axes, twin.roads, twin.lane_model, DARK)
    draw_marks(axes, twin.roads, twin.lane_model, DARK)
    marked = set(event["tracks"]) | ({nearest["track"]} if "track" in nearest else set())
    for row in rows_at(motion, moment):
        _draw_box(axes, row, marked=int(row["track"]) in marked)
    near = motion.rows.between(moment - _WAY_S, moment + _WAY_S)
    tracks = near["track"].to_numpy()
    xy = np.column_stack([near[name].to_numpy() for name in ("x", "y")])
    for track in sorted(marked):
        way = xy[tracks == track]
        if len(way):
            axes.plot(*way.T, color=style.ACCENT, linewidth=1.4, alpha=0.8, zorder=60)
    style.scale_bar(axes)
    style.north_arrow(axes)
    style.title(figure, event["event"].replace("_", " "), f"{moment:.1f} s   {_figures(nearest)}")
    style.written_attribution(figure, attribution)
    return figure


def _draw_box(axes: Axes, row: np.void, *, marked: bool) -> None:
    ahead = np.array([np.cos(row["yaw"]), np.sin(row["yaw"])]) * row["length"] / 2
    left = np.array([-np.sin(row["yaw"]), np.cos(row["yaw"])]) * row["width"] / 2
    at = np.array([row["x"], row["y"]])
    nose = at + 1.15 * ahead
    corners = [at + ahead + left, nose, at + ahead - left, at - ahead - left, at - ahead + left]
    edge: dict[str, Any] = {"edgecolor": style.PAPER, "linewidth": 0.6}
    if marked:
        edge = {"edgecolor": style.ACCENT, "linewidth": 1.8}
    colour = tuple(style.actor_colour(str(row["class"])))
    axes.add_patch(Polygon(np.array(corners), facecolor=colour, zorder=61, **edge))


def _figures(nearest: dict[str, Any]) -> str:
    """Return the measured values in a line."""
    words = []
    for key, name, unit in (("ttc_s", "TTC", "s"), ("pet_s", "PET", "s"), ("gap_m", "gap", "m")):
        if nearest.get(key) is not None:
            words.append(f"{name} {nearest[key]:.2f} {unit}")
    return "   ".join(words)
