"""A SUMO simulation in its own process: run as a script, never imported.

``libsumo`` is global state, prints freely, may crash its process, and brings an Arrow library that
conflicts with pyarrow's. So this file imports nothing of UrbanTwin: it reads a job (JSON), runs
SUMO and writes the output (NPY, JSON). Progress goes to standard output as lines ``progress
FRACTION``; SUMO's messages go to standard error.

The job's fields are those that ``simulation`` writes.
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
import threading
import time
from collections.abc import Container
from pathlib import Path
from types import ModuleType
from typing import Any

import libsumo
import numpy as np


# Loaded by path, since modules of this folder are not importable by name (see `simulation`).
def _beside(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


curving, railways, events = _beside("curves"), _beside("trams"), _beside("staging")
wrong_lanes, boarding = _beside("wrong_lanes"), _beside("boarding")
metering, narrow = _beside("gates"), _beside("one_lane")
lane_use, queues = _beside("lane_use"), _beside("queue_headway")

#: Step, trip, x, y, angle, speed, lane. A trip's number is its name in SUMO.
Row = tuple[int, int, float, float, float, float, int]
TYPES = [("step", "i4"), ("trip", "i4"), ("x", "f8"), ("y", "f8")]
TYPES += [("angle_deg", "f8"), ("speed", "f8"), ("lane", "i4")]
MANY_ROWS = 50_000
#: Interval of progress reports, seconds.
REPORT_S = 0.5
#: A vehicle that halts longer than this, seconds, and this far from the middle of its lane, metres,
#: may slide sideways at this speed, m/s.
WEDGED_S, ASIDE_M, SLIDES_MS = 40.0, 0.3, "0.3"
#: The first of a queue that halts within a junction for longer, s, drives out at this speed, m/s,
#: without SUMO's checks (https://sumo.dlr.de/docs/TraCI/Change_Vehicle_State.html).
LOCKED_S, LOCKED_MS, NO_CHECKS, USUAL_CHECKS = 60.0, 2.0, 0, 31
SIDEWAYS = "laneChangeModel.lcMaxSpeedLatStanding"


class Watch:
    """Statistics by second: numbers of actors, speeds, entries and halts.

    Args:
        classes: number of the class of each trip.
        kinds: number of classes.
        outer: edges of outer roads; an actor that leaves them enters the region.
        stuck_s: longer halts are recorded.
        parties: number of further members of each leader's group.
        passengers: passengers of buses and trams, who are not counted here.
    """

    def __init__(
        self,
        classes: list[int],
        kinds: int,
        outer: list[str],
        stuck_s: float,
        parties: dict[str, int],
        passengers: Container[str],
    ) -> None:
        self.parties, self.passengers = parties, passengers
        self.classes, self.outer, self.stuck_s = classes, frozenset(outer), stuck_s
        self.kinds = kinds
        self.minutes: list[dict[str, list[float]]] = []
        self.outside: set[str] = set()
        self.stuck: dict[str, tuple[float, str]] = {}
        self.longest_halt_s = 0.0
        self.vehicle_halt_s = 0.0
        self.queued: dict[str, float] = {}
        self.freed: set[str] = set()
        self.unlocked: set[str] = set()

    def look(self, time_s: float) -> None:
        """Sample the state, once a second."""
        minute = int(time_s // 60)
        while len(self.minutes) <= minute:
            zeros = [0.0] * self.kinds
            names = ("samples", "metres", "entries")
            fresh = {name: list(zeros) for name in names}
            most = {"least": [1e9] * self.kinds, "most": list(zeros), "seconds": [0.0]}
            self.minutes.append({**fresh, **most})
        row = self.minutes[minute]
        row["seconds"][0] += 1.0
        present = [0] * self.kinds
        for domain in (libsumo.vehicle, libsumo.person):
            for name in filter(events.is_actor, domain.getIDList()):
                if name in self.passengers:
                    continue
                kind, count = self.classes[int(name)], 1 + self.parties.get(name, 0)
                present[kind] += count
                row["samples"][kind] += count
                row["metres"][kind] += count * max(domain.getSpeed(name), 0.0)
                road = domain.getRoadID(name)
                if road in self.outer:
                    self.outside.add(name)
                elif name in self.outside and not road.startswith(":"):
                    self.outside.discard(name)
                    row["entries"][kind] += count
                halt_s = domain.getWaitingTime(name)
                self.longest_halt_s = max(self.longest_halt_s, halt_s)
                if halt_s > self.stuck_s:
                    self.stuck[name] = (time_s, domain.getLaneID(name))
                if halt_s > 0 and domain is libsumo.vehicle:
                    self.vehicle_halt_s = max(self.vehicle_halt_s, halt_s)
                    self._free(name, halt_s)
                    wrong_lanes.go_on(name, halt_s)
                    self._unlock(name, halt_s)
                    lane = domain.getLaneID(name)
                    self.queued[lane] = self.queued.get(lane, 0.0) + 1.0
        self._back_to_usual()
        for kind, number in enumerate(present):
            row["least"][kind] = min(row["least"][kind], number)
            row["most"][kind] = max(row["most"][kind], number)

    def _free(self, name: str, halt_s: float) -> None:
        """Let a vehicle that halts for long beside the middle of a lane slide sideways.

        Two-wheelers that overtake halfway on another lane would otherwise stand for ever.
        """
        is_beside = abs(libsumo.vehicle.getLateralLanePosition(name)) > ASIDE_M
        if halt_s > WEDGED_S and is_beside and name not in self.freed:
            libsumo.vehicle.setParameter(name, SIDEWAYS, SLIDES_MS)
            self.freed.add(name)

    def _unlock(self, name: str, halt_s: float) -> None:
        """Let the first of a queue that stands within a junction for long drive out of it.

        Two vehicles that SUMO let into one place would otherwise wait for each other for ever.
        """
        if halt_s < LOCKED_S or not libsumo.vehicle.getRoadID(name).startswith(":"):
            return
        leader = libsumo.vehicle.getLeader(name, 5.0)
        if not leader or leader[1] < -3.0:
            self.unlocked.add(name)
            libsumo.vehicle.setSpeedMode(name, NO_CHECKS)
            libsumo.vehicle.setSpeed(name, LOCKED_MS)

    def _back_to_usual(self) -> None:
        """Restore SUMO's control of freed and unlocked vehicles once they move on."""
        present = set(libsumo.vehicle.getIDList())
        for name in self.freed & present:
            if libsumo.vehicle.getSpeed(name) > 1.0:
                libsumo.vehicle.setParameter(name, SIDEWAYS, "0")
                self.freed.discard(name)
        for name in self.unlocked & present:
            if not libsumo.vehicle.getRoadID(name).startswith(":"):
                libsumo.vehicle.setSpeedMode(name, USUAL_CHECKS)
                libsumo.vehicle.setSpeed(name, -1)
                self.unlocked.discard(name)


