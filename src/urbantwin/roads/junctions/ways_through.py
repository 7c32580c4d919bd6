"""Centre lines of lane movements through a junction, and those that are drivable."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import resampled, smoothed, stations_of_points, wrapped
from urbantwin.roads.junctions.passage import Passage
from urbantwin.roads.junctions.plain import INTO_M
from urbantwin.roads.junctions.ring import Ring, ring_of, round_ring
from urbantwin.roads.junctions.strip import Strip
from urbantwin.roads.model.curve import Curve, aside, splined
from urbantwin.roads.round_standing import round_standing
from urbantwin.roads.streets.manoeuvre import gentle_curves

__all__ = ["Way", "WaysThrough", "ways_through"]

#: Points of the map's path within this distance of its ends, or twice that of sharper bends, are
#: dropped: metres, radians.
NEAR_M, SHARP = 3.0, np.radians(25.0)
#: Minimum radius of a drivable curve, metres (turning circles of cars are 10 to 12 m).
TIGHTEST_M = 2.5
#: Lane of an incoming edge, and lane of an outgoing edge: (edge, lane, edge, lane).
Way = tuple[str, int, str, int]
#: Minimum angle of turns across oncoming traffic, and tolerance of opposite directions, radians.
TURN, OPPOSITE = np.radians(50.0), np.radians(45.0)
#: Minimum distance between the centre lines of opposed turns, and maximum displacement for it,
#: metres.
APART_M, MOST_M = 3.4, 5.0
#: Tolerances for rounding the corners of a drawn line and of each lane beside it, and the target
#: radius, metres.
LINE_M, LANE_M, RADIUS_M = 0.25, 0.5, 12.0
#: Radius of the lateral shift of a lane that does not begin on its drawn path, metres.
SHIFT_RADIUS_M = 25.0
#: Spacing of the points that a curve passes through, metres.
SPACING_M = 2.0


@dataclass(frozen=True)
class WaysThrough:
    """Lane movements through a junction.

    Attributes:
        curves: their centre lines.
        led: the movements that were drawn, or that lead around a ring or an obstacle.
        drivable: the drivable ones, in the order of the junction's movements.
    """

    curves: Mapping[Way, Curve]
    led: frozenset[Way]
    drivable: tuple[Way, ...]


def ways_through(
    ways: Mapping[Way, Passage],
    strips: Mapping[str, Strip],
    *,
    followed: Mapping[str, NDArray[np.float64]],
    rings: Sequence[Ring],
    standing: Sequence[shapely.Geometry],
    driving_side: str,
) -> WaysThrough:
    """Return the movements through a junction in plan.

    Args:
        ways: passages by lane movement.
        strips: strips of the incoming and outgoing edges.
        followed: edge within the junction -> its drawn path (N, 2), site frame.
        rings: small roundabouts, site frame.
        standing: outlines of posts and islands, site frame.
        driving_side: ``right`` or ``left``.
    """
    curves = _curves(ways, strips, driving_side)
    drawn = drawn_turns(ways, curves, strips, followed)
    drawn |= _round_rings(ways, curves, rings, 1 if driving_side == "right" else -1)
    undrawn = [movement for movement in ways if movement not in drawn]
    passages = [ways[movement] for movement in undrawn]
    moved_curves = round_standing([curves[movement] for movement in undrawn], passages, standing)
    guided = drawn | {undrawn[k]: curve for k, curve in moved_curves.items()}
    curves |= guided
    return WaysThrough(curves, frozenset(guided), tuple(_drivable(ways, curves)))


def _round_rings(
    ways: Mapping[Way, Passage], curves: Mapping[Way, Curve], rings: Sequence[Ring], side: int
) -> dict[Way, Curve]:
    """Return the movements that use small rings, with paths around their centre."""
    ring_curves = {}
    for movement, passage in ways.items():
        inner = {edge.id: edge for edge in passage.path[1:-1]}
        ring = ring_of(inner, rings)
        if ring is None:
            continue
        along = sum(edge.line.length for name, edge in inner.items() if name in ring.edges)
        ends = curves[movement].at([0.0, curves[movement].length])
        curve = round_ring(ends, ring, float(along), side)
        if curve is not None:
            ring_curves[movement] = curve
    return ring_curves


def _drivable(ways: Iterable[Way], curves: Mapping[Way, Curve]) -> list[Way]:
    """Return movements without those too tight to drive, if each of their lanes has another.

    The last movement into a street is kept.
    """
    radius: dict[tuple[str, str], float] = {}
    for movement in ways:
        curve = curves[movement]
        s = np.linspace(0.0, curve.length, max(12, int(curve.length * 2)))
        bend = np.abs(np.gradient(np.unwrap(curve.at(s)[:, 2]), s)).max()
        pair = movement[0], movement[2]
        radius[pair] = min(radius.get(pair, np.inf), 1.0 / max(float(bend), 1e-6))
    open_movements = list(curves)
    for pair in sorted(radius, key=lambda pair: (radius[pair], pair)):
        if radius[pair] >= TIGHTEST_M:
            break
        remaining = [movement for movement in open_movements if (movement[0], movement[2]) != pair]
        lanes_served, edges_reached = (
            {movement[:2] for movement in remaining},
            {movement[2] for movement in remaining},
        )
        if pair[1] in edges_reached and all(
            movement[:2] in lanes_served
            for movement in open_movements
            if (movement[0], movement[2]) == pair
        ):
            open_movements = remaining
    return [movement for movement in ways if movement in open_movements]


def _curves(
    ways: Mapping[Way, Passage],
    strips: Mapping[str, Strip],
    driving_side: str,
) -> dict[Way, Curve]:
    """Return the centre line of each lane movement."""
    outward = -1 if driving_side == "right" else 1
    poses, guides = [], []
    streets = [(start, end) for start, _, end, _ in ways]
    for (start, k, end, j), passage in ways.items():
        first, last = strips[start], strips[end]
        t = first.across(k), last.across(j)
        a = _posed(first.at(first.middle.length - INTO_M), t[0])
        b = _posed(last.at(INTO_M), t[1])
        b[2] = a[2] + wrapped(b[2] - a[2])
        poses.append(np.array([a, b]))
        guides.append(_guide(passage, poses[-1], t, outward))
    curves = gentle_curves(poses, guides)
    separated = passing_in_front(curves, [streets.index(pair) for pair in streets], -outward)
    return dict(zip(ways, separated, strict=True))


def _posed(pose: NDArray[np.float64], t: float) -> NDArray[np.float64]:
    x, y, heading = pose
    return np.array([x - t * np.sin(heading), y + t * np.cos(heading), heading])


def _guide(
    passage: Passage, poses: NDArray[np.float64], t: tuple[float, float], outward: int
) -> shapely.LineString | None:
    """Return the map's own path through the junction; ``None`` if it has no edge there."""
    if len(passage.path) < 3:
        return None
    middles = [Strip(edge, outward) for edge in passage.path[1:-1]]
    total = sum(strip.middle.length for strip in middles)
    points, before = [poses[0, :2]], 0.0
    for strip in middles:
        line = strip.middle
        for station in np.linspace(0.0, line.length, max(2, int(line.length / 2.0) + 1)):
            share = (before + station) / max(total, 1e-9)
            low, high = strip.driven()
            lateral_m = float(
                np.clip(t[0] + share * (t[1] - t[0]), low + 1.0, max(high - 1.0, low + 1))
            )
            place = _posed(strip.at(float(station)), lateral_m)[:2]
            if np.linalg.norm(place - points[-1]) > 1.0:
                points.append(place)
        before += line.length
    return shapely.LineString(_passable(np.array([*points, poses[1, :2]]), poses))


