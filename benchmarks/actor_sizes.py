"""Sizes of our actors against those that annotators drew: ``python benchmarks/actor_sizes.py``.

Reads ``../shared/data/statistics/tumtraf-s110-boxes.csv`` (or the file that is given), percentiles
of each side by class. Prints the table of ``notebook/actors.md``: medians, ours and theirs, metres,
and the width of the middle 90 % of both; what is within 5 % (medians) and 25 % (widths) is in bold.
First true sizes (nothing of the fleet is chosen by the file), then those that annotators of TUMTraf
would draw of them: that is fitted to all of the file's quantiles (``benchmarks/annotators.py``, on
other vehicles of the same fleet), so it judges nothing of the fleet.
"""

import csv
import sys
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from urbantwin.traffic.assets import asset
from urbantwin.traffic.assets.annotators import drawn_size
from urbantwin.traffic.assets.fleet import Fleet
from urbantwin.traffic.assets.truck_parts import truck_parts
from urbantwin.traffic.paths.track_box import track_size

FILE = Path(__file__).parents[1].parent / "shared/data/statistics/tumtraf-s110-boxes.csv"
#: Theirs -> ours.
CLASSES = {
    "CAR": "car",
    "VAN": "van",
    "TRUCK": "truck",
    "TRAILER": "trailer",
    "BUS": "bus",
    "MOTORCYCLE": "motorcycle",
    "BICYCLE": "bicycle",
    "PEDESTRIAN": "pedestrian",
}
SIDES, DRAWN, WITHIN = ("length", "width", "height"), 2000, (0.05, 0.25)


def drawn(seed: int) -> dict[str, np.ndarray]:
    """Return class -> sizes (N, 3) of bodies that are stiff, drawn for Germany, metres.

    Vehicles that bend are several, and trucks are in two (`truck_parts`).
    """
    fleet, found = Fleet("DE", seed=seed), defaultdict(list)
    for name in CLASSES.values():
        for number in range(DRAWN if name != "trailer" else 0):
            entire = asset(fleet.body(name, number))
            for one in [asset(body.asset) for body in entire.bodies] or [entire]:
                parts = truck_parts(one.name)
                for part in parts:
                    found[part.actor_class].append(part.size)
                if not parts:
                    found[one.actor_class].append(track_size(one))
    return {name: np.array(sizes) for name, sizes in found.items()}


def table(every: Mapping[str, np.ndarray], rows: Mapping[str, Mapping[str, str]]) -> None:
    """Print how sizes of classes compare with percentiles."""
    met = [0, 0]
    print("| class | length | width | height | spread of length | of width | of height |")
    print("|---|---|---|---|---|---|---|")
    for theirs, ours in CLASSES.items():
        sizes, cells = every[ours], ([], [])
        for k, side in enumerate(SIDES):
            low, middle, high = np.quantile(sizes[:, k], [0.05, 0.5, 0.95])
            real = {q: float(rows[theirs][f"{side}_{q}_m"]) for q in ("p05", "median", "p95")}
            pairs = ((middle, real["median"]), (high - low, real["p95"] - real["p05"]))
            for column, (mine, other) in enumerate(pairs):
                off = mine / other - 1
                fine = abs(off) <= WITHIN[column]
                met[column] += fine
                text = f"{mine:.2f}, {other:.2f} ({100 * off:+.0f} %)"
                cells[column].append(f"**{text}**" if fine else text)
        print(f"| `{ours}` | {' | '.join(cells[0] + cells[1])} |")
    every_side = len(CLASSES) * len(SIDES)
    print(f"\nmedians within 5 %: {met[0]} of {every_side}", end="; ")
    print(f"spreads within 25 %: {met[1]} of {every_side}\n")


def main() -> None:
    """Print the tables."""
    file = Path(sys.argv[1]) if len(sys.argv) > 1 else FILE
    with file.open() as opened:
        rows = {row["class"]: row for row in csv.DictReader(opened)}
    true = drawn(seed=2)
    table(true, rows)
    annotated = {
        name: np.array(
            [drawn_size("tumtraf", name, tuple(size), k, 1) for k, size in enumerate(sizes)]
        )
        for name, sizes in true.items()
    }
    table(annotated, rows)


if __name__ == "__main__":
    main()
