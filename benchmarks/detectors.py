"""Saturation flow and red lights at a place, as SUMO's own detectors and signals tell them.

More come by every way over the main junction than it can carry. Induction loops at the stop lines
see fronts pass, and SUMO writes what its signals show: nothing of ours is between. HCM 2016, 19: a
lane with a queue discharges 1,700 to 2,000 cars an hour of green from its fifth vehicle on.

    python benchmarks/detectors.py twin/ [twin/ ...]
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from collections import defaultdict
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from urbantwin.roads.netconvert import sumo_binary, sumo_environment
from urbantwin.traffic.assets import asset
from urbantwin.traffic.calibration.passages import JunctionLinks
from urbantwin.traffic.demand.site_demand import demand_of
from urbantwin.traffic.sumo.driven_net import driven_net
from urbantwin.traffic.sumo.simulation import sumo_options, write_routes
from urbantwin.twin import Twin, load_twin

SECONDS, STEP_MS = 1800, 100
#: Who follows in a queue that discharges comes no later than this, seconds; the fifth is the first.
QUEUE_S, FIRST, FEWEST = 4.0, 4, 8


def watched(twin: Twin, per_lane: float, scratch: Path) -> dict[str, Any]:
    """Drive too many cars over a twin's main junction and return what SUMO's detectors saw."""
    links = JunctionLinks.of(twin.net_path, twin.roads)
    roads = {lane: road.id for road in twin.roads.roads for lane in road.lanes}
    turns = sorted({(roads[lane], leaving) for lane, leaving in links.ways.values()})
    lanes = {lane for lane, _ in links.links if "car" in twin.roads.lane_by_id[lane].allowed}
    of_road = {road: sum(1 for a, _ in turns if a == road) for road, _ in turns}
    wide = {road: max(1, sum(roads[lane] == road for lane in lanes)) for road, _ in turns}
    counts = [
        {
            "approach": a,
            "turn": b,
            "actor_class": "car",
            "per_hour": per_lane * wide[a] / of_road[a],
        }
        for a, b in turns
    ]
    asked = {**twin.site["traffic"], "per_hour": {}, "counts": counts, "warmup_s": 0.0}
    demand = demand_of(twin, asked=asked, duration_s=SECONDS, seed=1)
    net = driven_net(twin, asked, demand, SECONDS, scratch)
    write_routes(scratch / "r.rou.xml", demand, asset)
    root = ElementTree.parse(net).getroot()
    wired = [one for one in root.iter("connection") if one.get("tl") and one.get("via")]
    link: dict[str, tuple[str, str, int, str]] = {}
    told = ElementTree.Element("additional")
    for one in wired:
        lane, via = f"{one.get('from')}_{one.get('fromLane')}", one.get("via", "")
        if lane not in lanes:
            continue
        link[via] = lane, one.get("tl", ""), int(one.get("linkIndex", 0)), one.get("dir", "")
        # Behind the stop line: who stops at it may stand on a loop before it.
        where = {"lane": via, "pos": "0.1", "file": "e1.xml"}
        ElementTree.SubElement(told, "instantInductionLoop", id=via, **where)
    for light in sorted({light for _, light, _, _ in link.values()}):
        where = {"type": "SaveTLSStates", "source": light, "dest": "states.xml"}
        ElementTree.SubElement(told, "timedEvent", **where)
    ElementTree.ElementTree(told).write(scratch / "d.add.xml")
    how = [x for key, value in sumo_options(STEP_MS, 1).items() for x in (f"--{key}", str(value))]
    subprocess.run(
        [sumo_binary("sumo"), "-n", net, "-r", scratch / "r.rou.xml", "-a", scratch / "d.add.xml",
         *how, "--end", str(SECONDS), "--no-step-log", "true", "--xml-validation", "never"],
        check=True, capture_output=True, env=sumo_environment(),
    )  # fmt: skip
    return judged(scratch, link)


def judged(folder: Path, link: dict[str, tuple[str, str, int, str]]) -> dict[str, Any]:
    """Return saturation flows of lanes that lead straight on, and of others, and who ran red."""
    shown: dict[str, list[tuple[float, str]]] = defaultdict(list)
    for row in ElementTree.parse(folder / "states.xml").iter("tlsState"):
        shown[row.get("id", "")].append((float(row.get("time", 0)), row.get("state", "")))
    passed: dict[str, list[float]] = defaultdict(list)
    ran_red = 0
    for row in ElementTree.parse(folder / "e1.xml").iter("instantOut"):
        if row.get("state") != "enter":
            continue
        lane, light, index, _ = link[row.get("id", "")]
        at, time = [x for x, _ in shown[light]], float(row.get("time", 0))
        passed[lane].append(time)
        # Who was over the line when red came has its front behind it a step later.
        around = np.searchsorted(at, [time - 0.3, time + 0.1]).clip(0, len(at) - 1)
        letters = {state[index] for _, state in shown[light][around[0] : around[1] + 1]}
        ran_red += letters <= {"r", "u"}
    rates: dict[str, list[float]] = {"straight on": [], "turning": []}
    for lane, found in passed.items():
        mine = [one for one in link.values() if one[0] == lane]
        (light,) = {one[1] for one in mine}
        at = np.array([x for x, _ in shown[light]])
        green = np.array([any(s[one[2]] == "G" for one in mine) for _, s in shown[light]])
        starts = at[np.flatnonzero(green[1:] & ~green[:-1]) + 1]
        ends = at[np.flatnonzero(~green[1:] & green[:-1]) + 1]
        kind = "straight on" if {one[3] for one in mine} == {"s"} else "turning"
        times = np.sort(found)
        for start in starts:
            end = min([x for x in ends if x > start], default=np.inf)
            queue = times[(times >= start) & (times < end)]
            late = np.flatnonzero(np.diff(queue) > QUEUE_S)
            queue = queue[: late[0] + 1] if len(late) else queue
            if len(queue) >= FEWEST:
                rates[kind].append(3600 * (len(queue) - FIRST) / (queue[-1] - queue[FIRST - 1]))
    return {
        "passed": sum(map(len, passed.values())),
        "ran_red": ran_red,
        "saturation": {
            kind: {"greens": len(all_), "mean": round(float(np.mean(all_)))} if all_ else None
            for kind, all_ in rates.items()
        },
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("twins", nargs="+", type=Path)
    parser.add_argument("--per-lane", type=float, default=700.0, help="cars an hour")
    given = parser.parse_args()
    for folder in given.twins:
        with tempfile.TemporaryDirectory() as scratch:
            print(folder, watched(load_twin(folder), given.per_lane, Path(scratch)), flush=True)


if __name__ == "__main__":
    main()
