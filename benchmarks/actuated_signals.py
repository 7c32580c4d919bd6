"""Actuated signals where the truth is known: do simulated greens last as recorded ones do?

SUMO's own actuated controller shows an hour, as `known_traffic` drives it. Its first 60 % are
fitted to, the rest judges: by group, the Kolmogorov-Smirnov distance of how long greens last, in
the simulation, in a program that shows the median of all, and in the fitted part (chance).

    python benchmarks/actuated_signals.py site.yaml --out actuated/ --truth W99
"""

from __future__ import annotations

import argparse
import csv
import json
from collections import defaultdict
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import ks_2samp

from calibration import FIT_SHARE, GAP_S, TRUTHS
from known_traffic import drive, write_recording
from urbantwin.site import load_site
from urbantwin.traffic.calibration.calibrate import calibrate_traffic
from urbantwin.traffic.calibration.passages import JunctionLinks
from urbantwin.traffic.run import run_traffic
from urbantwin.twin.build import build_twin


def greens(changes: list[tuple[float, str]], begin_s: float, end_s: float) -> NDArray[np.float64]:
    """Return how long the greens last that are seen whole between two moments, seconds."""
    found, since = [], None
    for (_, was), (at, letter) in pairwise(changes):
        if letter in "Gg" and was not in "Gg":
            since = at
        elif letter not in "Gg" and was in "Gg":
            if since is not None and since >= begin_s and at < end_s:
                found.append(at - since)
            since = None
    return np.array(found)


def recorded(path: Path) -> dict[str, list[tuple[float, str]]]:
    """Return what each group showed, from a table of phases."""
    shown: dict[str, list[tuple[float, str]]] = defaultdict(list)
    with path.open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            shown[row["group"]].append((float(row["time_s"]), row["state"]))
    return shown


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("site", type=Path)
    parser.add_argument("--out", type=Path, default=Path("actuated"))
    parser.add_argument("--truth", choices=list(TRUTHS), default="W99")
    parser.add_argument("--seconds", type=float, default=3600.0, help="of the recording")
    parser.add_argument("--trials", type=float, default=3600.0, help="0: drivers are not fitted")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    truth, out = TRUTHS[given.truth], given.out
    twin = build_twin(load_site(given.site), out / "twin", lambda *_: None)
    tracks = drive(twin, truth, given.seconds, given.seed, out / "truth")
    file = write_recording(twin, tracks, truth, out / "truth/states.xml", given.seed, out)
    report = calibrate_traffic(
        file, given.site, out / "calibrated", fit_share=FIT_SHARE, gap_s=GAP_S,
        seconds=given.trials,
    )  # fmt: skip
    told = report["signals"]
    print(json.dumps(told["actuated"], indent=1))
    twin = build_twin(
        load_site(out / "calibrated/site.yaml"), out / "calibrated-twin", lambda *_: None
    )
    motion = run_traffic(twin, out / "motion", seconds=given.seconds, seed=given.seed)
    rows = motion.signals.to_pylist()
    link_of = {group: int(link) for link, group in told["group_of_link"].items()}
    signals = JunctionLinks.of(twin.net_path, twin.roads).signals
    assert signals is not None
    fit_s = FIT_SHARE * given.seconds
    for group, changes in sorted(recorded(out / "phases.csv").items()):
        if group not in link_of:
            continue
        shown = sorted(
            {
                (row["time_s"], row["state"])
                for row in rows
                if row["link"] == link_of[group] and row["signal"] == signals.program
            }
        )
        simulated = greens(shown, 0.0, given.seconds)
        fitted, held = greens(changes, 0.0, fit_s), greens(changes, fit_s + GAP_S, given.seconds)
        if len(held) < 3 or len(simulated) < 3:
            continue
        constant = np.full(1000, np.median(fitted))
        print(
            f"group {group}: held out {held.mean():.1f} s ({len(held)}), simulated "
            f"{simulated.mean():.1f} s ({len(simulated)}), KS {ks_2samp(simulated, held)[0]:.3f} "
            f"(with fitted part {ks_2samp(simulated, fitted)[0]:.3f}), "
            f"of fitted part {ks_2samp(fitted, held)[0]:.3f}, of the median "
            f"{ks_2samp(constant, held)[0]:.3f}"
        )


if __name__ == "__main__":
    main()
