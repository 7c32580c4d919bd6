"""All events on twins, one at a time, at a place that the traffic chooses: which can be staged.

The place is on the approach of a signal that most cars drive over, 25 m before its end; for people
it is the crossing nearest to the anchor, or the sidewalk nearest to that place. notebook/events.md
has the table.

    python benchmarks/events.py munich/twin chennai/twin --seconds 60 --at 15 --csv events.csv
"""

from __future__ import annotations

import argparse
import csv
import functools
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from urbantwin.errors import UrbanTwinError
from urbantwin.traffic import Motion, run
from urbantwin.traffic.events import EVENTS, PUT_IN
from urbantwin.twin import Twin, load_twin

BEFORE_END_M = 25.0
ASKED: dict[str, dict[str, Any]] = {
    "near_miss": {"pet_s": 1.0},
    "collision": {"within_s": 45.0},
    "red_light_running": {"within_s": 45.0},
    "work_zone": {"length_m": 10.0},
}


def once(function: Callable[..., Any], same: Callable[..., Any]) -> Callable[..., Any]:
    """Keep what a function returned: what is simulated without events is the same every time."""
    kept: dict[Any, Any] = {}

    @functools.wraps(function)
    def known(*given: Any, **named: Any) -> Any:
        key = same(*given, **named)
        if key is None:
            return function(*given, **named)
        if key not in kept:
            kept[key] = function(*given, **named)
        return kept[key]

    return known


def busiest(twin: Twin, motion: Motion) -> dict[str, float]:
    """Return the place on the signalised approach that most cars drive over, metres."""
    table = motion.actors
    kinds, lanes = table["class"].to_pylist(), table["lane"].to_pylist()
    signalled = {one.lane for one in twin.roads.signals}
    tracks = {
        (lane, track)
        for kind, lane, track, speed in zip(
            kinds, lanes, table["track"].to_pylist(), table["speed"].to_pylist(), strict=True
        )
        if kind in ("car", "van") and speed > 1.0
    }
    counts = Counter(lane for lane, _ in tracks)
    found = []
    for lane in twin.roads.lanes:
        near = float(np.linalg.norm(lane.centre[-1, :2]))
        if lane.kind != "driving" or not lane.road or lane.length < BEFORE_END_M + 10.0:
            continue
        if "car" in lane.allowed and near < 60.0:
            rank = lane.id in signalled if signalled else True
            found.append((not rank, -counts[lane.id], near, lane.id))
    lane = twin.roads.lane_by_id[min(found)[3]]
    line = shapely.LineString(lane.centre[:, :2])
    at = line.interpolate(line.length - BEFORE_END_M)
    return {"x": round(at.x, 2), "y": round(at.y, 2)}


def for_people(twin: Twin, place: dict[str, float]) -> dict[str, Any]:
    """Return the crossing nearest to the anchor, or a place for people near another."""
    crossings = [
        (float(np.linalg.norm(one.centre[:, :2].mean(axis=0))), one.id)
        for one in twin.roads.lanes
        if one.kind == "crossing"
    ]
    return {"crossing": min(crossings)[1]} if crossings else place


def staged(folder: Path, seconds: float, at_s: float, only: list[str]) -> list[dict[str, Any]]:
    """Stage every event on a twin; return a row for each."""
    twin = load_twin(folder)
    usual = run.demand_of, run.simulate, run.actor_table
    demand = once(run.demand_of, lambda *_, **__: "the same")
    run.demand_of = demand
    run.simulate = once(run.simulate, lambda *_, **named: None if named.get("staged") else "same")
    run.actor_table = once(
        run.actor_table,
        lambda _, whose, *__, **named: named["by_trip"] if whose is demand() else None,
    )
    rows = []
    try:
        with tempfile.TemporaryDirectory() as scratch:
            motion = run.run_traffic(twin, Path(scratch) / "usual", seconds=seconds)
            place = busiest(twin, motion)
            for name in only or [n for n in EVENTS if n != "trajectory"]:
                event = {"event": name, "at_s": at_s, "place": place, **ASKED.get(name, {})}
                if name == "crowd":
                    event["place"] = for_people(twin, place)
                if name == "blocked_sensor":
                    del event["place"]
                began = time.monotonic()
                row = {"twin": folder.parent.name, "event": name}
                try:
                    if name in PUT_IN:
                        made = run.with_more(twin, motion, [event])
                    else:
                        made = run.run_traffic(
                            twin,
                            Path(scratch) / "with",
                            seconds=seconds,
                            changes={"scenario": [event]},
                        )
                    (told,) = made.manifest["events"]
                    nearest = told.get("nearest", {})
                    row |= {"staged": "yes", "from_s": told["from_s"]}
                    row |= {key: nearest.get(key) for key in ("pet_s", "ttc_s", "gap_m")}
                    row |= {"tracks": len(told["tracks"]), "moved_m": told.get("moved_m", 0.0)}
                except UrbanTwinError as error:
                    row |= {
                        "staged": "no",
                        "why": str(error).partition("staged: ")[2] or str(error),
                    }
                row["took_s"] = round(time.monotonic() - began, 1)
                print("  ".join(f"{key} {value}" for key, value in row.items()), flush=True)
                rows.append(row)
    finally:
        run.demand_of, run.simulate, run.actor_table = usual
    return rows


def main() -> None:
    """Stage them, and write a table."""
    given = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    given.add_argument("twins", nargs="+", type=Path)
    given.add_argument("--seconds", type=float, default=60.0)
    given.add_argument("--at", type=float, default=15.0)
    given.add_argument("--only", action="append", default=[], choices=EVENTS)
    given.add_argument("--csv", type=Path)
    asked = given.parse_args()
    rows = [
        row for twin in asked.twins for row in staged(twin, asked.seconds, asked.at, asked.only)
    ]
    if asked.csv is not None:
        names = ["twin", "event", "staged", "from_s", "pet_s", "ttc_s", "gap_m", "tracks"]
        names += ["moved_m", "why"]
        with asked.csv.open("w", newline="") as file:
            table = csv.DictWriter(file, [*names, "took_s"])
            table.writeheader()
            table.writerows(rows)


if __name__ == "__main__":
    main()
