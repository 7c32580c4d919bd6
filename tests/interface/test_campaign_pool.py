"""Workers of a campaign that is cut off: they end, whatever they are at."""

import threading
import time
from concurrent.futures import wait
from dataclasses import dataclass
from pathlib import Path

from urbantwin.campaigns import Outcome, Step
from urbantwin.interface.campaign import _pool
from urbantwin.interface.campaign_step import make


@dataclass
class Long:
    """Makes steps: one at once, and one that takes a while to end when it is interrupted."""

    place: Path

    def outcome(self, step: Step) -> Outcome:
        if step.name == "short":
            return Outcome(why="no room", no_room=True)
        try:
            (self.place / "begun").touch()
            time.sleep(60)
        finally:
            time.sleep(1)
        return Outcome()


def _cut_off(place: Path) -> None:
    steps = [Step("dataset", name, "", (), {}) for name in ("long", "short")]
    try:
        with _pool(Long(place), 2) as pool:
            futures = [pool.submit(make, one) for one in steps]
            wait(futures[1:])
            while not (place / "begun").exists():
                time.sleep(0.01)
            raise OSError
    except OSError:
        (place / "ended").touch()


def test_a_worker_that_is_at_something_ends_with_the_campaign(tmp_path: Path) -> None:
    run = threading.Thread(target=_cut_off, args=(tmp_path,), daemon=True)
    run.start()
    run.join(40)
    assert (tmp_path / "ended").exists()
