"""Gates: the ends of outer roads, which meter the vehicles that enter the region.

Every vehicle of a closed loop returns to the region over an outer road. At the end of that road a
gate admits the next vehicle when the requested rate allows it. Until then vehicles queue on the
outer road, as at a ramp meter with queue override (Papageorgiou and Kotsialos, IEEE Transactions on
Intelligent Transportation Systems 3(4), 2002).

During the warm-up a gate without waiting vehicles adds one from its reserve, so that as many
vehicles circulate as the requested rate needs. After the warm-up no vehicle is added. The queues at
the gates are the demand that the streets do not carry. Bicycles have gates that add but never hold,
since they do not jam streets.

Part of SUMO's worker: imports nothing of UrbanTwin (see ``worker``).
"""

from __future__ import annotations

from collections import deque
from typing import Any

import libsumo
import numpy as np

#: Maximum number of admissions that a gate saves up while no vehicle waits: during the warm-up, and
#: after it. They let a gate make up for gaps in its arrivals.
MAX_SAVED_IN_WARMUP, MAX_SAVED = 50.0, 3.0
#: Times before the end of the warm-up, s: start of measuring the mean speed, and addition of the
#: vehicles that are missing at this speed. At most the vehicles of ``MOST_S`` seconds of inflow are
#: added.
MEASURED_S, TOP_UP_S, MOST_S = 60.0, 20.0, 100.0
#: The time between two admissions is uniform within 1 +- this, times the mean.
IRREGULARITY = 0.5
#: Comfortable braking of a vehicle that stops at a gate, m/s2, and the distance to the end of the
#: road within which a vehicle counts as at the gate, m.
BRAKING_MS2, AT_GATE_M = 2.0, 6.0
#: A gate admits vehicles regardless of its rate if the queue reaches this close to the start of its
#: outer road, m, or its first vehicle has waited this long, s. So the queue does not block the exit
#: of the region, and no vehicle waits for ever.
OVERRIDE_M, MAX_WAIT_S = 12.0, 200.0
#: No vehicle is admitted while the vehicles in a part of the region take up this share of its
#: lanes, bumper to bumper: urban networks carry most at a quarter to a third of the jam density
#: (Geroliminis and Daganzo, Transportation Research Part B 42(9), 2008).
FULL_SHARE = 0.35
#: A vehicle is added where the start of the outer road is free for this length, m.
FREE_M = 8.0
#: Duration of a stop at a gate, s: until the gate ends it.
WAIT_S = 1e6
BICYCLE, TRAM = "bicycle", "tram"


