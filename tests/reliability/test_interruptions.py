"""Signals while Python starts, twice, and to all processes at once; and two runs on one output."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ..thorough import further
from .kill_harness import PATIENCE_S, SCRATCH, check_whole, finish, killed, processes_of
from .small_site import COMMANDS, Stand, command_line

#: A run ends so soon after an interruption, on a machine that many share.
SOON_S = 3.0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("after_ms", [0, 20, 100, 400])
def test_an_interruption_while_python_starts(
    stand: Stand, tmp_path: Path, number: signal.Signals, after_ms: int
) -> None:
    out = tmp_path / "out" / "twin"
    arguments = ["build", stand.site, "-o", out, "--no-pictures"]
    ended = killed(arguments, stand.environment(tmp_path), after_ms / 1000, number)
    assert ended.in_time
    if (ended.heard and number != signal.SIGINT) or ended.code == 130:
        assert (ended.code, ended.err) == (130, "error: interrupted\n")
    else:  # before the first line of our own code: Python's own ways to end
        assert ended.code in ((-number, 1) if number == signal.SIGINT else (-number,))
    assert not list((tmp_path / "out").glob("*"))  # the command may have made its empty parent
    assert not list((tmp_path / "tmp").iterdir())


def ran(script: str) -> subprocess.CompletedProcess[str]:
    """Run a script to its end in a process of its own."""
    command = [sys.executable, "-c", script]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)


#: A signal that comes while LLVM asks Python for what it compiled before.
WITHIN_THE_COMPILER = """
import signal, sys
import numba
from urbantwin.interruption import unwinds

def meet(frame, event, argument):
    if event == "call" and frame.f_code.co_name == "_raw_object_cache_getbuffer":
        sys.setprofile(None)
        signal.raise_signal(signal.SIGTERM)

@numba.njit
def twice(x):
    return 2 * x

try:
    with unwinds():
        sys.setprofile(meet)
        print(twice(3), flush=True)
        while True:
            pass
except KeyboardInterrupt:
    print("unwound")
"""


#: A signal that comes while Python forgets something, where exceptions are printed and dropped.
WITHIN_A_CALLBACK = """
import signal, weakref
from urbantwin.interruption import unwinds

class Thing:
    pass

try:
    with unwinds():
        thing = Thing()
        watched = weakref.ref(thing, lambda _: signal.raise_signal(signal.SIGTERM))
        del thing
        while True:
            pass
except KeyboardInterrupt:
    print("unwound")
"""


def test_an_interruption_that_python_drops_comes_again() -> None:
    done = ran(WITHIN_A_CALLBACK)
    assert (done.returncode, done.stdout, done.stderr) == (0, "unwound\n", "")


#: A library that swallows whatever comes while it looks for another one, as pyarrow does.
SWALLOWED = """
import signal, time
from urbantwin.interruption import deferred, unwinds

cleaned = False
try:
    with unwinds() as heard:
        try:
            signal.raise_signal(signal.SIGTERM)
        except:
            time.sleep(0.3)  # it is handled so long, and comes again only then
        began = time.monotonic()
        try:
            while time.monotonic() < began + 10:
                time.sleep(0.001)
        finally:
            before = time.monotonic()
            while time.monotonic() < before + 0.3:  # cleaning up is not cut
                pass
            with deferred():
                time.sleep(0.3)
            cleaned = True
except KeyboardInterrupt:
    print("unwound", cleaned, before - began < 0.5, heard.count)
time.sleep(0.3)  # nothing comes afterwards
"""


def test_an_interruption_that_a_library_swallows_comes_again() -> None:
    done = ran(SWALLOWED)
    assert (done.returncode, done.stdout, done.stderr) == (0, "unwound True True 1\n", "")


@pytest.mark.parametrize("key", ["record", *further("traffic", "build")])
@pytest.mark.parametrize("moment", [4, *further(1, 2, 3, 5, 6)])  # quarters of a second
def test_one_interruption_in_the_first_seconds_ends_the_run(
    stand: Stand, tmp_path: Path, key: str, moment: int
) -> None:
    """At any moment: imports and start are where libraries swallow exceptions."""
    process = subprocess.Popen(
        command_line(COMMANDS[key].arguments(stand, tmp_path / "out" / COMMANDS[key].output)),
        env=stand.environment(tmp_path),
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    assert process.stderr is not None
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.25 * moment)
    os.kill(process.pid, signal.SIGINT)
    began = time.monotonic()
    assert process.wait(PATIENCE_S) in (130, -signal.SIGINT)
    assert time.monotonic() - began < SOON_S
    assert process.stderr.read() in (b"error: interrupted\n", b"")
    process.stderr.close()


#: Two signals while a thread is in compiled code, and a Python that takes long to take apart.
WITHIN_A_THREAD = """
import signal, threading, time
from concurrent.futures import ThreadPoolExecutor
import pythoncdt
from urbantwin.interruption import EXIT_CODE, ends_at_once, leave, unwinds