class Recorder:
    """Records positions and signal states, step by step.

    Args:
        arrays: the file (NPY) to which positions are written continuously; for an hour they take
            hundreds of megabytes.
    """

    def __init__(self, arrays: Path) -> None:
        self.rows: list[Row] = []
        self.count = 0
        self.file = arrays.open("wb")
        self._write_header()
        self.lanes: dict[str, int] = {}
        self.signals: list[tuple[int, str, str]] = []
        self.shown: dict[str, str] = {}
        self.teleports = 0
        self.collisions: dict[tuple[str, str], tuple[float, float, float, str]] = {}
        self.departed: set[int] = set()

    def count_incidents(self) -> None:
        """Count teleports, collisions and departures of the last step; remove stuck vehicles."""
        for name in libsumo.simulation.getStartingTeleportIDList():
            # SUMO would insert it elsewhere; here it is removed.
            libsumo.vehicle.remove(name)
            self.teleports += 1
        for collision in libsumo.simulation.getCollisions():
            pair = collision.collider, collision.victim
            if pair not in self.collisions:
                walks = pair[0] in libsumo.person.getIDList()
                x, y = (libsumo.person if walks else libsumo.vehicle).getPosition(pair[0])
                self.collisions[pair] = libsumo.simulation.getTime(), x, y, collision.lane
        departed = filter(events.is_actor, libsumo.simulation.getDepartedIDList())
        self.departed |= {int(name) for name in departed}
        self.departed |= {int(name) for name in libsumo.simulation.getDepartedPersonIDList()}

    def record(self, step: int) -> None:
        """Record positions and changes of signals as step ``step`` of the motion."""
        for domain in (libsumo.vehicle, libsumo.person):
            for name in sorted(filter(events.is_actor, domain.getIDList()), key=int):
                x, y = domain.getPosition(name)
                lane = domain.getLaneID(name)
                if not lane:  # being teleported, or between two stages
                    continue
                number = self.lanes.setdefault(lane, len(self.lanes))
                self.rows.append(
                    (step, int(name), x, y, domain.getAngle(name), domain.getSpeed(name), number)
                )
        if len(self.rows) > MANY_ROWS:
            self.pack()
        for program in sorted(libsumo.trafficlight.getIDList()):
            state = libsumo.trafficlight.getRedYellowGreenState(program)
            if self.shown.get(program) != state:
                self.shown[program] = state
                self.signals.append((step, program, state))

    def pack(self) -> None:
        """Write the buffered rows."""
        self.file.write(np.array(self.rows, TYPES).tobytes())
        self.count += len(self.rows)
        self.rows = []

    def _write_header(self) -> None:
        """Write the header with the number of rows; NumPy reserves space for its growth."""
        header = {
            "descr": np.lib.format.dtype_to_descr(np.dtype(TYPES)),
            "fortran_order": False,
            "shape": (self.count,),
        }
        np.lib.format.write_array_header_1_0(self.file, header)

    def write(
        self,
        texts: Path,
        watch: Watch,
        staged: list[dict[str, Any]],
        boarded: list[Any],
    ) -> None:
        """Write the remaining positions, and everything else (JSON)."""
        self.pack()
        self.file.seek(0)
        self._write_header()
        self.file.close()
        outcome = {
            "minutes": watch.minutes,
            "longest_halt_s": watch.longest_halt_s,
            "vehicle_halt_s": watch.vehicle_halt_s,
            "queued": dict(sorted(watch.queued.items())),
            "stuck": sorted((int(name), *where) for name, where in watch.stuck.items()),
            "sumo": libsumo.getVersion()[1],
            "lanes": list(self.lanes),
            "signals": self.signals,
            "teleports": self.teleports,
            "collisions": sorted((*first, *pair) for pair, first in self.collisions.items()),
            "departed": sorted(self.departed),
            "staged": staged,
            "boarded": boarded,
        }
        texts.write_text(json.dumps(outcome), encoding="utf-8")


