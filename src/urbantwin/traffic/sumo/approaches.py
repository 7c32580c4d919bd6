"""How approaches are used, in SUMO's process: by which lanes, and how close behind each other.

Part of SUMO's worker: nothing of UrbanTwin may be imported here (see ``worker``).
"""

from __future__ import annotations

from typing import Any

import libsumo

#: SUMO's classes of those whom it concerns not.
_OTHERS = ("bicycle", "tram", "pedestrian")
#: A lane is asked for anew before this has passed, seconds.
_KEEPS_S = 2.0


class Approaches:
    """Leads vehicles onto lanes of an approach, and lets them keep its headway there.

    Args:
        told: by road ``headway_s``, or none, and ``lanes``: by the road that comes next shares by
            the index of a lane.
    """

    def __init__(self, told: dict[str, Any]) -> None:
        self.told = told
        self.passed: dict[tuple[str, str], int] = {}
        self.given: dict[tuple[str, str, int], int] = {}
        self.there: dict[str, tuple[str, int | None, float]] = {}

    def look(self) -> None:
        """See to who is there, at a whole second."""
        here: dict[str, tuple[str, int | None, float]] = {}
        for road in self.told:
            for name in libsumo.edge.getLastStepVehicleIDs(road):
                if libsumo.vehicle.getVehicleClass(name) in _OTHERS:
                    continue
                here[name] = self.there.get(name) or self._comes(name, road)
                lane = here[name][1]
                if lane is not None and libsumo.vehicle.getLaneIndex(name) != lane:
                    libsumo.vehicle.changeLane(name, lane, _KEEPS_S)
        left = self.there.keys() - here.keys()
        for name in left & set(libsumo.vehicle.getIDList()) if left else ():
            libsumo.vehicle.setTau(name, self.there[name][2])
        self.there = here

    def _comes(self, name: str, road: str) -> tuple[str, int | None, float]:
        """Return where somebody new is, its lane, and the headway that it keeps elsewhere."""
        usual, one = libsumo.vehicle.getTau(name), self.told[road]
        if one["headway_s"] is not None:
            libsumo.vehicle.setTau(name, one["headway_s"])
        route, at = libsumo.vehicle.getRoute(name), libsumo.vehicle.getRouteIndex(name)
        turn = route[at + 1] if at + 1 < len(route) else ""
        shares = one["lanes"].get(turn)
        return road, self._lane(road, turn, shares) if shares else None, usual

    def _lane(self, road: str, turn: str, shares: dict[str, float]) -> int:
        """Return the lane that is farthest behind its share."""
        count = self.passed[road, turn] = self.passed.get((road, turn), 0) + 1
        behind = {
            int(lane): share * count - self.given.get((road, turn, int(lane)), 0)
            for lane, share in shares.items()
        }
        lane = max(behind, key=lambda one: (behind[one], -one))
        self.given[road, turn, lane] = self.given.get((road, turn, lane), 0) + 1
        return lane
