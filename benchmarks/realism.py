"""What each part of the simulator is worth to a detector on real frames: notebook/learning.md.

    python benchmarks/learning.py car WORK; python benchmarks/learning.py roadside WORK
    python benchmarks/realism.py WORK all glass ...     # all of them if none is named
    python benchmarks/realism.py WORK --table

The same drives are recorded again with one kind of realism switched off, a detector learns the same
number of steps from them, and the same real frames judge it. Labels of real frames do nothing else.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import yaml

from learning import (
    CARRIERS,
    EVERY_S,
    LUMPI,
    REAL,
    START_S,
    TOWN_SECONDS,
    TOWNS,
    carriers,
    run,
    written,
)
from urbantwin.traffic.assets import AssetName, sized_name
from urbantwin.traffic.motion import Motion
from urbantwin.traffic.motion_rows import as_rows

#: Towns and the roadside drive that all detectors learn from; the cars with KITTI's sensor alone.
LEARNED_TOWNS, LEARNED_DRIVE = ("munich", "manchester-kingsway"), 4
STEPS = 1500
#: Effects of the sensors that are switched off.
EFFECTS = {"footprint": "no-footprint", "drop-out": "no-dropout", "glass": "no-glass"}
_SIDES = ("length", "width", "height")


def recorded(work: Path, out: Path, *options: object, every: int = 1) -> list[Path]:
    """Record all drives with other options."""
    found = []
    for town in LEARNED_TOWNS:
        seed = next(one for name, one, _ in TOWNS if name == town)
        for number in range(CARRIERS - 1):
            found.append(out / f"{town}-{number}")
            _record(work / "car" / town, f"rig-{number}.yaml", seed, found[-1], options, every)
    found.append(out / "roadside")
    _record(work / "roadside", "free.yaml", LEARNED_DRIVE, found[-1], options, every)
    return found


def _record(
    place: Path, rig: str, seed: int, out: Path, options: tuple[object, ...], every: int
) -> None:
    file = place / rig
    step = round(EVERY_S * yaml.safe_load(file.read_text())["rate_hz"]) * every
    motion = place / "motion" if (place / "motion").exists() else place / f"motion-{seed}"
    how = ("--rig", file, "--start", START_S, "--every", step, "--workers", 1, "--seed", seed)
    out.parent.mkdir(parents=True, exist_ok=True)
    run(out.parent, "record", place / "twin", motion, *how, "--no-pictures", *options, out=out)


def driven_again(work: Path, out: Path, change: Callable[[Path, Path], None]) -> list[Path]:
    """Build and drive all places again; ``change`` makes the new place of the old one."""
    found = []
    for town in LEARNED_TOWNS:
        seed = next(one for name, one, _ in TOWNS if name == town)
        old, place = work / "car" / town, out / "places" / town
        change(old, place)
        seconds = ("--seconds", TOWN_SECONDS)
        _drive(place, old / "demand.yaml", seed, seconds)
        for number, track in enumerate(carriers(place / "motion")[: CARRIERS - 1]):
            rig = yaml.safe_load((old / f"rig-{number}.yaml").read_text())
            _own(place / f"rig-{number}.yaml", rig | {"ride": {"track": track}})
            found.append(out / f"{town}-{number}")
            _record(place, f"rig-{number}.yaml", seed, found[-1], (), 1)
    old, place = work / "roadside", out / "places" / "roadside"
    change(old, place)
    _own(place / "free.yaml", yaml.safe_load((old / "free.yaml").read_text()))
    for sensor in old.glob("rig-sensor-*.yaml"):
        _link(sensor, place / sensor.name)
    _drive(place, old / f"demand-{LEARNED_DRIVE}.yaml", LEARNED_DRIVE, ("--seconds", 302.0))
    found.append(out / "roadside")
    _record(place, "free.yaml", LEARNED_DRIVE, found[-1], (), 1)
    return found


def _drive(place: Path, demand: Path, seed: int, seconds: tuple[object, ...]) -> None:
    given = place / "demand.yaml"
    if not given.exists():
        given = demand
    if not (place / "motion").exists():
        run(place, "drive", place / "twin", "--demand", given, "--seed", seed, *seconds,
            "--no-pictures", out=place / "motion")  # fmt: skip


def without_parked(old: Path, place: Path) -> None:
    """Nobody parks."""
    place.mkdir(parents=True, exist_ok=True)
    _link(old / "twin", place / "twin")
    demand = old / "demand.yaml"
    demand = demand if demand.exists() else old / f"demand-{LEARNED_DRIVE}.yaml"
    written(place / "demand.yaml", yaml.safe_load(demand.read_text()) | {"parked": 0.0})


def without_clutter(old: Path, place: Path) -> None:
    """Beside the streets nothing stands but what the map has."""
    place.mkdir(parents=True, exist_ok=True)
    for one in old.iterdir():
        if one.name != "times.jsonl" and (one.is_file() or one.name == "rings"):
            _link(one, place / one.name)
    site = yaml.safe_load((old / "site.yaml").read_text())
    site["scene"] = site.get("scene", {}) | {"clutter": "none"}
    run(place, "build", _own(place / "site.yaml", site), "--no-pictures", out=place / "twin")


def without_size_spread(old: Path, place: Path) -> None:
    """Everybody of a class is as long, wide and high as the median of it."""
    place.mkdir(parents=True, exist_ok=True)
    _link(old / "twin", place / "twin")
    motion = old / "motion" if (old / "motion").exists() else old / f"motion-{LEARNED_DRIVE}"
    if (place / "motion").exists():
        return
    given = Motion.load(motion)
    known = given.actors.select(["class", *_SIDES])
    usual = {
        name: [float(np.median(known.filter(pa.compute.equal(known["class"], name))[side]))
               for side in _SIDES]
        for name in known["class"].unique().to_pylist()
    }  # fmt: skip
    tables = []
    for table in (given.actors, given.parked):
        names = table["class"].to_pylist()
        sides = np.array([usual.get(name, [np.nan] * 3) for name in names]).reshape(-1, 3)
        assets = [
            sized_name(AssetName.of(asset).unsized, *usual[name]) if name in usual else asset
            for name, asset in zip(names, table["asset"].to_pylist(), strict=True)
        ]
        columns = {"asset": pa.array(assets)}
        columns |= {
            side: pa.array(np.where(np.isnan(sides[:, k]), table[side].to_numpy(), sides[:, k]))
            for k, side in enumerate(_SIDES)
        }
        shown = [columns.get(name, table[name]) for name in table.column_names]
        tables.append(pa.table(shown, schema=table.schema))
    replace(given, rows=as_rows(tables[0]), parked=tables[1]).with_meshes().save(place / "motion")


def _own(file: Path, content: object) -> Path:
    """Write YAML in place of a link to another place's."""
    file.unlink(missing_ok=True)
    return written(file, content)


