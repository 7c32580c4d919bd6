"""An hour of a place's traffic, as SUMO itself counts it."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from urbantwin.traffic.demand.site_demand import demand_of
from urbantwin.traffic.fleet_of_twin import own_bodies
from urbantwin.traffic.flow.circulation_report import circulation_report
from urbantwin.traffic.sumo.simulation import observe
from urbantwin.traffic.sumo.tram_conflicts import tram_conflicts
from urbantwin.twin import Twin

__all__ = ["an_hour"]

#: SUMO's step, milliseconds, and the seconds whose means are compared.
STEP_MS, SLICE_S = 500, 900


def an_hour(twin: Twin, seconds: int = 3600, seed: int = 1) -> dict[str, Any]:
    """Drive a closed loop for an hour after its warm-up; paths are not worked out.

    Returns:
        ``driven``: share of what was requested, by the distance travelled in this hour, and
        ``held_up``: where the longest queue begins if that is less than nearly all. ``speeds``:
        mean speeds of vehicles in SUMO's own summary, m/s, by quarters of an hour.
        ``teleports``, and ``vehicles``: the fewest and most on the road, of the same.
        ``people``: the fewest and most, and ``planned`` of both. ``longest_halt_s``,
        ``stood``: how many stood for longer than 300 s, and ``where``.
    """
    asked = twin.site["traffic"]
    warmup_s = round(float(asked["warmup_s"]))
    demand = demand_of(twin, duration_s=seconds, seed=seed)
    with tempfile.TemporaryDirectory() as scratch:
        summary = Path(scratch) / "summary.xml"
        seen = observe(
            twin.net_path,
            demand,
            own_bodies(twin).asset,
            seconds=warmup_s + seconds,
            step_ms=STEP_MS,
            seed=seed,
            warmup_s=warmup_s,
            trams=tram_conflicts(twin.net_path, twin.roads),
            outputs={"summary-output": summary, "summary-output.period": 1},
        )
        rows = [
            {key: float(row.get(key, 0)) for key in ("time", "running", "meanSpeed", "teleports")}
            for row in ElementTree.parse(summary).iter("step")
        ]
    told = circulation_report(demand, seen, warmup_s, twin.roads)
    settled = [row for row in rows if row["time"] >= warmup_s]
    speeds = []
    for first in range(warmup_s, warmup_s + seconds, SLICE_S):
        part = [row["meanSpeed"] for row in settled if first <= row["time"] < first + SLICE_S]
        speeds.append(round(sum(part) / max(len(part), 1), 2))
    population = told["population"]
    people = population.get("pedestrian", {"planned": 0, "least": 0, "most": 0})
    return {
        "driven": told["carried_share_of_motor_traffic"],
        "share_of_guess": told["share_of_guess"],
        "held_up": told["held_up"],
        "speeds": speeds,
        "teleports": seen.teleports + int(max(row["teleports"] for row in rows)),
        "vehicles": [int(f(row["running"] for row in settled)) for f in (min, max)],
        "people": [people["least"], people["most"]],
        "planned": [
            sum(row["planned"] for name, row in population.items() if name != "pedestrian"),
            people["planned"],
        ],
        "longest_halt_s": told["longest_halt_s"],
        "stood": len(told["halted"]),
        "where": sorted({(row["class"], row["lane"]) for row in told["halted"]}),
    }
