"""What a campaign of many frames takes: machines, hours, storage, money, by what one took.

Costs are those that `urbantwin experiment run` noted of every step in its journal: time of
processors, children included, and bytes. Prices are given; those here are assumptions.

    urbantwin experiment run grid.yaml -o campaign/
    python benchmarks/scale.py campaign/ --frames 1e5 1e6 1e7
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from pathlib import Path


def costs(campaign: Path) -> dict[str, float]:
    """What was measured: seconds of a processor for a twin, a second of traffic and a frame."""
    total: dict[str, float] = defaultdict(float)
    journal = campaign / "journal" / "steps.jsonl"
    rows = {row["cell"]: row for row in map(json.loads, journal.read_text().splitlines())}
    for cell, row in rows.items():
        kind = cell.partition("s/")[0]
        if row.get("state") == "done":
            total[f"{kind}_s"] += row["processor_s"]
            total[f"{kind}_size"] += row["size"]
            total["bytes"] += row.get("bytes", 0)
    told = {f"{kind}_s": total[f"{kind}_s"] / max(total[f"{kind}_size"], 1)
            for kind in ("twin", "motion", "dataset")}  # fmt: skip
    return {**told, "frame_bytes": total["bytes"] / max(total["dataset_size"], 1)}


def main() -> None:
    """Print what was measured, and a row for each number of frames."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("campaign", type=Path)
    options.add_argument("--frames", type=float, nargs="+", default=[1e5, 1e6, 1e7])
    options.add_argument("--sites", type=int, default=50)
    options.add_argument("--recordings", type=int, default=4, help="of each motion")
    options.add_argument("--rate", type=float, default=10.0, help="frames a second of motion")
    options.add_argument("--processors", type=int, default=256)
    options.add_argument("--hour", type=float, default=0.045, help="price of a processor's hour")
    options.add_argument("--month", type=float, default=0.023, help="price of a GB for a month")
    options.add_argument("--months", type=float, default=3.0)
    given = options.parse_args()
    one = costs(given.campaign)
    print(", ".join(f"{name} {value:.4g}" for name, value in one.items()))
    print(
        "| frames | processor hours | hours | TB | computing | storage |\n|---|---|---|---|---|---|"
    )
    for frames in given.frames:
        seconds = (
            frames * one["dataset_s"]
            + frames / given.rate / given.recordings * one["motion_s"]
            + given.sites * one["twin_s"]
        )
        hours, size = seconds / 3600, frames * one["frame_bytes"]
        print(
            f"| {frames:,.0f} | {hours:,.0f} | {hours / given.processors:.1f} | {size / 1e12:.2f} "
            f"| ${hours * given.hour:,.0f} | ${size / 1e9 * given.month * given.months:,.0f} |"
        )


if __name__ == "__main__":
    main()
