"""Speeds in curves: the limit from a lane's curvature, with braking before it."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from urbantwin.geometry import stations_of_points

__all__ = ["SPACING_M", "curve_speeds", "lane_speeds"]

#: Lateral acceleration that drivers accept in urban curves, m/s^2: 0.23 g, the side friction for
#: streets designed for 40 km/h (AASHTO, Geometric Design, 2011).
SIDEWAYS_MS2 = 2.2
#: Deceleration before a curve, m/s^2: well below the comfortable 3.4 of most drivers (AASHTO).
BRAKING_MS2 = 2.0
#: Minimum speed in curves, m/s, also for the tightest turns.
LEAST_MS = 1.5
#: A curve is measured by two chords. Their length is that of a car or, for faster vehicles, the
#: distance driven in the time that a driver takes to turn the wheel, seconds.
CHORDS_M = (3.5, 5.5, 8.0, 11.0, 15.0)
STEERING_S = 0.6
#: Vehicles accelerate after a curve when their rear has left it, at this distance after the front,
#: metres.
REAR_M = 4
#: Spacing of the places with a speed, metres.
SPACING_M = 1.0
STRAIGHT_PER_M = 1e-4
#: Points closer to each other are one, metres.
SAME_M = 0.01
#: Length of the lanes considered before and behind a connection through a junction, metres.
BEFORE_M, BEHIND_M = 15.0, 60.0
#: Maximum number of lanes of a connection.
MOST_LANES = 8


def curve_speeds(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the speed limit (M,) from curvature, every ``SPACING_M`` from a line's start, m/s.

    In a curve of radius r it is sqrt(a r); before it, the speed from which braking is possible.

    Args:
        line: (N, 2) its points, metres.
    """
    along = stations_of_points(line)
    places = np.arange(0.0, along[-1] + SPACING_M, SPACING_M)
    speed = np.full(len(places), LEAST_MS)
    curvatures = np.maximum(_curvatures(line, along, places), STRAIGHT_PER_M)
    for k, (chord, bend) in enumerate(zip(CHORDS_M, curvatures, strict=True)):
        allowed = np.sqrt(SIDEWAYS_MS2 / bend)
        # Longer chords apply to vehicles that are fast enough to steer along them.
        fast = allowed >= (chord / STEERING_S if k else 0.0)
        limit = CHORDS_M[k + 1] / STEERING_S if k + 1 < len(CHORDS_M) else np.inf
        speed = np.maximum(speed, np.where(fast, np.minimum(allowed, limit), 0.0))
    speed = np.min(
        [np.r_[speed[:1].repeat(k), speed][: len(speed)] for k in range(REAR_M + 1)], axis=0
    )
    reach = 2 * BRAKING_MS2 * places
    energy = np.minimum.accumulate((speed**2 + reach)[::-1])[::-1]
    return np.asarray(np.sqrt(np.maximum(energy - reach, 0.0)))


