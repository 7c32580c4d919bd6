"""A labelled frame from above."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from urbantwin.drawing import style
from urbantwin.drawing.labelled_frame import LabelledPoints
from urbantwin.drawing.plan_ground import fill
from urbantwin.geometry import box_corners
from urbantwin.lidar.labels import LEVELS
from urbantwin.taxonomy import ACTOR_CLASSES, OBSTACLE, semantic_classes

__all__ = ["birdseye", "birdseye_figure"]

#: Maximum number of point classes in the legend.
_LEGEND_ROWS = 14
#: Height of a row of the legend, which is 1 high.
_ROW = 0.0285


def birdseye(
    frame: LabelledPoints,
    path: Path,
    *,
    reach_m: float | None = None,
    title: str = "",
    attribution: str | Iterable[str] = (),
) -> Path:
    """Draw a frame from above: points by class, boxes with their headings, sensors, range rings.

    Args:
        frame: the frame.
        path: the PNG to write.
        reach_m: half the side of the picture; default: the value that contains 97 % of the points.
        title: title of the picture.
        attribution: sources of the data.
    """
    figure = birdseye_figure(frame, reach_m=reach_m, title=title, attribution=attribution)
    return style.save(figure, path)


def birdseye_figure(
    frame: LabelledPoints,
    *,
    reach_m: float | None = None,
    title: str = "",
    attribution: str | Iterable[str] = (),
) -> Figure:
    """Return the figure of ``birdseye``; its first axes are in metres of the dataset's frame."""
    figure = style.new_figure(14.4, 12.0)
    axes = figure.add_axes((0.0125, 0.03, 0.75, 0.9))
    style.bare(axes)
    centre = _centre(frame)
    reach = reach_m if reach_m is not None else _reach(frame, centre)
    axes.set_xlim(centre[0] - reach, centre[0] + reach)
    axes.set_ylim(centre[1] - reach, centre[1] + reach)
    axes.set_aspect("equal")

    _rings(axes, frame, reach)
    _draw_ignored(axes, frame)
    _points(axes, frame, reach)
    _draw_boxes(axes, frame)
    for sensor in frame.sensors:
        x, y = sensor.dataset_SE3_sensor.translation[:2]
        axes.plot(x, y, "o", color=style.ACCENT, markersize=9, zorder=30)
        axes.plot(x, y, "o", color=style.PAPER, markersize=3, zorder=31)
    style.scale_bar(axes)
    style.north_arrow(axes, frame.x_axis_yaw)
    seen = int((frame.box_points > 0).sum())
    below = (
        f"frame {frame.name}   {frame.time_s:.1f} s   {len(frame.points):,} points   "
        f"{seen} of {len(frame.boxes)} actors with points"
    )
    style.title(figure, title or "Labelled frame from above", below)
    _legend(figure, frame)
    style.written_attribution(figure, attribution)
    return figure


def _centre(frame: LabelledPoints) -> tuple[float, float]:
    if not frame.sensors:
        return 0.0, 0.0
    places = np.array([one.dataset_SE3_sensor.translation[:2] for one in frame.sensors])
    return float(places[:, 0].mean()), float(places[:, 1].mean())


def _reach(frame: LabelledPoints, centre: tuple[float, float]) -> float:
    if not len(frame.points):
        return 50.0
    far = np.abs(frame.points[:, :2] - np.array(centre)).max(axis=1)
    return float(np.clip(np.percentile(far, 97), 15.0, 120.0))


def _rings(axes: Axes, frame: LabelledPoints, reach: float) -> None:
    step = next(m for m in (5, 10, 20, 25, 50, 100) if reach / m <= 5 or m == 100)
    for sensor in frame.sensors[:1]:
        x, y = sensor.dataset_SE3_sensor.translation[:2]
        for radius in np.arange(step, 1.5 * reach, step):
            ring = Circle((x, y), radius, fill=False, edgecolor=style.FAINT, linewidth=0.8)
            axes.add_patch(ring)
            if radius < reach:
                axes.text(
                    x,
                    y - radius,
                    f"{radius:g} m",
                    color=style.MUTED,
                    fontsize=8,
                    ha="center",
                    va="center",
                    zorder=25,
                    bbox={"facecolor": style.PAPER, "pad": 1, "lw": 0, "alpha": 0.7},
                )


def _points(axes: Axes, frame: LabelledPoints, reach: float) -> None:
    """Draw low points first, so that walls and actors stay visible over the ground."""
    order = np.argsort(frame.points[:, 2], kind="stable")
    actor = frame.instance[order] > 0
    size = float(np.clip(60.0 / reach, 0.35, 3.0))
    for chosen, factor, zorder in ((~actor, 1.0, 5), (actor, 2.2, 8)):
        index = order[chosen]
        axes.scatter(
            frame.points[index, 0],
            frame.points[index, 1],
            s=size * factor,
            c=style.class_colours(frame.semantic[index]),
            linewidths=0,
            zorder=zorder,
        )


