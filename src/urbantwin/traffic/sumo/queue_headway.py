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
#: SUMO's classes of those whom an approach's headway does not concern.
_OTHERS = ("bicycle", "tram", "pedestrian")


class QueueHeadways:
    """Lets who has stood keep another headway, to the end of the road on which it stood.

    After that it closes up at once, or falls back bit by bit.

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
        self.stood: dict[str, tuple[str, float]] = {}
        self.falls_back: dict[str, float] = {}

    def look(self) -> None:
        """See who stands, and who has left the road where it stood, at a whole second."""
        if not self.of_any:
            return
        vehicle = libsumo.vehicle
        there = vehicle.getIDList()
        stood: dict[str, tuple[str, float]] = {}
        for name in there:
            road, before = vehicle.getRoadID(name), self.stood.get(name)
            if before is not None and before[0] != road:
                self.falls_back[name] = before[1]
                before = None
            if before is None and not road.startswith(":") and vehicle.getSpeed(name) < STANDS_MS:
                headway_s = self._headway(name, road)
                if headway_s is not None:
                    before = road, self.falls_back.pop(name, vehicle.getTau(name))
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

    def _headway(self, name: str, road: str) -> float | None:
        """Return the headway that a vehicle keeps once it has stood on a road; none: its usual."""
        # A vehicle that was told anything has a type of its own.
        kind = libsumo.vehicle.getTypeID(name).removesuffix(f"@{name}")
        if kind not in self.kinds:
            told = libsumo.vehicletype.getParameter(kind, IN_QUEUES)
            self.kinds[kind] = float(told) if told else None
        if libsumo.vehicle.getVehicleClass(name) in _OTHERS:
            return self.kinds[kind]
        return self.roads.get(road, self.kinds[kind])
