"""The paths of a motion's actors from above."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pyarrow.compute as pc
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from urbantwin.drawing import style
from urbantwin.drawing.plan_ground import draw_ground, draw_surfaces
from urbantwin.drawing.plan_style import DARK
from urbantwin.taxonomy import BOX_SEMANTICS
from urbantwin.traffic.motion import Motion
from urbantwin.twin import Twin

__all__ = ["paths_figure"]

#: Margin around the paths if there is no twin, metres.
_MARGIN_M = 5.0
#: A path is interrupted if an actor moves by this between steps, metres: it left and returned.
_LEAP_M = 25.0
#: Distance between drawn points of a path, metres.
_FINE_M = 0.25
#: Number of classes in one row of the legend.
_ROW = 6


def paths_figure(
    motion: Motion, twin: Twin | None = None, *, attribution: str | Iterable[str] = ()
) -> Figure:
    """Draw the path of every actor, by class, and its position at the end of its path.

    Args:
        motion: the motion.
        twin: twin with the ground, the lanes and the region of the picture.
        attribution: sources of the data.
    """
    figure = style.new_figure(12.0, 12.9)
    axes = figure.add_axes((0.02, 0.06, 0.96, 0.87))
    style.bare(axes)
    tracks = np.asarray(motion.rows["track"].to_numpy())
    xy = np.column_stack([motion.rows[name].to_numpy() for name in ("x", "y")]).reshape(-1, 2)
    classes = motion.rows["class"]
    x0, y0, x1, y1 = _shown(xy, twin)
    width = 1.04 * max(x1 - x0, y1 - y0)
    axes.set_xlim((x0 + x1 - width) / 2, (x0 + x1 + width) / 2)
    axes.set_ylim((y0 + y1 - width) / 2, (y0 + y1 + width) / 2)
    axes.set_aspect("equal")
    if twin is not None:
        draw_ground(axes, twin.region, twin.mesh, DARK)
        draw_surfaces(axes, twin.roads, twin.lane_model, DARK)
    handles: list[Line2D] = []
    for name in BOX_SEMANTICS:
        mine = np.flatnonzero(pc.equal(classes, name).to_numpy())
        if not len(mine):
            continue
        colour = tuple(style.actor_colour(name))
        if any(one.get_color() == colour for one in handles):  # vans are cars to SemanticKITTI
            colour = tuple((part + 1) / 2 for part in colour)
        mine = mine[np.argsort(tracks[mine], kind="stable")]
        moved = np.linalg.norm(np.diff(xy[mine], axis=0), axis=1)
        ends = np.flatnonzero((moved > _LEAP_M) | (np.diff(tracks[mine]) != 0)) + 1
        drawn = np.diff(np.concatenate([[0.0], np.cumsum(moved)]) // _FINE_M, prepend=-1.0) != 0
        drawn[ends] = drawn[ends - 1] = drawn[-1] = True
        ways = np.split(xy[mine[drawn]], (np.cumsum(drawn) - 1)[ends])
        axes.add_collection(
            LineCollection(ways, colors=[colour], linewidths=1.1, alpha=0.65, zorder=40)
        )
        axes.plot(*np.array([way[-1] for way in ways]).T, ".", color=colour, zorder=41)
        count = len(np.unique(tracks[mine]))
        handles.append(Line2D([], [], color=colour, linewidth=3, label=f"{name} ({count})"))
    style.scale_bar(axes)
    style.north_arrow(axes)
    below = f"{motion.manifest['steps'] * motion.step_s:g} s   {len(np.unique(tracks))} actors"
    style.title(figure, "Paths of the actors", below)
    style.written_attribution(figure, attribution)
    if handles:
        figure.legend(
            handles=handles,
            loc="lower center",
            bbox_to_anchor=(0.5, 0.02 if len(handles) <= _ROW else 0.014),
            ncols=len(handles) if len(handles) <= _ROW else -(-len(handles) // 2),
            borderpad=0.0,
            frameon=False,
            fontsize=10,
            labelcolor=style.INK,
        )
    return figure


def _shown(xy: np.ndarray, twin: Twin | None) -> tuple[float, float, float, float]:
    """Return the bounds of the region, or of the paths."""
    if twin is not None:
        bounds: tuple[float, float, float, float] = twin.region.bounds
        return bounds
    if not len(xy):
        return -_MARGIN_M, -_MARGIN_M, _MARGIN_M, _MARGIN_M
    low, high = xy.min(axis=0) - _MARGIN_M, xy.max(axis=0) + _MARGIN_M
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])
