"""What a simulated hour of traffic takes: seconds of each stage, processor time, and memory.

Processor time, so that whatever else runs on the machine counts little; SUMO runs in a process of
its own.

    python benchmarks/hour.py                        # the demo's map, central Helsinki
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
from urbantwin.interface.whole_line import helsinki_extract
from urbantwin.site import init_site, load_site
from urbantwin.traffic import run_traffic
from urbantwin.twin import Twin, build_twin

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


class Stages:
    """The seconds between one stage and the next, as a progress callback sees them.

    Attributes:
        seconds: stage -> seconds, in the order of the stages.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._stage, self._since = "", time.perf_counter()

    def __call__(self, fraction: float, what: str) -> None:
        """Count the time since the last call for the stage that was named there."""
        del fraction
        now = time.perf_counter()
        if self._stage:
            self.seconds[self._stage] = self.seconds.get(self._stage, 0.0) + now - self._since
        self._stage, self._since = what, now


def helsinki(folder: Path) -> Twin:
    """Build the twin that `init` proposes for the demo's map."""
    return build_twin(load_site(init_site(folder / "site", helsinki_extract())), folder / "twin")


def main() -> None:
    """Drive a twin and print what it took."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("twin", type=Path, nargs="?", help="a twin's folder")
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--share", type=float, default=1.0, help="of the traffic of the site")
    given = parser.parse_args()
    scratch = tempfile.TemporaryDirectory()
    folder = Path(scratch.name)
    twin = ut.Twin.open(given.twin) if given.twin else helsinki(folder)
    asked = twin.site["traffic"]["per_hour"]
    fewer = {"per_hour": {name: count * given.share for name, count in asked.items()}}
    began = time.perf_counter()
    children = ChildrensMemory()
    children.start()
    stages = Stages()
    with scratch:
        motion = run_traffic(
            twin,
            folder / "motion",
            seconds=given.seconds,
            seed=given.seed,
            changes=fewer,
            progress=stages,
        )
    took = time.perf_counter() - began
    children.stop()
    own, sumo = (
        resource.getrusage(whose) for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    ours, theirs = own.ru_utime + own.ru_stime, sumo.ru_utime + sumo.ru_stime
    rows = motion.rows.num_rows
    at_once = rows / motion.manifest["steps"]
    for stage, seconds in stages.seconds.items():
        print(f"{seconds:7.1f} s  {stage}")
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
