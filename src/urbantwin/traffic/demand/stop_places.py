"""Where people wait at stops: on the footway beside the doors of what halts there."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads import BusStop, RoadNetwork

__all__ = ["DOORS_M", "WALKING_MS", "StopPlace", "stop_place"]

#: Where one gets on and off, metres behind the nose.
DOORS_M = {"bus": (1.5, 6.0), "tram": (6.0, 10.0)}
#: Half the width of who halts there, and the gap between door and footway, metres.
_HALF_M, _GAP_M = {"bus": 1.27, "tram": 1.2}, 0.1
#: People walk to and from the doors at this pace, m/s.
WALKING_MS = 1.2
#: A footway that is farther from a lane's middle is not that of the stop, metres.
_REACH_M = 8.0
#: Who waits takes so much of the kerb, and rows are so far from each other, metres; so many rows.
#: 0.8 m2 a person is level of service B to C of a waiting area (Highway Capacity Manual 2010,
#: chapter 23: 7 to 13 square feet).
_SPACING_M, _ROW_M, _ROWS = 0.95, 0.9, 3
#: From the edge of the footway to who waits, metres; and from the border of other things.
_KERB_M, _BODY_M = 0.15, 0.3
#: Behind a further row others have room to pass, metres.
_PASSAGE_M = 1.0
#: People do not stand in the order of nearness to the door: so much is chance, metres.
_SPREAD_M = 3.0


@dataclass(frozen=True, eq=False)
class StopPlace:
    """What is beside a stop.

    Attributes:
        stop: its number in the demand.
        kind: ``bus`` or ``tram``.
        lane: the footway, a lane's id.
        edge: its edge.
        along_m: where on it people leave for the stop and come from it, metres from its start.
        point: (2,) that place, site frame.
        doors: (2, 2) where people stand before the doors to get on and off of who halts there.
        slots: (S, 2) where people wait, in the order in which they are taken.
        faces: rad, where the vehicle comes to.
        leaves_s: how long it takes from the door to ``point``, seconds.
        end_m: where the noses of vehicles halt, metres from their lane's start.
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
    """Return where people wait at a stop; ``None`` where no footway leads to it.

    Args:
        roads: the lanes.
        stop: where buses or trams halt.
        number: of the stop in the demand.
        edges: ids of the edges that people walk on.
        seed: of the order in which places are taken.
    """
    edge = stop.lane.rpartition("_")[0]
    track = next((one for one in roads.tracks if one.id == edge), None)
    kind = "bus" if track is None else "tram"
    if track is None and stop.lane not in roads.lane_by_id:
        return None
    line = shapely.LineString((track.line if track else roads.lane_by_id[stop.lane].centre)[:, :2])
    door = _at(line, stop.end_m - DOORS_M[kind][1])
    ahead = _at(line, stop.end_m) - _at(line, stop.end_m - 4.0)
    ahead /= max(float(np.hypot(*ahead)), 1e-9)
    aside = np.array([ahead[1], -ahead[0]]) * (1.0 if roads.driving_side == "right" else -1.0)
    found = []
    for lane in roads.lanes:
        if lane.kind != "sidewalk" or lane.level or lane.road not in edges:
            continue
        middle = shapely.LineString(lane.centre[:, :2])
        along = float(middle.project(shapely.Point(door)))
        point = _at(middle, along)
        away = point - door
        if np.hypot(*away) <= _REACH_M and away @ aside > 0.7 * np.hypot(*away):
            found.append((lane.road != edge, float(np.hypot(*away)), lane.id, along, point, lane))
    if not found:
        return None
    *_, along, point, lane = min(found, key=lambda one: one[:3])
    slots = _slots(roads, line, stop, kind, ahead, aside, seed + 1000 * number)
    if not len(slots):
        return None
    outside = aside * (_HALF_M[kind] + _GAP_M)
    doors = np.array([_at(line, stop.end_m - back) + outside for back in DOORS_M[kind]])
    return StopPlace(
        number,
        kind,
        lane.id,
        lane.road,
        float(np.floor(np.clip(along, 0.1, lane.length - 0.1) * 100) / 100),
        point,
        doors,
        slots,
        float(np.arctan2(*-aside[::-1])),
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
    """Return places (S, 2) on the footway beside a stop."""
    room = roads.footway(0).intersection(shapely.Point(_at(line, stop.end_m)).buffer(40.0))
    room = room.buffer(-_BODY_M)
    shapely.prepare(room)
    random = np.random.Generator(np.random.Philox(key=[seed, 7_300_000]))
    deep = np.arange(_HALF_M[kind] + 0.2, _REACH_M, 0.1)
    found = []
    for along in np.arange(stop.end_m - 0.5, max(stop.start_m, stop.end_m - 14.0), -_SPACING_M):
        kerb = _at(line, float(along))
        inside = shapely.contains_xy(room, kerb + deep[:, None] * aside)
        if not inside.any():
            continue
        first = deep[inside.argmax()] + _KERB_M
        for row in range(_ROWS):
            place = kerb + (first + row * _ROW_M) * aside
            passage = place + (_PASSAGE_M if row else 0.0) * aside
            if shapely.contains_xy(room, *place) and shapely.contains_xy(room, *passage):
                away = abs(float(along) - stop.end_m + DOORS_M[kind][0]) + 1.5 * row
                found.append((away + _SPREAD_M * float(random.random()), *place))
    return np.array(sorted(found)).reshape(-1, 3)[:, 1:]


def _at(line: shapely.LineString, along_m: float) -> NDArray[np.float64]:
    point = line.interpolate(max(along_m, 0.0))
    return np.array([point.x, point.y])
