"""U-turns on the street."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import StageError
from urbantwin.roads import Lane
from urbantwin.traffic.events.lane_way import Way, lane_way
from urbantwin.traffic.events.places import Spot, find_spot, spot_on
from urbantwin.traffic.events.scenario import UTurn
from urbantwin.traffic.events.scripted import (
    REACHES_M,
    Scripted,
    Setting,
    drive_along,
    first_free,
    span_of,
)
from urbantwin.traffic.prescribed import PrescribedPath, usual_asset
from urbantwin.twin import Twin

__all__ = ["TurnInThree", "turn_in_three", "u_turn"]

#: Heading change of the first move of a three-point turn, rad.
_FIRST_MOVE_RAD = np.radians(75.0)
#: Mean speed within a move, m/s; pause after each, s; braking before and acceleration after, m/s2.
_MOVE_SPEED_MS, _PAUSE_S, _GENTLE_ACCELERATION_MS2 = 1.5, 0.8, 2.0
_POINT_SPACING_M, _TIME_SPACING_S = 0.1, 0.1


class TurnInThree(NamedTuple):
    """Path of a three-point turn.

    Attributes:
        time_s: (N,) seconds, relative to the middle of the second move, backwards.
        xy: (N, 2) site frame, metres.
        yaw: (N,) heading, rad, unwrapped.
        moves: (M, 2) points of the three moves alone.
    """

    time_s: NDArray[np.float64]
    xy: NDArray[np.float64]
    yaw: NDArray[np.float64]
    moves: NDArray[np.float64]


def turn_in_three(
    spot: Spot, back: Spot, radius: float, before: Way, away: Way, speed: float
) -> TurnInThree | None:
    """Return a three-point turn on circles of one radius; ``None`` if none reaches the lane back.

    With heading changes a and then b, it moves across by R (1 - cos a), back by R (cos a - cos b),
    and on by R (1 + cos b): together 2 R (1 - cos a + cos b), the distance of the lanes.

    Args:
        spot: begin of the turn.
        back: a place on the lane in the opposite direction.
        radius: turning radius of the vehicle's centre, metres.
        before: path to the spot.
        away: path onwards from the place on the lane back.
        speed: speed on both, m/s.
    """
    ahead = np.array([np.cos(spot.yaw), np.sin(spot.yaw)])
    left = np.array([-ahead[1], ahead[0]])
    across = float((back.xy - spot.xy) @ left)
    side, apart = np.sign(across), abs(across)
    cosine = np.cos(_FIRST_MOVE_RAD) - 1.0 + apart / (2 * radius)
    if not -0.95 < cosine < np.cos(_FIRST_MOVE_RAD):
        return None
    second = float(np.arccos(cosine))
    pieces: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
    x = y = 0.0
    for first, last, direction in (
        (0.0, _FIRST_MOVE_RAD, 1.0),
        (_FIRST_MOVE_RAD, second, -1.0),
        (second, np.pi, 1.0),
    ):
        count = max(int((last - first) * radius / _POINT_SPACING_M), 4)
        turned = np.linspace(first, last, count + 1)
        local = np.column_stack(
            [
                x + direction * radius * (np.sin(turned) - np.sin(first)),
                y + direction * radius * (np.cos(first) - np.cos(turned)),
            ]
        )
        x, y = local[-1]
        xy = spot.xy + local[:, :1] * ahead + side * local[:, 1:] * left
        pieces.append((xy, spot.yaw + side * turned))
    facing = np.array([np.cos(back.yaw), np.sin(back.yaw)])
    onwards = away.points[(away.points - pieces[-1][0][-1]) @ facing > 0.4]
    if len(onwards) < 2:
        return None
    times, places, yaws = _stopping_profile(before, speed, stops=True)
    clock = float(times[-1]) + _PAUSE_S
    middle_s = clock
    for number, (xy, yaw) in enumerate(pieces):
        lasts = len(xy) * _POINT_SPACING_M / _MOVE_SPEED_MS
        share = np.linspace(0.0, 1.0, max(int(lasts / _TIME_SPACING_S), 4) + 1)
        done = (1 - np.cos(np.pi * share)) / 2 * (len(xy) - 1)
        rows = np.arange(len(xy))
        times = np.append(times, clock + share * lasts)
        places = np.vstack(
            [places, *[np.column_stack([np.interp(done, rows, axis) for axis in xy.T])]]
        )
        yaws = np.append(yaws, np.interp(done, rows, yaw))
        if number == 1:
            middle_s = clock + lasts / 2
        clock += lasts + _PAUSE_S
    last_times, last_places, last_yaws = _stopping_profile(Way(onwards), speed, stops=False)
    times = np.append(times, clock + last_times)
    places = np.vstack([places, last_places])
    yaws = np.unwrap(np.append(yaws, last_yaws))
    moves = np.vstack([xy for xy, _ in pieces])
    return TurnInThree(times - middle_s, places, yaws, moves)


def _stopping_profile(
    way: Way, speed: float, *, stops: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return times (N,), positions and headings along a path with a stop at its end or its begin.

    Times begin at 0.
    """
    gentle_m = min(speed * speed / (2 * _GENTLE_ACCELERATION_MS2), way.length)
    gentle_s = np.sqrt(2 * gentle_m / _GENTLE_ACCELERATION_MS2)
    even_s = (way.length - gentle_m) / speed
    times = np.linspace(
        0.0, even_s + gentle_s, max(int((even_s + gentle_s) / _TIME_SPACING_S), 2) + 1
    )
    off = times if not stops else times[-1] - times
    travelled_m = np.where(
        off < gentle_s,
        _GENTLE_ACCELERATION_MS2 * off**2 / 2,
        gentle_m + np.maximum(off - gentle_s, 0.0) * speed,
    )
    station = way.length - travelled_m if stops else travelled_m
    heading = np.array([way.heading(float(station_m)) for station_m in station])
    return times, way.at(station), np.unwrap(heading)


