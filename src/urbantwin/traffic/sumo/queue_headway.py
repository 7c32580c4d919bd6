"""Headways of vehicles that leave queues, in SUMO's process.

A driver that starts from standstill keeps a longer headway than one that drives in a platoon, and
reduces it while driving; SUMO's drivers have one constant headway. Part of SUMO's worker: imports
nothing of UrbanTwin (see ``worker``).
"""

from __future__ import annotations

from typing import Any

import libsumo

#: Parameter of a vehicle type: headway when leaving a queue, seconds.
IN_QUEUES = "urbantwin.queue_headway"
#: Speed below which a vehicle counts as standing, m/s.
STANDS_MS = 0.5
#: Change of the headway towards the usual one per second after starting. So the discharge rate of a
#: queue rises, as at the junctions of Greenshields, Schapiro and Ericksen (Traffic Performance at
#: Urban Street Intersections, Yale, 1947); if the headway were kept to the stop line, it would
#: fall. Followers then slow down by a tenth at most.
_COMES_BACK = 0.1
#: Maximum distance over which a queue extends back over the roads before its signal, metres, since
#: maps split streets; and length of a road, metres, too short for three cars, over which a queue
#: extends past another signal.
_BEFORE_M, _SHORT_ROAD_M = 150.0, 25.0
#: SUMO's states of links on which vehicles do not wait, and on which they yield.
_FREE_STATES, _YIELD_STATES = "M", "m=swZ"
#: SUMO's vehicle classes to which an approach's headway does not apply.
_EXEMPT_CLASSES = ("bicycle", "tram", "pedestrian")


class QueueHeadways:
    """Gives standing vehicles another headway, which returns to the usual one after they start.

    The headway is that of the road at which the queue waits: the vehicle's own road, or a later one
    where vehicles wait for a signal or yield.

    Args:
        told: by road ``queue_headway_s``, which overrides that of a vehicle's type.
        of_types: whether any vehicle type has such a headway.
    """

    def __init__(self, told: dict[str, Any], of_types: bool = True) -> None:
        self.roads = {
            road: requests["queue_headway_s"]
            for road, requests in told.items()
            if requests["queue_headway_s"] is not None
        }
        self.of_any = of_types or bool(self.roads)
        self.kinds: dict[str, float | None] = {}
        self.stood: set[str] = set()
        #: Vehicle -> its usual headway, for vehicles with a changed one.
        self.usual: dict[str, float] = {}
        self.one_queue: dict[tuple[str, str], bool] = {}

    def look(self) -> None:
        """Update standing and started vehicles, once a second."""
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
        """Set the headway of a vehicle that has just stopped to that of its queue."""
        vehicle = libsumo.vehicle
        road = vehicle.getRoadID(name)
        headway_s = None if road.startswith(":") else self._headway(name, self._queue(name, road))
        if headway_s is not None:
            self.usual.setdefault(name, vehicle.getTau(name))
            vehicle.setTau(name, headway_s)

    def _queue(self, name: str, road: str) -> tuple[str, ...]:
        """Return the roads from a vehicle's own to the one at whose end its queue waits.

        If there is none within 150 m, only its own road.
        """
        vehicle = libsumo.vehicle
        route, route_index = vehicle.getRoute(name), vehicle.getRouteIndex(name)
        ahead_m = libsumo.lane.getLength(vehicle.getLaneID(name)) - vehicle.getLanePosition(name)
        roads = [road]
        for following in route[route_index + 1 :]:
            if not self._one_queue(roads[-1], following):
                return tuple(roads)
            ahead_m += libsumo.lane.getLength(f"{following}_0")
            if ahead_m > _BEFORE_M:
                return (road,)
            roads.append(following)
        return tuple(roads)

    def _one_queue(self, road: str, following: str) -> bool:
        """Return whether a queue on a road continues that at the end of the next road."""
        if (road, following) not in self.one_queue:
            states = [
                link[5]
                for number in range(libsumo.edge.getLaneNumber(road))
                for link in libsumo.lane.getLinks(f"{road}_{number}")
                if link[0].rpartition("_")[0] == following
            ]
            short = libsumo.lane.getLength(f"{following}_0") < _SHORT_ROAD_M
            self.one_queue[road, following] = all(
                state == _FREE_STATES or (short and state not in _YIELD_STATES) for state in states
            )
        return self.one_queue[road, following]

    def _headway(self, name: str, roads: tuple[str, ...]) -> float | None:
        """Return the headway of a vehicle standing in a queue; ``None``: its usual one."""
        # A vehicle with own parameters has a type of its own.
        kind = libsumo.vehicle.getTypeID(name).removesuffix(f"@{name}")
        if kind not in self.kinds:
            text = libsumo.vehicletype.getParameter(kind, IN_QUEUES)
            self.kinds[kind] = float(text) if text else None
        if libsumo.vehicle.getVehicleClass(name) in _EXEMPT_CLASSES:
            return self.kinds[kind]
        own = (self.roads[road] for road in reversed(roads) if road in self.roads)
        return next(own, self.kinds[kind])
