"""Streets with one lane for both directions, on which vehicles wait for oncoming traffic.

In SUMO both directions are separate edges in one place, so SUMO ignores oncoming traffic there.
Before every step this finds the vehicles that approach such a street. A vehicle enters if none
drives against it on all consecutive streets of this kind on its route, up to the next place where
two can pass. So it needs no space that another holds, and no two block each other.

Vehicles enter in the order of arrival, and close followers go with the first. Bicycles pass beside
a car and do not wait.

Part of SUMO's worker: imports nothing of UrbanTwin (see ``worker``).
"""

from __future__ import annotations

import math
from typing import Any

import libsumo

#: Braking before the street, m/s2, hardest braking, m/s2, and waiting position before the end of
#: the lane, m.
BRAKING_MS2, HARDEST_MS2, BEFORE_M = 2.0, 4.5, 1.0
#: A vehicle requests entry at its braking distance plus this time, s, and distance, m.
AHEAD_S, AHEAD_M = 1.0, 8.0
#: A vehicle that arrives within the first time after another follows it, s, unless an oncoming one
#: has waited for the second time, s.
FOLLOWS_S, PATIENCE_S = 5.0, 40.0
#: A vehicle that has waited this long, s, takes a detour, if one rejoins its route within this
#: number of edges.
GIVES_UP_S, REJOINS = 45.0, 12
#: A vehicle that has entered has left the previous road if its rear is this far beyond, m.
CLEAR_M = 1.0
#: Classes of vehicles that do not wait: bicycles have room, trams have rails.
_UNMETERED_CLASSES = ("bicycle", "tram")

#: The edge from which an admitted vehicle enters, and the edges that it holds.
_Passage = tuple[str, list[str]]


