"""Headways of those who leave queues, in SUMO's process.

Who sets out after standing keeps more time to who is ahead than who drives in a platoon all along,
and less and less of it as it drives; SUMO's drivers know one headway for all that. Part of SUMO's
worker: nothing of UrbanTwin may be imported here (see ``worker``).
"""

from __future__ import annotations

from typing import Any

import libsumo

#: Parameter of a vehicle type: the headway of who stands, seconds.
IN_QUEUES = "urbantwin.queue_headway"
#: Who is slower stands, m/s.
STANDS_MS = 0.5
#: Who has set out comes to its usual headway by so much each second. So queues are left faster and
#: faster, as at the junctions of Greenshields, Schapiro and Ericksen (Traffic Performance at Urban
#: Street Intersections, Yale, 1947); who keeps it to the stop line leaves them slower and slower
#: the farther behind it stood. And whoever is behind slows down by a tenth at most.
_COMES_BACK = 0.1
#: A queue reaches back from where it waits over roads that lead there so near before it, metres, as
#: maps cut streets; and past another signal, where no three cars fit between the two.
_BEFORE_M, _BETWEEN_M = 150.0, 25.0
#: SUMO's letters of links on which nobody waits, and on which who gives way does.
_GOES_ON, _GIVES_WAY = "M", "m=swZ"
#: SUMO's classes of those whom an approach's headway does not concern.
_OTHERS = ("bicycle", "tram", "pedestrian")


class QueueHeadways:
    """Lets who stands keep another headway, and come back to its own when it has set out.

    It is that of the road at which its queue waits: the road where it stands, or one that follows,
    where drivers wait for a signal or give way.

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
        self.stood: set[str] = set()
        #: Vehicle -> its usual headway, of those who have another.
        self.usual: dict[str, float] = {}
        self.one_queue: dict[tuple[str, str], bool] = {}

    def look(self) -> None:
        """See who stands, and who has set out, at a whole second."""
        if not self.of_any:
            return
        vehicle = libsumo.vehicle
        stood: set[str] = set()
        usual: dict[str, float] = {}
        for name in vehicle.getIDList():
            if vehicle.getSpeed(name) < STANDS_MS:
                stood.add(name)
                if name not in self.stood:
                    self._stands(name)
                if name in self.usual:
                    usual[name] = self.usual[name]
            elif name in self.usual:
                headway_s, own = vehicle.getTau(name), self.usual[name]
                step = min(max(own - headway_s, -_COMES_BACK), _COMES_BACK)
                vehicle.setTau(name, headway_s + step)
                if abs(own - headway_s) > _COMES_BACK:
                    usual[name] = own
        self.stood, self.usual = stood, usual

    def _stands(self, name: str) -> None:
        """Give a vehicle that has come to stand the headway of its queue."""
        vehicle = libsumo.vehicle
        road = vehicle.getRoadID(name)
        headway_s = None if road.startswith(":") else self._headway(name, self._queue(name, road))
        if headway_s is not None:
            self.usual.setdefault(name, vehicle.getTau(name))
            vehicle.setTau(name, headway_s)

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
        """Return the headway that a vehicle keeps who stands in a queue; none: its usual."""
        # A vehicle that was told anything has a type of its own.
        kind = libsumo.vehicle.getTypeID(name).removesuffix(f"@{name}")
        if kind not in self.kinds:
            told = libsumo.vehicletype.getParameter(kind, IN_QUEUES)
            self.kinds[kind] = float(told) if told else None
        if libsumo.vehicle.getVehicleClass(name) in _OTHERS:
            return self.kinds[kind]
        own = (self.roads[road] for road in reversed(roads) if road in self.roads)
        return next(own, self.kinds[kind])
