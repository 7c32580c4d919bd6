"""Waiting places at stops: on the footway beside the doors of buses and trams."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads import BusStop, RoadNetwork

__all__ = ["DOORS_M", "WALKING_MS", "StopPlace", "stop_place"]

#: Positions of two doors behind the vehicle's nose, metres.
DOORS_M = {"bus": (1.5, 6.0), "tram": (6.0, 10.0)}
#: Half width of the vehicle, and gap between door and footway, metres.
_HALF_WIDTH_M, _DOOR_GAP_M = {"bus": 1.27, "tram": 1.2}, 0.1
#: Walking speed to and from the doors, m/s.
WALKING_MS = 1.2
#: Maximum distance of the stop's footway from the middle of the lane, metres.
_MAX_FOOTWAY_DISTANCE_M = 8.0
#: Length of kerb per waiting person and distance between rows, metres, and number of rows. 0.8 m2
#: per person is level of service B to C of a waiting area (Highway Capacity Manual 2010, chapter
#: 23: 7 to 13 square feet).
_SPACING_M, _ROW_M, _ROWS = 0.95, 0.9, 3
#: Distance of waiting people from the edge of the footway, and from other obstacles, metres.
_KERB_M, _BODY_M = 0.15, 0.3
#: Passage that remains behind a further row, metres.
_PASSAGE_M = 1.0
#: Random part of the order of waiting places, which otherwise is by distance to the door, metres.
_SPREAD_M = 3.0


@dataclass(frozen=True, eq=False)
class StopPlace:
    """The waiting place of a stop.

    Attributes:
        stop: its number in the demand.
        kind: ``bus`` or ``tram``.
        lane: id of the footway's lane.
        edge: its edge.
        along_m: position on it where people leave for the stop and return, metres from its start.
        point: (2,) that position, site frame, metres.
        doors: (2, 2) positions in front of the doors, for boarding and alighting.
        slots: (S, 2) waiting positions, in the order in which they are taken.
        faces: heading of waiting people towards the vehicle, rad.
        leaves_s: walking time from the door to ``point``, seconds.
        end_m: position of the vehicles' noses, metres from the start of their lane.
    """

    stop: int
    kind: str
    lane: str
    edge: str
    along_m: float
    point: NDArray[np.float64]
    doors: NDArray[np.float64]
    slots: NDArray[np.float64]
    faces: float
    leaves_s: float
    end_m: float


def stop_place(
    roads: RoadNetwork, stop: BusStop, number: int, edges: Set[str], seed: int
) -> StopPlace | None:
    """Return the waiting place of a stop; ``None`` if no footway leads to it.

    Args:
        roads: the lanes.
        stop: a stop of buses or trams.
        number: its number in the demand.
        edges: ids of the edges that pedestrians use.
        seed: random seed of the order of waiting positions.
    """
    edge = stop.lane.rpartition("_")[0]
    track = next(
        (track_of_line for track_of_line in roads.tracks if track_of_line.id == edge), None
    )
    kind = "bus" if track is None else "tram"
    if track is None and stop.lane not in roads.lane_by_id:
        return None
    line = shapely.LineString((track.line if track else roads.lane_by_id[stop.lane].centre)[:, :2])
    door = _point_at(line, stop.end_m - DOORS_M[kind][1])
    ahead = _point_at(line, stop.end_m) - _point_at(line, stop.end_m - 4.0)
    ahead /= max(float(np.hypot(*ahead)), 1e-9)
    to_kerb = np.array([ahead[1], -ahead[0]]) * (1.0 if roads.driving_side == "right" else -1.0)
    candidates = []
    for lane in roads.lanes:
        if lane.kind != "sidewalk" or lane.level or lane.road not in edges:
            continue
        middle = shapely.LineString(lane.centre[:, :2])
        along = float(middle.project(shapely.Point(door)))
        point = _point_at(middle, along)
        away = point - door
        if np.hypot(*away) <= _MAX_FOOTWAY_DISTANCE_M and away @ to_kerb > 0.7 * np.hypot(*away):
            candidates.append(
                (lane.road != edge, float(np.hypot(*away)), lane.id, along, point, lane)
            )
    if not candidates:
        return None
    *_, along, point, lane = min(candidates, key=lambda candidate: candidate[:3])
    slots = _slots(roads, line, stop, kind, ahead, to_kerb, seed + 1000 * number)
    if not len(slots):
        return None
    outside = to_kerb * (_HALF_WIDTH_M[kind] + _DOOR_GAP_M)
    doors = np.array([_point_at(line, stop.end_m - back) + outside for back in DOORS_M[kind]])
    return StopPlace(
        number,
        kind,
        lane.id,
        lane.road,
        float(np.floor(np.clip(along, 0.1, lane.length - 0.1) * 100) / 100),
        point,
        doors,
        slots,
        float(np.arctan2(*-to_kerb[::-1])),
        max(float(np.hypot(*(point - doors[1]))) / WALKING_MS, 1.0),
        stop.end_m,
    )


def _slots(
    roads: RoadNetwork,
    line: shapely.LineString,
    stop: BusStop,
    kind: str,
    ahead: NDArray[np.float64],
    aside: NDArray[np.float64],
    seed: int,
) -> NDArray[np.float64]:
    """Return waiting positions (S, 2) on the footway beside a stop."""
    room = roads.footway(0).intersection(shapely.Point(_point_at(line, stop.end_m)).buffer(40.0))
    room = room.buffer(-_BODY_M)
    shapely.prepare(room)
    random = np.random.Generator(np.random.Philox(key=[seed, 7_300_000]))
    deep = np.arange(_HALF_WIDTH_M[kind] + 0.2, _MAX_FOOTWAY_DISTANCE_M, 0.1)
    slots = []
    for along in np.arange(stop.end_m - 0.5, max(stop.start_m, stop.end_m - 14.0), -_SPACING_M):
        kerb = _point_at(line, float(along))
        inside = shapely.contains_xy(room, kerb + deep[:, None] * aside)
        if not inside.any():
            continue
        first = deep[inside.argmax()] + _KERB_M
        for row in range(_ROWS):
            place = kerb + (first + row * _ROW_M) * aside
            passage = place + (_PASSAGE_M if row else 0.0) * aside
            if shapely.contains_xy(room, *place) and shapely.contains_xy(room, *passage):
                away = abs(float(along) - stop.end_m + DOORS_M[kind][0]) + 1.5 * row
                slots.append((away + _SPREAD_M * float(random.random()), *place))
    return np.array(sorted(slots)).reshape(-1, 3)[:, 1:]


def _point_at(line: shapely.LineString, along_m: float) -> NDArray[np.float64]:
    point = line.interpolate(max(along_m, 0.0))
    return np.array([point.x, point.y])
