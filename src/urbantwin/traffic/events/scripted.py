"""Events with scripted paths: their actors are inserted into a motion, others do not change."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import StageError
from urbantwin.roads import RoadNetwork
from urbantwin.traffic.assets import asset
from urbantwin.traffic.events.lane_way import Way, lane_way
from urbantwin.traffic.events.places import Spot, find_spot
from urbantwin.traffic.events.scenario import (
    BicycleWithoutLight,
    Crowd,
    Event,
    Passage,
    PlacedEvent,
    Trajectory,
    WrongWay,
)
from urbantwin.traffic.events.surroundings import Surroundings, passage_of_path
from urbantwin.traffic.motion import Motion
from urbantwin.traffic.prescribed import PrescribedPath, usual_asset
from urbantwin.traffic.solid_scene import Solid
from urbantwin.twin import Twin

__all__ = ["USUAL_SPEED_MS", "Scripted", "Setting", "WaySignals", "bicycle_without_light", "crowd"]


class WaySignals:
    """Check of red signals for an actor that moves along a path at constant speed.

    Args:
        way: the path.
        place_m: a place on it, metres from its start.
        speed: m/s.
        roads: the road network with its signals.
        motion: the motion with the signals' states.
    """

    def __init__(
        self, way: Way, place_m: float, speed: float, roads: RoadNetwork, motion: Motion
    ) -> None:
        table = motion.signals.to_pylist()
        self.stops: list[tuple[float, list[list[tuple[float, str]]]]] = []
        for head in roads.signals:
            if head.lane not in way.lanes[:-1]:
                continue
            later_s = (way.station_of(np.array([head.x, head.y])) - place_m) / speed
            shown = [
                [
                    (row["time_s"], row["state"])
                    for row in table
                    if (row["signal"], row["link"]) == (head.program, link)
                ]
                for link in head.links
            ]
            if 0 < later_s * speed + place_m < way.length:
                self.stops.append((later_s, shown))

    def __call__(self, at_s: float) -> str | None:
        """Return a red signal that an actor at the place at a time meets; ``None`` if none."""
        for later_s, links in self.stops:
            time_s = at_s + later_s
            if time_s < 0:
                continue  # before the motion
            states = [[state for from_s, state in link if from_s <= time_s] for link in links]
            if not any(link and link[-1] in "Gg" for link in states):
                return f"a signal is not green at {time_s:.1f} s"
        return None


__all__ += ["drive_along", "first_free", "passage", "span_of", "trajectory", "wrong_way"]

#: Usual speeds of inserted actors in towns, m/s.
USUAL_SPEED_MS = {
    "car": 8.0,
    "truck": 7.0,
    "bus": 7.0,
    "motorcycle": 9.0,
    "bicycle": 5.0,
    "pedestrian": 1.4,
}
#: Least gap of inserted actors to all others, metres.
CLEAR_M = 0.25
#: Spacing of the times that are tried, seconds.
_TIME_SPACING_S = 0.5
#: Every n-th step is checked first, before all of them.
_COARSE_STEPS = 8
#: Spacing of the times of a path, seconds.
MOMENT_S = 0.1
#: Length of paths before and beyond the place, metres; shorter ones are tried if others are in the
#: way.
REACHES_M = (60.0, 35.0, 20.0)


@dataclass(frozen=True, eq=False)
class Setting:
    """The surroundings of an event.

    Attributes:
        twin: the twin.
        others: actors of the motion.
        seed: random seed.
        number: number of the event, which selects its assets.
        solid: static obstacles.
    """

    twin: Twin
    others: Surroundings
    seed: int
    number: int
    solid: Solid

    @property
    def until_s(self) -> float:
        """Time of the motion's last step, seconds."""
        return float(self.others.motion.times()[-1])


