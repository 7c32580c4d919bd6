"""Labels of a plan, placed so that they hide neither lanes nor each other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from shapely.affinity import rotate, translate

from urbantwin.drawing import style
from urbantwin.drawing.plan_style import Look
from urbantwin.roads import RoadNetwork

__all__ = ["Label", "draw_labels", "street_labels"]

#: Minimum distance between repetitions of a street's name along the street, metres.
_AGAIN_M = 170.0
#: Width of a letter and height of a line in parts of the font's size.
_LETTER, _LINE = 0.62, 1.3
#: Candidate positions along a street, the middle first.
_TRIED = (0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8, 0.12, 0.88)


@dataclass(frozen=True)
class Label:
    """Text on the map: its middle (metres), its rotation (degrees), and its area."""

    text: str
    x: float
    y: float
    angle: float
    box: shapely.Geometry


def street_labels(
    network: RoadNetwork,
    room: shapely.Geometry,
    taken: Iterable[shapely.Geometry],
    *,
    letter_m: float,
) -> list[Label]:
    """Place the name of each street beside it, or on it if there is no space beside.

    Args:
        network: the lanes.
        room: area for text.
        taken: areas that must not be covered.
        letter_m: the size of the font, metres on the map.
    """
    paved = shapely.union_all(
        [
            area
            for level in network.levels
            for area in (network.carriageway(level), network.footway(level))
        ]
    )
    shapely.prepare(paved)
    hidden = shapely.union_all(list(taken))
    placed: list[Label] = []
    for name, lines in sorted(_streets(network, room).items()):
        for line in sorted(lines, key=lambda one: -one.length):
            if any(
                one.text == name
                and line.interpolate(0.5, normalized=True).distance(one.box) < _AGAIN_M
                for one in placed
            ):
                continue
            label = _placed(name, line, room, paved, hidden, placed, letter_m)
            if label is not None:
                placed.append(label)
    return placed


def draw_labels(axes: Axes, labels: Sequence[Label], look: Look, *, fontsize: float) -> None:
    """Write names with a halo."""
    for one in labels:
        axes.text(
            one.x,
            one.y,
            one.text,
            color=look.ink,
            fontsize=fontsize,
            rotation=one.angle,
            rotation_mode="anchor",
            ha="center",
            va="center_baseline",
            zorder=44,
            path_effects=[withStroke(linewidth=2.5, foreground=look.halo)],
        )


def _streets(network: RoadNetwork, room: shapely.Geometry) -> dict[str, list[shapely.LineString]]:
    """Return the lines of each named street, within the room, along its innermost lanes."""
    lanes = network.lane_by_id
    named: dict[str, list[shapely.LineString]] = {}
    for road in network.roads:
        if road.lanes and road.name and style.legible(road.name) == road.name:
            line = shapely.LineString(lanes[road.lanes[-1]].centre[:, :2])
            inside = shapely.get_parts(shapely.intersection(line, room))
            kept = [part for part in inside if part.geom_type == "LineString" and part.length > 12]
            named.setdefault(road.name, []).extend(kept)
    return named


def _placed(
    name: str,
    line: shapely.LineString,
    room: shapely.Geometry,
    paved: shapely.Geometry,
    hidden: shapely.Geometry,
    placed: Sequence[Label],
    letter_m: float,
) -> Label | None:
    length, height = _LETTER * letter_m * len(name), _LINE * letter_m
    if length > 1.6 * line.length:
        return None
    for beside in (True, False):
        for label in _candidates(name, line, paved, length, height, beside=beside):
            free = not label.box.intersects(hidden) and shapely.covers(room, label.box)
            free &= not any(label.box.intersects(other.box) for other in placed)
            if free and (not beside or not shapely.intersects(paved, label.box)):
                return label
    return None


def _candidates(
    name: str,
    line: shapely.LineString,
    paved: shapely.Geometry,
    length: float,
    height: float,
    *,
    beside: bool,
) -> Iterator[Label]:
    """Yield positions along a street: outside both its edges, or on its middle."""
    for share in _TRIED:
        at = share * line.length
        a, b = (
            np.array(line.interpolate(s).coords[0])
            for s in (max(at - length / 2, 0), min(at + length / 2, line.length))
        )
        way = b - a
        heading = float(np.arctan2(way[1], way[0]))
        angle = (np.degrees(heading) + 90) % 180 - 90  # readable from below or from the right
        normal = np.array([-np.sin(heading), np.cos(heading)])
        middle = (a + b) / 2
        flat = shapely.box(-length / 2, -height / 2, length / 2, height / 2)
        upright = rotate(flat, angle, origin=(0, 0))
        if not beside:
            x, y = float(middle[0]), float(middle[1])
            yield Label(name, x, y, float(angle), translate(upright, x, y))
            continue
        for side in (1.0, -1.0):
            for gap in np.arange(2.0, 45.0, 1.0):  # the first place past the edge of the street
                place = middle + side * gap * normal
                box = translate(upright, *place)
                if not shapely.intersects(paved, box.buffer(0.6)):
                    yield Label(name, float(place[0]), float(place[1]), float(angle), box)
                    break
