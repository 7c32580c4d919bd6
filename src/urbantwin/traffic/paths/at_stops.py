"""Passengers at stops: from the footway to the waiting position, to the door, and back.

SUMO moves passengers to a stop and on from it. Their waiting, boarding and alighting is added here:
each has its own waiting position, faces the road, and walks to the door when its turn comes.
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

#: Least distance of the centre of a waiting passenger from obstacles, metres.
_OBSTACLE_DISTANCE_M = 0.5
#: Distance from the side of a vehicle to a boarding or alighting passenger, metres.
_DOOR_DISTANCE_M = 0.15

#: Maximum duration of the walk to the door, seconds.
_MAX_BOARDING_WALK_S = 30.0

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class _Stay:
    """A passenger at a stop, between two walks of SUMO.

    Attributes:
        trip: number of its trip.
        place: the stop.
        slot: waiting position; ``None`` for an alighting passenger.
        door: position of the vehicle's door; ``None`` if it has not boarded yet.
        from_s: arrival at the stop, or at the door from inside.
        boards_s: start of the walk to the door.
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
    """Return SUMO's output with passengers that wait, board and alight added.

    Args:
        simulated: SUMO's output.
        demand: the trips that it refers to.
        blocks: obstacles in plan.
        step_s: time between steps, seconds.
        asset: returns an asset's dimensions by name.
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
    """Return the rows of all passengers at stops, and the lanes that they refer to."""
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
        # The end of SUMO's walk, or the start of the next one.
        beside = steps[0] - 1 if stay.slot is not None else steps[-1] + 1
        walked = rows[simulated.step[rows] == beside]
        footway = simulated.front[walked[0]] if len(walked) else stay.place.point
        xy, speed, yaw = _passenger_poses(
            stay, footway, np.asarray(steps * step_s), walks_on=bool(len(walked))
        )
        is_drawn = np.isfinite(speed)
        new.append(
            {
                "step": steps[is_drawn].astype(simulated.step.dtype),
                "trip": np.full(is_drawn.sum(), stay.trip, simulated.trip.dtype),
                "front": xy[is_drawn],
                "angle_deg": 90.0 - np.degrees(yaw[is_drawn]),
                "speed": speed[is_drawn],
                "lane": np.full(is_drawn.sum(), lanes.index(stay.place.lane), simulated.lane.dtype),
            }
        )
    return new, tuple(lanes)


def _stays(
    simulated: Simulated, places: Sequence[StopPlace], blocks: PlanBoxes, doors: _Doors
) -> Iterator[_Stay]:
    """Yield all stays at stops."""
    for place in places:
        slots = _free_slots(place.slots, blocks)
        taken: dict[int, int] = {}  # slot -> passenger
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
                waiting_xy, door = slots[slot % len(slots)], doors.of(vehicle, place, at_s, 0)
                yield _Stay(trip, place, waiting_xy, door, from_s, at_s)
            else:
                yield _Stay(trip, place, None, doors.of(vehicle, place, at_s, 1), at_s)
        for trip, (from_s, slot) in since.items():
            yield _Stay(trip, place, slots[slot % len(slots)], None, from_s)


def _steps_between_walks(
    stay: _Stay, walked_s: _Floats, first: int, last: int, step_s: float
) -> NDArray[np.int64]:
    """Return the steps of a stay, during which SUMO has no position."""
    begin = first
    if stay.slot is not None:
        before = walked_s[walked_s <= stay.from_s + 0.5 * step_s]
        if len(before):
            begin = round(before[-1] / step_s) + 1
        end = (
            last
            if np.isinf(stay.boards_s)
            else int((stay.boards_s + _MAX_BOARDING_WALK_S) / step_s)
        )
    else:
        begin = int(np.ceil(stay.from_s / step_s))
        after = walked_s[walked_s > stay.from_s]
        # SUMO lets it walk on at a whole second.
        longest = int(np.ceil((stay.from_s + stay.place.leaves_s + 1.5) / step_s))
        end = min(round(after[0] / step_s) - 1 if len(after) else last, longest)
    return np.arange(max(begin, first), min(end, last) + 1)


def _passenger_poses(
    stay: _Stay, footway: _Floats, time_s: _Floats, *, walks_on: bool
) -> tuple[_Floats, _Floats, _Floats]:
    """Return a passenger's positions (N, 2), speeds (N,), nan once boarded, and headings.

    It comes from a point on the footway, or goes there.
    """
    place = stay.place
    yaw = np.full(len(time_s), place.faces)
    if stay.slot is None:
        assert stay.door is not None
        # Arrives when SUMO's next walk starts.
        took = max(time_s[-1] - stay.from_s, 0.1) if walks_on else place.leaves_s
        xy, speed = _straight_walk(stay.door, footway, time_s, stay.from_s, took)
        return xy, speed, yaw + np.pi
    far = float(np.hypot(*(stay.slot - footway)))
    # Passengers from before the recorded time have long arrived.
    xy, speed = _straight_walk(footway, stay.slot, time_s, stay.from_s, far / WALKING_MS)
    if stay.door is not None:
        far = float(np.hypot(*(stay.door - stay.slot)))
        goes = time_s >= stay.boards_s
        to_door = _straight_walk(stay.slot, stay.door, time_s, stay.boards_s, far / WALKING_MS)
        xy[goes], speed[goes] = to_door[0][goes], to_door[1][goes]
        speed[time_s > stay.boards_s + far / WALKING_MS] = np.nan
    return xy, speed, yaw


def _straight_walk(
    start: _Floats, end: _Floats, time_s: _Floats, from_s: float, took_s: float
) -> tuple[_Floats, _Floats]:
    """Return positions (N, 2) and speeds (N,) on a straight walk of a given duration."""
    share = np.clip((time_s - from_s) / max(took_s, 0.1), 0.0, 1.0)
    pace = float(np.hypot(*(end - start))) / max(took_s, 0.1)
    goes = (time_s >= from_s) & (share < 1.0)
    return start + share[:, None] * (end - start), np.where(goes, pace, 0.0)


def _free_slots(slots: _Floats, blocks: PlanBoxes) -> _Floats:
    """Return the positions (S, 2) without obstacles; all of them if none is free."""
    tree = shapely.STRtree(blocks.polygons)
    rows_nearby = tree.query(
        shapely.points(slots), predicate="dwithin", distance=_OBSTACLE_DISTANCE_M
    )[0]
    free = np.delete(slots, rows_nearby, axis=0)
    return free if len(free) else slots


class _Doors:
    """Positions of the doors of halting vehicles.

    Args:
        simulated: SUMO's output.
        by_trip: its rows by trip and step.
        demand: the trips.
        step_s: time between steps, seconds.
        asset: returns an asset's dimensions by name.
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
        """Return the position in front of a door: for boarding (0) or alighting (1)."""
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
        return np.asarray(seen.front[row] - back * ahead + side * (half + _DOOR_DISTANCE_M) * left)
