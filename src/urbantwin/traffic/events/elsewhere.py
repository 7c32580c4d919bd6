"""Alternative places for events whose requested place lacks traffic or room."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import pyarrow as pa
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.errors import StageError
from urbantwin.traffic.events.places import Place, Spot, find_spot, lanes_for, spot_on
from urbantwin.traffic.events.scenario import (
    ChildBetweenParkedCars,
    Collision,
    Convoy,
    Debris,
    EmergencyVehicle,
    HardBrake,
    NearMiss,
    PlacedEvent,
    RedLightRunning,
    StalledVehicle,
    UTurn,
    WorkZone,
)
from urbantwin.twin import Twin

__all__ = ["Passing", "moved", "places_that_serve", "staged_near"]

#: Spacing of places along a lane, and their distance from its ends, metres.
_PLACE_SPACING_M, _END_DISTANCE_M = 15.0, 10.0
#: Number of alternatives tried: for inserted actors, and for events that SUMO drives again.
_MAX_INSERTED_TRIES, _MAX_SIMULATED_TRIES = 10, 2
#: Maximum number of alternatives on one lane.
_MAX_PER_LANE = 2
#: Speeds below which a vehicle counts as standing, and above which as driving, m/s.
_STANDING_MS, _DRIVING_MS = 1.0, 4.0
#: Distance within which a vehicle is at the place, and a standing one is in the way, metres.
_AT_PLACE_M, _IN_THE_WAY_M = 6.0, 12.0
#: Rounding of the share of time during which a standing vehicle is in the way.
_SHARE_ROUNDING = 0.25
#: Maximum distance between the centres of two vehicles in a following pair, metres.
_MAX_FOLLOWING_M = 35.0
#: Distance to the stop line of vehicles that drive towards a red signal, and that wait there,
#: metres.
_RED_APPROACH_M, _WAITING_AT_LINE_M = 25.0, 8.0
#: Comfortable braking, m/s2, and gap left before an obstacle, metres.
_COMFORTABLE_MS2, _OBSTACLE_GAP_M = 2.5, 4.0

_Staged = TypeVar("_Staged")


@dataclass(frozen=True, eq=False)
class Passing:
    """Vehicles of a motion, one row per vehicle and step.

    Attributes:
        time_s: (N,) seconds of the motion.
        track: (N,) track ids.
        xy: (N, 2) metres, site frame.
        speed: (N,) m/s.
        lane: (N,) ids of lanes.
    """

    time_s: NDArray[np.float64]
    track: NDArray[np.int64]
    xy: NDArray[np.float64]
    speed: NDArray[np.float64]
    lane: NDArray[np.str_]

    @classmethod
    def of(cls, actors: pa.Table, from_s: float, until_s: float) -> Passing:
        """Return the vehicles between two times."""
        time_s = np.asarray(actors["time_s"].to_numpy(), np.float64)
        kind = np.asarray(actors["class"].to_numpy(zero_copy_only=False), str)
        selected = (time_s >= from_s - 1e-6) & (time_s <= until_s + 1e-6)
        selected &= ~np.isin(kind, ("pedestrian", "animal", "obstacle"))
        xy = np.column_stack([actors[name].to_numpy() for name in ("x", "y")])
        return cls(
            time_s[selected],
            np.asarray(actors["track"].to_numpy(), np.int64)[selected],
            xy[selected],
            np.asarray(actors["speed"].to_numpy(), np.float64)[selected],
            np.asarray(actors["lane"].to_numpy(zero_copy_only=False), str)[selected],
        )

    def share_standing(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the share (M,) of steps at which a standing vehicle is near places (M, 2).

        Rounded down to multiples of ``_SHARE_ROUNDING``.
        """
        steps = max(len(np.unique(self.time_s)), 1)
        slow = np.flatnonzero(self.speed < _STANDING_MS)
        if not len(slow):
            return np.zeros(len(xy))
        rows_nearby = cKDTree(self.xy[slow]).query_ball_point(xy, _IN_THE_WAY_M)
        share = np.array([len(np.unique(self.time_s[slow[rows]])) / steps for rows in rows_nearby])
        return np.asarray(np.floor(share / _SHARE_ROUNDING) * _SHARE_ROUNDING)

    def on(self, spot: Spot) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Return the rows on a spot's lane, and their positions along it, metres."""
        rows = np.flatnonzero(self.lane == spot.lane.id)
        line = shapely.LineString(spot.lane.centre[:, :2])
        return rows, np.asarray(shapely.line_locate_point(line, shapely.points(self.xy[rows])))


