"""Detectors trained on twins alone, and judged by real frames.

    python benchmarks/learning.py roadside WORK     # twin, traffic, labelled frames
    python benchmarks/learning.py car WORK
    python benchmarks/learning.py judge WORK        # trains on both, judges: docs/howto/train.md

Every step is a command of `urbantwin`, printed as it is run; what is there is not made again, so a
second call goes on after an interruption. WORK/times.jsonl gets the seconds of each. Recordings and
maps are those of ../shared/data. Labels of real frames judge in the end; nothing else reads them.
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.compute as pc
import yaml

import urbantwin as ut

PROJECT = Path(__file__).resolve().parents[1]
REAL = PROJECT.parent / "shared" / "data"
LUMPI = REAL / "recordings" / "lumpi"

#: Frames of LUMPI that the twin and its background are made from (notebook/hannover.md).
FIRST = range(1, 13)
#: Vehicles per hour: as calibrated (notebook/hannover.md), with more of rare classes.
USUAL = {"car": 2820, "van": 95, "bus": 60, "truck": 60, "bicycle": 900, "pedestrian": 1200}
MANY = {"car": 1800, "van": 200, "bus": 150, "truck": 200, "motorcycle": 60}
MANY |= {"bicycle": 1300, "pedestrian": 2000}
#: Roadside drives: seed, demand, whether the static world is the measured one, use.
DRIVES = (
    (1, USUAL, True, "train"),
    (2, MANY, True, "train"),
    (3, MANY, True, "train"),
    (4, MANY, False, "train"),
    (5, USUAL, True, "held"),
    (6, MANY, True, "held"),
)
#: Seconds of a drive, between its frames, and before the first.
SECONDS, EVERY_S, START_S = 302.0, 4.0, 2.0
#: How long one detector is trained: three quarters of an hour on two processors.
TRAIN_STEPS = 9000
#: Towns by car: extract, seed, use; the share of spaces that are taken, and times the guesses.
TOWNS = (
    ("munich", 1, "train"),
    ("neukolln", 2, "train"),
    ("manchester-kingsway", 3, "train"),
    ("taipei", 4, "held"),
)
RADIUS_M, PARKED = 180.0, 0.8
MORE = {"truck": 2.0, "bus": 1.5, "bicycle": 2.0, "pedestrian": 2.0, "motorcycle": 1.5}
#: Cars that carry the rig in each town, and the seconds of each drive.
CARRIERS, TOWN_SECONDS = 3, 202.0
#: Sensors on a car: KITTI's, and Argoverse 2's pair, whose lower unit hangs upside down.
CARS: dict[str, list[dict[str, Any]]] = {
    "hdl64": [{"name": "roof", "model": "HDL-64E", "forward_m": 0.0, "height_m": 1.73}],
    "vlp32": [
        {"name": "upper", "model": "VLP-32C", "forward_m": 0.0, "height_m": 1.97},
        {"name": "lower", "model": "VLP-32C", "forward_m": 0.0, "height_m": 1.86, "roll_deg": 180},
    ],
}


def run(work: Path, *given: Any, out: Path | None = None) -> None:
    """Run a command of ours unless its output is there; note how long it took."""
    words = [str(word) for word in given]
    if out is not None:
        if out.exists():
            return
        words += ["-o", str(out)]
    print("urbantwin", *words, flush=True)
    began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "urbantwin", *words, "--quiet"], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    note = {"command": words, "s": time.perf_counter() - began, "processor_s": processor}
    with (work / "times.jsonl").open("a") as log:
        log.write(json.dumps(note) + "\n")


def written(path: Path, content: Any) -> Path:
    """Write YAML."""
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


def roadside_data(work: Path) -> None:
    """Twin and measured background of Hannover from unlabelled frames; its simulated traffic."""
    work.mkdir(parents=True, exist_ok=True)
    first = work / "first"
    if not first.exists():
        first.mkdir()
        for number in FIRST:
            shutil.copy(LUMPI / f"{number:04}.bin", first)
    rings, found = work / "rings", work / "rig.yaml"
    run(work, "rig", "discover", first, "--frames", rings, out=found)
    example = PROJECT / "examples" / "hannover"
    shutil.copy(example / "sketch.geojson", work)
    site = yaml.safe_load((example / "site.yaml").read_text())
    site |= {"geometry": [{"file": "rings/", "kind": "recording"}], "rig": "rig.yaml"}
    twin = work / "twin"
    run(work, "build", written(work / "site.yaml", site), "--no-pictures", out=twin)
    measured = work / "measured.npz"
    options = ("--rig", found, "--points-in", "site", "--interval", 1)
    run(work, "rig", "background", rings, "--twin", twin, *options, out=measured)
    # The real sensors keep no time with each other: neither do these.
    rig = yaml.safe_load(found.read_text())
    for sensor in rig["sensors"]:
        sensor["phase_lock"] = False
    free = written(work / "free.yaml", rig)
    for seed, demand, is_measured, use in DRIVES:
        asked = written(work / f"demand-{seed}.yaml", {"per_hour": demand})
        motion = work / f"motion-{seed}"
        times = ("--seed", seed, "--seconds", SECONDS)
        run(work, "drive", twin, "--demand", asked, *times, "--no-pictures", out=motion)
        there = ("--background", measured, "--fuse") if is_measured else ()
        every = EVERY_S if use == "train" else 3 * EVERY_S
        times = ("--start", START_S, "--every", round(every * rig["rate_hz"]))
        how = ("--workers", 1, "--seed", seed, "--no-pictures", *there)
        run(work, "record", twin, motion, "--rig", free, *times, *how, out=work / use / str(seed))


def carriers(motion: Path) -> Iterable[int]:
    """Tracks of the cars that go farthest."""
    rows = ut.open(motion).actors
    rows = rows.filter(pc.equal(rows["class"], "car"))
    gone = {}
    for track in np.unique(rows["track"].to_numpy()):
        one = rows.filter(pc.equal(rows["track"], track)).sort_by("time_s")
        if one.num_rows < TOWN_SECONDS / 0.1:
            continue  # not there all the time
        gone[int(track)] = np.hypot(np.diff(one["x"]), np.diff(one["y"])).sum()
    return sorted(gone, key=lambda track: -gone[track])[:CARRIERS]


def car_data(work: Path) -> None:
    """Twins of towns from their maps alone, seen by sensors on their own cars."""
    work.mkdir(parents=True, exist_ok=True)
    for town, seed, use in TOWNS:
        place = work / town
        twin, motion = place / "twin", place / "motion"
        if not (place / "site.yaml").exists():
            maps = ("--osm", REAL / "osm" / f"{town}.osm", "--at-junction", "--radius", RADIUS_M)
            run(work, "init", place, *maps)
        run(work, "build", place / "site.yaml", "--no-pictures", out=twin)
        guess = yaml.safe_load((place / "site.yaml").read_text())["traffic"]["per_hour"]
        asked = {name: round(count * MORE.get(name, 1)) for name, count in guess.items()}
        demand = written(place / "demand.yaml", {"per_hour": asked, "parked": PARKED})
        times = ("--seed", seed, "--seconds", TOWN_SECONDS)
        run(work, "drive", twin, "--demand", demand, *times, "--no-pictures", out=motion)
        for number, track in enumerate(carriers(motion)):
            # The last car of each town carries Argoverse's pair.
            name = "vlp32" if number == CARRIERS - 1 else "hdl64"
            ride = {"track": track}
            sensors = [{**one, "left_m": 0.0} for one in CARS[name]]
            rig = {"rate_hz": 10, "label_range_m": 60, "ride": ride, "sensors": sensors}
            file = written(place / f"rig-{number}.yaml", rig)
            every = EVERY_S if use == "train" else 2 * EVERY_S
            times = ("--start", START_S, "--every", round(every * rig["rate_hz"]))
            how = ("--workers", 1, "--seed", seed, "--no-pictures")
            out = work / use / f"{town}-{number}-{name}"
            run(work, "record", twin, motion, "--rig", file, *times, *how, out=out)


def judged(work: Path) -> None:
    """Train one detector on all that was recorded; judge it by simulated and by real frames."""
    datasets = sorted(work.glob("*/train/*"))
    model = work / "model"
    how = ("--part", "all", "--steps", TRAIN_STEPS, "--seed", 1)
    run(work, "model", "train", *datasets, *how, out=model)
    held = sorted(work.glob("*/held/*"))
    for data in (*held, REAL / "recordings" / "kitti-training", LUMPI):
        report = work / "judged" / "-".join(data.parts[-2:])
        run(work, "model", "evaluate", model, data, out=report)
        told = json.loads((report / "evaluation.json").read_text())
        print(data.name, told["in_short"], flush=True)


def main() -> None:
    """Do what is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("model", choices=("roadside", "car", "judge"))
    parser.add_argument("work", type=Path)
    given = parser.parse_args()
    work = given.work.resolve()
    if given.model == "judge":
        judged(work)
    else:
        {"roadside": roadside_data, "car": car_data}[given.model](work / given.model)


if __name__ == "__main__":
    main()
