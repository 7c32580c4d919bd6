"""Every extract at hand through the main job, as a new user runs it: a table to judge places by.

`init` with what it proposes, then `build`, `traffic` and `record`: each a command of its own, as
`run` does them, with their pictures. What they made is then read from its files and compared with
the OpenStreetMap file itself; notebook/places.md says how each column is measured.

    python benchmarks/places.py
    python benchmarks/places.py --only london-borough --only chennai --seconds 5
    python benchmarks/places.py --stages build,traffic --out places/ --csv places.csv
    python benchmarks/places.py --seed 7007 --each 2     # places drawn at random, not proposed ones
"""

from __future__ import annotations

import argparse
import csv
import json
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import shapely

import urbantwin as ut
from places_map import MappedStreets
from places_motion import driving, seeing, street_covered
from places_roads import measure
from urbantwin.interface.whole_line import Run
from urbantwin.roads.build import NETWORK_CLASSES
from urbantwin.site import read_extract
from urbantwin.site.extract import Extract
from urbantwin.traffic.demand.site_demand import demand_of
from urbantwin.traffic.fleet_of_twin import own_bodies
from urbantwin.traffic.flow.circulation_report import circulation_report
from urbantwin.traffic.sumo.simulation import observe
from urbantwin.traffic.sumo.tram_conflicts import tram_conflicts
from urbantwin.twin import Twin

DATA = Path(__file__).parents[2] / "shared/data/osm"
STAGES = ("build", "traffic", "record")
ENDINGS = (".osm", ".osm.bz2", ".osm.gz", ".osm.pbf")
#: A command that takes longer has not come to an end, seconds.
LIMIT_S = 900.0
#: Least shares of found and mapped, of what is carried, and of what is seen; most of the rest.
TARGETS = {
    "seconds": 180.0, "crossings": 0.95, "unmapped": 0, "signals": 0.95, "lanes": 0.95,
    "arrows": 1.0, "carried": 0.9, "lateral": 0, "overlaps": 0, "seen": 0.6, "cycle": 120.0,
    "driven": 0.9, "slowing": 0.85, "stood": 0, "teleports": 0,
}  # fmt: skip
COLUMNS = (
    "seconds", "crossings", "unmapped", "signals", "heads", "lanes", "arrows", "guess", "carried",
    "moved", "red", "lateral", "most", "brakes", "overlaps", "seen", "ground", "points", "near",
    "warnings", "cycle", "driven", "slowing", "halt", "stood",
    "teleports",
)  # fmt: skip
#: Radii of regions that are drawn, metres.
RADII_M = (80.0, 100.0, 120.0, 150.0)
#: SUMO's step, milliseconds, and the seconds whose means are compared.
STEP_MS, SLICE_S = 500, 900


def extracts(data: Path, only: list[str]) -> dict[str, Path]:
    """Return the extracts of a folder by name, those of a name that is asked for."""
    found = {
        path.name.removesuffix(ending): path
        for path in sorted(data.iterdir())
        for ending in ENDINGS
        if path.name.endswith(ending)
    }
    for name in only:
        if name not in found:
            raise SystemExit(f"{name} is not in {data}: {', '.join(found)}")
    return {name: path for name, path in found.items() if name in only or not only}


def command(*given: str | Path) -> tuple[float, str]:
    """Run a command of ours; return how long it took, and its lines on stderr.

    Raises:
        RuntimeError: it failed, or came to no end; with its last line.
    """
    began = time.perf_counter()
    try:
        done = subprocess.run(
            [sys.executable, "-m", "urbantwin", *map(str, given)],
            capture_output=True, text=True, timeout=LIMIT_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"{given[0]}: no end after {LIMIT_S:.0f} s") from None
    if done.returncode:
        last = done.stderr.strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
        raise RuntimeError(f"{given[0]}: {last[0]}")
    return time.perf_counter() - began, done.stderr


def drawn(found: dict[str, Path], given: argparse.Namespace) -> dict[str, tuple[Path, list[str]]]:
    """Return the places that are run, by name: an extract, and where in it, as `init` takes it."""
    if given.seed is None:
        return {name: (path, []) for name, path in found.items()}
    places = {}
    for name, path in found.items():
        for k, (lat, lon, radius) in enumerate(anchors(path, given.seed, given.each), 1):
            where = [f"--lat={lat}", f"--lon={lon}", f"--radius={radius}"]
            places[f"{name}-{k}"] = path, where
    return places