def _draw_ignored(axes: Axes, frame: LabelledPoints) -> None:
    """Hatch areas in which labels do not count, under the points."""
    with mpl.rc_context({"hatch.linewidth": 0.6}):
        for area in frame.ignored.values():
            fill(axes, [area], "none", hatch="////", edgecolor=style.FAINT, zorder=1)


def _draw_boxes(axes: Axes, frame: LabelledPoints) -> None:
    levels = frame.difficulty or tuple(
        "seen" if count else None for count in frame.box_points.tolist()
    )
    shapes, faces, edges, noses, widths = [], [], [], [], []
    dashes: list[Any] = []
    for box, name, level in zip(frame.boxes, frame.classes, levels, strict=True):
        shapes.append(box_corners(box)[:4, :2])
        colour = style.actor_colour(name)
        # Boxes that do not count are labels too, drawn fainter and dashed.
        alpha, line = (1.0, 1.5) if level else (0.5, 1.0)
        faces.append((*colour, 0.18 if level else 0.06))
        edges.append((*colour, alpha))
        widths.append(line)
        dashes.append("-" if level else (0, (3, 2)))
        along = np.array([np.cos(box[6]), np.sin(box[6])])
        nose = box[:2] + along * box[3] / 2
        noses.append(np.array([nose, nose + along * max(0.8, 0.3 * box[3])]))
    if not shapes:
        return
    outlines = PolyCollection(
        shapes,
        facecolors=faces,
        edgecolors=edges,
        linewidths=widths,
        linestyles=dashes,
        joinstyle="miter",
        zorder=15,
    )
    axes.add_collection(outlines, autolim=False)
    style.draw_lines(axes, noses, edges, linewidths=widths, zorder=15)


def _legend(figure: Figure, frame: LabelledPoints) -> None:
    axes = figure.add_axes((0.775, 0.03, 0.215, 0.9))
    style.bare(axes)
    axes.set_xlim(0, 1)
    axes.set_ylim(0, 1)
    y = 0.985
    numbers, counts = np.unique(frame.semantic, return_counts=True)
    names = {one.id: one.name for one in semantic_classes().values()}
    rows = sorted(zip(counts.tolist(), numbers.tolist(), strict=True), reverse=True)
    y = _heading(axes, y, "Points")
    # The lower part needs its space first: a heading and its gap take as much as 2.5 rows.
    below = len(ACTOR_CLASSES) + len(frame.ignored) + len(frame.sensors)
    below += (len(LEVELS) + 1) * bool(frame.difficulty)
    headings = 3 + bool(frame.difficulty) + bool(frame.ignored)
    room = int((0.97 - 0.07 * headings) / _ROW) - below
    for count, number in rows[: max(3, min(_LEGEND_ROWS, room))]:
        y = _row(axes, y, style.class_colours([number])[0], names.get(number, "?"), f"{count:,}")
    y = _heading(axes, y - 0.03, "Boxes (with points)")
    obstacles = [OBSTACLE] if OBSTACLE in frame.classes else []
    for name in (*ACTOR_CLASSES, *obstacles):
        mine = np.array([one == name for one in frame.classes], bool)
        text = f"{int(mine.sum())} ({int((frame.box_points[mine] > 0).sum())})"
        y = _row(axes, y, style.actor_colour(name), name, text, hollow=True)
    if frame.difficulty:
        y = _heading(axes, y - 0.03, "Difficulty")
        for level in (*(one.name for one in LEVELS), None):
            count = sum(one == level for one in frame.difficulty)
            grey = np.array([0.75, 0.75, 0.75])
            y = _row(axes, y, grey, level or "ignored: broken outline", f"{count}", hollow=True)
    if frame.ignored:
        y = _heading(axes, y - 0.03, "Not counted: hatched")
        for reason, area in frame.ignored.items():
            y = _row(
                axes, y, np.array(mpl.colors.to_rgb(style.FAINT)), reason, f"{area.area:,.0f} m²"
            )
    y = _heading(axes, y - 0.03, "Sensors")
    for sensor in frame.sensors:
        y = _row(axes, y, np.array([1.0, 0.82, 0.29]), sensor.name, sensor.model)


def _heading(axes: Axes, y: float, text: str) -> float:
    axes.text(0.0, y, text, color=style.INK, fontsize=12, weight="bold", va="top")
    return y - 0.04


def _row(
    axes: Axes,
    y: float,
    colour: NDArray[np.float64],
    name: str,
    value: str,
    *,
    hollow: bool = False,
) -> float:
    axes.plot(
        0.03,
        y - 0.009,
        "s",
        markersize=9,
        color=colour,
        markerfacecolor="none" if hollow else colour,
        markeredgewidth=1.5,
        clip_on=False,
    )
    axes.text(0.1, y, name, color=style.INK, fontsize=10.5, va="top")
    axes.text(1.0, y, value, color=style.MUTED, fontsize=10.5, va="top", ha="right")
    return y - _ROW
