"""Sizes of our actors against those that annotators drew: ``python benchmarks/actor_sizes.py``.

Reads ``../shared/data/statistics/tumtraf-s110-boxes.csv`` (or the file that is given), percentiles
of each side by class. Prints the table of ``docs/actors.md``: medians, ours and theirs, metres, and
the width of the middle 90 % of both; what is within 5 % (medians) and 25 % (widths) is in bold.
First true sizes (nothing of the fleet is chosen by the file), then those that annotators of TUMTraf
would draw of them: what they draw is fitted to the file's quartiles and its middle 90 %
(``benchmarks/annotators.py``), so only the medians judge.
"""

import csv
import sys
from collections import defaultdict
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np
import yaml

from urbantwin.traffic.assets import Asset, AssetName, asset, asset_mesh
from urbantwin.traffic.assets.annotators import drawn_size
from urbantwin.traffic.assets.fleet import Fleet
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
#: Behind a tractor's nose its trailer begins, metres (``articulated.yaml``).
TOWED_M = 2.88
Size = tuple[float, float, float]


def drawn() -> dict[str, np.ndarray]:
    """Return class -> sizes (N, 3) of bodies that are stiff, drawn for Germany, metres.

    Vehicles that bend are several, and, as the instructions of TUMTraf's annotators have it
    (proAnno), a cab is a truck and what it carries or pulls a trailer, be it a box, a tipper or a
    mixer.
    """
    fleet, found = Fleet("DE", seed=1), defaultdict(list)
    for name in CLASSES.values():
        for number in range(DRAWN if name != "trailer" else 0):
            entire = asset(fleet.body(name, number))
            for one in [asset(body.asset) for body in entire.bodies] or [entire]:
                if one.actor_class == "truck":
                    for kind, size in zip(("truck", "trailer"), _cab_and_load(one), strict=False):
                        found[kind].append(size)
                else:
                    found[one.actor_class].append(track_size(one))
    return {name: np.array(sizes) for name, sizes in found.items()}


def _cab_and_load(one: Asset) -> list[Size]:
    """Return the sizes of a truck's cab and its load; of a tractor up to its trailer."""
    body = AssetName.of(one.name).body
    cab_m = _entries()[body]["cab"]["size"][0] * one.length / asset(body).length
    corners = asset_mesh(one.name).vertices
    behind = corners[:, 0].max() - corners[:, 0]
    cab, load = corners[behind <= cab_m + 0.02], corners[behind > cab_m]
    if body == "truck-tractor":
        return [(TOWED_M, float(np.ptp(cab[:, 1])), float(cab[:, 2].max()))]
    return [
        (length, float(np.ptp(part[:, 1])), float(part[:, 2].max()))
        for length, part in ((cab_m, cab), (one.length - cab_m, load))
    ]


@cache
def _entries() -> dict:
    found = {}
    for name in ("assets.yaml", "articulated.yaml"):
        found |= yaml.safe_load(files("urbantwin.traffic.assets").joinpath(name).read_text())
    return found


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
    true = drawn()
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