def staged_near(
    event: PlacedEvent,
    twin: Twin,
    actors: pa.Table,
    stage: Callable[[PlacedEvent], _Staged],
    refused: StageError,
) -> tuple[_Staged, dict[str, object]]:
    """Stage an event of inserted actors at another place, if its own is not possible.

    Places without standing vehicles come first, and of those the nearest.

    Args:
        event: the event.
        twin: the twin.
        actors: actors of the motion.
        stage: stages an event at its place.
        refused: error at the event's own place.

    Returns:
        The staged result, and entries of the report about the move.

    Raises:
        StageError: no other place is possible either.
    """
    spots = _places_around(event, twin)
    window = event.at_s - event.within_s, event.at_s + event.within_s
    passing = Passing.of(actors, *window)
    if isinstance(event, NearMiss | ChildBetweenParkedCars):
        spots = [place for place in spots if _is_driven_on(passing, place)]
    requested = find_spot(event.place, twin, event.users)
    away = np.array([float(np.hypot(*(place.xy - requested.xy))) for place in spots])
    share = passing.share_standing(np.array([place.xy for place in spots]).reshape(-1, 2))
    on_lane: Counter[str] = Counter()
    most = 1 if isinstance(event, UTurn) else _MAX_PER_LANE  # a U-turn tries its whole lane
    for k in np.lexsort([away, share]).tolist():
        if on_lane.total() == _MAX_INSERTED_TRIES:
            break
        lane = spots[k].lane.id
        if on_lane[lane] == most:
            continue
        on_lane[lane] += 1
        try:
            staged = stage(moved(event, spots[k]))
        except StageError:
            continue
        return staged, _moved_report(away[k], refused)
    places = f"{on_lane.total()} other places within {event.within_m:g} m"
    raise StageError(f"{refused}; nor at {places}")


def places_that_serve(
    event: PlacedEvent, twin: Twin, actors: pa.Table
) -> list[tuple[Spot, dict[str, object]]]:
    """Return the places for an event that others react to, the best first.

    Up to the event the traffic equals the one without it, which shows where its conditions hold.
    The requested place comes first if they hold there; if they hold nowhere, it is the only one.

    Args:
        event: the event.
        twin: the twin.
        actors: actors of the motion without the event.
    """
    requested = find_spot(event.place, twin, event.users)
    if not requested.lane.road:
        return [(requested, {})]
    passing = Passing.of(actors, event.at_s, event.at_s + event.within_s)
    signalled = {signal.lane for signal in twin.roads.signals}
    others = sorted(
        (place for place in _places_around(event, twin) if place.lane.road),
        key=lambda place: float(np.hypot(*(place.xy - requested.xy))),
    )
    if isinstance(event, EmergencyVehicle | Convoy):  # they use all lanes of a road
        first = {place.lane.road: place for place in reversed(others)}
        others = [
            place
            for place in others
            if first[place.lane.road] is place and place.lane != requested.lane
        ]
    serving = [place for place in others if _serves(event, place, passing, signalled)]
    if not serving and isinstance(event, RedLightRunning):
        serving = [place for place in others if _has_waiting_vehicle(place, passing, signalled)]
    reason = "the place has not the traffic, or the room, that it needs"
    reported = [
        (place, _moved_report(float(np.hypot(*(place.xy - requested.xy))), reason))
        for place in _of_different_lanes(serving, event)[:_MAX_SIMULATED_TRIES]
    ]
    # A vehicle on a parallel lane may take part as well (`reacting.plan_events`), unless the lane
    # is to be closed.
    beside = () if isinstance(event, WorkZone | Debris) else serving
    as_asked = any(
        place.lane.road == requested.lane.road
        and float(np.hypot(*(place.xy - requested.xy))) < _AT_PLACE_M
        for place in beside
    )
    if not serving or as_asked or _serves(event, requested, passing, signalled):
        return [(requested, {}), *reported]
    return reported


def moved(event: PlacedEvent, spot: Spot) -> PlacedEvent:
    """Return an event at another place."""
    place = Place(lane=spot.lane.id, offset_m=spot.along_m)
    return event.model_copy(update={"place": place})