class OneLaneStreets:
    """Streets on which vehicles wait for oncoming ones.

    Args:
        known: result of ``one_lane_streets``.
    """

    def __init__(self, known: dict[str, Any]) -> None:
        self.street: dict[str, str] = known.get("street", {})
        self.mouths: list[str] = known.get("mouths", [])
        self.short = frozenset(known.get("short", ()))
        self.passages: dict[str, _Passage] = {}
        self.waiting: dict[str, float] = {}
        self.entered: dict[str, float] = {}
        self.tried: dict[str, float] = {}
        self.slowed: set[str] = set()

    def heed(self, step_s: float) -> None:
        """Admit or hold the vehicles that approach these streets; called before every step."""
        if not self.street:
            return
        self._leave()
        now_s = libsumo.simulation.getTime()
        asking: dict[str, tuple[str, list[str], float]] = {}
        for edge in self.mouths:
            held: set[str] = set()
            for name in self._motor(edge):
                ahead_m = self._asks(name, edge)
                lane = libsumo.vehicle.getLaneID(name)
                if ahead_m is None or lane in held:
                    continue
                run = self._run(name)
                if not run or set(run) <= set(self._own(name)):
                    continue
                asking[name] = edge, run, ahead_m
                held.add(lane)
        self.waiting = {name: self.waiting.get(name, now_s) for name in asking}
        self.tried = {name: at_s for name, at_s in self.tried.items() if name in asking}
        slowed: set[str] = set()
        before: list[tuple[float, list[str]]] = []
        for name in sorted(
            asking, key=lambda vehicle_id: (self.waiting[vehicle_id], len(vehicle_id), vehicle_id)
        ):
            edge, run, ahead_m = asking[name]
            oncoming = [since for since, other in before if _are_opposed(run, other, self.street)]
            follows = now_s - self.entered.get(run[0], -math.inf) < FOLLOWS_S
            may = not oncoming or (follows and now_s - min(oncoming) < PATIENCE_S)
            if may and self._is_free(name, run):
                self.passages[name] = edge, run
                self.entered[run[0]] = now_s
                del self.waiting[name]
                continue
            before.append((self.waiting[name], run))
            if now_s - self.waiting[name] > self.tried.get(name, 0.0) + GIVES_UP_S:
                self.tried[name] = now_s - self.waiting[name]
                self._go_round(name)
            speed = libsumo.vehicle.getSpeed(name)
            most = max(_safe_speed(ahead_m - BEFORE_M), speed - HARDEST_MS2 * step_s, 0.0)
            libsumo.vehicle.setSpeed(name, most)
            slowed.add(name)
        present = set(libsumo.vehicle.getIDList())
        for name in sorted((self.slowed - slowed) & present):
            libsumo.vehicle.setSpeed(name, -1)
        self.slowed = slowed

    def _motor(self, edge: str) -> list[str]:
        """Return the motor vehicles on an edge, the first one first."""
        vehicle = libsumo.vehicle
        names = [
            name
            for name in libsumo.edge.getLastStepVehicleIDs(edge)
            if vehicle.getVehicleClass(name) not in _UNMETERED_CLASSES
        ]
        return sorted(names, key=lambda name: (-vehicle.getLanePosition(name), name))

    def _own(self, name: str) -> list[str]:
        return self.passages[name][1] if name in self.passages else []

    def _asks(self, name: str, edge: str) -> float | None:
        """Return a vehicle's distance to the end of its lane if it requests entry, else ``None``.

        A vehicle at a red light or with a stop on this edge makes no request.
        """
        vehicle = libsumo.vehicle
        speed = vehicle.getSpeed(name)
        ahead_m = libsumo.lane.getLength(vehicle.getLaneID(name)) - vehicle.getLanePosition(name)
        if ahead_m > speed * speed / (2.0 * BRAKING_MS2) + AHEAD_S * speed + AHEAD_M:
            return None
        if self._waits_at_red(name):
            return None
        if any(stop.lane.rpartition("_")[0] == edge for stop in vehicle.getStops(name, 1)):
            return None
        return float(ahead_m)

    def _waits_at_red(self, name: str) -> bool:
        """Return whether the signal at the end of a vehicle's lane is red."""
        vehicle = libsumo.vehicle
        ahead_m = libsumo.lane.getLength(vehicle.getLaneID(name)) - vehicle.getLanePosition(name)
        signals: Any = vehicle.getNextTLS(name)
        return bool(signals and signals[0][2] < ahead_m + 1.0 and signals[0][3] in "rR")

    def _run(self, name: str) -> list[str]:
        """Return the edges of one lane ahead of a vehicle, up to the next passing place."""
        run: list[str] = []
        route = libsumo.vehicle.getRoute(name)
        for edge in route[libsumo.vehicle.getRouteIndex(name) + 1 :]:
            if edge in self.street:
                run.append(edge)
            elif edge not in self.short:
                break
        return run

    def _go_round(self, name: str) -> None:
        """Reroute a vehicle over another link of its lane that rejoins its route.

        A queue behind a waiting vehicle may otherwise reach round to those that it waits for.
        """
        vehicle = libsumo.vehicle
        route, route_index = vehicle.getRoute(name), vehicle.getRouteIndex(name)
        # A vehicle with own parameters has a type of its own, which ``findRoute`` does not know.
        kind = vehicle.getTypeID(name).removesuffix(f"@{name}")
        best: tuple[float, list[str]] | None = None
        for link in libsumo.lane.getLinks(vehicle.getLaneID(name)):
            first = libsumo.lane.getEdgeID(link[0])
            closed = vehicle.getVehicleClass(name) in libsumo.lane.getDisallowed(link[0])
            if first.startswith(":") or first in self.street or closed:
                continue
            for rest in range(route_index + 1, min(route_index + 1 + REJOINS, len(route))):
                detour = libsumo.simulation.findRoute(first, route[rest], kind)
                around = detour.edges and not self.street.keys() & set(detour.edges)
                if around and (best is None or detour.travelTime < best[0]):
                    best = detour.travelTime, [*detour.edges, *route[rest + 1 :]]
        if best is not None:
            vehicle.setRoute(name, [route[route_index], *best[1]])

    def _is_free(self, name: str, run: list[str]) -> bool:
        return not any(
            _are_opposed(run, edges, self.street)
            for other, (_, edges) in self.passages.items()
            if other != name
        )

    def _leave(self) -> None:
        """Release the edges that vehicles have left; register vehicles that were not admitted."""
        vehicle = libsumo.vehicle
        present = set(vehicle.getIDList())
        for name, (entry, edges) in list(self.passages.items()):
            if name not in present:
                del self.passages[name]
                continue
            road = vehicle.getRoadID(name)
            if road == entry and self._waits_at_red(name):
                del self.passages[name]
                continue
            rear_m = vehicle.getLanePosition(name) - vehicle.getLength(name)
            if road.startswith(":") or road == entry or rear_m < CLEAR_M:
                continue
            if road in edges:
                self.passages[name] = entry, edges[edges.index(road) :]
            elif road not in self.short:
                del self.passages[name]
        for edge in self.street:
            for name in self._motor(edge):
                if edge not in self._own(name):
                    self.passages[name] = "", [edge, *self._run(name)]


def _are_opposed(first: list[str], second: list[str], street: dict[str, str]) -> bool:
    """Return whether vehicles that drive over the given edges meet on a street."""
    second_edges: dict[str, set[str]] = {}
    for edge in second:
        second_edges.setdefault(street[edge], set()).add(edge)
    first_edges: dict[str, set[str]] = {}
    for edge in first:
        first_edges.setdefault(street[edge], set()).add(edge)
    return any(
        len(edges | second_edges[key]) > 1
        for key, edges in first_edges.items()
        if key in second_edges
    )


def _safe_speed(gap_m: float) -> float:
    """Return the speed from which a vehicle can stop within a distance, m/s."""
    reaction = BRAKING_MS2 * 0.5
    return max(-reaction + math.sqrt(reaction**2 + 2 * BRAKING_MS2 * max(gap_m, 0.0)), 0.0)
