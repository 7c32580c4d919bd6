"""Every command killed: bytes, processes and files afterwards; `-m kills` for all moments."""

import random
import shutil
import signal
from pathlib import Path

import pytest

from ..thorough import further
from .kill_harness import PATIENCE_S, check_left, finish, killed, place_for
from .small_site import COMMANDS, Stand

#: So many random moments of each command.
MOMENTS = {"record": 50, "compare": 7, "compare-control": 3}
MOST = [(key, n) for key in COMMANDS for n in range(MOMENTS.get(key, 10))]
#: In make thorough, late enough that something is there.
FEW = further(("record", 0.7), ("build", 0.8), ("traffic", 0.6), ("tune", 0.85))


def check_killed(
    stand: Stand, key: str, place: Path, share: float, number: signal.Signals, *, older: bool
) -> None:
    command = COMMANDS[key]
    older = older or command.in_place
    duration_s = stand.duration_s(key)
    out = place_for(stand, command, place, older=older)
    ended = killed(
        command.arguments(stand, out), stand.environment(place), share * duration_s, number
    )
    if ended.in_time and number == signal.SIGKILL:
        assert ended.code == -signal.SIGKILL
    elif ended.in_time and ended.code == 130:
        assert ended.err == "error: interrupted\n"
    else:
        assert (ended.code, ended.err) == (0, "")
    assert ended.survivors_s < PATIENCE_S
    scratch = number == signal.SIGKILL or command.resumes
    check_left(stand, key, command, out, older=older, scratch=scratch)
    finish(stand, key, command, out, place)
    print(  # the figures of `make kills`
        f"{key} {number.name} at {share:.3f} of {duration_s:.1f} s, older {older}, "
        f"{'in time' if ended.in_time else 'over'}, children gone after {ended.survivors_s:.2f} s"
    )
    shutil.rmtree(place)


@pytest.mark.kills
@pytest.mark.parametrize(("key", "n"), MOST, ids=str)
def test_a_random_moment(stand: Stand, tmp_path: Path, key: str, n: int) -> None:
    share = random.Random(f"{key} {n}").uniform(0.0, 1.0)
    check_killed(stand, key, tmp_path / "place", share, signal.SIGKILL, older=n % 2 == 1)


@pytest.mark.kills
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("key", COMMANDS)
def test_an_interruption(stand: Stand, tmp_path: Path, key: str, number: signal.Signals) -> None:
    share = random.Random(f"{key} {number}").uniform(0.1, 0.95)
    check_killed(stand, key, tmp_path / "place", share, number, older=False)


@pytest.mark.parametrize(("key", "share"), FEW)
def test_a_moment(stand: Stand, tmp_path: Path, key: str, share: float) -> None:
    number = signal.SIGTERM if key in ("background", "tune") else signal.SIGKILL
    check_killed(stand, key, tmp_path / "place", share, number, older=False)
