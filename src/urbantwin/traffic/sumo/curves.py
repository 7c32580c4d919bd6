"""Lower speeds of vehicles in curves: a script (``python drive.py``), or part of a simulation.

Gates meter the inflow if ``gates.json`` is beside it (``gates.py``). Vehicles wait for oncoming
ones on streets of one lane if ``one_lane.json`` is (``one_lane.py``).

In SUMO a lane has one speed, so a street with a curve has the speed of its straight part. This sets
each vehicle's maximum speed, step by step, to the speed at its position on the lane.

The file is self-contained and stands beside ``curves.json`` in an exported SUMO folder.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from runpy import run_path
from typing import Any

import libsumo

#: Parameter of a vehicle type: factor on the speeds of ``curves.json``.
IN_BENDS = "urbantwin.in_bends"


class Curves:
    """Lowers speeds on and before the curves of lanes.

    Args:
        curves: ``speeds``: by lane, the speed every ``spacing_m`` metres from its start, m/s;
            ``rear_m``: assumed distance from the front of a vehicle to its rear, metres.
    """

    def __init__(self, curves: dict[str, Any]) -> None:
        self.speeds: dict[str, list[float]] = curves["speeds"]
        self.spacing_m, self.rear_m = float(curves["spacing_m"]), float(curves["rear_m"])
        self.usual: dict[str, float] = {}
        self.last: dict[str, float] = {}
        self.share: dict[str, float] = {}

    def slow_down(self) -> None:
        """Set the maximum speed of each vehicle for the next step."""
        for name in libsumo.vehicle.getIDList():
            along = self.speeds.get(libsumo.vehicle.getLaneID(name))
            if along is None and name not in self.usual:
                continue
            usual = self.usual.setdefault(name, libsumo.vehicle.getMaxSpeed(name))
            at_m = max(libsumo.vehicle.getLanePosition(name), 0.0)
            allowed = usual
            if along is not None:
                allowed = along[min(int(at_m / self.spacing_m), len(along) - 1)]
                allowed = min(usual, allowed * self._share(name))
            if at_m < self.rear_m:  # the rear is on the previous lane
                allowed = min(allowed, self.last.get(name, usual))
            self.last[name] = allowed
            libsumo.vehicle.setMaxSpeed(name, allowed)
            if along is None and at_m >= self.rear_m:
                del self.usual[name], self.last[name]

    def _share(self, vehicle: str) -> float:
        """Return the speed factor in curves of a vehicle's type."""
        kind = libsumo.vehicle.getTypeID(vehicle)
        if kind not in self.share:
            self.share[kind] = float(libsumo.vehicletype.getParameter(kind, IN_BENDS) or 1.0)
        return self.share[kind]


def drive(folder: Path, options: list[str]) -> None:
    """Run an exported folder to its end, with further options of SUMO."""
    libsumo.start(["sumo", "-c", str(folder / "twin.sumocfg"), *options])
    curves = Curves(json.loads((folder / "curves.json").read_text(encoding="utf-8")))
    gates = one_lane = None
    if (folder / "one_lane.json").is_file():
        streets = json.loads((folder / "one_lane.json").read_text(encoding="utf-8"))
        one_lane = run_path(str(folder / "one_lane.py"))["OneLaneStreets"](streets)
    if (folder / "gates.json").is_file():
        job = json.loads((folder / "gates.json").read_text(encoding="utf-8"))
        gates = run_path(str(folder / "gates.py"))["Gates"](job, job["outer"])
    end_s = float(libsumo.simulation.getOption("end"))
    per_second = max(1, round(1 / libsumo.simulation.getDeltaT()))
    made = 0
    while libsumo.simulation.getTime() < end_s:
        curves.slow_down()
        if one_lane is not None:
            one_lane.heed(libsumo.simulation.getDeltaT())
        libsumo.simulationStep()
        if gates is not None and made % per_second == 0:
            gates.act(libsumo.simulation.getTime())
        made += 1
    libsumo.close()


if __name__ == "__main__":
    drive(Path(__file__).resolve().parent, sys.argv[1:])
