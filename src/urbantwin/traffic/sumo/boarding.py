"""Boarding and alighting at stops, in SUMO's process.

Part of SUMO's worker: imports nothing of UrbanTwin (see ``worker``). In SUMO, both waiting and
absent passengers stand at the stop, and neither is recorded. This module decides who boards and
alights, and lets alighted passengers walk on.
"""

from __future__ import annotations

from typing import Any

import libsumo

#: SUMO's number of a waiting stage.
_WAITING_STAGE = 1
#: Time from the halt until the doors open, and between consecutive passengers, seconds (Transit
#: Capacity and Quality of Service Manual 2013, chapter 6: 1.75 s to 2.5 s through a door of a bus
#: without payment; several doors are open).
DOORS_S, EACH_S = 1.0, 1.8
#: Maximum number of passengers per halt and direction, and least time between boarding and
#: alighting, seconds.
MOST, AWAY_S = 6, 90.0
#: A vehicle halting farther from the stop's end is behind another, metres.
_MAX_STOP_DISTANCE_M = 3.0


class Boarding:
    """Boarding and alighting passengers.

    Args:
        told: ``stops``: number -> end, metres, and walking time, seconds; ``alight``: by stop,
            number of alighting passengers at each halt; ``people``: by name, its stop and first
            activity.
    """

    def __init__(self, told: dict[str, Any]) -> None:
        self.stops: dict[str, Any] = told.get("stops", {})
        self.alight: dict[str, list[int]] = told.get("alight", {})
        self.stop_of: dict[str, str] = {
            n: stop_and_state[0] for n, stop_and_state in told.get("people", {}).items()
        }
        self.state: dict[str, str] = {
            n: stop_and_state[1] for n, stop_and_state in told.get("people", {}).items()
        }
        self.since = dict.fromkeys(self.state, -AWAY_S)
        self.halted: dict[str, set[str]] = {name: set() for name in self.stops}
        self.halts = dict.fromkeys(self.stops, 0)
        self.walks_on: list[tuple[float, str]] = []
        #: Events: time, kind, passenger, stop, vehicle, and rank among the passengers of the halt.
        self.events: list[tuple[float, str, int, int, int, int]] = []
        for name, state in self.state.items():
            if state == "waits":
                self._note(0.0, "waits", name, -1, 0)

    def look(self, now_s: float) -> None:
        """Update waiting passengers and halted vehicles, once a second."""
        if not self.stops:
            return
        for at_s, name in [stage_end for stage_end in self.walks_on if stage_end[0] <= now_s]:
            self.walks_on.remove((at_s, name))
            libsumo.person.removeStage(name, 0)
            self.state[name] = "walks"
        present = set(libsumo.person.getIDList())
        for name, state in self.state.items():
            if (
                state == "walks"
                and name in present
                and libsumo.person.getStage(name, 0).type == _WAITING_STAGE
            ):
                self.state[name], self.since[name] = "waits", now_s
                self._note(now_s, "waits", name, -1, 0)
        for stop, (end_m, _) in self.stops.items():
            halting = {
                name
                for name in libsumo.busstop.getVehicleIDs(stop)
                if abs(libsumo.vehicle.getLanePosition(name) - end_m) < _MAX_STOP_DISTANCE_M
            }
            for vehicle in sorted(halting - self.halted[stop]):
                self._exchange(stop, vehicle, now_s, present)
            self.halted[stop] = halting

    def _exchange(self, stop: str, vehicle: str, now_s: float, present: set[str]) -> None:
        """Let passengers alight and board."""
        own = [n for n, stop_id in self.stop_of.items() if stop_id == stop and n in present]
        own.sort(key=lambda name: (self.since[name], int(name)))
        away = [n for n in own if self.state[n] == "rides" and self.since[n] <= now_s - AWAY_S]
        waiting = [n for n in own if self.state[n] == "waits"]
        planned = self.alight[stop]
        off = planned[self.halts[stop] % len(planned)]
        self.halts[stop] += 1
        for k, name in enumerate(away[: min(off, MOST)]):
            at_s = now_s + DOORS_S + k * EACH_S
            self._note(at_s, "alights", name, int(vehicle), k)
            self.state[name] = "alights"
            self.walks_on.append((at_s + self.stops[stop][1], name))
        for k, name in enumerate(waiting[:MOST]):
            self._note(now_s + DOORS_S + k * EACH_S, "boards", name, int(vehicle), k)
            self.state[name], self.since[name] = "rides", now_s

    def _note(self, at_s: float, what: str, name: str, vehicle: int, k: int) -> None:
        self.events.append((at_s, what, int(name), int(self.stop_of[name]), vehicle, k))
