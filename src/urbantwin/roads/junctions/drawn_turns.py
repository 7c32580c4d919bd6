"""Ways through a junction that keep to a line drawn for them, each lane in its place beside it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import resampled, smoothed, stations_of_points
from urbantwin.roads.junctions.passage import Passage
from urbantwin.roads.junctions.strip import Strip
from urbantwin.roads.model.curve import Curve, aside, splined

__all__ = ["drawn_turns"]

#: Corners of the line, and then of every lane beside it, are rounded within so much until their
#: radius is as large as the last, metres.
LINE_M, LANE_M, RADIUS_M = 0.25, 0.5, 12.0
#: A lane that does not begin where it is drawn goes there with this radius, metres.
SHIFT_RADIUS_M = 25.0
#: Points that a way's curve goes through are this far apart, metres.
SPACING_M = 2.0
#: A lane's way: its edge, its number there, and those that it leads to.
Way = tuple[str, int, str, int]


def drawn_turns(
    ways: Mapping[Way, Passage],
    curves: Mapping[Way, Curve],
    strips: Mapping[str, Strip],
    followed: Mapping[str, NDArray[np.float64]],
) -> dict[Way, Curve]:
    """Return the middle of each lane's way where a line through the junction is to be followed.

    The line is the middle of the lanes that turn side by side. A way begins and ends in its lanes,
    and goes on in them as far as the line does not reach.

    Args:
        ways: the passages through a junction by lanes.
        curves: their ways where no line is drawn, which begin and end in their lanes.
        strips: where the edges lie that lead in and out.
        followed: edge within the junction -> its line (N, 2).
    """
    beside: dict[Passage, list[Way]] = defaultdict(list)
    lines: dict[Passage, NDArray[np.float64]] = {}
    for way, passage in ways.items():
        drawn = [followed[edge.id] for edge in passage.path[1:-1] if edge.id in followed]
        lane = passage.entry.lanes[way[1]]
        own = passage.entry.is_cycle_track
        if drawn and (own or lane.admits("passenger") or lane.admits("bus")):
            beside[passage].append(way)
            lines[passage] = np.vstack(drawn)
    found: dict[Way, Curve] = {}
    for passage, mine in beside.items():
        # Lanes are counted from the kerb.
        order = sorted({way[1:2] + way[3:] for way in mine})
        widths = [passage.entry.lanes[k].width for k, _ in order]
        middle = _distinct(smoothed(_distinct(lines[passage]), LINE_M, radius_m=RADIUS_M))
        kerb = np.cumsum(widths) - np.array(widths) / 2
        outward = strips[passage.entry.id].outward
        for way in mine:
            place = outward * (sum(widths) / 2 - kerb[order.index((way[1], way[3]))])
            ends = curves[way].at([0.0, curves[way].length])
            found[way] = _along(middle, ends, float(place))
    return found


def _along(middle: NDArray[np.float64], ends: NDArray[np.float64], place: float) -> Curve:
    """Return a way from pose to pose (2, 3) that runs ``place`` metres left of a line (N, 2)."""
    lane = _beside(middle, place)
    length = float(stations_of_points(lane)[-1])
    ahead = np.column_stack([np.cos(ends[:, 2]), np.sin(ends[:, 2])])
    off = np.zeros_like(lane)
    for k, station in ((0, stations_of_points(lane)), (-1, stations_of_points(lane[::-1])[::-1])):
        left = np.array([-ahead[k, 1], ahead[k, 0]])
        lacking = float((ends[k, :2] - lane[k]) @ left)
        # Two arcs of about that radius that meet in the middle.
        reach = min(float(np.sqrt(6.0 * SHIFT_RADIUS_M * abs(lacking))), length / 2)
        share = np.clip(station / max(reach, 1e-9), 0.0, 1.0)
        off += np.outer(lacking * (1.0 - share * share * (3.0 - 2.0 * share)), left)
    lane = lane + off
    within = ((lane - ends[0, :2]) @ ahead[0] > 0.5) & ((ends[1, :2] - lane) @ ahead[1] > 0.5)
    course = _distinct(np.vstack([ends[0, :2], lane[_middle_run(within)], ends[1, :2]]))
    headings = float(ends[0, 2]), float(ends[1, 2])
    calm = smoothed(course, LANE_M, headings=headings, radius_m=RADIUS_M)
    return splined(resampled(calm, SPACING_M), *headings)


def _middle_run(within: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return points that lie between the ends; those far round a bend may lie behind them, too."""
    found = np.ones_like(within)
    half = len(within) // 2
    if len(behind := np.flatnonzero(~within[:half])):
        found[: behind[-1] + 1] = False
    if len(beyond := np.flatnonzero(~within[half:])):
        found[half + beyond[0] :] = False
    return found


def _beside(middle: NDArray[np.float64], place: float) -> NDArray[np.float64]:
    """Return a smooth line (N, 2) moved to its left."""
    leg = np.gradient(middle, axis=0)
    return aside(np.column_stack([middle, np.arctan2(leg[:, 1], leg[:, 0])]), place)


def _distinct(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points without those that lie where the one before lies."""
    apart = np.linalg.norm(np.diff(points, axis=0), axis=1) > 0.01
    return np.asarray(points[np.concatenate([[True], apart])])
