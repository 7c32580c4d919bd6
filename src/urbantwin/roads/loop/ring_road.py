"""Ring roads: outer roads round the region from one-way exits to distant one-way entries."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from urbantwin.roads.loop.dubins import Pose2
from urbantwin.roads.loop.free_space import Points, band, dubins_points, unit
from urbantwin.roads.loop.layout import CLEARANCE_M, Gate, Layout, half_width, outer_tags

__all__ = ["WAY_OUT_M", "add_ring_roads"]

#: Radius of the bends, metres, and their speed limit, km/h: 2.8 m/s^2 lateral.
RADIUS_M, KMH = 25.0, 30
#: Spacing of points along a road, metres.
STEP_M = 8.0
#: Length of the straight way out of a gate that is reserved for its road, metres.
WAY_OUT_M = 130.0


def add_ring_roads(
    layout: Layout, exits: list[Gate], entries: list[Gate], tips: list[Gate]
) -> tuple[int, int]:
    """Join exits to entries; return the number of roads made and of gates left open.

    With exits only or entries only, the far points of turnarounds replace the others.
    """
    if not (exits or entries):
        return 0, 0
    starts, ends = exits or tips, entries or tips
    if not (starts and ends):
        return 0, len(exits) + len(entries)
    hull = layout.space.hull
    length = float(hull.exterior.length)
    stations = [
        np.array([layout.space.place(gate.point, gate.heading) for gate in gates])
        for gates in (starts, ends)
    ]
    distances = ring_distance(stations[0], stations[1], length)
    if exits and entries:
        pairs = match_exits(stations[0], stations[1], length)
    elif exits:
        pairs = [(k, int(row.argmin())) for k, row in enumerate(distances)]
    else:
        pairs = [(int(column.argmin()), k) for k, column in enumerate(distances.T)]
    # The shortest first: roads inside a longer one must exist before it.
    pairs.sort(key=lambda pair: (float(distances[pair]), pair))
    leave, arrive = Counter(i for i, _ in pairs), Counter(j for _, j in pairs)
    for i, j in pairs:
        leave[i] -= 1
        arrive[j] -= 1
        forward = (stations[1][j] - stations[0][i]) % length <= length / 2
        _road(layout, starts[i], ends[j], forward, leave[i] > 0, arrive[j] > 0)
    return len(pairs), 0


def _road(
    layout: Layout,
    exit_: Gate,
    entry: Gate,
    forward: bool,
    more_leave: bool,
    more_arrive: bool,
) -> None:
    """Add one road round the region.

    Of roads that share a gate, the outermost leads straight into it; inner ones join it from the
    side.
    """
    street = exit_ if exit_.street >= 0 else entry
    lanes = entry.lanes if entry.street >= 0 else exit_.lanes
    lane_m = max(exit_.lane_m, entry.lane_m)
    tags = outer_tags(street.tags, lanes, lane_m, side=layout.side, kmh=KMH, sidewalks="both")
    half = half_width(lanes * lane_m, tags)
    ring = layout.space.ring(half)
    a, b = (_station(ring, gate) for gate in (exit_, entry))
    line: list[Points] = []
    joints: dict[int, int] = {}
    first, last = exit_.node, entry.node
    start, end = _pose(ring, a, exit_.heading), _pose(ring, b, entry.heading + math.pi)
    sense = 1.0 if forward else -1.0
    if more_leave:
        first, start = layout.new_node(), _pose(ring, a, _course(ring, a, sense))
        exit_.joints.append((first, np.array(start[:2])))
    else:
        line.append(exit_.point)
        for node, point in exit_.joints:
            joints[len(line)] = node
            line.append(point)
    if more_arrive:
        last, end = layout.new_node(), _pose(ring, b, _course(ring, b, sense))
    paths = _candidate_paths(ring, start, end, a, b, sense)
    path = min(paths, key=lambda path: layout.space.walls_on(band(path, half)))
    line += list(path)
    if more_arrive:
        entry.joints.append((last, np.array(end[:2])))
    else:
        for node, point in reversed(entry.joints):
            joints[len(line)] = node
            line.append(point)
        line.append(entry.point)
    points = np.array(line)
    layout.space.take(shapely.LineString(points).buffer(half + CLEARANCE_M))
    layout.add_halves(points, tags, first=first, last=last, joints=joints)


def _candidate_paths(
    ring: shapely.LinearRing, start: Pose2, end: Pose2, a: float, b: float, sense: float
) -> list[Points]:
    """Return candidate paths (N, 2) between two poses: along the ring if they are far apart on it.

    Otherwise straight across, and through a point of the ring between, to avoid buildings.
    """
    length = float(ring.length)
    arc = (sense * (b - a)) % length
    bend = 2.5 * RADIUS_M
    if arc < 3 * bend:
        middle = _pose(ring, a + sense * arc / 2, _course(ring, a + sense * arc / 2, sense))
        halves = (dubins_points(start, middle, RADIUS_M), dubins_points(middle, end, RADIUS_M))
        return [dubins_points(start, end, RADIUS_M), np.vstack([halves[0], halves[1][1:]])]
    stations = a + sense * np.linspace(bend, arc - bend, max(2, int((arc - 2 * bend) / STEP_M) + 1))
    points = shapely.get_coordinates(ring.interpolate(stations % length))
    on, off = (
        (float(x), float(y), _course(ring, float(s), sense))
        for (x, y), s in ((points[0], stations[0]), (points[-1], stations[-1]))
    )
    return [
        np.vstack(
            [dubins_points(start, on, RADIUS_M), points[1:-1], dubins_points(off, end, RADIUS_M)]
        )
    ]


def _station(ring: shapely.LinearRing, gate: Gate) -> float:
    """Return where the straight way out of a gate crosses the ring, metres along it."""
    ray = shapely.LineString([gate.point, gate.point + unit(gate.heading) * float(ring.length)])
    meet = shapely.get_coordinates(shapely.intersection(ray, ring))
    return float(ring.project(shapely.Point(meet[0] if len(meet) else gate.point)))


def _pose(ring: shapely.LinearRing, station: float, heading: float) -> Pose2:
    point = ring.interpolate(station % float(ring.length))
    return float(point.x), float(point.y), heading


def _course(ring: shapely.LinearRing, station: float, sense: float) -> float:
    """Return the heading along the ring at a station."""
    length = float(ring.length)
    stations = [(station + sense * d) % length for d in (-1.0, 1.0)]
    (x0, y0), (x1, y1) = shapely.get_coordinates(ring.interpolate(stations))
    return math.atan2(y1 - y0, x1 - x0)


def ring_distance(
    start: NDArray[np.float64], end: NDArray[np.float64], length: float
) -> NDArray[np.float64]:
    """Return the shorter distances (N, M) along a ring between places (N,) and (M,), metres."""
    gap = np.abs(np.asarray(start)[:, None] - np.asarray(end)[None])
    return np.asarray(np.minimum(gap, length - gap))


def match_exits(
    exits: NDArray[np.float64], entries: NDArray[np.float64], length: float
) -> list[tuple[int, int]]:
    """Return pairs (exit, entry) that include each at least once and give short roads.

    The cost of a pair is the square root of its length along the border. With a concave cost the
    cheapest pairs never cross, because uncrossing two of them always saves (McCann, "Exact
    solutions to the transportation problem on the line", Proceedings of the Royal Society A 455,
    1999). Roads outside the region can then be drawn without crossings.

    Args:
        exits: (N,) places of the exits along the border, metres.
        entries: (M,) places of the entries.
        length: length of the border, metres.
    """
    if not len(exits) or not len(entries):
        return []
    cost = np.sqrt(ring_distance(exits, entries, length))
    swap = len(exits) < len(entries)
    if swap:
        cost = cost.T
    # Each of the more numerous side is in one pair; those without a free partner share the nearest.
    rows, columns = cost.shape
    padded = np.hstack([cost, np.repeat(cost.min(axis=1, keepdims=True), rows - columns, axis=1)])
    row, column = linear_sum_assignment(padded)
    pairs = [
        (int(r), int(c) if c < columns else int(cost[r].argmin()))
        for r, c in zip(row, column, strict=True)
    ]
    return sorted((c, r) if swap else (r, c) for r, c in pairs)
