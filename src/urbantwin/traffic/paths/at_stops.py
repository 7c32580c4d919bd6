"""At stops: from the footway to where somebody waits, to the door, and from the door back.

SUMO lets people walk to a stop and on from it. Where they stand meanwhile, and how they get on and
off, is drawn here: who waits has a place of its own, faces the road, and walks to the door when
its turn comes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.traffic.assets import Asset
from urbantwin.traffic.demand.demand import Demand
from urbantwin.traffic.demand.stop_places import DOORS_M, WALKING_MS, StopPlace
from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.sumo.simulation import Simulated, with_rows

__all__ = ["with_passengers_at_stops"]

#: Nobody waits nearer to a post or a wall than this, metres, from the middle.
_CLEAR_M = 0.5
#: From the side of a vehicle to the face of who gets on, or to the back of who gets off, metres.
_DOOR_M = 0.15

#: Who sets out for the door is gone after so long, seconds.
_BOARDED_S = 30.0

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class _Stay:
    """Somebody at a stop, between two walks that SUMO lets it take.

    Attributes:
        trip: who.
        place: which stop.
        slot: where it waits; ``None`` for who gets off.
        door: of the vehicle; ``None`` for who has not got on yet.
        from_s: when it arrives at the stop, or at the door from within.
        boards_s: when it sets out for the door.
    """

    trip: int
    place: StopPlace
    slot: _Floats | None
    door: _Floats | None
    from_s: float
    boards_s: float = np.inf


def with_passengers_at_stops(
    simulated: Simulated,
    demand: Demand,
    blocks: PlanBoxes,
    *,
    step_s: float,
    asset: Callable[[str], Asset],
) -> Simulated:
    """Return what SUMO saw, and those who wait at stops, get on and get off.

    Args:
        simulated: what SUMO saw.
        demand: the trips that it refers to.
        blocks: what stands in the way, in plan.
        step_s: time between steps.
        asset: an asset's dimensions by name.
    """
    if not simulated.boarded or not len(simulated.step):
        return simulated
    new, lanes = _at_stops(simulated, demand, blocks, step_s, asset)
    whole = [simulated]
    del simulated
    return replace(with_rows(whole, new), lanes=lanes)


def _at_stops(
    simulated: Simulated,
    demand: Demand,
    blocks: PlanBoxes,
    step_s: float,
    asset: Callable[[str], Asset],
) -> tuple[list[dict[str, NDArray[np.generic]]], tuple[str, ...]]:
    """Return the rows of everybody at stops, and the lanes that they refer to."""
    by_trip = simulated.by_trip()
    doors = _Doors(simulated, by_trip, demand, step_s, asset)
    first, last = int(simulated.step.min()), int(simulated.step.max())
    lanes = list(simulated.lanes)
    new: list[dict[str, NDArray[np.generic]]] = []
    for stay in _stays(simulated, demand.passengers.places, blocks, doors):
        rows = simulated.of_trip(stay.trip, by_trip)
        steps = _steps_between_walks(
            stay, np.asarray(simulated.step[rows] * step_s), first, last, step_s
        )
        if not len(steps):
            continue
        if stay.place.lane not in lanes:
            lanes.append(stay.place.lane)
        # Where SUMO left it, or lets it walk on from.
        beside = steps[0] - 1 if stay.slot is not None else steps[-1] + 1
        walked = rows[simulated.step[rows] == beside]
        footway = simulated.front[walked[0]] if len(walked) else stay.place.point
        xy, speed, yaw = _drawn(
            stay, footway, np.asarray(steps * step_s), walks_on=bool(len(walked))
        )
        kept = np.isfinite(speed)
        new.append(
            {
                "step": steps[kept].astype(simulated.step.dtype),
                "trip": np.full(kept.sum(), stay.trip, simulated.trip.dtype),
                "front": xy[kept],
                "angle_deg": 90.0 - np.degrees(yaw[kept]),
                "speed": speed[kept],
                "lane": np.full(kept.sum(), lanes.index(stay.place.lane), simulated.lane.dtype),
            }
        )
    return new, tuple(lanes)


def _stays(
    simulated: Simulated, places: Sequence[StopPlace], blocks: PlanBoxes, doors: _Doors
) -> Iterator[_Stay]:
    """Yield everybody's stays at stops."""
    for place in places:
        slots = _free(place.slots, blocks)
        taken: dict[int, int] = {}  # slot -> who waits there
        since: dict[int, tuple[float, int]] = {}
        for at_s, what, trip, stop, vehicle, _ in sorted(simulated.boarded):
            if stop != place.stop:
                continue
            if what == "waits":
                slot = next(k for k in range(len(taken) + 1) if k not in taken)
                taken[slot], since[trip] = trip, (at_s, slot)
            elif what == "boards":
                from_s, slot = since.pop(trip)
                del taken[slot]
                here, door = slots[slot % len(slots)], doors.of(vehicle, place, at_s, 0)
                yield _Stay(trip, place, here, door, from_s, at_s)
            else:
                yield _Stay(trip, place, None, doors.of(vehicle, place, at_s, 1), at_s)
        for trip, (from_s, slot) in since.items():
            yield _Stay(trip, place, slots[slot % len(slots)], None, from_s)