def place(
    name: str, extract: Path, where: list[str], folder: Path, given: argparse.Namespace
) -> dict[str, Any]:
    """Run one place of an extract and measure what came out."""
    site, made = folder / "site.yaml", Run(folder)
    seconds: dict[str, float] = {}
    told: list[str] = []
    row: dict[str, Any] = {"place": name, "stage_seconds": seconds, "warnings": told}
    length = ["--seconds", str(given.seconds)] if given.seconds else []
    pool = ["--workers", str(given.workers)] if given.workers else []
    commands = {
        "init": ("init", folder, "--osm", extract.resolve(), *where, "--force"),
        "build": ("build", site, "-o", folder / "twin"),
        "traffic": ("drive", folder / "twin", "-o", folder / "motion", *length),
        "record": (
            "record", folder / "twin", folder / "motion", "-o", folder / "dataset", *pool,
        ),
    }  # fmt: skip
    try:
        for stage in ("init", *given.stages):
            print(f"{name}: {stage}", file=sys.stderr, flush=True)
            seconds[stage], lines = command(*commands[stage])
            told += [line for line in lines.splitlines() if line.startswith("warning:")]
            if stage == "build":
                twin = ut.Twin.open(made.folder / "twin")
                anchor = twin.frame.latitude, twin.frame.longitude
                row["streets"] = measure(twin, MappedStreets(extract, *anchor))
                row["covered"] = street_covered(twin, folder / "coverage")
                if given.hour:
                    row["hour"] = an_hour(twin)
            elif stage == "traffic":
                row["traffic"] = driving(made.twin, made.motion)
            elif stage == "record":
                row["frames"] = seeing(made.dataset)
    except RuntimeError as problem:
        row["failed"] = str(problem)
    return row


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
        "teleports": max(seen.teleports, *(int(row["teleports"]) for row in rows)),
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


def anchors(path: Path, seed: int, count: int) -> list[tuple[float, float, float]]:
    """Draw latitude, longitude and radius: signals and junctions in turn."""
    extract = read_extract(path)
    uses = Counter(
        node
        for way in extract.highways()
        if way.tags["highway"] in NETWORK_CLASSES and way.tags.get("area") != "yes"
        for node in way.nodes
        if node in extract.nodes
    )
    low, high = np.percentile(list(extract.nodes.values()), [3, 97], axis=0)
    beside = path.with_name(f"{path.name.split('.')[0]}.boundary.json")
    area = shapely.box(*low, *high)
    if beside.exists():
        area &= shapely.union_all(shapely.get_parts(shapely.from_geojson(beside.read_text())))
    nodes = [node for node in sorted(uses) if area.contains(shapely.Point(extract.nodes[node]))]
    lit = [node for node in nodes if _is_signal(extract, node)]
    meeting = [node for node in nodes if uses[node] > 1]
    random = np.random.default_rng([seed, sum(path.name.encode())])
    found = []
    for k in range(count):
        pool = lit if lit and k % 2 == 0 else meeting
        lon, lat = extract.nodes[pool[int(random.integers(len(pool)))]]
        found.append((round(lat, 6), round(lon, 6), float(random.choice(RADII_M))))
    return found


def _is_signal(extract: Extract, node: int) -> bool:
    tags = extract.node_tags.get(node, {})
    return "traffic_signals" in (tags.get("highway"), tags.get("crossing"))