def _passable(points: NDArray[np.float64], poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Remove points that a smooth path cannot pass: sharp bends, and points beyond its ends."""
    inner = points[1:-1]
    start, end = poses[:, :2]
    ahead = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    keep = ((inner - start) @ ahead[0] > NEAR_M) & ((end - inner) @ ahead[1] > NEAR_M)
    leg = np.diff(points, axis=0)
    turn = np.abs(wrapped(np.diff(np.arctan2(leg[:, 1], leg[:, 0]))))
    for bend in inner[turn > SHARP]:
        keep &= np.linalg.norm(inner - bend, axis=1) > 2 * NEAR_M
    return np.vstack([start, inner[keep], end])


def passing_in_front(curves: Sequence[Curve], groups: Sequence[int], inner: float) -> list[Curve]:
    """Return curves in which opposed inner turns no longer cross.

    Args:
        curves: paths through one junction.
        groups: index of the pair of streets of each path: its lanes are moved alike.
        inner: 1 where turns to the left cross oncoming traffic (right-hand traffic), else -1.
    """
    ends = np.array([curve.at([0.0, curve.length]) for curve in curves]).reshape(-1, 2, 3)
    turn = inner * wrapped(ends[:, 1, 2] - ends[:, 0, 2])
    turning = [k for k in range(len(curves)) if turn[k] > TURN]
    middle = {k: curves[k].at([curves[k].length / 2])[0] for k in turning}
    shift_of: dict[int, float] = {}
    for k in turning:
        heading = middle[k][2]
        inwards = inner * np.array([-np.sin(heading), np.cos(heading)])
        for j in turning:
            opposed = abs(wrapped(ends[k, 0, 2] - ends[j, 0, 2] + np.pi)) < OPPOSITE
            if not opposed or curves[k].line.distance(curves[j].line) >= APART_M:
                continue
            distance_m = float((middle[k][:2] - middle[j][:2]) @ inwards)
            lacking_m = float(np.clip((APART_M - distance_m) / 2, 0.0, MOST_M))
            shift_of[groups[k]] = max(shift_of.get(groups[k], 0.0), lacking_m)
    adjusted = list(curves)
    for k in turning:
        if shift_m := shift_of.get(groups[k], 0.0):
            heading = middle[k][2]
            inwards = inner * np.array([-np.sin(heading), np.cos(heading)])
            points = np.array([ends[k, 0, :2], middle[k][:2] + shift_m * inwards, ends[k, 1, :2]])
            adjusted[k] = splined(points, float(ends[k, 0, 2]), float(ends[k, 1, 2]))
    return adjusted


def drawn_turns(
    ways: Mapping[Way, Passage],
    curves: Mapping[Way, Curve],
    strips: Mapping[str, Strip],
    followed: Mapping[str, NDArray[np.float64]],
) -> dict[Way, Curve]:
    """Return the centre lines of lane movements along drawn lines through a junction.

    The drawn line is the centre of all lanes that turn side by side. A movement begins and ends in
    its lanes and continues in them where the line does not reach.

    Args:
        ways: passages through a junction by lane movement.
        curves: their paths without drawn lines, which begin and end in their lanes.
        strips: strips of the incoming and outgoing edges.
        followed: edge within the junction -> its line (N, 2).
    """
    beside: dict[Passage, list[Way]] = defaultdict(list)
    lines: dict[Passage, NDArray[np.float64]] = {}
    for movement, passage in ways.items():
        drawn = [followed[edge.id] for edge in passage.path[1:-1] if edge.id in followed]
        lane = passage.entry.lanes[movement[1]]
        is_cycle_track = passage.entry.is_cycle_track
        if drawn and (is_cycle_track or lane.admits("passenger") or lane.admits("bus")):
            beside[passage].append(movement)
            lines[passage] = np.vstack(drawn)
    turn_curves: dict[Way, Curve] = {}
    for passage, movements in beside.items():
        # Lanes are counted from the kerb.
        order = sorted({movement[1:2] + movement[3:] for movement in movements})
        widths = [passage.entry.lanes[k].width for k, _ in order]
        middle = _distinct(smoothed(_distinct(lines[passage]), LINE_M, radius_m=RADIUS_M))
        kerb = np.cumsum(widths) - np.array(widths) / 2
        outward = strips[passage.entry.id].outward
        for movement in movements:
            place = outward * (sum(widths) / 2 - kerb[order.index((movement[1], movement[3]))])
            ends = curves[movement].at([0.0, curves[movement].length])
            turn_curves[movement] = _offset_path(middle, ends, float(place))
    return turn_curves


def _offset_path(middle: NDArray[np.float64], ends: NDArray[np.float64], place: float) -> Curve:
    """Return a path between two poses (2, 3), ``place`` metres left of a line (N, 2)."""
    lane = _offset_line(middle, place)
    length = float(stations_of_points(lane)[-1])
    ahead = np.column_stack([np.cos(ends[:, 2]), np.sin(ends[:, 2])])
    shift = np.zeros_like(lane)
    for k, station in ((0, stations_of_points(lane)), (-1, stations_of_points(lane[::-1])[::-1])):
        left = np.array([-ahead[k, 1], ahead[k, 0]])
        lacking_m = float((ends[k, :2] - lane[k]) @ left)
        # Two arcs of about that radius, joined in the middle.
        reach = min(float(np.sqrt(6.0 * SHIFT_RADIUS_M * abs(lacking_m))), length / 2)
        share = np.clip(station / max(reach, 1e-9), 0.0, 1.0)
        shift += np.outer(lacking_m * (1.0 - share * share * (3.0 - 2.0 * share)), left)
    lane = lane + shift
    within = ((lane - ends[0, :2]) @ ahead[0] > 0.5) & ((ends[1, :2] - lane) @ ahead[1] > 0.5)
    course = _distinct(np.vstack([ends[0, :2], lane[_middle_run(within)], ends[1, :2]]))
    headings = float(ends[0, 2]), float(ends[1, 2])
    calm = smoothed(course, LANE_M, headings=headings, radius_m=RADIUS_M)
    return splined(resampled(calm, SPACING_M), *headings)


def _middle_run(within: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the mask of points between the ends; far around a bend, points may lie behind them."""
    between_ends = np.ones_like(within)
    half = len(within) // 2
    if len(behind_start := np.flatnonzero(~within[:half])):
        between_ends[: behind_start[-1] + 1] = False
    if len(beyond := np.flatnonzero(~within[half:])):
        between_ends[half + beyond[0] :] = False
    return between_ends


def _offset_line(middle: NDArray[np.float64], place: float) -> NDArray[np.float64]:
    """Return a smooth line (N, 2) offset to its left by ``place`` metres."""
    leg = np.gradient(middle, axis=0)
    return aside(np.column_stack([middle, np.arctan2(leg[:, 1], leg[:, 0])]), place)


def _distinct(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points without consecutive duplicates."""
    is_distinct = np.linalg.norm(np.diff(points, axis=0), axis=1) > 0.01
    return np.asarray(points[np.concatenate([[True], is_distinct])])