@dataclass(frozen=True, eq=False)
class Scripted:
    """The actors inserted for an event.

    Attributes:
        paths: their paths.
        from_s: begin of the event.
        until_s: end of the event.
        with_track: the track of the traffic that it concerns; ``None``: the nearest.
        told: further entries of the report.
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
    refuses: Callable[[float], str | None] | None = None,
) -> tuple[float, Sequence[PrescribedPath]]:
    """Return the time nearest to the event's at which its actors hit no other, and the actors.

    Args:
        event: gives the requested time and its tolerance.
        setting: the surroundings.
        build: makes the actors for a time.
        refuses: returns another reason against a time, or ``None``.

    Raises:
        StageError: there is no such time; the message names the actor in the way.
    """
    in_the_way = ""
    for at_s in _times(event, setting.until_s):
        besides = None if refuses is None else refuses(at_s)
        if besides is not None:
            in_the_way = in_the_way or besides
            continue
        paths = build(at_s)
        blocked = False
        for path in paths:
            passage = passage_of_path(path, setting.others.motion)
            if not len(passage.time_s):
                continue
            closest = None
            if in_the_way:
                # Most times are rejected because of an actor that is in the way for a second or
                # more.
                sampled_rows = np.arange(0, len(passage.time_s), _COARSE_STEPS)
                closest = setting.others.nearest(passage.of_rows(sampled_rows))
            if closest is None or closest.gap_m >= CLEAR_M:
                closest = setting.others.nearest(passage)
            if closest is not None and closest.gap_m < CLEAR_M:
                blocked = True
                in_the_way = in_the_way or (
                    f"track {closest.track} comes as near as {closest.gap_m:.2f} m at "
                    f"{closest.at_s:.1f} s"
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
    for number in range(1, int(event.within_s / _TIME_SPACING_S) + 1):
        for sign in (1, -1):
            at_s = round(event.at_s + sign * number * _TIME_SPACING_S, 6)
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
    """Return an actor that moves along a path at constant speed and is at a place at a time.

    Args:
        way: the path.
        place_m: the place, metres from the path's start.
        at_s: the time.
        speed: m/s.
        actor_class: its class.
        asset: its mesh.
        until_s: end of the motion, to which the actor is cut; ``None``: the whole path.

    Raises:
        StageError: no part of it is within the motion.
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
    """Make a vehicle that drives against the direction of the lane at the place."""
    return _along_lane(event, setting, event.actor, event.speed, backwards=True)


def bicycle_without_light(event: BicycleWithoutLight, setting: Setting) -> Scripted:
    """Make a bicycle along the lane at the place, on the kerb's side."""
    return _along_lane(event, setting, "bicycle", event.speed, told={"unlit": True})


def passage(event: Passage, setting: Setting) -> Scripted:
    """Make an additional actor along the lane at the place."""
    speed = event.speed or USUAL_SPEED_MS[event.actor]
    return _along_lane(event, setting, event.actor, speed, heeds_signals=True)


def trajectory(event: Trajectory, setting: Setting) -> Scripted:
    """Make an actor with a given trajectory."""
    mesh = event.asset or usual_asset(event.actor, setting.number)
    times = np.array(event.time_s)
    in_motion = times < setting.until_s + MOMENT_S
    yaw = None if event.yaw_deg is None else np.radians(event.yaw_deg)[in_motion]
    xy = np.column_stack([event.x, event.y])[in_motion]
    path = PrescribedPath(event.actor, mesh, times[in_motion], xy, yaw)
    return span_of([path], {} if event.name is None else {"name": event.name})


def _along_lane(
    event: PlacedEvent,
    setting: Setting,
    actor_class: str,
    speed: float,
    *,
    backwards: bool = False,
    heeds_signals: bool = False,
    told: dict[str, Any] | None = None,
) -> Scripted:
    """Make an actor along the lane at constant speed, two-wheelers on the kerb's side.

    If other actors block the whole path, a shorter part of it is used.
    """
    spot = find_spot(event.place, setting.twin, event.users)
    mesh = usual_asset(actor_class, setting.number)
    refused: StageError | None = None
    reaches = [(reach_m, reach_m) for reach_m in REACHES_M]
    if heeds_signals:
        # The shortest path starts at the begin of the place's own lane, beyond the stop line.
        reaches.append((spot.along_m, REACHES_M[-1]))
    lateral = _lateral(actor_class, spot, setting.twin)
    for (back_m, ahead_m), beside_m in product(reaches, lateral):
        lane_path, place_m = lane_way(
            setting.twin.roads,
            spot.lane,
            spot.along_m,
            event.users,
            back_m=back_m,
            ahead_m=ahead_m,
        )
        signals: WaySignals | None = None
        if heeds_signals:
            roads, motion = setting.twin.roads, setting.others.motion
            signals = WaySignals(lane_path, place_m, speed, roads, motion)
        if backwards:
            lane_path, place_m = lane_path.reversed(), lane_path.length - place_m
        line = lane_path.moved(-beside_m if backwards else beside_m) if beside_m else lane_path
        at_m = line.length * place_m / lane_path.length

        def build(at_s: float, line: Way = line, at_m: float = at_m) -> list[PrescribedPath]:
            until_s = setting.until_s
            return [drive_along(line, at_m, at_s, speed, actor_class, mesh, until_s=until_s)]

        try:
            at_s, paths = first_free(event, setting, build, signals)
        except StageError as error:
            refused = refused or error
            continue
        return span_of(paths, {"at_s": at_s, "lane": spot.lane.id, "speed": speed, **(told or {})})
    assert refused is not None
    raise refused


