"""What annotators draw around a true size: ``python benchmarks/annotators.py [kitti|tumtraf]``.

Prints rows for ``traffic/assets/annotators.yaml``. Of TUMTraf S110 quantiles of our fleet's sides
are mapped to theirs; between the five that the file has theirs are taken to lie straight. All five
are used, so nothing is left to judge (``benchmarks/actor_sizes.py`` draws other vehicles of the
same fleet). Of KITTI (about two minutes) the drawn boxes over those mended to their points, on
frames 0 to 11; frames 12 to 23 judge.
"""

import csv
import sys
from pathlib import Path

import numpy as np

from actor_sizes import CLASSES, FILE, SIDES, drawn
from urbantwin.fidelity.objects.compare import compare_in_boxes
from urbantwin.fidelity.readers import open_recording
from urbantwin.lidar import sensor

KITTI = Path(__file__).parents[1].parent / "shared/data/recordings/kitti-training"
#: Fewest points of an object whose box is mended.
FEWEST = 30
#: Quantiles that the file has, and those that are mapped: where a fleet has two kinds, its median
#: may lie anywhere between them.
QUANTILES = {"p05": 0.05, "p25": 0.25, "median": 0.5, "p75": 0.75, "p95": 0.95}
MAPPED = (0.05, 0.15, 0.25, 0.35, 0.45, 0.5, 0.55, 0.65, 0.75, 0.85, 0.95)
SEEDS = range(1, 6)
#: By how much vehicles of the same size are told apart, metres: a bus is 2.55 m wide, all are.
APART_M = 0.02


def tumtraf() -> None:
    """Map quantile to quantile, and print."""
    with FILE.open() as opened:
        rows = {row["class"]: row for row in csv.DictReader(opened)}
    every = [drawn(seed) for seed in SEEDS]
    for theirs, ours in CLASSES.items():
        print(f"  {ours}:")
        sizes = np.concatenate([one[ours] for one in every])
        away = np.random.default_rng(0).standard_normal((9, *sizes.shape))
        own = np.quantile(sizes + APART_M * away, MAPPED, axis=(0, 1))
        for k, side in enumerate(SIDES):
            told = [float(rows[theirs][f"{side}_{name}_m"]) for name in QUANTILES]
            drawn_m = np.interp(MAPPED, list(QUANTILES.values()), told)
            print(f"    {side}: {{{_listed('actual', own[:, k])}, ", end="")
            print(f"{_listed('drawn', drawn_m)}, scatter: {APART_M}}}")


def _listed(name: str, values: np.ndarray) -> str:
    return f"{name}: [{', '.join(f'{value:.2f}' for value in values)}]"


def kitti() -> None:
    """Measure on half of the frames, print, and measure on the other half."""
    recording = open_recording(KITTI)
    for name, numbers in (("fitted", range(12)), ("judged", range(12, 24))):
        seen = compare_in_boxes(recording, sensor("HDL-64E"), numbers=list(numbers)).seen
        cars = [one for one in seen if one.class_name == "car" and one.counts["real"] >= FEWEST]
        sizes = np.array([one.mended_box[3:6] for one in cars])
        part = np.array([one.box[3:6] for one in cars]) / sizes
        usual, scatter = np.median(part, axis=0), part.std(axis=0) * np.median(sizes, axis=0)
        print(f"{name}, {len(cars)} cars:")
        for k, side in enumerate(SIDES):
            print(f"    {side}: {{actual: [0, 10], drawn: [0, {10 * usual[k]:.2f}], ", end="")
            print(f"scatter: {scatter[k] / usual[k]:.3f}}}")


if __name__ == "__main__":
    {"kitti": kitti, "tumtraf": tumtraf}[sys.argv[1] if len(sys.argv) > 1 else "tumtraf"]()