class _Gate:
    """The end of one outer road, for motor vehicles or for bicycles.

    Attributes:
        edge: id of the outer road.
        holds: whether vehicles wait for an admission.
        part: number of the part of the network that it leads into, of those of its kind.
        saved: admissions that the rate allows now; each entering vehicle takes one.
        price: admissions that the next vehicle takes; 1 on average.
        held: waiting vehicle -> start of waiting, s.
        admitted: vehicles that are admitted and have not left the outer road yet.
    """

    def __init__(self, plan: dict[str, Any], random: np.random.Generator) -> None:
        self.edge, self.holds = str(plan["edge"]), bool(plan["holds"])
        self.part = int(plan["part"])
        self.per_second = float(plan["per_hour"]) / 3600.0
        self.reserve = deque(map(str, plan["reserve"]))
        self.random = random
        self.length_m = libsumo.lane.getLength(f"{self.edge}_0")
        self.saved, self.price = float(random.random()) - 0.5, 1.0
        self.held: dict[str, float] = {}
        self.admitted: set[str] = set()

    def vehicles(self) -> list[str]:
        """Return the vehicles on the outer road that the gate meters, the first one first."""
        vehicle = libsumo.vehicle
        names = [
            name
            for name in libsumo.edge.getLastStepVehicleIDs(self.edge)
            if (vehicle.getVehicleClass(name) == BICYCLE) != self.holds
            and vehicle.getVehicleClass(name) != TRAM
        ]
        return sorted(names, key=lambda name: (-vehicle.getLanePosition(name), int(name)))

    def pay(self) -> None:
        """Take the admissions of one vehicle, and draw those of the next."""
        self.saved -= self.price
        self.price = 1.0 + IRREGULARITY * (2.0 * float(self.random.random()) - 1.0)

    def meter(self, now_s: float, *, full: bool, spare: bool) -> None:
        """Admit or hold the vehicles that reach the end of the road.

        Args:
            now_s: simulation time.
            full: whether its part of the region is full.
            spare: whether fewer vehicles than requested entered through all gates of the part, so
                that a gate with more arrivals makes up for others.
        """
        vehicle = libsumo.vehicle
        names = self.vehicles()
        self.admitted.intersection_update(names)
        self.held = {name: since for name, since in self.held.items() if name in names}
        tail_m = min(
            (
                vehicle.getLanePosition(name) - vehicle.getLength(name)
                for name in names
                if vehicle.getSpeed(name) < 0.5
            ),
            default=self.length_m,
        )
        for name in names:
            if name in self.admitted:
                _end_stop(name)
                continue
            speed = vehicle.getSpeed(name)
            ahead_m = self.length_m - vehicle.getLanePosition(name)
            if ahead_m > speed * speed / (2.0 * BRAKING_MS2) + AT_GATE_M + speed:
                break
            too_long = now_s - self.held.get(name, now_s) > MAX_WAIT_S
            allowed = (spare or self.saved >= self.price) and not full
            if tail_m < OVERRIDE_M or too_long or allowed:
                tail_m = self.length_m
                self.admit(name)
            elif name not in self.held:
                self.hold(name, now_s)

    def count(self) -> None:
        """Let all vehicles pass; each takes an admission when it enters the outer road."""
        present = set(self.vehicles())
        for _ in present - self.admitted:
            self.pay()
        self.admitted = present

    def admit(self, name: str) -> None:
        """Admit a vehicle."""
        self.pay()
        self.admitted.add(name)
        if self.held.pop(name, None) is not None:
            _end_stop(name)

    def hold(self, name: str, now_s: float) -> None:
        """Stop a vehicle at the end of the road; admit it if it is too near to stop."""
        lane = libsumo.vehicle.getLaneIndex(name)
        end_m = libsumo.lane.getLength(f"{self.edge}_{lane}")
        try:
            libsumo.vehicle.setStop(name, self.edge, end_m - 0.5, lane, WAIT_S)
        except libsumo.TraCIException:
            self.admit(name)
        else:
            self.held[name] = now_s

    def add(self, types: dict[str, str]) -> None:
        """Add a vehicle from the reserve if none waits and the rate allows one."""
        if not self.reserve or self.saved < self.price or self.held:
            return
        for other in libsumo.edge.getLastStepVehicleIDs(self.edge):
            rear_m = libsumo.vehicle.getLanePosition(other) - libsumo.vehicle.getLength(other)
            if rear_m < FREE_M:
                return
        name = self.reserve.popleft()
        libsumo.vehicle.add(
            name, f"route-{name}", typeID=types[name], depart="now", departLane="best",
            departPos="base", departSpeed="max",
        )  # fmt: skip
        self.pay()
        self.admitted.add(name)


def _end_stop(name: str) -> None:
    """Remove the stop at the gate, if there is one.

    SUMO ignores the removal of a stop that is reached in this step; it is repeated in the next
    second.
    """
    stops = libsumo.vehicle.getStops(name, 1)
    if stops and stops[0].duration > WAIT_S / 2:
        if libsumo.vehicle.isStopped(name):
            libsumo.vehicle.resume(name)
        else:
            libsumo.vehicle.replaceStop(name, 0, "")


class _Part:
    """A part of the network of motor vehicles.

    Attributes:
        room: vehicles that fit into the region bumper to bumper.
        passage_m: mean distance from one entry into the region to the next.
        inside: vehicles that are in the region now.
        metres: distance driven while the speed was measured.
        seconds: total driving time while the speed was measured.
    """

    def __init__(self, room: float, passage_m: float) -> None:
        self.room, self.passage_m = room, passage_m
        self.inside, self.metres, self.seconds = 0, 0.0, 0.0

    @property
    def full(self) -> bool:
        """Whether no more vehicles may enter."""
        return 0.0 < FULL_SHARE * self.room <= self.inside


