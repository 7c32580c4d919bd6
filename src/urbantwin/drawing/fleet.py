"""A frame of a fleet from above: points of each node, visibility of actors, poses of nodes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from urbantwin.dataset.reading import Fleet, fused_cloud
from urbantwin.dataset.reading.columns import BOX
from urbantwin.drawing import style
from urbantwin.geometry import Pose, box_corners

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["figure_of_fleet", "telling_frame"]

#: Colours of nodes, in their order; repeated if there are more nodes.
_COLOURS = ("#5ec8f2", "#f2b84b", "#8bd450", "#e77fd0", "#f26d5b", "#9a8cff", "#4fd6b5", "#d8d8d8")
_SEEN_BY_MORE, _SEEN_BY_NONE = "#ffffff", "#77808a"
_REACH_M = (25.0, 130.0)
#: An error of a place is drawn if it is larger than this, metres.
_SHOWN_ERROR_M = 0.05


def telling_frame(fleet: Fleet) -> str:
    """Return the first frame with the most actors seen by more than one node."""
    frames = np.asarray(fleet.boxes["frame"].to_pylist(), object)
    shared = fleet.boxes["num_nodes"].to_numpy() > 1
    counts = [int(shared[frames == name].sum()) for name in fleet.names]
    return fleet.names[int(np.argmax(counts))]


def figure_of_fleet(
    fleet: Fleet, frame: str | None = None, attribution: str | Iterable[str] = ()
) -> Figure:
    """Return the figure of a frame; its first axes are in metres of the site.

    Points have the colour of their node and are drawn at its true pose. Boxes are white if several
    nodes have points on the actor, of the node's colour if one has, and dashed if none has. A cross
    marks a node's estimated position if it differs from the true one.

    Args:
        fleet: the fleet.
        frame: name of the frame; default: that of `telling_frame`.
        attribution: sources of the data.

    Raises:
        InputError: there is no such frame, or a file is damaged.
    """
    name = telling_frame(fleet) if frame is None else frame
    cloud = fused_cloud(fleet, name, using="true")
    rows = fleet.boxes_of(name)
    figure = style.new_figure(14.4, 12.0)
    axes = figure.add_axes((0.0125, 0.03, 0.75, 0.9))
    style.bare(axes)
    places = _places(fleet, name)
    centre, reach = _view(places, cloud.points)
    axes.set_xlim(centre[0] - reach, centre[0] + reach)
    axes.set_ylim(centre[1] - reach, centre[1] + reach)
    axes.set_aspect("equal")
    colours = np.array([mpl.colors.to_rgb(_colour(k)) for k in range(len(fleet.node_names))])
    order = np.argsort(cloud.points[:, 2], kind="stable")
    actor = cloud.instance[order] > 0
    for chosen, size, alpha, zorder in ((~actor, 0.5, 0.35, 5), (actor, 2.5, 1.0, 8)):
        index = order[chosen]
        axes.scatter(cloud.points[index, 0], cloud.points[index, 1], s=size, alpha=alpha,
                     c=colours[cloud.node[index]], linewidths=0, zorder=zorder)  # fmt: skip
    counts = _boxes(axes, fleet, rows)
    for number, (node, pose, believed) in enumerate(places):
        if pose is not None and believed is not None:
            _node(axes, node, pose, believed, _colour(number))
    style.scale_bar(axes)
    style.north_arrow(axes, 0.0)
    present = sum(pose is not None for _, pose, _ in places)
    time_s = float(fleet.times_s[fleet.names.index(name)])
    style.title(
        figure,
        "Nodes that see one scene",
        f"frame {name}   {time_s:.1f} s   {len(cloud.points):,} points of {present} nodes",
    )
    _legend(figure, fleet, name, counts)
    style.written_attribution(figure, attribution)
    return figure


def _colour(number: int) -> str:
    return _COLOURS[number % len(_COLOURS)]


def _places(fleet: Fleet, frame: str) -> list[tuple[str, Pose | None, Pose | None]]:
    """Return name, true and reported pose of every node; ``None`` for a node that is absent."""
    states = ((name, fleet.state(frame, name)) for name in fleet.node_names)
    return [(name, state.place, state.believed) for name, state in states]


def _view(
    places: Iterable[tuple[str, Pose | None, Pose | None]], points: NDArray[np.float32]
) -> tuple[NDArray[np.float64], float]:
    """Return the middle of the picture and half its side: all nodes, and most points."""
    at = np.array([pose.translation[:2] for _, pose, _ in places if pose is not None])
    at = at.reshape(-1, 2)
    if not len(at):
        at = np.zeros((1, 2))
    centre = (at.min(axis=0) + at.max(axis=0)) / 2
    reach = float(np.abs(at - centre).max()) + 10.0
    if len(points):
        reach = max(reach, float(np.percentile(np.abs(points[:, :2] - centre).max(axis=1), 90)))
    return centre, float(np.clip(reach, *_REACH_M))


def _boxes(axes: Axes, fleet: Fleet, rows: pa.Table) -> dict[str, int]:
    """Draw the common labels; return the numbers seen by no node, by one and by several."""
    counts = {"none": 0, "one": 0, "more": 0}
    for row in rows.to_pylist():
        box = np.array([row[name] for name in BOX], np.float64)
        seen = [k for k, name in enumerate(fleet.node_names) if row[f"num_points.{name}"]]
        kind = "more" if len(seen) > 1 else "one" if seen else "none"
        counts[kind] += 1
        colour = {"more": _SEEN_BY_MORE, "none": _SEEN_BY_NONE}.get(kind) or _colour(seen[0])
        axes.add_patch(
            Polygon(
                box_corners(box)[:4, :2],
                facecolor="none",
                edgecolor=colour,
                linewidth=1.6 if kind == "more" else 1.0,
                linestyle="-" if seen else (0, (3, 2)),
                zorder=15,
            )
        )
    return counts


def _node(axes: Axes, name: str, pose: Pose, believed: Pose, colour: str) -> None:
    """Draw a node's position, its heading, and its estimated position."""
    place, ahead = pose.translation[:2], pose.rotation[:2, 0]
    axes.plot(*np.array([place, place + 4.0 * ahead]).T, color=colour, linewidth=2.0, zorder=29)
    axes.plot(*place, "o", color=colour, markeredgecolor=style.PAPER, markersize=11, zorder=30)
    at = (float(place[0]), float(place[1]))
    axes.annotate(name, at, xytext=(9, 9), textcoords="offset points", color=colour, fontsize=12,
                  weight="bold", zorder=32)  # fmt: skip
    wrong = believed.translation[:2]
    if np.linalg.norm(wrong - place) > _SHOWN_ERROR_M:
        axes.plot(*wrong, "x", color=colour, markersize=10, markeredgewidth=2.5, zorder=31)


