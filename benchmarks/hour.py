"""What a simulated hour of traffic takes: processor time, beside SUMO's own, and memory.

Processor time, so that whatever else runs on the machine counts little; SUMO runs in processes of
its own (the pilots that find how many circulate are among them).

    python benchmarks/hour.py places/munich/twin
    python benchmarks/hour.py places/munich/twin --seconds 900 --seed 3
    python benchmarks/hour.py places/munich/twin --share 0.66  # of its traffic
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from pathlib import Path

import urbantwin as ut
from urbantwin.traffic import run_traffic


def main() -> None:
    """Drive a twin and print what it took."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("twin", type=Path, help="a twin's folder")
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--share", type=float, default=1.0, help="of the traffic of the site")
    given = parser.parse_args()
    twin = ut.Twin.open(given.twin)
    asked = twin.site["traffic"]["per_hour"]
    fewer = {"per_hour": {name: count * given.share for name, count in asked.items()}}
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        motion = run_traffic(
            twin, Path(folder) / "motion", seconds=given.seconds, seed=given.seed, changes=fewer
        )
    took = time.perf_counter() - began
    own, sumo = (
        resource.getrusage(whose) for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    ours, theirs = own.ru_utime + own.ru_stime, sumo.ru_utime + sumo.ru_stime
    rows = motion.rows.num_rows
    at_once = rows / motion.manifest["steps"]
    print(f"{rows} poses, {at_once:.0f} actors at a time, {took:.0f} s on this machine")
    print(
        f"SUMO {theirs:.0f} s of processor time, the rest {ours:.0f} s: {ours / theirs:.2f} of it"
    )
    most, most_of_sumo = (one.ru_maxrss * 1024 / 1e9 for one in (own, sumo))  # kibibytes
    print(f"memory at most {most:.2f} GB, SUMO {most_of_sumo:.2f} GB")
    told = motion.manifest["overlaps"]
    print(f"pairs in each other {told['between']}, with the scene {told['with']}")


if __name__ == "__main__":
    main()
