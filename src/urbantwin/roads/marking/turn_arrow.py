"""Turn arrows on lanes before their stop lines."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
import shapely
import shapely.ops
from numpy.typing import NDArray
from shapely.affinity import affine_transform

from urbantwin.geometry import wrapped
from urbantwin.roads.network import Lane, RoadNetwork

__all__ = ["ARROW_M", "arrow", "arrow_at", "turn_arrow", "turns"]

#: Length of an arrow, and distance of its tip from the stop line, metres.
ARROW_M, BEFORE_STOP_M = 6.0, 2.5
#: Candidate lengths of signed arrows if room lacks (TSRGD 2016, diagram 1038: 4 m; US MUTCD figure
#: 3B-24: 2.4 to 3.9 m), and minimum distance from the stop line and the lane's start, metres.
LENGTHS_M, CLOSEST_M = (6.0, 5.0, 4.0, 3.0), 0.8
#: Minimum length of lanes with two signed arrows, and their spacing (US MUTCD 3B.20: at least two,
#: one of them near where the lane begins), metres.
LONG_M, AGAIN_M = 45.0, 30.0
#: Turns in the map (OSM wiki, "Key:turn") -> painted arrows.
PAINTED = {
    "left": "left", "slight_left": "left", "sharp_left": "left", "merge_to_left": "left",
    "right": "right", "slight_right": "right", "sharp_right": "right", "merge_to_right": "right",
    "through": "through", "reverse": "around",
}  # fmt: skip
ORDER: tuple[str, ...] = ("left", "through", "right", "around")
#: Arrows are bent where their line deviates more than this from straight, metres.
BENT_M = 0.1
#: Lane width of an arrow of normal width, metres, and maximum scale; narrower lanes have narrower
#: arrows.
LANE_M, WIDEST = 3.0, 1.15
#: Length of the line upstream, metres; maximum turn of connections that lead straight on, radians.
UPSTREAM_M, STRAIGHT = 20.0, np.radians(45.0)
#: Maximum turn of through movements, and minimum turn of U-turns, radians.
STRAIGHT_ON, U_TURN = np.radians(30.0), np.radians(150.0)


def turn_arrow(network: RoadNetwork, lane: Lane) -> shapely.Geometry | None:
    """Return the arrows before a lane's stop line, site frame, metres.

    Signed turns of the map are painted, twice on long lanes. Without any on the street, arrows show
    the lane's movements, except where it leads to no junction, or has no signal and only goes
    straight on or allows all turns. The arrow of a signed lane that is too short is further
    upstream (`approach_line`); other short lanes have none.
    """
    if lane.kind == "bicycle":
        return None
    if lane.arrows is None:
        return _movement_arrow(network, lane)
    words = {PAINTED[word] for word in lane.arrows if word in PAINTED}
    shown = tuple(movement for movement in ORDER if movement in words)
    line: shapely.LineString | None = shapely.LineString(lane.centre[:, :2])
    if lane.length < ARROW_M + 2 * BEFORE_STOP_M:
        line = approach_line(network, lane)
    if not shown or line is None or line.length < LENGTHS_M[-1] + 2 * CLOSEST_M + 1e-6:
        return None
    before = float(np.clip((line.length - ARROW_M) / 2, CLOSEST_M, BEFORE_STOP_M))
    room = line.length - before - CLOSEST_M
    length, tip = next(length_m for length_m in LENGTHS_M if length_m <= room), line.length - before
    tips = [tip] if line.length < LONG_M else [tip, tip - AGAIN_M]
    return shapely.union_all([arrow_on(line, shown, lane.width, tip, length) for tip in tips])


def _movement_arrow(network: RoadNetwork, lane: Lane) -> shapely.Geometry | None:
    """Return the arrow for a lane's movements; ``None`` if it needs none."""
    movements = turns(network, lane)
    if not movements or lane.length < ARROW_M + 2 * BEFORE_STOP_M:
        return None
    plain = movements == ("through",) or {"left", "through", "right"} <= set(movements)
    if plain and lane.id not in network.stopped_lanes:
        return None
    return arrow_at(movements, lane, lane.length - BEFORE_STOP_M, ARROW_M)


