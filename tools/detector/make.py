"""Make the weights of the shipped detector: twins of five towns, recordings of them, one training.

    python tools/detector/make.py MAPS -o build/detector         # or: make detector MAPS=folder

MAPS is a folder with the OpenStreetMap extracts that grid.yaml names (munich.osm, ...; .osm.bz2 and
.osm.pbf are read, too). About 40 minutes on two cores; the same inputs give the same weights on one
kind of processor. No real point cloud and no real label is read.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

import yaml

HERE = Path(__file__).parent
SHIPPED = HERE.parents[1] / "src/urbantwin/learn/shipped"
CLASSES = ("car", "pedestrian", "bicycle", "truck", "bus")
STEPS = 1500


def run(*arguments: str | Path, may_fail: bool = False) -> None:
    """Run a command of urbantwin, with one thread of PyTorch: its sums depend on their number."""
    command = [sys.executable, "-m", "urbantwin", *map(str, arguments)]
    print("$", *command[2:], flush=True)
    subprocess.run(command, check=not may_fail, env={**os.environ, "OMP_NUM_THREADS": "1"})


def main() -> None:
    """Make what is missing, and copy the model into the package."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("maps", type=Path)
    parser.add_argument("-o", "--out", type=Path, default=Path("build/detector"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    grid = yaml.safe_load((HERE / "grid.yaml").read_text(encoding="utf-8"))
    for name in grid["sites"]:
        found = sorted(given.maps.glob(f"{name}.osm*"))
        if not found:
            raise SystemExit(f"error: {given.maps}: no extract {name}.osm")
        if not (given.out / name / "site.yaml").is_file():
            run("init", given.out / name, "--osm", found[0].resolve())
    for file in ("grid.yaml", "car.yaml", "bus.yaml"):
        shutil.copy(HERE / file, given.out / file)
    # A town without a bus in this minute has no recording from one: its cell fails.
    campaign = given.out / "campaign"
    run("experiment", "run", given.out / "grid.yaml", "-o", campaign, may_fail=True)
    datasets = sorted((campaign / "datasets").iterdir())
    classes = [word for name in CLASSES for word in ("--class", name)]
    model = given.out / "model"
    run("model", "train", *datasets, "-o", model, "--part", "all", *classes,
        "--steps", str(STEPS), "--seed", "1")  # fmt: skip
    for file in ("model.safetensors", "model.yaml", "model.json"):
        shutil.copy(model / file, SHIPPED / file)


if __name__ == "__main__":
    main()