def line_of(row: dict[str, Any]) -> dict[str, str]:
    """Return a row of the table: found/mapped, counts and shares, marked where they miss."""
    streets, traffic, frames = (row.get(key, {}) for key in ("streets", "traffic", "frames"))
    line = dict.fromkeys(COLUMNS, "")

    def put(column: str, text: str, value: float, *, most: bool = False) -> None:
        target = TARGETS.get(column)
        missed = target is not None and (value > target if most else value < target)
        line[column] = text + ("*" if missed else "")

    total = sum(row["stage_seconds"].values())
    put("seconds", f"{total:.0f}", total, most=True)
    for column in ("crossings", "signals", "heads", "lanes", "arrows"):
        if column in streets:
            found, mapped = streets[column]
            put(column, f"{found}/{mapped}", found / mapped if mapped else 1.0)
    if streets:
        unmapped = streets["unmapped_zebras"]
        put("unmapped", f"{unmapped}/{streets['zebras']}", unmapped, most=True)
        for column, layer in (("seen", "facing"), ("ground", "ground")):
            put(column, f"{row['covered'][layer]:.0%}", row["covered"][layer])
    if traffic:
        if traffic["carried"] is not None:
            put("carried", f"{traffic['carried']:.2f}", traffic["carried"])
        if traffic["share_of_guess"] is not None:
            line["guess"] = f"{traffic['share_of_guess']:.2f}"
        over, vehicles, most = traffic["lateral"]
        line["moved"] = "{}/{}".format(*traffic["moved"])
        line["red"] = "{}/{}".format(*traffic["stops_at_red"])
        put("lateral", f"{over}/{vehicles}", over, most=True)
        line["most"], line["brakes"] = f"{most:.1f}", f"{traffic['braking']:.1f}"
        put("overlaps", str(traffic["overlaps"]), traffic["overlaps"], most=True)
    if frames:
        line["points"], line["near"] = f"{frames['with_points_all']:.0%}", f"{frames['near']:.0%}"
    line["warnings"] = str(len(row["warnings"]))
    if streets:
        put("cycle", f"{streets['longest_cycle_s']:.0f}", streets["longest_cycle_s"], most=True)
    if hour := row.get("hour"):
        first, last = hour["speeds"][0], hour["speeds"][-1]
        put("driven", f"{hour['driven']:.2f}", hour["driven"])
        put("slowing", f"{last / max(first, 0.1):.2f}", last / max(first, 0.1))
        line["halt"] = f"{hour['longest_halt_s']:.0f}"
        put("stood", str(hour["stood"]), hour["stood"], most=True)
        put("teleports", str(hour["teleports"]), hour["teleports"], most=True)
    return line


def table(rows: list[dict[str, Any]]) -> str:
    """Return the table as text, and below it the share of each class of actors with points."""
    lines = [{"place": row["place"], **line_of(row)} for row in rows]
    names = ("place", *COLUMNS)
    wide = {name: max(len(name), *(len(line[name]) for line in lines)) for name in names}
    text = ["  ".join(f"{name:{wide[name]}}" for name in names)]
    text += ["  ".join(f"{line[name]:{wide[name]}}" for name in names) for line in lines]
    text.append("* misses: " + ", ".join(f"{name} {value}" for name, value in TARGETS.items()))
    for row in rows:
        if "frames" in row:
            shares = row["frames"]["with_points"]
            told = ", ".join(f"{kind} {share:.0%}" for kind, share in shares.items())
            text.append(f"{row['place']}: boxes with points: {told}")
    text += [f"{row['place']}: failed: {row['failed']}" for row in rows if "failed" in row]
    return "\n".join(text)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=DATA, help="folder of extracts")
    parser.add_argument("--only", action="append", default=[], metavar="NAME")
    parser.add_argument("--seconds", type=float, help="of traffic; 20 when not given")
    parser.add_argument("--stages", default=",".join(STAGES), help="the first of them, or all")
    parser.add_argument("--seed", type=int, help="draw places at random instead")
    parser.add_argument("--each", type=int, default=2, help="places drawn of each extract")
    parser.add_argument("--hour", action="store_true", help="drive an hour, too")
    parser.add_argument("--workers", type=int, help="processes to record with")
    parser.add_argument("--out", type=Path, help="keep what is made in this folder")
    parser.add_argument("--csv", type=Path, help="write the table to this file")
    parser.add_argument("--json", action="store_true", help="print everything measured")
    given = parser.parse_args()
    given.stages = given.stages.split(",")
    if tuple(given.stages) != STAGES[: len(given.stages)]:
        parser.error(f"--stages: expected {', '.join(STAGES)}, from the first on")
    if not given.data.is_dir():
        raise SystemExit(f"{given.data} is missing")
    with tempfile.TemporaryDirectory() as scratch:
        rows = [
            place(name, extract, where, (given.out or Path(scratch)) / name, given)
            for name, (extract, where) in drawn(extracts(given.data, given.only), given).items()
        ]
    if given.csv:
        with given.csv.open("w", newline="") as file:
            writer = csv.DictWriter(file, ["place", *COLUMNS])
            writer.writeheader()
            writer.writerows({"place": row["place"], **line_of(row)} for row in rows)
    print(json.dumps(rows, indent=1) if given.json else table(rows))


if __name__ == "__main__":
    main()