class Gates:
    """The gates of a network.

    Args:
        job: ``gates``: ``edge``, ``per_hour``, ``holds``, ``reserve`` (numbers of trips) and
            ``part`` of each; ``types``: number of a trip in reserve -> its vehicle type;
            ``until_s``: end of adding vehicles; ``parts``: ``edges``, ``room`` (vehicles that fit
            into the region bumper to bumper) and ``passage_m`` (mean distance from one entry into
            the region to the next); ``seed``.
        outer: ids of all outer roads.
    """

    def __init__(self, job: dict[str, Any], outer: list[str]) -> None:
        self.types: dict[str, str] = job["types"]
        self.until_s = float(job["until_s"])
        self.parts = [_Part(float(x["room"]), float(x["passage_m"])) for x in job["parts"]]
        self.part_of_edge = {
            str(edge): part
            for row, part in zip(job["parts"], self.parts, strict=True)
            for edge in row["edges"]
        }
        self.part_of_vehicle: dict[str, _Part] = {}
        self.outer = frozenset(outer)
        seed = int(job["seed"])
        self.gates = [
            _Gate(plan, np.random.Generator(np.random.Philox(key=[seed, number])))
            for number, plan in enumerate(job["gates"])
        ]
        self.now_s, self.topped_up = 0.0, False

    def act(self, now_s: float) -> None:
        """Admit, hold and add vehicles; called once each second."""
        if not self.gates:
            return
        passed_s, self.now_s = now_s - self.now_s, now_s
        warming_up = now_s < self.until_s
        self._count_inside()
        if self.until_s - MEASURED_S < now_s < self.until_s:
            self._top_up(now_s)
        any_full = any(part.full for part in self.parts)
        for gate in self.gates:
            most = MAX_SAVED_IN_WARMUP if warming_up else MAX_SAVED
            gate.saved = float(np.clip(gate.saved + gate.per_second * passed_s, -most, most))
            full = self.parts[gate.part].full if gate.holds else any_full
            if gate.holds:
                gate.meter(now_s, full=full, spare=self._too_few(gate))
            else:
                gate.count()
            if warming_up and not full and self._too_few(gate):
                gate.add(self.types)

    def _top_up(self, now_s: float) -> None:
        """Measure the speed of motor vehicles; near the end, let gates add the missing vehicles.

        By Little's law as many vehicles must be moving as enter during the time of a full circuit.
        Vehicles that wait at gates do not count.
        """
        gates = [gate for gate in self.gates if gate.holds]
        waiting = {name for gate in gates for name in gate.held}
        moving: dict[int, int] = {}
        for name in self._motor():
            part = self._part_of(name)
            if part is not None and name not in waiting:
                part.metres += max(libsumo.vehicle.getSpeed(name), 0.0)
                part.seconds += 1.0
                moving[id(part)] = moving.get(id(part), 0) + 1
        if self.topped_up or now_s < self.until_s - TOP_UP_S:
            return
        self.topped_up = True
        for number, part in enumerate(self.parts):
            own = [gate for gate in gates if gate.part == number]
            speed = max(part.metres / max(part.seconds, 1.0), 0.5)
            per_second = sum(gate.per_second for gate in own)
            missing = per_second * part.passage_m / speed - moving.get(id(part), 0)
            share = min(max(missing / max(per_second, 1e-9), 0.0), MOST_S)
            for gate in own:
                gate.saved += gate.per_second * share

    def _too_few(self, gate: _Gate) -> bool:
        """Return whether fewer vehicles than requested entered through all gates of a part."""
        own = (x for x in self.gates if (x.holds, x.part) == (gate.holds, gate.part))
        return sum(x.saved for x in own) >= 1.0

    def _motor(self) -> list[str]:
        """Return the motor vehicles on the road."""
        vehicle = libsumo.vehicle
        return [
            name
            for name in vehicle.getIDList()
            if vehicle.getVehicleClass(name) not in (BICYCLE, TRAM)
        ]

    def _part_of(self, name: str) -> _Part | None:
        """Return the part of the network that a vehicle is on, which is constant."""
        if name not in self.part_of_vehicle:
            for edge in libsumo.vehicle.getRoute(name):
                if edge in self.part_of_edge:
                    self.part_of_vehicle[name] = self.part_of_edge[edge]
                    break
        return self.part_of_vehicle.get(name)

    def _count_inside(self) -> None:
        """Count the motor vehicles in the region, by part of the network."""
        for part in self.parts:
            part.inside = 0
        for name in self._motor():
            part_of_it = self._part_of(name)
            if part_of_it is not None and libsumo.vehicle.getRoadID(name) not in self.outer:
                part_of_it.inside += 1
