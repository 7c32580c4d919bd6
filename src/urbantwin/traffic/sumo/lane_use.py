"""Choice of lanes on approaches, in SUMO's process.

Part of SUMO's worker: imports nothing of UrbanTwin (see ``worker``).
"""

from __future__ import annotations

from collections import Counter, defaultdict
from typing import Any

import libsumo

#: SUMO's vehicle classes that are not assigned to lanes.
_UNASSIGNED_CLASSES = ("bicycle", "tram", "pedestrian")
#: Duration of a lane request, seconds: until the next update.
_REQUEST_S = 1.0
#: Vehicles slower than the first, m/s, get no request, nor do vehicles longer than the second,
#: metres, which would block two lanes.
_MIN_SPEED_MS, _MAX_LENGTH_M = 2.0, 8.0
#: Distance to the end of the road before an approach from which lanes are chosen, metres.
_CHOICE_DISTANCE_M = 150.0


class LaneUse:
    """Assigns vehicles to the lanes of an approach in given shares.

    A vehicle gets the lane that is farthest below its share; without random draws, few vehicles
    reach the shares, too. Since approaches may be short, it is assigned on the road before already.
    Whether it reaches its lane in time depends on traffic.

    Args:
        told: by road ``lanes``: by next road, shares by index of a lane.
    """

    def __init__(self, told: dict[str, Any]) -> None:
        self.told = {
            road: requests["lanes"] for road, requests in told.items() if requests["lanes"]
        }
        self.before = _lanes_before(self.told)
        self.came: Counter[tuple[str, str]] = Counter()
        self.given: Counter[tuple[str, str, int]] = Counter()
        self.lane_of: dict[str, tuple[str, int | None]] = {}

    def look(self) -> None:
        """Update the lane requests, once a second."""
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
                road = _next_road(name)
                if road in follow and end_m - vehicle.getLanePosition(name) < _CHOICE_DISTANCE_M:
                    lane = self._lane(name, road)
                    self._ask(name, [] if lane is None else follow[road].get(lane, []))
        present = set(vehicle.getIDList())
        self.lane_of = {name: lane for name, lane in self.lane_of.items() if name in present}

    def _ask(self, name: str, lanes: list[int]) -> None:
        """Request a change to the nearest of some lanes of the vehicle's road, or to stay there."""
        if lanes and libsumo.vehicle.getSpeed(name) >= _MIN_SPEED_MS:
            now = libsumo.vehicle.getLaneIndex(name)
            lane = min(lanes, key=lambda lane_index: (abs(lane_index - now), lane_index))
            libsumo.vehicle.changeLane(name, lane, _REQUEST_S)

    def _lane(self, name: str, road: str) -> int | None:
        """Return the lane of an approach that a vehicle is assigned to."""
        if name not in self.lane_of or self.lane_of[name][0] != road:
            self.lane_of[name] = road, self._chosen(name, road)
        return self.lane_of[name][1]

    def _chosen(self, name: str, road: str) -> int | None:
        vehicle = libsumo.vehicle
        if (
            vehicle.getVehicleClass(name) in _UNASSIGNED_CLASSES
            or vehicle.getLength(name) > _MAX_LENGTH_M
        ):
            return None
        if vehicle.getStops(name, 1):  # the stop determines its lane
            return None
        turn = _next_road(name, road)
        shares = self.told[road].get(turn)
        if shares is None:
            return None
        self.came[road, turn] += 1
        deficit = {
            int(lane): share * self.came[road, turn] - self.given[road, turn, int(lane)]
            for lane, share in shares.items()
        }
        lane = max(sorted(deficit), key=deficit.__getitem__)
        self.given[road, turn, lane] += 1
        return lane


def _next_road(name: str, road: str | None = None) -> str:
    """Return the road after the one that a vehicle is on, or after a given one."""
    route, route_index = libsumo.vehicle.getRoute(name), libsumo.vehicle.getRouteIndex(name)
    if road is not None:
        route_index = next(
            (k for k in range(route_index, len(route)) if route[k] == road), len(route)
        )
    return route[route_index + 1] if route_index + 1 < len(route) else ""


def _lanes_before(roads: dict[str, Any]) -> dict[str, dict[str, dict[int, list[int]]]]:
    """Return edge before a road -> the road -> index of its lane -> lanes that lead onto it."""
    leads_to: dict[str, dict[str, dict[int, list[int]]]] = defaultdict(lambda: defaultdict(dict))
    for lane in libsumo.lane.getIDList() if roads else ():
        if lane.startswith(":"):
            continue
        for link in libsumo.lane.getLinks(lane):
            road, _, onto = link[0].rpartition("_")
            if road in roads:
                edge, _, number = lane.rpartition("_")
                leads_to[edge][road].setdefault(int(onto), []).append(int(number))
    return {edge: {road: dict(x) for road, x in by.items()} for edge, by in leads_to.items()}