def _moved_report(away_m: float, why: object) -> dict[str, object]:
    return {"moved_m": round(away_m, 1), "moved_because": str(why)}


def _places_around(event: PlacedEvent, twin: Twin) -> list[Spot]:
    """Return other places within reach of an event's own; on the same lane if it names one."""
    requested = find_spot(event.place, twin, event.users)
    places = []
    for lane in lanes_for(twin, event.users):
        if event.place.lane not in (None, lane.id):
            continue
        room = lane.length - 2 * _END_DISTANCE_M
        if room < 0:
            continue
        for along in _END_DISTANCE_M + np.linspace(0, room, int(room / _PLACE_SPACING_M) + 1):
            spot = spot_on(lane, round(float(along), 2))
            away = float(np.hypot(*(spot.xy - requested.xy)))
            if 1.0 < away <= event.within_m:
                places.append(spot)
    return places


def _is_driven_on(passing: Passing, spot: Spot) -> bool:
    nearby = np.hypot(*(passing.xy - spot.xy).T) < _AT_PLACE_M
    return bool((nearby & (passing.speed > _DRIVING_MS)).any())


def _serves(event: PlacedEvent, spot: Spot, passing: Passing, signalled: set[str]) -> bool:
    """Return whether a place meets the conditions of an event that others react to."""
    rows, along = passing.on(spot)
    speed, ahead = passing.speed[rows], spot.along_m - along
    at_place, drives = np.abs(ahead) < _AT_PLACE_M, speed > _DRIVING_MS
    stops = speed**2 / (2 * _COMFORTABLE_MS2) + _OBSTACLE_GAP_M

    def tracks_in(some: NDArray[np.bool_]) -> set[int]:
        return set(passing.track[rows[some]].tolist())

    serves = True
    match event:
        case HardBrake():
            serves = bool((at_place & drives).any())
        case StalledVehicle():
            serves = bool(
                tracks_in(at_place) & tracks_in((ahead > np.maximum(stops, 8.0)) & drives)
            )
        case Collision():
            serves = _one_behind_another(passing, rows, along, spot)
        case RedLightRunning():
            left = spot.lane.length - along
            comes = (left > 2.0) & (left < _RED_APPROACH_M) & drives
            waits = (left < _WAITING_AT_LINE_M) & (speed < _STANDING_MS)
            serves = spot.lane.id in signalled and bool(tracks_in(comes) & tracks_in(waits))
        case WorkZone() | Debris():
            long_m = event.length_m if isinstance(event, WorkZone) else 2.0
            in_the_way = (ahead < stops) & (ahead > -long_m - _OBSTACLE_GAP_M - 6.0)
            busy = np.unique(passing.time_s[rows[in_the_way]])
            fits = spot.along_m + long_m < spot.lane.length - 1.0
            serves = fits and len(busy) < len(np.unique(passing.time_s))
    return serves


def _of_different_lanes(spots: list[Spot], event: PlacedEvent) -> list[Spot]:
    """Return spots; for an event at the end of a lane, only the first on each lane."""
    if not isinstance(event, RedLightRunning):
        return spots
    first = {spot.lane.id: spot for spot in reversed(spots)}
    return [spot for spot in spots if first[spot.lane.id] is spot]


def _has_waiting_vehicle(spot: Spot, passing: Passing, signalled: set[str]) -> bool:
    """Return whether a vehicle waits at the signal at the end of a lane."""
    rows, along = passing.on(spot)
    waits = (spot.lane.length - along < _WAITING_AT_LINE_M) & (passing.speed[rows] < _STANDING_MS)
    return spot.lane.id in signalled and bool(waits.any())


def _one_behind_another(
    passing: Passing, rows: NDArray[np.intp], along: NDArray[np.float64], spot: Spot
) -> bool:
    """Return whether two vehicles follow each other closely near a place on a lane."""
    order = np.lexsort([along, passing.time_s[rows]])
    times, station_m, speed = passing.time_s[rows][order], along[order], passing.speed[rows][order]
    same = np.diff(times) < 1e-6
    close = same & (np.diff(station_m) < _MAX_FOLLOWING_M) & (speed[:-1] > _DRIVING_MS)
    return bool((close & (np.abs(station_m[:-1] - spot.along_m) < 30.0)).any())
