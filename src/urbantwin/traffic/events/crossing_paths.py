"""Actors that cross the path of a vehicle of the traffic with a requested margin."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import StageError
from urbantwin.traffic.assets import asset
from urbantwin.traffic.events.lane_way import Way, lane_way
from urbantwin.traffic.events.measures import conflict
from urbantwin.traffic.events.places import Spot, find_spot
from urbantwin.traffic.events.scenario import ChildBetweenParkedCars, NearMiss
from urbantwin.traffic.events.scripted import (
    CLEAR_M,
    MOMENT_S,
    USUAL_SPEED_MS,
    Scripted,
    Setting,
    drive_along,
)
from urbantwin.traffic.events.surroundings import passage_of_path
from urbantwin.traffic.prescribed import PrescribedPath, usual_asset

__all__ = ["child_between_parked_cars", "near_miss"]

_VEHICLES = ("car", "van", "truck", "bus", "motorcycle")
#: Length of the crossing actor's path before and beyond the vehicle's path, metres.
_BEFORE_M = {"pedestrian": 6.0, "bicycle": 25.0}
_BEYOND_M = {"pedestrian": 6.0, "bicycle": 20.0}
#: Spacing of the points of a path that are checked for obstacles, metres.
_CHECK_SPACING_M = 0.5
#: Shares of that length that are tried if there are obstacles.
_LENGTH_SHARES = {"pedestrian": (1.0,), "bicycle": (1.0, 0.5, 0.3)}
_LANE_PATH_M = 45.0
#: Range of decelerations, m/s2; the highest is that on dry asphalt.
_MAX_DECELERATION_MS2, _MIN_DECELERATION_MS2 = 9.0, 0.5
#: Least duration of the motion after the encounter, seconds.
_MIN_AFTER_S = 4.0
#: Maximum number of vehicles tried, by distance in time.
_MAX_VEHICLES_TRIED = 12
#: Gap between the braking actor and the other's path, metres.
_MARGIN_M = 0.5
#: Tolerance of the requested times, seconds.
_TIME_TOLERANCE_S = 0.06
#: Distance of parked cars from the kerb, and gap between them, metres.
_KERB_DISTANCE_M, _PARKED_GAP_M = 0.3, 1.6
#: Time before and after the encounter for which cars stand that cannot be parked throughout,
#: seconds.
_PARKED_AROUND_S = 8.0
#: Offsets along the street of the places tried for parked cars, metres.
_SHIFTS_M = tuple(sorted((4.0 * k for k in range(-8, 9)), key=abs))


def near_miss(event: NearMiss, setting: Setting) -> Scripted:
    """Cross the path of the vehicle that passes the place nearest to the requested time."""
    spot = find_spot(event.place, setting.twin, event.users)
    return _with_passing_vehicle(
        event,
        setting,
        spot,
        lambda track, meets_s: _near_miss(event, setting, track, meets_s),
        # Coordinates give a place, not a lane of a junction.
        yaw=None if event.place.lane is None and event.place.street is None else spot.yaw,
        near_m=2.5 if event.place.lane is not None else 6.0,
    )


def _with_passing_vehicle(
    event: NearMiss | ChildBetweenParkedCars,
    setting: Setting,
    spot: Spot,
    stage: Callable[[int, float], Scripted],
    *,
    yaw: float | None,
    near_m: float,
) -> Scripted:
    """Return the result of ``stage`` for the first passing vehicle for which it succeeds.

    Raises:
        StageError: ``stage`` fails for each vehicle; the message is that of the first.
    """
    passing = setting.others.passing(
        spot.xy,
        event.at_s,
        event.within_s,
        classes=_VEHICLES,
        yaw=yaw,
        until_s=setting.until_s - _MIN_AFTER_S,
        near_m=near_m,
    )
    refused = ""
    for track, meets_s in passing[:_MAX_VEHICLES_TRIED]:
        try:
            return stage(track, meets_s)
        except StageError as error:
            refused = refused or str(error)
    raise StageError(refused or _no_vehicle_text(event, spot.lane.id))


def _near_miss(event: NearMiss, setting: Setting, track: int, meets_s: float) -> Scripted:
    """Cross the path of a track with the requested margin.

    Raises:
        StageError: it is not possible.
    """
    target = setting.others.passage(track)
    meeting_xy = np.array([np.interp(meets_s, target.time_s, axis) for axis in target.xy.T])
    yaw = float(np.interp(meets_s, target.time_s, np.unwrap(target.yaw)))
    speed = event.speed or USUAL_SPEED_MS[event.actor]
    mesh = usual_asset(event.actor, setting.number)
    refused = ""
    for route in _ways_across(event, setting, meeting_xy, yaw):
        place_m = route.station_of(meeting_xy)
        if _is_blocked(route, mesh, setting):
            refused = refused or (
                f"near_miss at {event.at_s:g} s cannot be staged: something that stands is in the "
                f"way of the {event.actor}"
            )
            continue
        try:
            if event.pet_s is not None:
                path = _passing(event, setting, route, place_m, meets_s, speed, mesh, track)
            else:
                path = _braking(event, setting, route, place_m, meets_s, speed, mesh, track)
        except StageError as error:
            refused = refused or str(error)
            continue
        passage = passage_of_path(path, setting.others.motion)
        other = setting.others.nearest(passage, frozenset({track}))
        if other is not None and other.gap_m < CLEAR_M:
            refused = refused or (
                f"near_miss at {event.at_s:g} s cannot be staged: track {other.track} comes as "
                f"near as {other.gap_m:.2f} m to the {event.actor}"
            )
            continue
        requested = {"pet_s": event.pet_s} if event.pet_s is not None else {"ttc_s": event.ttc_s}
        report = {"asked": requested, "meets_at_s": round(meets_s, 3)}
        ends = float(path.time_s[0]), float(path.time_s[-1])
        return Scripted((path,), *ends, with_track=track, told=report)
    raise StageError(refused)


def child_between_parked_cars(event: ChildBetweenParkedCars, setting: Setting) -> Scripted:
    """Park two cars at the kerb, and let a child run out from between them."""
    spot = find_spot(event.place, setting.twin, event.users)
    return _with_passing_vehicle(
        event,
        setting,
        spot,
        lambda track, _: _child(event, setting, spot, track),
        yaw=spot.yaw,
        near_m=2.5,
    )


def _child(event: ChildBetweenParkedCars, setting: Setting, spot: Spot, track: int) -> Scripted:
    """Let a child run out in front of a track.

    Raises:
        StageError: it is not possible.
    """
    target = setting.others.passage(track)
    refused = ""
    for shift in _SHIFTS_M:
        route, place_m = lane_way(
            setting.twin.roads, spot.lane, spot.along_m, "car", back_m=40.0, ahead_m=40.0
        )
        station = place_m + shift
        if not 12.0 < station < route.length - 12.0:
            continue
        place_xy = route.at(np.array([station]))[0]
        away = np.hypot(*(target.xy - place_xy).T)
        if float(away.min()) > 2.5:
            continue
        meets_s = float(target.time_s[int(np.argmin(away))])
        if abs(meets_s - event.at_s) > event.within_s:
            continue
        side = -1.0 if setting.twin.roads.driving_side == "right" else 1.0
        parked: list[PrescribedPath] = []
        # Parked throughout, at the kerb, or half or fully on the sidewalk; else only around the
        # encounter.
        around = (
            max(meets_s - _PARKED_AROUND_S, 0.0),
            min(meets_s + _PARKED_AROUND_S, setting.until_s),
        )
        parking_options = [
            (further, span)
            for span in ((0.0, setting.until_s), around)
            for further in (0, 1.2, 2.2)
        ]
        for further_m, span in parking_options:
            cars, out_m = _parked(setting, route, station, side, further_m, span)
            passages = [passage_of_path(car, setting.others.motion) for car in cars]
            nearest_ones = [setting.others.nearest(passage) for passage in passages]
            in_the_way = [
                neighbour
                for neighbour in nearest_ones
                if neighbour is not None and neighbour.gap_m < 0.1
            ]
            if not in_the_way:
                parked = cars
                break
            refused = refused or f"track {in_the_way[0].track} goes where a car would be parked"
        if not parked:
            continue
        yaw = route.heading(station)
        left = np.array([-np.sin(yaw), np.cos(yaw)])
        start, end = place_xy + side * left * out_m, place_xy - side * left * 7.0
        line = Way(np.linspace(start, end, 40))
        nearest = line.station_of(target.xy[int(np.argmin(away))])
        child = _passing(
            event, setting, line, nearest, meets_s, event.speed, "pedestrian-child", track
        )
        waits = max(float(child.time_s[0]) - 4.0, 0.0)
        if waits < child.time_s[0] - 0.2:
            child = PrescribedPath(
                "pedestrian",
                child.asset,
                np.concatenate([[waits], child.time_s]),
                np.vstack([child.xy[:1], child.xy]),
                yaw=np.full(len(child.time_s) + 1, float(np.arctan2(*(end - start)[::-1]))),
            )
        other = setting.others.nearest(
            passage_of_path(child, setting.others.motion), frozenset({track})
        )
        if other is not None and other.gap_m < 0.1:
            refused = refused or f"track {other.track} is in the child's way"
            continue
        report: dict[str, Any] = {"asked": {"pet_s": event.pet_s}, "meets_at_s": round(meets_s, 3)}
        return Scripted(
            (child, *parked),
            float(child.time_s[0]),
            float(child.time_s[-1]),
            with_track=track,
            told=report,
        )
    reason = refused or "the vehicle does not keep to its lane there"
    raise StageError(f"{event.event} at {event.at_s:g} s cannot be staged: {reason}")


def _parked(
    setting: Setting,
    way: Way,
    station: float,
    side: float,
    further_m: float,
    span: tuple[float, float],
) -> tuple[list[PrescribedPath], float]:
    """Return two cars parked on one side of a path, and the lateral offset of a child behind them.

    They stand at the kerb, or ``further_m`` farther from the path, during an interval.
    """
    station_xy, yaw = way.at(np.array([station]))[0], way.heading(station)
    across = side * np.array([-np.sin(yaw), np.cos(yaw)])
    line = shapely.LineString([station_xy, station_xy + 15.0 * across])
    road = shapely.intersection(line, setting.twin.roads.carriageway(0))
    pieces = [
        piece
        for piece in shapely.get_parts(road)
        if piece.distance(shapely.Point(station_xy)) < 0.5
    ]
    kerb_m = max((piece.length for piece in pieces), default=2.0)
    names = [usual_asset("car", 3 * setting.number + k) for k in (1, 2)]
    widest = max(asset(name).width for name in names)
    # Without room beside the lane they stand half on the sidewalk.
    out_m = max(kerb_m - _KERB_DISTANCE_M - widest / 2, 2.0 + widest / 2) + further_m
    cars = []
    for name, sign in zip(names, (1.0, -1.0), strict=True):
        middle = station + sign * (_PARKED_GAP_M / 2 + asset(name).length / 2)
        heading = way.heading(middle)
        out = side * out_m * np.array([-np.sin(heading), np.cos(heading)])
        place = way.at(np.array([middle]))[0] + out
        cars.append(
            PrescribedPath(
                "car",
                name,
                np.array([span[0], max(span[1], span[0] + 1e-3)]),
                np.array([place, place]),
                yaw=np.full(2, heading),
                speed=np.zeros(2),
            )
        )
    return cars, out_m + widest / 2 + 0.5


def _is_blocked(way: Way, mesh: str, setting: Setting) -> bool:
    """Return whether a body that moves along a path overlaps a static obstacle."""
    stations = np.linspace(0.0, way.length, int(way.length / _CHECK_SPACING_M) + 2)
    yaw = np.array([way.heading(float(station_m)) for station_m in stations])
    body = asset(mesh)
    size = body.length, body.width, body.height
    return bool(setting.solid.met(way.at(stations), yaw, size).any())


def _ways_across(
    event: NearMiss, setting: Setting, at: NDArray[np.float64], yaw: float
) -> list[Way]:
    """Return paths over a place, the best first: lanes for motor vehicles, else straight lines."""
    if event.actor in ("car", "motorcycle"):
        return _lanes_across(event.actor, setting, at, yaw)
    kerb = -1.0 if setting.twin.roads.driving_side == "right" else 1.0
    paths = []
    for share, side in product(_LENGTH_SHARES[event.actor], (kerb, -kerb)):
        across = share * side * np.array([-np.sin(yaw), np.cos(yaw)])
        ends = at + across * _BEFORE_M[event.actor], at - across * _BEYOND_M[event.actor]
        paths.append(Way(np.linspace(*ends, 60)))
    return paths


def _lanes_across(
    actor_class: str, setting: Setting, at: NDArray[np.float64], yaw: float
) -> list[Way]:
    """Return paths along lanes that cross a heading near a place, shifted onto the place."""
    roads = setting.twin.roads
    candidates = []
    for lane in roads.lanes:
        if lane.kind != "connection" or actor_class not in lane.allowed or lane.length < 4.0:
            continue
        line = shapely.LineString(lane.centre[:, :2])
        if line.distance(shapely.Point(at)) > 6.0:
            continue
        along = float(shapely.line_locate_point(line, shapely.Point(at)))
        route, station = lane_way(
            roads, lane, along, actor_class, back_m=_LANE_PATH_M, ahead_m=_LANE_PATH_M
        )
        angle = abs(float(np.sin(route.heading(station) - yaw)))
        off = at - route.at(np.array([station]))[0]
        if angle > 0.6:
            candidates.append((round(float(np.hypot(*off)) - 3 * angle, 6), lane.id, route, off))
    if not candidates:
        raise StageError(
            f"near_miss cannot be staged: no lane for a {actor_class} crosses the way of the "
            f"vehicle within 6 m of {at[0]:.1f}, {at[1]:.1f}; a place in the junction is needed"
        )
    return [Way(route.points + off, route.lanes) for _, _, route, off in sorted(candidates)[:6]]


def _passing(
    event: NearMiss | ChildBetweenParkedCars,
    setting: Setting,
    way: Way,
    place_m: float,
    meets_s: float,
    speed: float,
    mesh: str,
    track: int,
) -> PrescribedPath:
    """Return an actor with constant speed that leaves a post-encroachment time to a track.

    Both keep their paths, so that a delay changes the post-encroachment time by the same amount.
    """
    wanted = event.pet_s
    assert wanted is not None
    before = getattr(event, "passes", "before") == "before"
    actor = str(getattr(event, "actor", "pedestrian"))
    target = setting.others.passage(track).between(meets_s - 12.0, meets_s + 12.0)
    over_s = meets_s + (-4.0 if before else 4.0)
    pet_s: float | None = None
    for _ in range(4):
        path = drive_along(way, place_m, over_s, speed, actor, mesh)
        passage = passage_of_path(path, setting.others.motion)
        between = conflict(passage, target) if len(passage.time_s) > 1 else None
        pet_s = None if between is None else between.pet_s
        if pet_s is None:
            break
        if abs(pet_s - wanted) <= 0.015:
            break
        over_s += (pet_s - wanted) if before else (wanted - pet_s)
    if pet_s is None or abs(pet_s - wanted) > _TIME_TOLERANCE_S:
        raise StageError(
            f"{event.event} at {event.at_s:g} s cannot be staged: "
            f"a post-encroachment time of {wanted:g} s to track {track} is not reached"
        )
    return drive_along(way, place_m, over_s, speed, actor, mesh, until_s=setting.until_s)


def _braking(
    event: NearMiss,
    setting: Setting,
    way: Way,
    place_m: float,
    meets_s: float,
    speed: float,
    mesh: str,
    track: int,
) -> PrescribedPath:
    """Return an actor on a collision course with a track that brakes in time."""
    wanted = event.ttc_s
    assert wanted is not None
    target = setting.others.passage(track).between(meets_s - 12.0, meets_s + 12.0)
    stands_m = _stopping_station(setting, way, place_m, mesh, target)
    path: PrescribedPath | None = None
    # Late braking gives a short time to collision; the deceleration determines how late.
    low, high = _MIN_DECELERATION_MS2, _MAX_DECELERATION_MS2
    reached = np.inf
    for _ in range(18):
        middle = (low + high) / 2
        trial = _stopping(
            way, place_m, meets_s, speed, stands_m, middle, event, (mesh, setting.until_s)
        )
        between = conflict(passage_of_path(trial, setting.others.motion), target)
        ttc = np.inf if between is None or between.ttc_s is None else between.ttc_s
        if abs(ttc - wanted) < abs(reached - wanted):
            path, reached = trial, ttc
        if ttc > wanted:
            low = middle
        else:
            high = middle
    if path is None or abs(reached - wanted) > _TIME_TOLERANCE_S:
        raise StageError(
            f"near_miss at {event.at_s:g} s cannot be staged: a {event.actor} at {speed:g} m/s "
            f"that can stop does not come to a time to collision of {wanted:g} s with track {track}"
        )
    return path


def _stopping_station(
    setting: Setting,
    way: Way,
    place_m: float,
    mesh: str,
    target: Any,  # noqa: ANN401
) -> float:
    """Return the station at which an actor stands just before the target's path."""
    swept = shapely.union_all(target.boxes())
    half = asset(mesh).length / 2
    for station in np.arange(place_m, 0.0, -0.1):
        ahead = way.at(np.array([station + half + _MARGIN_M]))[0]
        heading = way.heading(station)
        side = np.array([-np.sin(heading), np.cos(heading)]) * asset(mesh).width / 2
        front = shapely.LineString([ahead + side, ahead - side])
        if not front.intersects(swept):
            return float(station)
    return 0.0


