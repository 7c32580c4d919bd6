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
import threading
import time
from contextlib import suppress
from pathlib import Path

import urbantwin as ut
from urbantwin.traffic import run_traffic

#: How often is looked at how much memory processes have, seconds.
_EVERY_S = 0.2


class ChildrensMemory(threading.Thread):
    """Looks at the most memory that any one child of this process has ever had (Linux).

    ``ru_maxrss`` of children does not tell: it has what their parent had when it started them
    (getrusage(2); the kernel's ``exec_mmap``).

    Attributes:
        most: bytes.
    """

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.most = 0
        self._done = threading.Event()

    def run(self) -> None:
        """Look until `stop`."""
        while not self._done.wait(_EVERY_S):
            for task in Path("/proc/self/task").iterdir():
                with suppress(OSError):
                    for child in (task / "children").read_text().split():
                        self._look(Path("/proc") / child / "status")

    def stop(self) -> None:
        """Look no longer."""
        self._done.set()
        self.join()

    def _look(self, status: Path) -> None:
        with suppress(OSError):  # it has ended
            for line in status.read_text(encoding="utf-8").splitlines():
                if line.startswith("VmHWM:"):
                    self.most = max(self.most, int(line.split()[1]) * 1024)


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
    children = ChildrensMemory()
    children.start()
    with tempfile.TemporaryDirectory() as folder:
        motion = run_traffic(
            twin, Path(folder) / "motion", seconds=given.seconds, seed=given.seed, changes=fewer
        )
    took = time.perf_counter() - began
    children.stop()
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
    most = own.ru_maxrss * 1024  # kibibytes
    print(f"memory at most {most / 1e9:.2f} GB, SUMO {children.most / 1e9:.2f} GB")
    told = motion.manifest["overlaps"]
    print(f"pairs in each other {told['between']}, with the scene {told['with']}")


if __name__ == "__main__":
    main()