def _legend(figure: Figure, fleet: Fleet, frame: str, counts: dict[str, int]) -> None:
    axes = figure.add_axes((0.775, 0.03, 0.215, 0.9))
    style.bare(axes)
    axes.set_xlim(0, 1)
    axes.set_ylim(0, 1)
    y = 0.985
    axes.text(0.0, y, "Nodes (points)", color=style.INK, fontsize=12, weight="bold", va="top")
    for number, name in enumerate(fleet.node_names):
        y -= 0.04
        state = fleet.state(frame, name)
        told = f"{state.points:,}{', lost' if state.lost else ''}" if state.present else "absent"
        axes.plot(0.03, y - 0.009, "o", markersize=9, color=_colour(number), clip_on=False)
        axes.text(0.1, y, name, color=style.INK, fontsize=10.5, va="top")
        axes.text(1.0, y, told, color=style.MUTED, fontsize=10.5, va="top", ha="right")
    y -= 0.07
    axes.text(0.0, y, "Actors", color=style.INK, fontsize=12, weight="bold", va="top")
    for kind, colour, words in (
        ("more", _SEEN_BY_MORE, "seen by several nodes"),
        ("one", _colour(0), "by one: its colour"),
        ("none", _SEEN_BY_NONE, "by none: broken"),
    ):
        y -= 0.04
        axes.plot(0.03, y - 0.009, "s", markersize=9, color=colour, markerfacecolor="none",
                  markeredgewidth=1.5, clip_on=False)  # fmt: skip
        axes.text(0.1, y, words, color=style.INK, fontsize=10.5, va="top")
        axes.text(1.0, y, f"{counts[kind]}", color=style.MUTED, fontsize=10.5, va="top", ha="right")
