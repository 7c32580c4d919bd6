"""Events whose actors' ways are ours: they are put into a motion, and nobody else changes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import StageError
from urbantwin.traffic.events.lane_way import Way, lane_way
from urbantwin.traffic.events.places import Spot, find_spot
from urbantwin.traffic.events.scenario import (
    BicycleWithoutLight,
    Crowd,
    Event,
    Passage,
    PlacedEvent,
    UTurn,
    WrongWay,
)
from urbantwin.traffic.events.surroundings import Surroundings, passage_of_path
from urbantwin.traffic.prescribed import PrescribedPath, usual_asset
from urbantwin.twin import Twin

__all__ = ["USUAL_SPEED_MS", "Scripted", "Setting", "bicycle_without_light", "crowd"]
__all__ += ["drive_along", "first_free", "passage", "u_turn", "wrong_way"]

#: Who is put in drives as fast as its class does in towns, m/s.
USUAL_SPEED_MS = {
    "car": 8.0,
    "truck": 7.0,
    "bus": 7.0,
    "motorcycle": 9.0,
    "bicycle": 5.0,
    "pedestrian": 1.4,
}
#: Who is put in stays at least so far from everybody else, metres.
CLEAR_M = 0.25
#: Times that are tried lie so far apart, seconds.
_TRIED_EVERY_S = 0.5
#: Moments of a path lie so far apart, seconds.
MOMENT_S = 0.1
#: Paths begin and end so far from the place, metres.
REACH_M = 60.0
#: The tightest turns of vehicles, radius of the middle of the vehicle, metres: what U-turns try.
_RADII_M = {"car": (5.5, 5.0, 4.5), "bicycle": (3.0, 2.0), "motorcycle": (4.0, 3.0)}
_LARGE_RADII_M = (9.0, 8.0)
#: Share of a U-turn that may lie beside the carriageway.
_BESIDE = 0.03


@dataclass(frozen=True, eq=False)
class Setting:
    """What an event happens in.

    Attributes:
        twin: where.
        others: who is there.
        seed: of random choices of this event.
        number: of the event, which chooses its meshes.
    """

    twin: Twin
    others: Surroundings
    seed: int
    number: int

    @property
    def until_s(self) -> float:
        """The last step of the motion."""
        return float(self.others.motion.times()[-1])


@dataclass(frozen=True, eq=False)
class Scripted:
    """Who is put into a motion for an event.

    Attributes:
        paths: who, and how they move.
        from_s: when the event begins.
        until_s: and ends.
        with_track: the track of the traffic that it is about; ``None`` for whoever comes nearest.
        told: what is to be said of it besides.
    """

    paths: tuple[PrescribedPath, ...]
    from_s: float
    until_s: float
    with_track: int | None = None
    told: dict[str, Any] = field(default_factory=dict)


def first_free(
    event: Event,
    setting: Setting,
    build: Callable[[float], Sequence[PrescribedPath]],
    ignoring: frozenset[int] = frozenset(),
) -> tuple[float, Sequence[PrescribedPath]]:
    """Return the time nearest to the event's at which its actors run into nobody, and the actors.

    Args:
        event: says when, and how far from that.
        setting: where it happens.
        build: makes the actors for a time.
        ignoring: tracks that do not count.

    Raises:
        StageError: there is no such time; who is in the way is told.
    """
    in_the_way = ""
    for at_s in _times(event, setting.until_s):
        paths = build(at_s)
        blocked = False
        for path in paths:
            passage = passage_of_path(path, setting.others.motion)
            if not len(passage.time_s):
                continue
            found = setting.others.nearest(passage, ignoring)
            if found is not None and found.gap_m < CLEAR_M:
                blocked = True
                in_the_way = in_the_way or (
                    f"track {found.track} comes as near as {found.gap_m:.2f} m at "
                    f"{found.at_s:.1f} s"
                )
                break
        if not blocked:
            return at_s, paths
    raise StageError(
        f"{event.event} at {event.at_s:g} s cannot be staged: no free time within "
        f"{event.within_s:g} s of it ({in_the_way})"
    )


def _times(event: Event, until_s: float) -> Iterator[float]:
    """Yield the times to try, the nearest first."""
    yield event.at_s
    for number in range(1, int(event.within_s / _TRIED_EVERY_S) + 1):
        for sign in (1, -1):
            at_s = round(event.at_s + sign * number * _TRIED_EVERY_S, 6)
            if 0 <= at_s < until_s:
                yield at_s


def drive_along(
    way: Way,
    place_m: float,
    at_s: float,
    speed: float,
    actor_class: str,
    asset: str,
    *,
    until_s: float | None = None,
) -> PrescribedPath:
    """Return somebody who goes along a way evenly, and is at a place on it at a time.

    Args:
        way: the way.
        place_m: the place, metres from the way's start.
        at_s: the time.
        speed: m/s.
        actor_class: who.
        asset: its mesh.
        until_s: the end of the motion, before and after which nobody is kept; ``None`` for all of
            the way.

    Raises:
        StageError: nothing of it is within the motion.
    """
    first, last = at_s - place_m / speed, at_s + (way.length - place_m) / speed
    if until_s is not None:
        first, last = max(first, 0.0), min(last, until_s)
    if last <= first:
        raise StageError(f"the {actor_class} would come beyond the motion")
    times = np.linspace(first, last, max(round((last - first) / MOMENT_S), 2) + 1)
    xy = way.at(place_m + (times - at_s) * speed)
    return PrescribedPath(actor_class, asset, times, xy)


def wrong_way(event: WrongWay, setting: Setting) -> Scripted:
    """Drive against the direction of the lane at the place."""
    return _along_lane(event, setting, event.actor, event.speed, backwards=True)


def bicycle_without_light(event: BicycleWithoutLight, setting: Setting) -> Scripted:
    """Ride along the lane at the place, on the kerb's side."""
    return _along_lane(event, setting, "bicycle", event.speed, told={"unlit": True})