ends_at_once()

class Slow:
    def __del__(self):
        time.sleep(0.5)

slow = Slow()
points = [pythoncdt.V2d(i * 0.618034 % 1, i * 0.754877 % 1) for i in range(50_000)]
begun = threading.Event()

def triangulate():
    begun.set()
    while True:
        mesh = pythoncdt.Triangulation(
            pythoncdt.VertexInsertionOrder.AUTO,
            pythoncdt.IntersectingConstraintEdges.TRY_RESOLVE,
            0.0,
        )
        mesh.insert_vertices(points)

def interrupt():
    begun.wait()
    for number in (1, 2):
        time.sleep(0.05)
        signal.pthread_kill(threading.main_thread().ident, signal.SIGTERM)
        while heard.count < number:
            time.sleep(0.01)

with unwinds() as heard:
    try:
        with ThreadPoolExecutor(1) as pool:
            pool.submit(triangulate)
            threading.Thread(target=interrupt, daemon=True).start()
            time.sleep(60)
    except KeyboardInterrupt:
        pass
leave(EXIT_CODE)
"""


def test_a_thread_that_still_works_does_not_crash_an_interrupted_process() -> None:
    done = ran(WITHIN_A_THREAD)
    assert (done.returncode, done.stderr) == (130, "")


def test_an_interruption_of_the_compiler_waits_until_it_has_returned() -> None:
    done = ran(WITHIN_THE_COMPILER)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.endswith("unwound\n")


def waited(stand: Stand, tmp_path: Path, key: str) -> tuple[subprocess.Popen[bytes], Path]:
    """Start a command and wait until it has its scratch."""
    out = tmp_path / "out" / COMMANDS[key].output
    process = subprocess.Popen(
        command_line(COMMANDS[key].arguments(stand, out)),
        env=stand.environment(tmp_path),
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    began = time.monotonic()
    while not (out.parent.exists() and any(map(held, out.parent.iterdir()))):
        assert time.monotonic() - began < PATIENCE_S
        assert process.poll() is None
        time.sleep(0.005)
    return process, out


def held(path: Path) -> bool:
    """Whether a path is the scratch of a run that has written to it."""
    return bool(SCRATCH.fullmatch(path.name)) and any(path.iterdir())


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("key", "to_all"),
    [("traffic", False), ("record", True), *further(("traffic", True), ("record", False))],
    ids=["traffic-twice", "record-all", "traffic-all", "record-twice"],
)
def test_an_interruption_of_all_at_once_and_twice(
    stand: Stand, tmp_path: Path, key: str, to_all: bool
) -> None:
    process, out = waited(stand, tmp_path, key)
    assert process.stderr is not None
    time.sleep(0.1)
    if to_all:  # what a terminal that closes does, or `timeout`
        os.killpg(process.pid, signal.SIGTERM)
    else:
        os.kill(process.pid, signal.SIGTERM)
        time.sleep(0.05)
        os.kill(process.pid, signal.SIGINT)
    assert process.wait(PATIENCE_S) == 130
    while processes_of(process.pid):
        time.sleep(0.02)
    assert process.stderr.read() == b"error: interrupted\n"
    process.stderr.close()
    left = list(out.parent.iterdir()) if out.parent.exists() else []
    assert all(one.name.endswith(".urbantwin-partial") for one in left)
    assert COMMANDS[key].resumes or not left
    assert not list((tmp_path / "tmp").iterdir())


@pytest.mark.thorough
def test_a_second_run_is_refused_and_the_first_ends_whole(stand: Stand, tmp_path: Path) -> None:
    stand.expected("traffic")
    process, out = waited(stand, tmp_path, "traffic")
    assert process.stderr is not None
    second = stand.ran(COMMANDS["traffic"].arguments(stand, out), tmp_path)
    assert process.poll() is None, "the first was over too soon for this test"
    assert second == (
        2,
        f"error: {out}: another run is writing it (process {process.pid}); "
        "expected another output, or to wait for that run\n",
    )
    assert process.wait(PATIENCE_S) == 0
    assert process.stderr.read() == b""
    process.stderr.close()
    check_whole(stand, "traffic", COMMANDS["traffic"], out, tmp_path)


@pytest.mark.parametrize("key", ["traffic", "record"])
def test_a_killed_run_leaves_no_lock_and_is_gone_on_with(
    stand: Stand, tmp_path: Path, key: str
) -> None:
    stand.expected(key)
    process, out = waited(stand, tmp_path, key)
    while key == "record" and not any(out.parent.glob("*/done/*.json")):
        assert process.poll() is None
        time.sleep(0.005)
    process.kill()
    process.wait()
    assert process.stderr is not None
    process.stderr.close()
    finish(stand, key, COMMANDS[key], out, tmp_path)  # at once: SUMO may still be ending