def simulate(job: dict[str, Any]) -> None:
    """Run one job."""
    libsumo.start(["sumo", *job["options"]])
    recorder = Recorder(Path(job["arrays"]))
    lanes = lane_use.LaneUse(job["approaches"])
    headways = queues.QueueHeadways(job["approaches"], job["queue_headways"])
    stops = boarding.Boarding(job["boarding"])
    gates = metering.Gates(job["gates"], job["outer"])
    watch = Watch(
        job["classes"], job["kinds"], job["outer"], job["stuck_s"], job["parties"], stops.state
    )
    per_second = max(1, round(1 / libsumo.simulation.getDeltaT()))
    first, last, substeps = job["first_step"], job["last_step"], job["substeps"]
    total = job["warmup_substeps"] + last * substeps + 1
    curves = curving.Curves(job["curves"])
    staging = events.Staging(job["staged"])
    trams = railways.Trams(job["trams"])
    one_lane = narrow.OneLaneStreets(job["one_lane"])
    step_s = libsumo.simulation.getDeltaT()
    reported = 0.0
    for made in range(total):
        curves.slow_down()
        trams.heed(step_s)
        one_lane.heed(step_s)
        staging.act()
        libsumo.simulationStep()
        recorder.count_incidents()
        if made % per_second == 0:
            lanes.look()
            headways.look()
            gates.act(libsumo.simulation.getTime())
            watch.look(libsumo.simulation.getTime())
            stops.look(libsumo.simulation.getTime())
        step, rest = divmod(made - job["warmup_substeps"], substeps)
        if step >= first and rest == 0:
            recorder.record(step)
        if made % max(total // 100, 1) == 0 or time.monotonic() > reported + REPORT_S:
            reported = time.monotonic()
            sys.stdout.write(f"progress {made / total:.3f}\n")
            sys.stdout.flush()
    recorder.write(Path(job["texts"]), watch, staging.told(), stops.events)
    libsumo.close()


def end_with_the_run() -> None:
    """Exit when the parent process dies, which closes stdin."""
    while os.read(sys.stdin.fileno(), 1):
        pass
    os._exit(1)


if __name__ == "__main__":
    threading.Thread(target=end_with_the_run, daemon=True).start()
    simulate(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