def passage(event: Passage, setting: Setting) -> Scripted:
    """Come along the lane at the place, as anybody does."""
    speed = event.speed or USUAL_SPEED_MS[event.actor]
    return _along_lane(event, setting, event.actor, speed)


def _along_lane(
    event: PlacedEvent,
    setting: Setting,
    actor_class: str,
    speed: float,
    *,
    backwards: bool = False,
    told: dict[str, Any] | None = None,
) -> Scripted:
    """Go along the lane at the place evenly, two-wheelers on the kerb's side if there is room."""
    spot = find_spot(event.place, setting.twin, event.users)
    way, place_m = lane_way(
        setting.twin.roads,
        spot.lane,
        spot.along_m,
        event.users,
        back_m=REACH_M,
        ahead_m=REACH_M,
    )
    if backwards:
        way, place_m = way.reversed(), way.length - place_m
    mesh = usual_asset(actor_class, setting.number)
    refused: StageError | None = None
    for beside_m in _lateral(actor_class, spot, setting.twin):
        line = way.moved(-beside_m if backwards else beside_m) if beside_m else way
        at_m = line.length * place_m / way.length

        def build(at_s: float, line: Way = line, at_m: float = at_m) -> list[PrescribedPath]:
            until_s = setting.until_s
            return [drive_along(line, at_m, at_s, speed, actor_class, mesh, until_s=until_s)]

        try:
            at_s, paths = first_free(event, setting, build)
        except StageError as error:
            refused = refused or error
            continue
        return _of(paths, {"at_s": at_s, "lane": spot.lane.id, "speed": speed, **(told or {})})
    assert refused is not None
    raise refused