def _link(old: Path, new: Path) -> None:
    if not new.exists():
        new.symlink_to(old.resolve())


def datasets(work: Path, name: str) -> list[Path]:
    """Return what one detector learns from."""
    out = work / "realism" / name.split("@", maxsplit=1)[0]
    if name.startswith("all"):
        return recorded(work, work / "realism" / "all")
    if name in EFFECTS:
        return recorded(work, out, "--effects", EFFECTS[name])
    if name == "a quarter of the frames":
        return recorded(work, out, every=4)
    if name == "one town":
        return [one for one in datasets(work, "all") if one.name.startswith(LEARNED_TOWNS[0])]
    if name == "two towns":
        return [one for one in datasets(work, "all") if one.name != "roadside"]
    change = {
        "parked cars": without_parked,
        "clutter": without_clutter,
        "size spread": without_size_spread,
    }
    return driven_again(work, out, change[name])


NAMES = ("all", "all@2", "all@3", *EFFECTS, "size spread", "parked cars", "clutter")
NAMES += ("one town", "two towns", "a quarter of the frames")


def judged(work: Path, name: str) -> None:
    """Let one detector learn, and judge it."""
    place = work / "realism" / "models" / name.replace(" ", "-")
    place.mkdir(parents=True, exist_ok=True)
    seed = name.split("@")[1] if "@" in name else 1
    classes = [word for one in ("car", "bicycle", "pedestrian") for word in ("--class", one)]
    how = ("--steps", STEPS, "--seed", seed, *classes)
    run(place, "model", "train", *datasets(work, name), "--part", "all", *how, out=place / "model")
    for data in (REAL / "recordings" / "kitti-training", LUMPI):
        run(
            place, "model", "evaluate", place / "model", data, "--within", 40, out=place / data.name
        )


def table(work: Path) -> None:
    """Print the figures of all detectors as rows of a table."""
    for name in NAMES:
        cells = []
        for data in ("kitti-training", "lumpi"):
            file = work / "realism" / "models" / name.replace(" ", "-") / data / "evaluation.json"
            if not file.exists():
                break
            classes = json.loads(file.read_text())["classes"]
            for label, measure in (
                ("car", "within_2_m"), ("car", "bev_iou_0.5"), ("pedestrian", "within_1_m"),
            ):  # fmt: skip
                row = classes[label]["ap"][measure]
                ends = "-".join(f"{100 * one:.0f}" for one in row["ap_ci95"] or ())
                cells.append(f"{100 * row['ap']:.0f} ({ends})")
        else:
            print("|", name, "|", " | ".join(cells), "|")


def main() -> None:
    """Do what is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("work", type=Path)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(NAMES))
    parser.add_argument("--table", action="store_true")
    given = parser.parse_args()
    work = given.work.resolve()
    if given.table:
        table(work)
        return
    for name in given.names or NAMES:
        judged(work, name)


if __name__ == "__main__":
    main()