def arrow_at(ways: tuple[str, ...], lane: Lane, at: float, length: float) -> shapely.Geometry:
    """Return an arrow with its tip on a lane's centre line, ``at`` metres from the lane's start."""
    return arrow_on(shapely.LineString(lane.centre[:, :2]), ways, lane.width, at, length)


def arrow_on(
    line: shapely.LineString, ways: tuple[str, ...], width: float, at: float, length: float
) -> shapely.Geometry:
    """Return an arrow with its tip on a line, ``at`` metres from its start, for a lane width."""
    ends = line.interpolate([max(at - length, 0.0), at])
    a, b = shapely.get_coordinates(ends)
    c, s = (b - a) / max(float(np.linalg.norm(b - a)), 1e-9)
    arrow_width = ARROW_M * min(width / LANE_M, WIDEST)
    arrow_width *= 1.0 if length >= ARROW_M else 0.9
    middle = shapely.ops.substring(line, max(at - length, 0.0), at)
    if shapely.hausdorff_distance(middle, shapely.LineString([a, b])) > BENT_M:
        return _along_curve(arrow(ways), line, arrow_width, at, length)
    return affine_transform(
        arrow(ways), [length * c, -arrow_width * s, length * s, arrow_width * c, b[0], b[1]]
    )


def _along_curve(
    shape: shapely.Geometry, line: shapely.LineString, wide: float, at: float, length: float
) -> shapely.Geometry:
    """Return an arrow of unit length drawn along a curved line."""

    def placed(points: NDArray[np.float64]) -> NDArray[np.float64]:
        along = np.clip(at + length * points[:, 0], 0.0, line.length)
        reach = np.clip([along - 1.0, along + 1.0], 0.0, line.length)
        centre, back, ahead = (
            shapely.get_coordinates(line.interpolate(s)) for s in (along, *reach)
        )
        step = ahead - back
        step /= np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9)
        left = np.column_stack([-step[:, 1], step[:, 0]])
        return np.asarray(centre + wide * points[:, 1:] * left)

    return shapely.make_valid(shapely.transform(shape.segmentize(0.1), placed))


@cache
def arrow(ways: tuple[str, ...]) -> shapely.Geometry:
    """Return a turn arrow of length 1 along x, its tip at 0, for some movements.

    The shapes follow the arrows of road markings (US MUTCD, figure 3B-24; German RMS 1, 297).
    """
    thick, parts = 0.05, []
    several = len(ways) > 1
    if "through" in ways:
        parts += [_stroke([(-1.0, 0.0), (-0.3, 0.0)], thick)]
        parts += [shapely.Polygon([(0.0, 0.0), (-0.32, 0.12), (-0.32, -0.12)])]
    for movement, side in (("left", 1.0), ("right", -1.0)):
        if movement not in ways:
            continue
        back = 0.36 if "through" in ways else 0.0
        start = (-1.0, 0.0) if not several else (-0.62 - back, 0.0)
        bend = [(-0.34, 0.0), (-0.25, 0.015), (-0.19, 0.05), (-0.16, 0.1)]
        path = [start, *((x - back, y * side) for x, y in bend)]
        x, y = path[-1]
        head = [(x - 0.14, y), (x + 0.14, y), (x, y + 0.15 * side)]
        parts += [_stroke(path, thick), shapely.Polygon(head)]
        if several and "through" not in ways:
            parts += [_stroke([(-1.0, 0.0), (-0.3, 0.0)], thick)]
    if "around" in ways:
        side = -1.0 if "right" in ways and "left" not in ways else 1.0
        back = 0.4 if several else 0.0
        bend = [(-0.16, 0.0), (-0.08, 0.03), (-0.03, 0.1), (-0.08, 0.17), (-0.16, 0.2), (-0.3, 0.2)]
        path = [(-1.0, 0.0), *((x - back, y * side) for x, y in bend)]
        x, y = path[-1]
        head = [(x, y - 0.09), (x, y + 0.09), (x - 0.24, y)]
        parts += [_stroke(path, thick), shapely.Polygon(head)]
    shape = shapely.union_all(parts)
    # An arrow that bends to one side is shifted to the other, to centre it in the lane.
    y0, y1 = shape.bounds[1], shape.bounds[3]
    return affine_transform(shape, [1, 0, 0, 1, 0, -0.5 * (y0 + y1)])


