"""Headways of those who leave queues, in SUMO's process.

Who sets out after standing keeps more time to who is ahead than who drives in a platoon all along;
SUMO's drivers know one headway for both. Part of SUMO's worker: nothing of UrbanTwin may be
imported here (see ``worker``).
"""

from __future__ import annotations

from typing import Any

import libsumo

#: Parameter of a vehicle type: the headway of who has stood, seconds.
IN_QUEUES = "urbantwin.queue_headway"
#: Who is slower stands, m/s.
STANDS_MS = 0.5
#: Who keeps more time when it moves on takes it by so much each second: whoever is behind slows
#: down by a tenth, and not to a standstill beyond the stop line.
_LETS_GO = 0.1
#: A queue reaches back from where it waits over roads that lead there so near before it, metres, as
#: maps cut streets; and past another signal, where no three cars fit between the two.
_BEFORE_M, _BETWEEN_M = 150.0, 25.0
#: SUMO's letters of links on which nobody waits, and on which who gives way does.
_GOES_ON, _GIVES_WAY = "M", "m=swZ"
#: SUMO's classes of those whom an approach's headway does not concern.
_OTHERS = ("bicycle", "tram", "pedestrian")


class QueueHeadways:
    """Lets who has stood keep another headway, to the end of the road at which its queue waits.

    That is the road where it stood, or one that follows: where drivers wait for a signal or give
    way. After that it closes up at once, or falls back bit by bit.

    Args:
        told: by road ``queue_headway_s``, which goes before that of a vehicle's type.
        of_types: whether any type may have one.
    """

    def __init__(self, told: dict[str, Any], of_types: bool = True) -> None:
        self.roads = {
            road: one["queue_headway_s"]
            for road, one in told.items()
            if one["queue_headway_s"] is not None
        }
        self.of_any = of_types or bool(self.roads)
        self.kinds: dict[str, float | None] = {}
        #: Vehicle -> roads of its queue that are still to come, the one that it is on first, and
        #: its usual headway.
        self.stood: dict[str, tuple[tuple[str, ...], float]] = {}
        self.falls_back: dict[str, float] = {}
        self.one_queue: dict[tuple[str, str], bool] = {}

    def look(self) -> None:
        """See who stands, and who has left the roads of its queue, at a whole second."""
        if not self.of_any:
            return
        vehicle = libsumo.vehicle
        there = vehicle.getIDList()
        stood: dict[str, tuple[tuple[str, ...], float]] = {}
        for name in there:
            road, before = vehicle.getRoadID(name), self.stood.get(name)
            if before is not None:
                left = _left(before[0], road)
                if left:
                    before = left, before[1]
                else:
                    self.falls_back[name] = before[1]
                    before = None
            if before is None and not road.startswith(":") and vehicle.getSpeed(name) < STANDS_MS:
                roads = self._queue(name, road)
                headway_s = self._headway(name, roads)
                if headway_s is not None:
                    before = roads, self.falls_back.pop(name, vehicle.getTau(name))
                    vehicle.setTau(name, headway_s)
            if before is not None:
                stood[name] = before
        self.stood = stood
        falls_back: dict[str, float] = {}
        for name in (one for one in there if one in self.falls_back):
            headway_s = min(self.falls_back[name], vehicle.getTau(name) + _LETS_GO)
            vehicle.setTau(name, headway_s)
            if headway_s < self.falls_back[name]:
                falls_back[name] = self.falls_back[name]
        self.falls_back = falls_back

    def _queue(self, name: str, road: str) -> tuple[str, ...]:
        """Return the roads from the one where a vehicle stands to the one at whose end it waits.

        Where nobody waits within 150 m, that is the road where it stands.
        """
        vehicle = libsumo.vehicle
        route, at = vehicle.getRoute(name), vehicle.getRouteIndex(name)
        ahead_m = libsumo.lane.getLength(vehicle.getLaneID(name)) - vehicle.getLanePosition(name)
        roads = [road]
        for following in route[at + 1 :]:
            if not self._one_queue(roads[-1], following):
                return tuple(roads)
            ahead_m += libsumo.lane.getLength(f"{following}_0")
            if ahead_m > _BEFORE_M:
                return (road,)
            roads.append(following)
        return tuple(roads)

    def _one_queue(self, road: str, following: str) -> bool:
        """Return whether who stands on a road waits with those at the end of the next."""
        if (road, following) not in self.one_queue:
            states = [
                link[5]
                for number in range(libsumo.edge.getLaneNumber(road))
                for link in libsumo.lane.getLinks(f"{road}_{number}")
                if link[0].rpartition("_")[0] == following
            ]
            short = libsumo.lane.getLength(f"{following}_0") < _BETWEEN_M
            self.one_queue[road, following] = all(
                one == _GOES_ON or (short and one not in _GIVES_WAY) for one in states
            )
        return self.one_queue[road, following]

    def _headway(self, name: str, roads: tuple[str, ...]) -> float | None:
        """Return the headway that a vehicle keeps who has stood in a queue; none: its usual."""
        # A vehicle that was told anything has a type of its own.
        kind = libsumo.vehicle.getTypeID(name).removesuffix(f"@{name}")
        if kind not in self.kinds:
            told = libsumo.vehicletype.getParameter(kind, IN_QUEUES)
            self.kinds[kind] = float(told) if told else None
        if libsumo.vehicle.getVehicleClass(name) in _OTHERS:
            return self.kinds[kind]
        own = (self.roads[road] for road in reversed(roads) if road in self.roads)
        return next(own, self.kinds[kind])


def _left(roads: tuple[str, ...], now: str) -> tuple[str, ...]:
    """Return the roads of a queue that are still to come, of those that were; empty: it is left.

    Args:
        roads: that were to come when somebody looked last.
        now: where the vehicle is, a road or within a junction.
    """
    if now.startswith(":"):
        return roads if len(roads) > 1 else ()
    return roads[roads.index(now) :] if now in roads else ()