def _steps_between_walks(
    stay: _Stay, walked_s: _Floats, first: int, last: int, step_s: float
) -> NDArray[np.int64]:
    """Return the steps at which somebody is at a stop: SUMO draws it before and after."""
    begin = first
    if stay.slot is not None:
        before = walked_s[walked_s <= stay.from_s + 0.5 * step_s]
        if len(before):
            begin = round(before[-1] / step_s) + 1
        end = last if np.isinf(stay.boards_s) else int((stay.boards_s + _BOARDED_S) / step_s)
    else:
        begin = int(np.ceil(stay.from_s / step_s))
        after = walked_s[walked_s > stay.from_s]
        # SUMO lets it walk on at a whole second.
        longest = int(np.ceil((stay.from_s + stay.place.leaves_s + 1.5) / step_s))
        end = min(round(after[0] / step_s) - 1 if len(after) else last, longest)
    return np.arange(max(begin, first), min(end, last) + 1)


def _drawn(
    stay: _Stay, footway: _Floats, time_s: _Floats, *, walks_on: bool
) -> tuple[_Floats, _Floats, _Floats]:
    """Return where somebody is at times (N, 2), how fast (N,), nan for gone, and its heading.

    It comes from a place on the footway, or goes there.
    """
    place = stay.place
    yaw = np.full(len(time_s), place.faces)
    if stay.slot is None:
        assert stay.door is not None
        # In time for where SUMO lets it walk on from.
        took = max(time_s[-1] - stay.from_s, 0.1) if walks_on else place.leaves_s
        xy, speed = _between(stay.door, footway, time_s, stay.from_s, took)
        return xy, speed, yaw + np.pi
    far = float(np.hypot(*(stay.slot - footway)))
    # Who was there before anything was seen has long arrived.
    xy, speed = _between(footway, stay.slot, time_s, stay.from_s, far / WALKING_MS)
    if stay.door is not None:
        far = float(np.hypot(*(stay.door - stay.slot)))
        goes = time_s >= stay.boards_s
        to_door = _between(stay.slot, stay.door, time_s, stay.boards_s, far / WALKING_MS)
        xy[goes], speed[goes] = to_door[0][goes], to_door[1][goes]
        speed[time_s > stay.boards_s + far / WALKING_MS] = np.nan
    return xy, speed, yaw


def _between(
    start: _Floats, end: _Floats, time_s: _Floats, from_s: float, took_s: float
) -> tuple[_Floats, _Floats]:
    """Return who goes from one place to another within a time: where (N, 2), how fast (N,)."""
    share = np.clip((time_s - from_s) / max(took_s, 0.1), 0.0, 1.0)
    pace = float(np.hypot(*(end - start))) / max(took_s, 0.1)
    goes = (time_s >= from_s) & (share < 1.0)
    return start + share[:, None] * (end - start), np.where(goes, pace, 0.0)


def _free(slots: _Floats, blocks: PlanBoxes) -> _Floats:
    """Return the places (S, 2) where nothing stands; all where that leaves none."""
    tree = shapely.STRtree(blocks.polygons)
    near = tree.query(shapely.points(slots), predicate="dwithin", distance=_CLEAR_M)[0]
    free = np.delete(slots, near, axis=0)
    return free if len(free) else slots


class _Doors:
    """Where the doors of vehicles are while they halt.

    Args:
        simulated: what SUMO saw.
        by_trip: its rows by trip and step.
        demand: the trips.
        step_s: time between steps.
        asset: an asset's dimensions by name.
    """

    def __init__(
        self,
        simulated: Simulated,
        by_trip: NDArray[np.int64],
        demand: Demand,
        step_s: float,
        asset: Callable[[str], Asset],
    ) -> None:
        self._simulated, self._by_trip, self._demand = simulated, by_trip, demand
        self._step_s, self._asset = step_s, asset

    def of(self, vehicle: int, place: StopPlace, at_s: float, which: int) -> _Floats:
        """Return where people stand before a door: the one to get on (0) or off (1)."""
        seen = self._simulated
        rows = seen.of_trip(vehicle, self._by_trip)
        away_s = np.abs(seen.step[rows] * self._step_s - at_s)
        if not len(rows) or away_s.min() > 0.5:
            return np.asarray(place.doors[which])
        row = rows[away_s.argmin()]
        yaw = np.radians(90.0 - seen.angle_deg[row])
        ahead = np.array([np.cos(yaw), np.sin(yaw)])
        left = np.array([-ahead[1], ahead[0]])
        side = np.sign((place.point - seen.front[row]) @ left) or 1.0
        half = self._asset(self._demand.trips[vehicle].asset).width / 2
        back = DOORS_M[place.kind][which]
        return np.asarray(seen.front[row] - back * ahead + side * (half + _DOOR_M) * left)
