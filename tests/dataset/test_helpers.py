"""Processes that help to record: what they get, and one recording after the other."""

import os
import signal
import time
from concurrent.futures import Future
from threading import Thread

import pytest

from urbantwin.dataset import record
from urbantwin.dataset.ignore_regions import areas_of
from urbantwin.dataset.rehearsal import rehearse
from urbantwin.lidar.sight import ignore_areas
from urbantwin.processes import Helpers, handed, helpers, over, received, settle


def test_helpers_serve_one_recording_after_the_other(twin, motion, rig, tmp_path, digests):
    """The second is of another seed: they must not go on with what they have of the first."""
    with helpers(2, rehearse) as crew:
        for seed in (5, 6):
            record(twin, motion, rig, tmp_path / f"with{seed}", workers=crew, seed=seed, stop_s=0.5)
    for seed in (5, 6):
        record(twin, motion, rig, tmp_path / f"alone{seed}", workers=1, seed=seed, stop_s=0.5)
        assert digests(tmp_path / f"with{seed}") == digests(tmp_path / f"alone{seed}")
    assert digests(tmp_path / "with5") != digests(tmp_path / "with6")


def test_this_process_is_one_of_the_workers():
    with helpers(3, int) as crew:
        others = {crew.pool.submit(os.getpid).result() for _ in range(20)}
        assert crew.workers == 3
        assert os.getpid() not in others
        assert len(others) <= 2
    with helpers(1, int) as crew:
        assert crew.pool is None


def test_what_is_handed_reaches_others_as_long_as_the_block_runs():
    value = {"numbers": list(range(100_000)), "text": "ä"}
    with helpers(2, int) as crew:
        with handed(value) as place:
            assert crew.pool.submit(received, place).result() == value
        with pytest.raises(FileNotFoundError):
            crew.pool.submit(received, place).result()


@pytest.mark.thorough
def test_helpers_write_nothing_when_a_recording_has_been_interrupted(twin, motion, rig, tmp_path):
    """They stay, and another run may work on the same output by then."""

    def stop(_share, doing):
        if doing.startswith("frame 2 "):
            raise KeyboardInterrupt

    def files():
        inside = [path for path in tmp_path.rglob("*") if path.is_file()]
        return {path: path.stat().st_mtime_ns for path in inside}

    with helpers(2, rehearse) as crew:
        with pytest.raises(KeyboardInterrupt):
            record(twin, motion, rig, tmp_path / "out", workers=crew, seed=5, progress=stop)
        there = files()
        time.sleep(1.0)
        assert files() == there
        record(twin, motion, rig, tmp_path / "out", workers=crew, seed=5)
    assert (tmp_path / "out" / "SHA256SUMS").is_file()


def test_helpers_find_the_areas_to_ignore_and_are_not_missed_when_killed(twin, rig):
    def areas(crew):
        with areas_of({"a": rig}, twin.mesh, twin.region, crew) as found:
            return [(one.reason, one.area.wkb) for one in found("a")]

    expected = [(one.reason, one.area.wkb) for one in ignore_areas(rig, twin.mesh, twin.region)]
    assert {"outside", "unseen"} <= {reason for reason, _ in expected}
    assert areas(Helpers(1, None)) == expected
    with helpers(2, int) as crew:
        assert areas(crew) == expected
        os.kill(crew.pool.submit(os.getpid).result(), signal.SIGKILL)
        assert areas(crew) == expected


def test_nobody_waits_for_what_was_lost_with_the_last_helper():
    """A future that a pool no longer knows of, while it still has workers and when it has none."""
    lost, done = Future(), Future()
    lost.set_running_or_notify_cancel()
    done.set_result(1)
    waiting = Thread(target=settle, args=([lost, done],), daemon=True)
    with helpers(2, int) as crew:
        assert crew.pool.submit(os.getpid).result()
        waiting.start()
        waiting.join(1.0)
        assert waiting.is_alive()
        assert over([lost, done]) == {done}
        crew.pool.shutdown()
        waiting.join(10.0)
        assert not waiting.is_alive()
    assert over([lost]) == set()
