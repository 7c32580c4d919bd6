"""Workers of an experiment that is cut off: they end, whatever they are at."""

import importlib
import threading
import time
from concurrent.futures import wait
from pathlib import Path

import pytest

from urbantwin.experiments.course import Step
from urbantwin.experiments.workers import local_pool, make

#: A module that workers can import, which those of tests are not.
_MAKER = """
import time
from dataclasses import dataclass
from pathlib import Path

from urbantwin.errors import NoRoomError


@dataclass
class Long:
    place: Path

    def made(self, step, workers, tell):
        if step.name == "short":
            raise NoRoomError("no room")
        try:
            (self.place / "begun").touch()
            time.sleep(60)
        finally:
            time.sleep(1)  # it takes a while to end when it is interrupted
        return {}
"""


def _cut_off(maker, place: Path) -> None:
    steps = [Step("dataset", name, "", (), {}) for name in ("long", "short")]
    try:
        with local_pool(maker, place, 2) as pool:
            futures = [pool.submit(make, one) for one in steps]
            wait(futures[1:])
            while not (place / "begun").exists():
                time.sleep(0.01)
            raise OSError
    except OSError:
        (place / "ended").touch()


@pytest.mark.thorough
def test_a_worker_that_is_at_something_ends_with_the_campaign(tmp_path, monkeypatch) -> None:
    (tmp_path / "maker_of_steps.py").write_text(_MAKER)
    monkeypatch.syspath_prepend(tmp_path)
    maker = importlib.import_module("maker_of_steps").Long(tmp_path)
    run = threading.Thread(target=_cut_off, args=(maker, tmp_path), daemon=True)
    run.start()
    run.join(40)
    assert (tmp_path / "ended").exists()