def _stroke(path: list[tuple[float, float]], width: float) -> shapely.Geometry:
    return shapely.LineString(path).buffer(width / 2, cap_style="flat", join_style="mitre")


def approach_line(network: RoadNetwork, lane: Lane) -> shapely.LineString | None:
    """Return the line for a short signed lane's arrow, up to the lane's end.

    It begins on the connection that leads most nearly straight into the lane, and on the lane
    before that unless other turns are signed there. Only lanes without crossing traffic are part of
    it.

    Returns:
        The line; ``None`` where the lane leads straight on to one with the same arrows, whose arrow
            serves both.
    """
    if lane.id not in network.stopped_lanes:
        for connection, after in _connections(network, lane, ahead=True):
            if after.arrows == lane.arrows and _is_free(network, connection):
                return None
    points = lane.centre[:, :2]
    before = sorted(
        (abs(_turn(connection)), connection.id, connection, first)
        for connection, first in _connections(network, lane, ahead=False)
        if abs(_turn(connection)) < STRAIGHT and _is_free(network, connection)
    )
    for _, _, connection, first in before[:1]:
        points = np.vstack([connection.centre[:-1, :2], points])
        if first.arrows is None or first.arrows == lane.arrows:
            points = np.vstack([first.centre[:-1, :2], points])
    line = shapely.LineString(points)
    return shapely.ops.substring(line, max(line.length - UPSTREAM_M, 0.0), line.length)


def _connections(network: RoadNetwork, lane: Lane, *, ahead: bool) -> Iterator[tuple[Lane, Lane]]:
    """Yield the connections at a lane's end or start, each with the lane beyond it."""
    for name in lane.successors if ahead else network.lanes_into.get(lane.id, ()):
        connection = network.lane_by_id.get(name)
        if connection is None or not connection.junction:
            continue
        for other in connection.successors if ahead else network.lanes_into.get(connection.id, ()):
            beyond = network.lane_by_id.get(other)
            if beyond is not None and not beyond.junction:
                yield connection, beyond


def _turn(way: Lane) -> float:
    legs = np.diff(way.centre[:, :2], axis=0)
    first, last = (float(np.arctan2(leg[1], leg[0])) for leg in (legs[0], legs[-1]))
    return float(wrapped(last - first))


def _is_free(network: RoadNetwork, way: Lane) -> bool:
    """Return whether a connection has no signal and no crossing traffic except of its own lanes."""
    own_lanes = {*network.lanes_into.get(way.id, ())}
    if own_lanes & network.stopped_lanes:
        return False
    line = shapely.LineString(way.centre[:, :2])
    return not any(
        line.intersects(shapely.LineString(other.centre[:, :2]))
        for other in network.lanes
        if other.junction == way.junction
        and other.kind in ("connection", "crossing")
        and not own_lanes & {other.id, *network.lanes_into.get(other.id, ())}
        and not set(other.successors) & {way.id, *way.successors}
        and other.id != way.id
    )


def turns(network: RoadNetwork, lane: Lane) -> tuple[str, ...]:
    """Return the movements of a lane at its end: left, through, right, around.

    Empty for a lane that does not end at a junction.
    """
    movements = set()
    start = _heading(lane.centre[-2:, :2])
    for name in lane.successors:
        connection = network.lane_by_id.get(name)
        if connection is None or not connection.junction:
            continue
        for last in _ends_of_way(network, connection):
            change = wrapped(_heading(last.centre[-2:, :2]) - start)
            if abs(change) <= STRAIGHT_ON:
                movements.add("through")
            elif abs(change) >= U_TURN:
                movements.add("around")
            else:
                movements.add("left" if change > 0 else "right")
    return tuple(name for name in ("left", "through", "right", "around") if name in movements)


def _ends_of_way(network: RoadNetwork, way: Lane, depth: int = 6) -> Iterator[Lane]:
    """Yield the last lanes within the junction of all continuations of a lane."""
    following = [network.lane_by_id.get(name) for name in way.successors]
    inside = [lane for lane in following if lane and lane.junction == way.junction]
    if not inside or depth == 0:
        yield way
    else:
        for lane in inside:
            yield from _ends_of_way(network, lane, depth - 1)


def _heading(ends: NDArray[np.float64]) -> float:
    return float(np.arctan2(*(ends[1] - ends[0])[::-1]))