def lane_speeds(
    network: etree._Element, only: Collection[str] | None = None
) -> dict[str, NDArray[np.float64]]:
    """Return the speeds of ``curve_speeds`` on all lanes for vehicles, in SUMO's length units.

    All lanes of an edge have one length in SUMO, so a vehicle on the outside of a bend covers more
    ground than SUMO's position indicates. Positions and speeds are scaled to SUMO's length.

    A connection is evaluated together with its incoming and outgoing lane, so that corners between
    two lanes and curves just behind are included.

    Args:
        network: the root of a ``.net.xml``.
        only: ids of lanes; all by default.
    """
    lines: dict[str, NDArray[np.float64]] = {}
    lengths: dict[str, float] = {}
    for edge in network.iterfind("edge"):
        if edge.get("function") not in ("crossing", "walkingarea"):
            for lane in edge.iterfind("lane"):
                points = [point.split(",")[:2] for point in lane.get("shape", "").split()]
                line = _distinct(np.array(points, np.float64).reshape(-1, 2))
                if len(line) > 1:
                    lines[lane.get("id", "")] = line
                    lengths[lane.get("id", "")] = float(lane.get("length", "nan"))
    before: dict[str, str] = {}
    after: dict[str, str] = {}
    for item in network.iterfind("connection"):
        start = f"{item.get('from')}_{item.get('fromLane')}"
        end = f"{item.get('to')}_{item.get('toLane')}"
        via = item.get("via", end)
        before.setdefault(via, start)
        after.setdefault(via, end)
        if start.startswith(":"):
            after[start] = via
    by_lane = {}
    for name, line in lines.items():
        if only is not None and name not in only:
            continue
        drawn = float(stations_of_points(line)[-1])
        stretch = drawn / lengths[name] if lengths[name] > 0 else 1.0
        speeds = _speeds_on_lane(name, lines, before, after)
        places = np.arange(0.0, drawn / stretch + SPACING_M, SPACING_M) * stretch
        by_lane[name] = np.interp(places, np.arange(len(speeds)) * SPACING_M, speeds) / stretch
    return by_lane


def _speeds_on_lane(
    name: str,
    lines: Mapping[str, NDArray[np.float64]],
    before: Mapping[str, str],
    after: Mapping[str, str],
) -> NDArray[np.float64]:
    """Return the speeds (M,) on a lane, ``lines[name]``, m/s."""
    lane_line = lines[name]
    count = int(stations_of_points(lane_line)[-1] / SPACING_M) + 1
    if not name.startswith(":"):
        return curve_speeds(lane_line)[:count]
    incoming = _beginning(lines.get(before.get(name, ""), lane_line[:1])[::-1], BEFORE_M)[::-1]
    parts, current = [lane_line], name
    while current.startswith(":") and len(parts) < MOST_LANES and after.get(current, "") in lines:
        current = after[current]
        parts.append(lines[current])
    line = _beginning(np.vstack(parts), count * SPACING_M + BEHIND_M)
    joined = _distinct(np.vstack([incoming, line]))
    first = int(stations_of_points(np.vstack([incoming, lane_line[:1]]))[-1] / SPACING_M)
    return curve_speeds(joined)[first : first + count]


def _beginning(line: NDArray[np.float64], length_m: float) -> NDArray[np.float64]:
    """Return the first ``length_m`` metres of a line."""
    along = stations_of_points(line)
    end = [np.interp(length_m, along, line[:, k]) for k in (0, 1)]
    return np.vstack([line[along < length_m], end])


def _distinct(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a line without consecutive duplicate points."""
    is_distinct = np.linalg.norm(np.diff(line, axis=0), axis=1) > SAME_M
    return np.asarray(line[np.concatenate([[True], is_distinct])]) if len(line) else line


def _curvatures(
    line: NDArray[np.float64], along: NDArray[np.float64], places: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the curvature (C, M) at places of a line from C pairs of chords, 1/m."""
    chords = np.array(CHORDS_M)
    offsets = np.concatenate([[0.0], -chords, chords])[:, None]
    points = _at(line, along, (places + offsets).ravel()).reshape(len(offsets), -1, 2)
    a, b = points[0] - points[1 : len(chords) + 1], points[len(chords) + 1 :] - points[0]
    turn = np.arctan2(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], (a * b).sum(axis=-1))
    return np.asarray(np.abs(turn) / chords[:, None])


def _at(
    line: NDArray[np.float64], along: NDArray[np.float64], places: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the points (M, 2) of a line at places, extended straight beyond its ends."""
    points = np.column_stack([np.interp(places, along, line[:, k]) for k in (0, 1)])
    for end, inner, beyond in ((0, 1, places), (-1, -2, places - along[-1])):
        leg = (line[end] - line[inner]) / max(float(np.linalg.norm(line[end] - line[inner])), 1e-9)
        beyond_m = np.maximum(-beyond if end == 0 else beyond, 0.0)
        points += beyond_m[:, None] * leg
    return points
