"""Events staged in a running SUMO, to which other traffic reacts.

Part of SUMO's worker: imports nothing of UrbanTwin (see ``worker``). Each event is a state machine
that selects its vehicle at the requested time, controls it step by step, and records what happened.
Before the first event's time nothing changes the simulation.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import libsumo

#: SUMO's speed modes (https://sumo.dlr.de/docs/TraCI/Change_Vehicle_State.html): all checks, none,
#: and all but right of way and red lights.
_ALL_CHECKS, _NO_CHECKS, _IGNORES_SIGNALS = 31, 0, 7
#: The same, also ignoring vehicles on the junction.
_IGNORES_SIGNALS_AND_JUNCTION = 39
#: SUMO's lane-change modes: no changes, and the default.
_NO_LANE_CHANGES, _DEFAULT_LANE_CHANGES = 512, 1621
_MIN_MOVING_MS = 3.0  # slower vehicles are not selected for events that need a moving one
_COMFORTABLE_MS2 = 2.5
#: Deceleration of a wreck, m/s2 (locked wheels on dry asphalt: 0.7 g).
_SLIDING_MS2 = 6.9
#: Distance within which a vehicle is selected that has to stop at a place, metres.
_SELECTION_RANGE_M = 120.0
#: Distance ahead of a blue light within which a vehicle makes way, and lateral movement that counts
#: as making way, metres.
_SIREN_RANGE_M, _MIN_LATERAL_M = 30.0, 0.3
_OBSTACLE_PREFIX = "obstacle-"


class Staged(ABC):
    """An event: waits for its time and vehicle, acts, and records what happened.

    Args:
        told: the job's row: ``event``, ``at_s``, ``within_s``, ``lane``, acceptable ``lanes``,
            ``along_m`` and fields of its kind.
        taken: names of vehicles that take part in any event.
    """

    tries = 0

    def __init__(self, told: dict[str, Any], taken: set[str]) -> None:
        self.told, self.taken = told, taken
        self.state = "waits"
        self.who: list[str] = []
        self.from_s = self.until_s = -1.0
        self.note: dict[str, Any] = {}

    @property
    def _lane(self) -> str:
        return str(self.told["lane"])

    def act(self, now_s: float, step_s: float) -> None:
        """Act before the next step."""
        if now_s < self.told["at_s"] or self.state in ("done", "missed"):
            return
        if self.state == "waits":
            if now_s > self.told["at_s"] + self.told["within_s"] and not self.tries:
                self.state = "missed"
            elif self._begin(now_s):
                self.state, self.from_s = "acts", now_s
                self.taken.update(self.who)
        elif any(name not in self._present() for name in self.who):
            self._end(now_s)
        else:
            self._go_on(now_s, step_s)

    def _present(self) -> frozenset[str]:
        return frozenset(libsumo.vehicle.getIDList())

    @abstractmethod
    def _begin(self, now_s: float) -> bool:
        """Select a vehicle; return whether the event began."""

    def _go_on(self, now_s: float, step_s: float) -> None:  # noqa: B027 - optional
        pass

    def _end(self, now_s: float) -> None:
        if self.state == "acts":
            self.state, self.until_s = "done", now_s

    def _free(self, lane: str) -> list[str]:
        """Return the vehicles on a lane that take part in no event."""
        names = filter(str.isdigit, libsumo.lane.getLastStepVehicleIDs(lane))
        return [name for name in names if name not in self.taken]

    def _reaching(self, before_m: float, after_m: float) -> list[str]:
        """Return the moving vehicles between two distances before the place, the nearest first.

        Those on the place's lane precede those on the other acceptable lanes.
        """
        vehicles = []
        for rank, lane in enumerate(self.told["lanes"]):
            for name in self._free(lane):
                ahead = self.told["along_m"] - libsumo.vehicle.getLanePosition(name)
                if after_m <= ahead <= before_m and libsumo.vehicle.getSpeed(name) > _MIN_MOVING_MS:
                    vehicles.append((rank, ahead, int(name), name))
        return [vehicle[-1] for vehicle in sorted(vehicles)]


class HardBrake(Staged):
    """The vehicle that reaches the place brakes to a stop, stands, and drives on."""

    stopped_s = -1.0

    def _begin(self, now_s: float) -> bool:
        names = self._reaching(6.0, -6.0)
        if not names:
            return False
        self.who = names[:1]
        self.note["speed_before"] = round(libsumo.vehicle.getSpeed(names[0]), 3)
        libsumo.vehicle.setSpeedMode(names[0], _NO_CHECKS)
        libsumo.vehicle.setLaneChangeMode(names[0], _NO_LANE_CHANGES)
        return True

    def _go_on(self, now_s: float, step_s: float) -> None:
        name = self.who[0]
        speed = libsumo.vehicle.getSpeed(name)
        if self.stopped_s < 0:
            libsumo.vehicle.setSpeed(name, max(speed - self.told["deceleration"] * step_s, 0.0))
            if speed <= 0:
                self.stopped_s = now_s
        elif now_s >= self.stopped_s + self.told["stands_s"]:
            free(name)
            self._end(now_s)


class Collision(Staged):
    """A vehicle brakes or stands, and its follower does not react; both stay as wrecks."""

    touched_s = -1.0
    common = 0.0

    def _begin(self, now_s: float) -> bool:
        for name in self._reaching(40.0, -40.0):
            ahead = libsumo.vehicle.getLeader(name, 60.0)
            if not ahead or not ahead[0].isdigit() or ahead[0] in self.taken or ahead[1] > 40.0:
                continue
            leader = ahead[0]
            same = libsumo.vehicle.getLaneID(leader) == libsumo.vehicle.getLaneID(name)
            lateral_m = abs(
                libsumo.vehicle.getLateralLanePosition(leader)
                - libsumo.vehicle.getLateralLanePosition(name)
            )
            if not same or lateral_m > 0.6:
                continue
            self.who = [name, leader]
            for participant in self.who:
                libsumo.vehicle.setSpeedMode(participant, _NO_CHECKS)
                libsumo.vehicle.setLaneChangeMode(participant, _NO_LANE_CHANGES)
            self.note["speed_before"] = round(libsumo.vehicle.getSpeed(name), 3)
            return True
        return False

    def _go_on(self, now_s: float, step_s: float) -> None:
        follower, leader = self.who
        speeds = [libsumo.vehicle.getSpeed(participant) for participant in self.who]
        if self.touched_s < 0:
            braked = max(speeds[1] - self.told["deceleration"] * step_s, 0.0)
            libsumo.vehicle.setSpeed(leader, braked)
            libsumo.vehicle.setSpeed(follower, speeds[0])
            ahead = libsumo.vehicle.getLeader(follower, 60.0)
            if ahead and ahead[0] == leader:
                # SUMO's distance excludes the follower's minimum gap.
                gap = ahead[1] + libsumo.vehicle.getMinGap(follower)
                if gap <= (speeds[0] - braked) * step_s:
                    self.touched_s = now_s
                    # Inelastic collision of equal masses: both move on together.
                    self.common = (speeds[0] + braked) / 2
                    self.note["speed_at_impact"] = round(speeds[0], 3)
                    self.note["speed_of_other"] = round(braked, 3)
                    self.note["impact_s"] = now_s
                    libsumo.vehicle.setSpeed(follower, max(gap, 0.0) / step_s + braked)
        else:
            self.common = max(self.common - _SLIDING_MS2 * step_s, 0.0)
            for participant in self.who:
                libsumo.vehicle.setSpeed(participant, self.common)


class RedLight(Staged):
    """A vehicle that approaches a red signal on the lane drives on."""

    speed = 0.0
    impatient = False

    def _begin(self, now_s: float) -> bool:
        self.impatient = now_s > self.told["at_s"] + self.told["within_s"] / 2
        return any(self._runs(lane) for lane in self.told["lanes"])

    def _runs(self, lane: str) -> bool:
        """Return whether the first vehicle on a lane approaches a red signal; it then drives on."""
        length = libsumo.lane.getLength(lane)
        vehicles = [
            (length - libsumo.vehicle.getLanePosition(name), int(name), name)
            for name in self._free(lane)
        ]
        if not vehicles:
            return False
        to_line, _, name = min(vehicles)
        speed = libsumo.vehicle.getSpeed(name)
        signals = libsumo.vehicle.getNextTLS(name)
        if not signals or signals[0][3] not in "rR":
            return False
        # It could stop comfortably, and does not. If none approaches for long, the first waiting
        # vehicle starts.
        comes = speed >= _MIN_MOVING_MS and 0.5 * speed < to_line < max(2.5 * speed, 12.0)
        if not comes and not (self.impatient and to_line < 4.0):
            return False
        self.who = [name]
        self.note |= {"signal": signals[0][0], "link": int(signals[0][1]), "lane": lane}
        self.note["speed_before"] = round(speed, 3)
        self.speed = max(speed, 6.0)
        libsumo.vehicle.setSpeedMode(
            name, _IGNORES_SIGNALS if self.tries < 1 else _IGNORES_SIGNALS_AND_JUNCTION
        )
        libsumo.vehicle.setSpeed(name, self.speed)
        return True

    def _go_on(self, now_s: float, step_s: float) -> None:
        name = self.who[0]
        road = libsumo.vehicle.getRoadID(name)
        if road.startswith(":") and "crossed_s" not in self.note:
            state = libsumo.trafficlight.getRedYellowGreenState(self.note["signal"])
            self.note["crossed_s"] = now_s
            self.note["shown"] = state[self.note["link"]]
        if "crossed_s" in self.note and not road.startswith(":"):
            free(name)
            self._end(now_s)
        elif (
            "crossed_s" not in self.note
            and libsumo.vehicle.getSpeed(name) < 0.5
            and now_s > self.from_s + 3.0
        ):
            # Cross traffic went first: the next vehicle is selected.
            free(name)
            self.state, self.who, self.note = "waits", [], {}
            self.tries += 1


class Stalled(Staged):
    """A vehicle that can still stop at the place does so, and stays."""

    halted_s = -1.0

    def _begin(self, now_s: float) -> bool:
        for lane, ahead, name in self._coming():
            speed = libsumo.vehicle.getSpeed(name)
            if ahead < speed * speed / (2 * _COMFORTABLE_MS2) + 4.0:
                continue
            edge, number = lane.rsplit("_", 1)
            try:
                libsumo.vehicle.setStop(
                    name, edge, self.told["along_m"], int(number), self.told["lasts_s"]
                )
            except libsumo.TraCIException:
                continue
            self.who = [name]
            return True
        return False

    def _coming(self) -> list[tuple[str, float, str]]:
        """Return the vehicles that approach the place: lane, metres to it, name; the nearest first.

        If the lane is short, they are still on the road before it when they have to brake.
        """
        vehicles = []
        for name in filter(str.isdigit, libsumo.vehicle.getIDList()):
            if name in self.taken or libsumo.vehicle.getSpeed(name) <= _MIN_MOVING_MS:
                continue
            on = libsumo.vehicle.getLaneID(name)
            lanes = self.told["lanes"]
            lane = on if on in lanes else self._lane
            if libsumo.vehicle.getVehicleClass(name) in libsumo.lane.getDisallowed(lane):
                continue
            edge, number = lane.rsplit("_", 1)
            ahead = libsumo.vehicle.getDrivingDistance(
                name, edge, self.told["along_m"], int(number)
            )
            if 8.0 <= ahead <= _SELECTION_RANGE_M:
                vehicles.append((ahead, int(name), lane, name))
        return [(lane, ahead, name) for ahead, _, lane, name in sorted(vehicles)]

    def _go_on(self, now_s: float, step_s: float) -> None:
        name = self.who[0]
        if libsumo.vehicle.isStopped(name):
            if self.halted_s < 0:
                self.halted_s = now_s
                self.note["halted_s"] = now_s
                libsumo.vehicle.setLaneChangeMode(name, _NO_LANE_CHANGES)
        elif self.halted_s >= 0:
            libsumo.vehicle.setLaneChangeMode(name, _DEFAULT_LANE_CHANGES)
            self._end(now_s)


class Arrivals(Staged):
    """Vehicles that enter one behind the other: a convoy, or one with a blue light."""

    def __init__(self, told: dict[str, Any], taken: set[str]) -> None:
        super().__init__(told, taken)
        self.first_aside: dict[tuple[str, str], float] = {}
        self.made_way: set[str] = set()
        self.signal: tuple[str, str] | None = None

    def _begin(self, now_s: float) -> bool:
        kind, edges = self.told["kind"], self.told["edges"]
        if not self.note:
            route = f"route-{self.told['number']}"
            libsumo.route.add(route, edges)
            for name, values in self.told["types"].items():
                libsumo.vehicletype.copy("DEFAULT_VEHTYPE", name)
                libsumo.vehicletype.setVehicleClass(name, values["vclass"])
                for size in ("Length", "Width", "Height"):
                    set_size = getattr(libsumo.vehicletype, f"set{size}")
                    set_size(name, values[size.lower()])
                libsumo.vehicletype.setSpeedFactor(name, values["speed_factor"])
                libsumo.vehicletype.setLateralAlignment(name, "center")
                if kind == "emergency":
                    libsumo.vehicletype.setParameter(name, "has.bluelight.device", "true")
            self.note["route"] = len(edges)
            for name, kind_of in self.told["vehicles"]:
                libsumo.vehicle.add(
                    name, route, kind_of, depart="now", departLane="best", departPos="base",
                    departSpeed="max",
                )  # fmt: skip
        entered = [name for name, _ in self.told["vehicles"] if name in self._present()]
        self.who = entered
        return bool(entered)

    def act(self, now_s: float, step_s: float) -> None:
        """Update its vehicles every step, since they enter one after the other."""
        if self.state == "acts":
            present = self._present()
            entered = [name for name, _ in self.told["vehicles"] if name in present]
            self.note["came"] = max(self.note.get("came", 0), len(entered))
            if self.told["kind"] == "emergency":
                for name in entered:
                    self._look_ahead(name)
            for name in entered:
                if "passed_s" not in self.note and libsumo.vehicle.getLaneID(name) == self._lane:
                    self.note["passed_s"] = now_s
            self.who = sorted({*self.who, *entered}, key=int)
            if not entered:
                self._end(now_s)
        else:
            super().act(now_s, step_s)

    def _look_ahead(self, name: str) -> None:
        """Record vehicles that make way for a blue light, and signals passed at red."""
        road, position_m = libsumo.vehicle.getRoadID(name), libsumo.vehicle.getLanePosition(name)
        for other in libsumo.edge.getLastStepVehicleIDs(road):
            if (
                other == name
                or not 0 < libsumo.vehicle.getLanePosition(other) - position_m < _SIREN_RANGE_M
            ):
                continue
            lateral_m = libsumo.vehicle.getLateralLanePosition(other)
            lane = libsumo.vehicle.getLaneID(other)
            first = self.first_aside.setdefault((other, lane), lateral_m)
            if abs(lateral_m - first) >= _MIN_LATERAL_M:
                self.made_way.add(other)
        self.note["made_way"] = len(self.made_way)
        if road.startswith(":"):
            if self.signal is not None and self.signal[1] in "rR":
                self.note["reds_passed"] = self.note.get("reds_passed", 0) + 1
            self.signal = None
        else:
            ahead = libsumo.vehicle.getNextTLS(name)
            is_near = ahead and ahead[0][2] < 15.0
            self.signal = (ahead[0][0], ahead[0][3]) if is_near else None


class Obstacle(Staged):
    """An obstacle on a lane, which SUMO simulates as a standing vehicle."""

    def _begin(self, now_s: float) -> bool:
        edge, lane = libsumo.lane.getEdgeID(self._lane), self._lane.rsplit("_", 1)[1]
        name = f"{_OBSTACLE_PREFIX}{self.told['number']}"
        length = libsumo.lane.getLength(self._lane)
        end_m = min(self.told["along_m"] + self.told["length_m"], length - 1.0)
        if not self.note:
            libsumo.route.add(name, [edge])
            libsumo.vehicletype.copy("DEFAULT_VEHTYPE", name)
            libsumo.vehicletype.setLength(name, end_m - self.told["along_m"])
            libsumo.vehicletype.setWidth(name, self.told["width_m"])
            libsumo.vehicletype.setMinGap(name, 0.0)
            libsumo.vehicletype.setVehicleClass(name, self.told["vclass"])
            self.note["tried"] = True
            self.note |= {"lane": self._lane, "width_m": self.told["width_m"]}
            self.note["along_m"] = [self.told["along_m"], round(end_m, 3)]
        # The lane is free, and no vehicle is too close to stop.
        for other in libsumo.lane.getLastStepVehicleIDs(self._lane):
            position_m = libsumo.vehicle.getLanePosition(other)
            speed = libsumo.vehicle.getSpeed(other)
            free_m = self.told["along_m"] - position_m
            behind_m = position_m - libsumo.vehicle.getLength(other) - end_m
            if free_m < speed * speed / (2 * _COMFORTABLE_MS2) + 3.0 and behind_m < 1.0:
                return False
        if name not in self._present():
            libsumo.vehicle.add(
                name, name, name, depart="now", departLane=lane, departPos=f"{end_m:.2f}",
                departSpeed="0",
            )  # fmt: skip
            # With a stop it does not count as jammed.
            try:
                libsumo.vehicle.setStop(name, edge, end_m, int(lane), 1e6)
            except libsumo.TraCIException:
                libsumo.vehicle.setSpeedMode(name, _NO_CHECKS)
                libsumo.vehicle.setSpeed(name, 0.0)
            libsumo.vehicle.setLaneChangeMode(name, _NO_LANE_CHANGES)
        self.who = [name]
        return True

    def act(self, now_s: float, step_s: float) -> None:
        """Keep the obstacle until its time is over."""
        if self.state == "acts" and self.who[0] in self._present():
            self.note["stands"] = True
        if self.state != "acts":
            super().act(now_s, step_s)
        elif self.told["lasts_s"] is not None and now_s >= self.from_s + self.told["lasts_s"]:
            if self.who[0] in self._present():
                libsumo.vehicle.remove(self.who[0])
            self._end(now_s)


KINDS: dict[str, type[Staged]] = {
    "hard_brake": HardBrake,
    "collision": Collision,
    "red_light_running": RedLight,
    "stalled_vehicle": Stalled,
    "emergency_vehicle": Arrivals,
    "convoy": Arrivals,
    "work_zone": Obstacle,
    "debris": Obstacle,
}


def free(name: str) -> None:
    """Return the control of a vehicle to SUMO."""
    libsumo.vehicle.setSpeed(name, -1)
    libsumo.vehicle.setSpeedMode(name, _ALL_CHECKS)
    libsumo.vehicle.setLaneChangeMode(name, _DEFAULT_LANE_CHANGES)


def is_actor(name: str) -> bool:
    """Return whether a vehicle is an actor, not a staged obstacle."""
    return not name.startswith(_OBSTACLE_PREFIX)


class Staging:
    """All events of a job.

    Args:
        rows: the job's ``staged``; times are from SUMO's start.
    """

    def __init__(self, rows: list[dict[str, Any]]) -> None:
        coming = {name for row in rows for name, _ in row.get("vehicles", ())}
        self.events = [KINDS[row["event"]](row, coming) for row in rows]

    def act(self) -> None:
        """Let all events act before the next step."""
        now_s, step_s = libsumo.simulation.getTime(), libsumo.simulation.getDeltaT()
        for event in self.events:
            event.act(now_s, step_s)

    def told(self) -> list[dict[str, Any]]:
        """Return the outcome of each event; times from SUMO's start."""
        return [
            {
                "number": event.told["number"],
                "state": event.state,
                "trips": [int(name) for name in event.who if is_actor(name)],
                "from_s": event.from_s,
                "until_s": event.until_s,
                "note": event.note,
            }
            for event in self.events
        ]