#: Offsets along the lane at which a U-turn is tried, metres.
_SHIFTS_M = tuple(sorted((5.0 * k for k in range(-6, 7)), key=abs))
#: Turning radii of the vehicles' centres that are tried, metres, down to the tightest.
_RADII_M = {"car": (5.5, 5.0, 4.5), "bicycle": (3.0, 2.0), "motorcycle": (4.0, 3.0)}
_LARGE_RADII_M = (9.0, 8.0)
#: Maximum distance to a junction that is used if the street has no room, places beyond the stop
#: line, and maximum distance of the lane back, metres.
_TO_JUNCTION_M, _BEYOND_M, _MAX_BACK_DISTANCE_M = 60.0, (2.0, 5.0, 8.0, 12.0), 30.0
_MAX_PARALLEL_COS = -0.95
#: Share of a U-turn that may lie beside the carriageway.
_MAX_OFF_ROAD_SHARE = 0.03


def u_turn(event: UTurn, setting: Setting) -> Scripted:
    """Make a U-turn from the place's lane to the opposite one, where there is room."""
    requested = find_spot(event.place, setting.twin, event.users)
    refused: StageError | None = None
    for shift_m in _SHIFTS_M:
        along_m = requested.along_m + shift_m
        if not (0 <= along_m <= requested.lane.length):
            continue
        try:
            return _u_turn_at(event, setting, spot_on(requested.lane, along_m), shift_m)
        except StageError as error:
            refused = refused or error
    for spot, back in _in_junction(event, requested, setting.twin):
        try:
            shift_m = round(requested.lane.length - requested.along_m, 1)
            return _u_turn_at(event, setting, spot, shift_m, back)
        except StageError as error:
            refused = refused or error
    assert refused is not None
    raise refused


