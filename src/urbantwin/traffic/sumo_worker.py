"""One SUMO simulation, in a process of its own: run as a script, never imported.

``libsumo`` is global state, prints what it likes and can take its process down, and it brings an
Arrow library that must not meet pyarrow's. So this file imports nothing of UrbanTwin: it reads a
job (JSON), drives SUMO and writes what it saw (NPY, JSON). Progress goes to standard output, lines
``progress FRACTION``; SUMO's messages go to standard error.

The job's fields are those of ``simulation.Job``.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import libsumo
import numpy as np

#: Step, trip, x, y, angle, speed, lane. A trip's number is its name in SUMO.
Row = tuple[int, int, float, float, float, float, int]


class Recorder:
    """Collects, step by step, where everybody is and what the signals show."""

    def __init__(self) -> None:
        self.rows: list[Row] = []
        self.lanes: dict[str, int] = {}
        self.signals: list[tuple[int, str, str]] = []
        self.shown: dict[str, str] = {}
        self.teleports = 0
        self.collisions: set[tuple[str, str]] = set()
        self.departed: set[int] = set()

    def count_incidents(self) -> None:
        """Count what went wrong in the step just made, and take out who was stuck."""
        for name in libsumo.simulation.getStartingTeleportIDList():
            # SUMO would set it down elsewhere; for the onlooker it is gone.
            libsumo.vehicle.remove(name)
            self.teleports += 1
        for collision in libsumo.simulation.getCollisions():
            self.collisions.add((collision.collider, collision.victim))
        self.departed |= {int(name) for name in libsumo.simulation.getDepartedIDList()}
        self.departed |= {int(name) for name in libsumo.simulation.getDepartedPersonIDList()}

    def record(self, step: int) -> None:
        """Note positions and changes of signals as step ``step`` of the motion."""
        for domain in (libsumo.vehicle, libsumo.person):
            for name in sorted(domain.getIDList(), key=int):
                x, y = domain.getPosition(name)
                lane = domain.getLaneID(name)
                if not lane:  # being teleported, or between two stages
                    continue
                number = self.lanes.setdefault(lane, len(self.lanes))
                self.rows.append(
                    (step, int(name), x, y, domain.getAngle(name), domain.getSpeed(name), number)
                )
        for program in sorted(libsumo.trafficlight.getIDList()):
            state = libsumo.trafficlight.getRedYellowGreenState(program)
            if self.shown.get(program) != state:
                self.shown[program] = state
                self.signals.append((step, program, state))

    def write(self, arrays: Path, texts: Path) -> None:
        """Write the positions (NPY) and everything else (JSON)."""
        types = [("step", "i4"), ("trip", "i4"), ("x", "f8"), ("y", "f8")]
        types += [("angle_deg", "f8"), ("speed", "f8"), ("lane", "i4")]
        np.save(arrays, np.array(self.rows, types))
        outcome = {
            "sumo": libsumo.getVersion()[1],
            "lanes": list(self.lanes),
            "signals": self.signals,
            "teleports": self.teleports,
            "collisions": sorted(self.collisions),
            "departed": sorted(self.departed),
        }
        texts.write_text(json.dumps(outcome))


def simulate(job: dict[str, Any]) -> None:
    """Run one job."""
    libsumo.start(["sumo", *job["options"]])
    recorder = Recorder()
    first, last, substeps = job["first_step"], job["last_step"], job["substeps"]
    total = job["warmup_substeps"] + last * substeps + 1
    for made in range(total):
        libsumo.simulationStep()
        recorder.count_incidents()
        step, rest = divmod(made - job["warmup_substeps"], substeps)
        if step >= first and rest == 0:
            recorder.record(step)
        if made % max(total // 100, 1) == 0:
            sys.stdout.write(f"progress {made / total:.3f}\n")
            sys.stdout.flush()
    recorder.write(Path(job["arrays"]), Path(job["texts"]))
    libsumo.close()


if __name__ == "__main__":
    simulate(json.loads(Path(sys.argv[1]).read_text()))