def u_turn(event: UTurn, setting: Setting) -> Scripted:
    """Turn round from the place's lane to the one of the other direction."""
    spot = find_spot(event.place, setting.twin, event.users)
    back = _opposite(event, spot, setting.twin)
    there, place_m = lane_way(
        setting.twin.roads, spot.lane, spot.along_m, event.actor, back_m=REACH_M, ahead_m=1.0
    )
    away, begin_m = lane_way(
        setting.twin.roads, back.lane, back.along_m, event.actor, back_m=1.0, ahead_m=REACH_M
    )
    before = there.at(np.arange(0.0, place_m, 0.5))
    after = away.at(np.arange(begin_m, away.length, 0.5))
    area = setting.twin.roads.carriageway(spot.lane.level)
    for radius in _RADII_M.get(event.actor, _LARGE_RADII_M):
        turn = _omega(spot, back, radius)
        line = shapely.LineString(turn)
        beside = shapely.difference(line, area).length / line.length
        if beside <= _BESIDE:
            break
    else:
        raise StageError(
            f"u_turn at {event.at_s:g} s cannot be staged: the street is too narrow for a "
            f"{event.actor} to turn at {spot.xy[0]:.1f}, {spot.xy[1]:.1f}"
        )
    # The way back begins where the turn has led to, ahead or behind.
    keep = (after - turn[-1]) @ np.array([np.cos(back.yaw), np.sin(back.yaw)]) > 0.4
    way = Way(np.vstack([before, turn, after[keep]]))
    middle = way.station_of(turn[len(turn) // 2])
    mesh = usual_asset(event.actor, setting.number)

    def build(at_s: float) -> list[PrescribedPath]:
        return [
            drive_along(way, middle, at_s, event.speed, event.actor, mesh, until_s=setting.until_s)
        ]

    at_s, paths = first_free(event, setting, build)
    told = {"at_s": at_s, "lane": spot.lane.id, "to_lane": back.lane.id, "radius_m": radius}
    return _of(paths, told)


def crowd(event: Crowd, setting: Setting) -> Scripted:
    """Let people stand together on what is walked on around the place."""
    spot = find_spot(event.place, setting.twin, event.users)
    roads = setting.twin.roads
    walked = shapely.union_all(
        [roads.footway(spot.lane.level), roads.area_of(("crossing",), spot.lane.level)]
    )
    random = np.random.Generator(np.random.Philox(key=[setting.seed, 7000 + setting.number]))
    from_s, until_s = event.at_s, min(event.at_s + event.lasts_s, setting.until_s)
    paths: list[PrescribedPath] = []
    # A crowd of 1.5 people per square metre still lets everybody stand (Fruin, Pedestrian Planning
    # and Design, 1971: level of service D).
    radius = float(np.sqrt(event.count / 1.5 / np.pi)) + 0.5
    taken: list[NDArray[np.float64]] = []
    for trial in range(200 * event.count):
        turn, out, facing = random.random(3)
        spread = radius * (1.0 + trial / (50.0 * event.count))
        at = spot.xy + spread * np.sqrt(out) * np.array(
            [np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)]
        )
        if any(float(np.hypot(*(at - one))) < 0.65 for one in taken):
            continue
        if not shapely.contains_xy(walked, *at):
            continue
        inwards = float(np.arctan2(*(spot.xy - at)[::-1])) + (facing - 0.5)
        path = PrescribedPath(
            "pedestrian",
            usual_asset("pedestrian", len(paths) + 31 * setting.number),
            np.array([from_s, until_s]),
            np.array([at, at]),
            yaw=np.array([inwards, inwards]),
            speed=np.zeros(2),
        )
        found = setting.others.nearest(passage_of_path(path, setting.others.motion))
        if found is not None and found.gap_m < 0.05:
            continue
        paths.append(path)
        taken.append(at)
        if len(paths) == event.count:
            return Scripted(tuple(paths), from_s, until_s, told={"people": len(paths)})
    raise StageError(
        f"crowd at {event.at_s:g} s cannot be staged: room for {len(paths)} of {event.count} people"
        f" on what is walked on around {spot.xy[0]:.1f}, {spot.xy[1]:.1f}"
    )


def _of(paths: Sequence[PrescribedPath], told: dict[str, Any]) -> Scripted:
    first = min(float(path.time_s[0]) for path in paths)
    last = max(float(path.time_s[-1]) for path in paths)
    return Scripted(tuple(paths), first, last, told=told)


def _lateral(actor_class: str, spot: Spot, twin: Twin) -> tuple[float, ...]:
    """Return how far to the left of the lane's middle to try, metres: two-wheelers at the kerb."""
    if actor_class not in ("bicycle", "motorcycle"):
        return (0.0,)
    kerb = -1.0 if twin.roads.driving_side == "right" else 1.0
    room = max(spot.lane.width / 2 - 0.5, 0.0)
    return (kerb * room, 0.0, -kerb * room)


def _opposite(event: UTurn, spot: Spot, twin: Twin) -> Spot:
    """Return the nearest place on a lane that leads the other way."""
    found = []
    for lane in twin.roads.lanes:
        if lane.kind not in ("driving", "bus") or event.actor not in lane.allowed:
            continue
        line = shapely.LineString(lane.centre[:, :2])
        along = float(shapely.line_locate_point(line, shapely.Point(spot.xy)))
        if not 2.0 < along < line.length - 5.0:
            continue
        ends = [
            shapely.get_coordinates(line.interpolate(along + way))[0] for way in (-0.5, 0.0, 0.5)
        ]
        yaw = float(np.arctan2(*(ends[2] - ends[0])[::-1]))
        away = float(np.hypot(*(ends[1] - spot.xy)))
        if np.cos(yaw - spot.yaw) < -0.85 and away < 25.0:
            found.append((away, lane.id, Spot(lane, along, ends[1], yaw)))
    if not found:
        raise StageError(
            f"u_turn at {event.at_s:g} s cannot be staged: no lane for a {event.actor} leads back "
            f"beside {spot.lane.id}"
        )
    return min(found, key=lambda one: one[:2])[2]


def _omega(spot: Spot, back: Spot, radius: float) -> NDArray[np.float64]:
    """Return a turn (N, 2) of a radius onto the way back: outwards first where that is too near.

    Between lanes that are less than two radii apart it leads away by an angle a, round by a half
    turn and 2 a, and back by a: cos a = (apart / 2 + radius) / (2 radius).
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
