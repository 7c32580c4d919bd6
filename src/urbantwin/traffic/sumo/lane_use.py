"""By which lanes an approach is left, in SUMO's process.

Part of SUMO's worker: nothing of UrbanTwin may be imported here (see ``worker``).
"""

from __future__ import annotations

from collections import Counter, defaultdict
from typing import Any

import libsumo

#: SUMO's classes of those whom it does not concern.
_OTHERS = ("bicycle", "tram", "pedestrian")
#: A lane is asked for until somebody looks again, seconds.
_KEEPS_S = 1.0
#: Who is slower is asked for nothing, m/s, and who is longer never, metres: it would stand across
#: two lanes, and nobody would pass.
_SLOWEST_MS, _LONGEST_M = 2.0, 8.0
#: On the road before an approach lanes are chosen so near to its end, metres.
_BEFORE_M = 150.0


class LaneUse:
    """Leads vehicles onto the lanes of an approach, in the shares that a site says.

    Who comes gets the lane that is farthest behind its share (no draw: few vehicles have the shares
    that many have), on the road before the approach already, since approaches may be short. Whether
    it comes to its lane in time is up to traffic.

    Args:
        told: by road ``lanes``: by the road that comes next, shares by the index of a lane.
    """

    def __init__(self, told: dict[str, Any]) -> None:
        self.told = {road: one["lanes"] for road, one in told.items() if one["lanes"]}
        self.before = _before(self.told)
        self.came: Counter[tuple[str, str]] = Counter()
        self.given: Counter[tuple[str, str, int]] = Counter()
        self.lane_of: dict[str, tuple[str, int | None]] = {}

    def look(self) -> None:
        """See to who is there, at a whole second."""
        if not self.told:
            return
        vehicle = libsumo.vehicle
        for road in self.told:
            for name in sorted(libsumo.edge.getLastStepVehicleIDs(road)):
                lane = self._lane(name, road)
                self._ask(name, [] if lane is None else [lane])
        for edge, follow in self.before.items():
            end_m = libsumo.lane.getLength(f"{edge}_0")
            for name in sorted(libsumo.edge.getLastStepVehicleIDs(edge)):
                road = _next(name)
                if road in follow and end_m - vehicle.getLanePosition(name) < _BEFORE_M:
                    lane = self._lane(name, road)
                    self._ask(name, [] if lane is None else follow[road].get(lane, []))
        there = set(vehicle.getIDList())
        self.lane_of = {name: lane for name, lane in self.lane_of.items() if name in there}

    def _ask(self, name: str, lanes: list[int]) -> None:
        """Ask a vehicle to change onto the nearest of some lanes of its road, or to stay there."""
        if lanes and libsumo.vehicle.getSpeed(name) >= _SLOWEST_MS:
            now = libsumo.vehicle.getLaneIndex(name)
            lane = min(lanes, key=lambda one: (abs(one - now), one))
            libsumo.vehicle.changeLane(name, lane, _KEEPS_S)

    def _lane(self, name: str, road: str) -> int | None:
        """Return the lane of an approach that somebody is led to."""
        if name not in self.lane_of or self.lane_of[name][0] != road:
            self.lane_of[name] = road, self._chosen(name, road)
        return self.lane_of[name][1]

    def _chosen(self, name: str, road: str) -> int | None:
        vehicle = libsumo.vehicle
        if vehicle.getVehicleClass(name) in _OTHERS or vehicle.getLength(name) > _LONGEST_M:
            return None
        if vehicle.getStops(name, 1):  # it has a lane already
            return None
        turn = _next(name, road)
        shares = self.told[road].get(turn)
        if shares is None:
            return None
        self.came[road, turn] += 1
        behind = {
            int(lane): share * self.came[road, turn] - self.given[road, turn, int(lane)]
            for lane, share in shares.items()
        }
        lane = max(sorted(behind), key=behind.__getitem__)
        self.given[road, turn, lane] += 1
        return lane


def _next(name: str, road: str | None = None) -> str:
    """Return the road that a vehicle takes after the one that it is on, or after another."""
    route, at = libsumo.vehicle.getRoute(name), libsumo.vehicle.getRouteIndex(name)
    if road is not None:
        at = next((k for k in range(at, len(route)) if route[k] == road), len(route))
    return route[at + 1] if at + 1 < len(route) else ""


def _before(roads: dict[str, Any]) -> dict[str, dict[str, dict[int, list[int]]]]:
    """Return edge before a road -> the road -> index of its lane -> lanes that lead onto it."""
    found: dict[str, dict[str, dict[int, list[int]]]] = defaultdict(lambda: defaultdict(dict))
    for lane in libsumo.lane.getIDList() if roads else ():
        if lane.startswith(":"):
            continue
        for link in libsumo.lane.getLinks(lane):
            road, _, onto = link[0].rpartition("_")
            if road in roads:
                edge, _, number = lane.rpartition("_")
                found[edge][road].setdefault(int(onto), []).append(int(number))
    return {edge: {road: dict(x) for road, x in by.items()} for edge, by in found.items()}