def crowd(event: Crowd, setting: Setting) -> Scripted:
    """Make a group of standing pedestrians on the walkable area around the place."""
    spot = find_spot(event.place, setting.twin, event.users)
    roads = setting.twin.roads
    walked = shapely.union_all(
        [roads.footway(spot.lane.level), roads.area_of(("crossing",), spot.lane.level)]
    )
    random = np.random.Generator(np.random.Philox(key=[setting.seed, 7000 + setting.number]))
    from_s, until_s = event.at_s, min(event.at_s + event.lasts_s, setting.until_s)
    paths: list[PrescribedPath] = []
    # 1.5 persons per square metre still allow standing (Fruin, Pedestrian Planning and Design,
    # 1971: level of service D).
    radius = float(np.sqrt(event.count / 1.5 / np.pi)) + 0.5
    taken: list[NDArray[np.float64]] = []
    for trial in range(200 * event.count):
        turn, out, facing = random.random(3)
        spread = radius * (1.0 + trial / (50.0 * event.count))
        point = spot.xy + spread * np.sqrt(out) * np.array(
            [np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)]
        )
        if any(float(np.hypot(*(point - other))) < 0.65 for other in taken):
            continue
        if not shapely.contains_xy(walked, *point):
            continue
        inwards = float(np.arctan2(*(spot.xy - point)[::-1])) + (facing - 0.5)
        path = PrescribedPath(
            "pedestrian",
            usual_asset("pedestrian", len(paths) + 31 * setting.number),
            np.array([from_s, until_s]),
            np.array([point, point]),
            yaw=np.array([inwards, inwards]),
            speed=np.zeros(2),
        )
        closest = setting.others.nearest(passage_of_path(path, setting.others.motion))
        if closest is not None and closest.gap_m < 0.05:
            continue
        body = asset(path.asset)
        size = body.length, body.width, body.height
        if setting.solid.met(point[None], np.array([inwards]), size).any():
            continue
        paths.append(path)
        taken.append(point)
        if len(paths) == event.count:
            return Scripted(tuple(paths), from_s, until_s, told={"people": len(paths)})
    raise StageError(
        f"crowd at {event.at_s:g} s cannot be staged: room for {len(paths)} of {event.count} people"
        f" on what is walked on around {spot.xy[0]:.1f}, {spot.xy[1]:.1f}"
    )


def span_of(paths: Sequence[PrescribedPath], told: dict[str, Any]) -> Scripted:
    """Return actors as an event from the first appearance to the last disappearance."""
    first = min(float(path.time_s[0]) for path in paths)
    last = max(float(path.time_s[-1]) for path in paths)
    return Scripted(tuple(paths), first, last, told=told)


def _lateral(actor_class: str, spot: Spot, twin: Twin) -> tuple[float, ...]:
    """Return lateral offsets to try, metres to the left; two-wheelers at the kerb first."""
    if actor_class not in ("bicycle", "motorcycle"):
        return (0.0,)
    kerb = -1.0 if twin.roads.driving_side == "right" else 1.0
    room = max(spot.lane.width / 2 - 0.5, 0.0)
    return (kerb * room, 0.0, -kerb * room)