def _u_turn_at(
    event: UTurn, setting: Setting, spot: Spot, shift_m: float, back: Spot | None = None
) -> Scripted:
    """Make a U-turn at a spot, to a place on the lane back.

    Raises:
        StageError: there is no room, or no free time.
    """
    back = _opposite(event, spot, setting.twin) if back is None else back
    approach, place_m = lane_way(
        setting.twin.roads, spot.lane, spot.along_m, event.actor, back_m=REACHES_M[0], ahead_m=1.0
    )
    away, begin_m = lane_way(
        setting.twin.roads, back.lane, back.along_m, event.actor, back_m=1.0, ahead_m=REACHES_M[0]
    )
    area = setting.twin.roads.carriageway(spot.lane.level)
    for radius in _RADII_M.get(event.actor, _LARGE_RADII_M):
        turn = _omega(spot, back, radius)
        line = shapely.LineString(turn)
        beside = shapely.difference(line, area).length / line.length
        if beside <= _MAX_OFF_ROAD_SHARE:
            break
    else:
        in_three = _three_point_turn(event, setting, spot, back, approach, place_m, away, begin_m)
        if in_three is not None:
            return in_three
        raise StageError(
            f"u_turn at {event.at_s:g} s cannot be staged: the street is too narrow for a "
            f"{event.actor} to turn at {spot.xy[0]:.1f}, {spot.xy[1]:.1f}"
        )
    refused: StageError | None = None
    for reach_m in REACHES_M:
        before = approach.at(np.arange(max(place_m - reach_m, 0.0), place_m, 0.5))
        after = away.at(np.arange(begin_m, min(begin_m + reach_m, away.length), 0.5))
        # The path back begins where the turn ends, which may lie ahead or behind.
        keep = (after - turn[-1]) @ np.array([np.cos(back.yaw), np.sin(back.yaw)]) > 0.4
        way = Way(np.vstack([before, turn, after[keep]]))
        middle = way.station_of(turn[len(turn) // 2])
        mesh = usual_asset(event.actor, setting.number)

        def build(
            at_s: float, way: Way = way, middle: float = middle, mesh: str = mesh
        ) -> list[PrescribedPath]:
            until_s = setting.until_s
            return [drive_along(way, middle, at_s, event.speed, event.actor, mesh, until_s=until_s)]

        try:
            at_s, paths = first_free(event, setting, build)
        except StageError as error:
            refused = refused or error
            continue
        report = {"at_s": at_s, "lane": spot.lane.id, "to_lane": back.lane.id, "radius_m": radius}
        return span_of(paths, {**report, "moved_along_m": shift_m} if shift_m else report)
    assert refused is not None
    raise refused


def _three_point_turn(
    event: UTurn,
    setting: Setting,
    spot: Spot,
    back: Spot,
    there: Way,
    place_m: float,
    away: Way,
    begin_m: float,
) -> Scripted | None:
    """Make a three-point turn, if there is room; two-wheelers never need one.

    Raises:
        StageError: there is room, but no free time.
    """
    if event.actor in ("bicycle", "motorcycle"):
        return None
    area = setting.twin.roads.carriageway(spot.lane.level)
    mesh = usual_asset(event.actor, setting.number)
    refused: StageError | None = None
    for reach_m, radius in product(REACHES_M, _RADII_M.get(event.actor, _LARGE_RADII_M)):
        before = Way(there.at(np.arange(max(place_m - reach_m, 0.0), place_m + 0.01, 0.5)))
        onwards = Way(away.at(np.arange(begin_m, min(begin_m + reach_m, away.length), 0.5)))
        turn = turn_in_three(spot, back, radius, before, onwards, event.speed)
        if turn is None:
            continue
        moves = shapely.MultiPoint(turn.moves)
        if len(shapely.get_parts(shapely.difference(moves, area))) > _MAX_OFF_ROAD_SHARE * len(
            turn.moves
        ):
            continue

        def build(at_s: float, turn: TurnInThree = turn) -> list[PrescribedPath]:
            times = turn.time_s + at_s
            in_span = (times >= 0) & (times <= setting.until_s)
            path = PrescribedPath(
                event.actor, mesh, times[in_span], turn.xy[in_span], turn.yaw[in_span]
            )
            return [path]

        try:
            at_s, paths = first_free(event, setting, build)
        except StageError as error:
            refused = refused or error
            continue
        report = {"at_s": at_s, "lane": spot.lane.id, "to_lane": back.lane.id, "radius_m": radius}
        return span_of(paths, {**report, "moves": 3})
    if refused is not None:
        raise refused
    return None


def _opposite(event: UTurn, spot: Spot, twin: Twin) -> Spot:
    """Return the nearest place on a lane in the opposite direction."""
    candidates = []
    for lane in twin.roads.lanes:
        if lane.kind not in ("driving", "bus") or event.actor not in lane.allowed:
            continue
        line = shapely.LineString(lane.centre[:, :2])
        along = float(shapely.line_locate_point(line, shapely.Point(spot.xy)))
        if not 2.0 < along < line.length - 5.0:
            continue
        ends = [
            shapely.get_coordinates(line.interpolate(along + offset_m))[0]
            for offset_m in (-0.5, 0.0, 0.5)
        ]
        yaw = float(np.arctan2(*(ends[2] - ends[0])[::-1]))
        away = float(np.hypot(*(ends[1] - spot.xy)))
        if np.cos(yaw - spot.yaw) < -0.85 and away < 25.0:
            candidates.append((away, lane.id, Spot(lane, along, ends[1], yaw)))
    if not candidates:
        raise StageError(
            f"u_turn at {event.at_s:g} s cannot be staged: no lane for a {event.actor} leads back "
            f"beside {spot.lane.id}"
        )
    return min(candidates, key=lambda candidate: candidate[:2])[2]


def _in_junction(event: UTurn, asked: Spot, twin: Twin) -> Iterator[tuple[Spot, Spot]]:
    """Yield places in the junction at the end of a lane, and on opposite lanes from there.

    Streets with a median allow U-turns only there.
    """
    lane = asked.lane
    if lane.length - asked.along_m > _TO_JUNCTION_M:
        return
    end, before = (_place(lane, lane.length - away) for away in (0.0, 2.0))
    ahead = (end - before) / max(float(np.hypot(*(end - before))), 1e-9)
    yaw, left = float(np.arctan2(*ahead[::-1])), np.array([-ahead[1], ahead[0]])
    candidates = []
    for other in twin.roads.lanes:
        if other.kind not in ("driving", "bus") or event.actor not in other.allowed:
            continue
        start, onwards = _place(other, 0.0), _place(other, 2.0)
        back_yaw = float(np.arctan2(*(onwards - start)[::-1]))
        apart = abs(float((start - end) @ left))
        if (
            np.cos(back_yaw - yaw) < _MAX_PARALLEL_COS
            and abs((start - end) @ ahead) < _MAX_BACK_DISTANCE_M > apart
        ):
            candidates.append((apart, other.id, Spot(other, 0.0, start, back_yaw)))
    for _, _, back in sorted(candidates, key=lambda candidate: candidate[:2]):
        for beyond_m in _BEYOND_M:
            yield Spot(lane, lane.length, end + beyond_m * ahead, yaw), back


def _place(lane: Lane, along_m: float) -> NDArray[np.float64]:
    """Return a point on a lane (2,)."""
    point = shapely.LineString(lane.centre[:, :2]).interpolate(along_m)
    return np.array([point.x, point.y])


def _omega(spot: Spot, back: Spot, radius: float) -> NDArray[np.float64]:
    """Return a turn (N, 2) of a given radius onto the lane back, outwards first if too near.

    Between lanes less than two radii apart it leads away by an angle a, round by a half turn and 2
    a, and back by a: cos a = (apart / 2 + radius) / (2 radius).
    """
    ahead = np.array([np.cos(spot.yaw), np.sin(spot.yaw)])
    left = np.array([-ahead[1], ahead[0]])
    across = float((back.xy - spot.xy) @ left)
    side = 1.0 if across > 0 else -1.0
    apart = abs(across)
    swing = float(np.arccos(min((apart / 2 + radius) / (2 * radius), 1.0)))
    wide = max(apart - 2 * radius, 0.0)
    pieces = [(-swing, radius), (np.pi / 2 + swing, radius)]
    local = [np.zeros(2)]
    heading = 0.0
    if swing <= 1e-9:
        pieces = [(np.pi / 2, radius)]

    def run(turned: float, around: float) -> None:
        nonlocal heading
        steps = max(int(abs(turned) * around / 0.25), 2)
        for _ in range(steps):
            heading += turned / steps / 2
            local.append(
                local[-1]
                + abs(turned) * around / steps * np.array([np.cos(heading), np.sin(heading)])
            )
            heading += turned / steps / 2

    for turned, around in pieces:
        run(turned, around)
    if wide:
        local.append(local[-1] + wide * np.array([np.cos(heading), np.sin(heading)]))
    for turned, around in pieces[::-1]:
        run(turned, around)
    points = np.array(local)
    return np.asarray(spot.xy + points[:, :1] * ahead + side * points[:, 1:] * left)
