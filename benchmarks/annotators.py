"""What annotators draw around a true size: ``python benchmarks/annotators.py [kitti|tumtraf]``.

Prints rows for ``traffic/assets/annotators.yaml``. Of TUMTraf S110 the middle of the
quartiles of each side and the width of its middle 90 % are fitted to: by how much our fleet's are
shifted, and how much narrower or wider they lie. Medians are left to judge
(``benchmarks/actor_sizes.py``). Of KITTI (about two minutes)
the drawn boxes over those mended to their points, on frames 0 to 11; frames 12 to 23 judge.
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
#: Width of the middle 90 % of a normal distribution, standard deviations; fewest points of an
#: object whose box is mended.
MOST, FEWEST = 3.290, 30
#: How long loads are is the fleet's; our boxes of trucks hold the load too.
ELSE = {("truck", "length"), ("trailer", "length")}


def tumtraf() -> None:
    """Fit to the quantiles but the medians, and print."""
    with FILE.open() as opened:
        rows = {row["class"]: row for row in csv.DictReader(opened)}
    every = drawn()
    for theirs, ours in CLASSES.items():
        cells = []
        for k, side in enumerate(SIDES):
            if (ours, side) in ELSE:
                continue
            real = {q: float(rows[theirs][f"{side}_{q}_m"]) for q in ("p05", "p25", "p75", "p95")}
            low, own_25, own_75, high = np.quantile(every[ours][:, k], [0.05, 0.25, 0.75, 0.95])
            own, other = high - low, real["p95"] - real["p05"]
            of_true = min(1.0, other / own) if own > 0.01 else 1.0
            scatter = max(other**2 - (of_true * own) ** 2, 0.0) ** 0.5 / MOST
            off = (real["p25"] + real["p75"]) / 2 - of_true * (own_25 + own_75) / 2
            cells.append(f"{side}: [{off:.3f}, {of_true:.3f}, {scatter:.3f}]")
        print(f"  {ours}: {{{', '.join(cells)}}}")


def kitti() -> None:
    """Measure on half of the frames, print, and measure on the other half."""
    recording = open_recording(KITTI)
    for name, numbers in (("fitted", range(12)), ("judged", range(12, 24))):
        seen = compare_in_boxes(recording, sensor("HDL-64E"), numbers=list(numbers)).seen
        cars = [one for one in seen if one.class_name == "car" and one.counts["real"] >= FEWEST]
        sizes = np.array([one.mended_box[3:6] for one in cars])
        part = np.array([one.box[3:6] for one in cars]) / sizes
        usual, scatter = np.median(part, axis=0), part.std(axis=0) * np.median(sizes, axis=0)
        cells = [f"{side}: [0.0, {usual[k]:.3f}, {scatter[k]:.3f}]" for k, side in enumerate(SIDES)]
        print(f"{name}, {len(cars)} cars: {{{', '.join(cells)}}}")


if __name__ == "__main__":
    {"kitti": kitti, "tumtraf": tumtraf}[sys.argv[1] if len(sys.argv) > 1 else "tumtraf"]()
