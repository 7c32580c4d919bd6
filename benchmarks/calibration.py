"""Calibration where a recording is long enough, and its truth known: does an hour match?

Fitted to the first 60 % of a recording, judged by the rest. What chance alone does is told by the
truth itself, driven again with another seed: no calibration can be expected to come nearer.

    python benchmarks/calibration.py site.yaml ... --out calibrated/ --truth IDM
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

from known_traffic import Truth, drive, write_recording
from urbantwin.site import load_site
from urbantwin.traffic.calibration.agreement import agreement
from urbantwin.traffic.calibration.calibrate import calibrate_traffic
from urbantwin.traffic.calibration.measured import measured
from urbantwin.traffic.calibration.passages import JunctionLinks, passages_of
from urbantwin.twin import load_twin
from urbantwin.twin.build import build_twin

FIGURES = ("class_shares_points", "turn_shares_points", "speed_ks", "headway_ks")
WANTED = (2.0, 5.0, 0.1, 0.1)
FIT_SHARE, GAP_S = 0.6, 5.0
TRUTHS = {
    "IDM": Truth(
        per_hour=1300.0,
        shares={"car": 0.72, "van": 0.12, "truck": 0.07, "bus": 0.02, "motorcycle": 0.07},
        bicycles=160.0,
        people=220.0,
        drivers={
            "carFollowModel": "IDM", "tau": "1.1", "minGap": "2.6", "accel": "1.8", "decel": "2.2",
            "delta": "4", "speedFactor": "normc(0.88,0.13,0.5,1.4)", "lcAssertive": "1.5",
        },
        greens=(1.5, 0.8, 1.3),
        cycle_s=80.0,
    ),
    "W99": Truth(
        per_hour=1100.0,
        shares={"car": 0.66, "van": 0.15, "truck": 0.1, "bus": 0.03, "motorcycle": 0.06},
        bicycles=90.0,
        people=320.0,
        drivers={
            "carFollowModel": "W99", "cc1": "1.3", "minGap": "1.7", "accel": "2.2",
            "speedFactor": "normc(0.95,0.09,0.6,1.3)",
        },
        greens=(0.9, 1.6),
        actuated=True,
        cycle_s=100.0,
        platoon_share=0.6,
        sublane_m=0.8,
    ),
    "EIDM": Truth(
        per_hour=1200.0,
        shares={"car": 0.8, "van": 0.08, "truck": 0.06, "bus": 0.03, "motorcycle": 0.03},
        bicycles=120.0,
        people=150.0,
        drivers={
            "carFollowModel": "EIDM", "tau": "1.2", "minGap": "2.2", "accel": "2.0",
            "speedFactor": "normc(0.92,0.1,0.6,1.3)",
        },
        greens=(1.3, 1.3),
        cycle_s=75.0,
    ),
}  # fmt: skip


def judge(site: Path, name: str, out: Path, seconds: float, seed: int) -> dict[str, Any]:
    """Make a recording, calibrate to it, and return the figures."""
    out.mkdir(parents=True, exist_ok=True)
    truth = TRUTHS[name]
    twin_folder = out / "twin"
    if twin_folder.exists():
        twin = load_twin(twin_folder)
    else:
        twin = build_twin(load_site(site), twin_folder, lambda *_: None)
    tracks = drive(twin, truth, seconds, seed, out / "truth")
    file = write_recording(twin, tracks, truth, out / "truth/states.xml", seed, out)
    again = drive(twin, truth, seconds, seed + 1000, out / "again")
    links = JunctionLinks.of(twin.net_path, twin.roads)

    def part(of: list[Any], begin_s: float, end_s: float) -> Any:
        passages = passages_of(of, twin.roads, links)
        return measured(of, passages, twin.roads, begin_s, end_s)

    held_out = part(tracks, FIT_SHARE * seconds + GAP_S, seconds)
    chance = agreement(held_out, part(again, 0.0, seconds))
    began = time.perf_counter()
    report = calibrate_traffic(
        file, site, out / "calibrated", fit_share=FIT_SHARE, gap_s=GAP_S, seconds=3600.0, seed=1
    )
    row = {
        "place": site.parent.name,
        "truth": name,
        "seconds": round(time.perf_counter() - began),
        "held_out": report["held_out"],
        "fitted": report["fitted"],
        "truth_again": chance,
        "fitted_with_held_out": report["fitted_with_held_out"],
        "drivers": {one["field"]: one for one in report["drivers"]},
        "not_told": report["not_told"],
    }
    (out / "row.json").write_text(json.dumps(row, indent=1))
    return row


def table(rows: list[dict[str, Any]]) -> str:
    """Return the figures as text."""
    lines = [f"{'place':24} {'truth':5} {'':22} " + " ".join(f"{x:>20}" for x in FIGURES)]
    for row in rows:
        for key in ("fitted", "held_out", "truth_again", "fitted_with_held_out"):
            told = " ".join(f"{row[key][x]!s:>20}" for x in FIGURES)
            lines.append(f"{row['place']:24} {row['truth']:5} {key:22} {told}")
    lines.append(f"{'wanted':53} " + " ".join(f"{x:>20}" for x in WANTED))
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sites", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, default=Path("calibrated"))
    parser.add_argument("--truth", choices=list(TRUTHS), default="IDM")
    parser.add_argument("--seconds", type=float, default=3600.0, help="of the recording")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    rows = []
    for site in given.sites:
        out = given.out / f"{site.resolve().parent.name}-{given.truth}"
        rows.append(judge(site.resolve(), given.truth, out, given.seconds, given.seed))
        print(table(rows[-1:]), flush=True)
    print(table(rows))


if __name__ == "__main__":
    main()