def _stopping(
    way: Way,
    place_m: float,
    meets_s: float,
    speed: float,
    stands_m: float,
    deceleration: float,
    event: NearMiss,
    mesh_and_end: tuple[str, float],
) -> PrescribedPath:
    """Return an actor that would meet the target, stops before its path, and then proceeds.

    Args:
        way: path of the actor.
        place_m: station at which it would meet the target.
        meets_s: time at which it would meet the target.
        speed: m/s.
        stands_m: station at which it stops.
        deceleration: deceleration, m/s2; the higher, the later it brakes.
        event: the event.
        mesh_and_end: its mesh, and the end of the motion, seconds.
    """
    mesh, until_s = mesh_and_end
    braking_m = speed * speed / (2 * deceleration)
    starts_s = meets_s - place_m / speed
    brakes_s = starts_s + max(stands_m - braking_m, 0.0) / speed
    stops_s = brakes_s + speed / deceleration
    goes_s = max(stops_s, meets_s) + 2.0
    times = np.arange(max(starts_s, 0.0), min(goes_s + 8.0, until_s) + 1e-9, MOMENT_S)
    even = stands_m - braking_m - np.maximum(brakes_s - times, 0.0) * speed
    slowing = np.clip(times - brakes_s, 0.0, speed / deceleration)
    station = even + speed * slowing - deceleration * slowing**2 / 2
    away = np.maximum(times - goes_s, 0.0)
    station += np.where(away < speed / 1.5, 0.75 * away**2, speed * (away - speed / 3.0))
    heading = np.array([way.heading(float(station_m)) for station_m in station])
    return PrescribedPath(event.actor, mesh, times, way.at(station), yaw=heading)


def _no_vehicle_text(event: NearMiss | ChildBetweenParkedCars, lane: str) -> str:
    return (
        f"{event.event} at {event.at_s:g} s cannot be staged: nobody drives past "
        f"the place on lane {lane} within {event.within_s:g} s of it"
    )
