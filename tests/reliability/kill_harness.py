"""Killing the program: a moment, a signal, what is left, and the same command once more."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

from urbantwin.artefact.written_files import RECORD

from .small_site import Command, Stand, bytes_of, command_line

#: A machine that many share is slow at times.
PATIENCE_S = 60.0
SCRATCH = re.compile(r"\..+\.\d+(\.[0-9a-f]{16}\.urbantwin-partial|\.urbantwin-(new|old))")
#: Whole entries of the cache: the arbitrary site's, and what runs of SUMO showed.
_CONTROL = re.compile(r"cache/urbantwin(/arbitrary(/[0-9a-f]{24}(/two-avenues(/.+)?)?)?)?")
_RUNS = re.compile(r"cache/urbantwin(/sumo(/[0-9a-f]{32}(/(rows\.npy|outcome\.json))?)?)?")
PARTS = ("twin", "motion", "dataset")


@dataclass(frozen=True)
class Ended:
    """How a run ended.

    Attributes:
        code: its exit code, or minus the signal.
        err: what it said on standard error.
        in_time: whether the signal met it alive.
        survivors_s: how long its children outlived it.
        heard: whether it had said before what is to become of the signal.
    """

    code: int
    err: str
    in_time: bool
    survivors_s: float
    heard: bool = True


def killed(
    arguments: list[object],
    environment: dict[str, str],
    after_s: float,
    number: signal.Signals = signal.SIGKILL,
) -> Ended:
    """Start a command in a session of its own and send its first process a signal.

    Args:
        arguments: of the program.
        environment: of the process.
        after_s: when, from its start.
        number: the signal.
    """
    process = subprocess.Popen(
        command_line(arguments),
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    assert process.stderr is not None
    try:
        process.wait(after_s)
    except subprocess.TimeoutExpired:
        heard = is_caught(process.pid, number)
        os.kill(process.pid, number)
        in_time = True
    else:
        heard = in_time = False
    code = process.wait(PATIENCE_S)
    # Nobody survives a SIGKILL: it was over when it came, and only waited to be asked.
    in_time &= number != signal.SIGKILL or code != 0
    began = time.monotonic()
    while left := processes_of(process.pid):
        assert time.monotonic() - began < PATIENCE_S, f"still there: {left}"
        time.sleep(0.02)
    survivors_s = time.monotonic() - began
    err = process.stderr.read().decode()
    process.stderr.close()
    return Ended(code, err, in_time, survivors_s, heard)


def is_caught(process: int, number: signal.Signals) -> bool:
    """Return whether a process has a handler of its own, from ``/proc``."""
    status = Path(f"/proc/{process}/status").read_text(encoding="utf-8")
    return bool(int(status.split("SigCgt:")[1].split()[0], 16) >> (number - 1) & 1)


def processes_of(session: int) -> dict[int, str]:
    """Return the processes of a session, and what they are, from ``/proc``."""
    found = {}
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            state, _, _, its_session = (entry / "stat").read_text().rpartition(")")[2].split()[:4]
            if int(its_session) == session and state not in "ZX":
                found[int(entry.name)] = (entry / "cmdline").read_text().replace("\0", " ")
        except (FileNotFoundError, ProcessLookupError):
            continue
    return found


def place_for(stand: Stand, command: Command, place: Path, *, older: bool) -> Path:
    """Make a place for a command's output, with an older one in it, and return the output."""
    out = place / "out" / command.output
    out.parent.mkdir(parents=True)
    if older:
        former = stand.older(command.output)
        (shutil.copytree if former.is_dir() else shutil.copyfile)(former, out)
        if former.is_file():  # which is known to be ours
            shutil.copyfile(former.parent / RECORD, out.parent / RECORD)
    return out


def check_left(
    stand: Stand, key: str, command: Command, out: Path, *, older: bool, scratch: bool = True
) -> None:
    """Check what a killed run left: the older or the new artefact, whole, and scratch.

    Args:
        stand: what is expected.
        key: of the command.
        command: the command.
        out: its output.
        older: whether an older artefact was there.
        scratch: whether scratch may be there.
    """
    hidden = [one.name for one in out.parent.rglob(".*") if one.name.endswith(ENDINGS)]
    visible = [one.name for one in out.parent.iterdir() if one.name not in (*hidden, RECORD)]
    assert set(visible) <= {command.output}
    assert all(SCRATCH.fullmatch(name) for name in hidden)
    assert scratch or not hidden, hidden
    pairs = [(out, stand.expected(key), stand.older(command.output) if older else None)]
    if key == "run":  # each of the three by itself
        pairs = [
            (new / part, want / part, was and was / part)
            for new, want, was in pairs
            for part in PARTS
        ]
    for new, want, was in pairs:
        if was is None and not new.exists():
            continue
        possible = [bytes_of(want)] + ([] if was is None else [bytes_of(was)])
        assert bytes_of(new) in possible, f"{new} is neither the older nor the new one"
        if new.is_dir():
            check_inventory(new)


ENDINGS = (".urbantwin-new", ".urbantwin-partial", ".urbantwin-old")


def check_inventory(folder: Path) -> None:
    """Check an artefact by the program that everybody has."""
    done = subprocess.run(
        ["sha256sum", "--check", "--strict", "--quiet", "SHA256SUMS"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def finish(stand: Stand, key: str, command: Command, out: Path, place: Path) -> None:
    """Give the command once more, check its bytes and that there is nothing else."""
    assert stand.ran(command.arguments(stand, out), place) == (0, "")
    check_whole(stand, key, command, out, place)


def check_whole(stand: Stand, key: str, command: Command, out: Path, place: Path) -> None:
    """Check that an output is as undisturbed, and that nothing else is anywhere."""
    assert bytes_of(out) == bytes_of(stand.expected(key))
    assert {one.name for one in out.parent.iterdir()} - {RECORD} == {command.output}
    assert list((place / "tmp").iterdir()) == []
    cache = [str(one.relative_to(place)) for one in (place / "cache").rglob("*")]
    controls = [name for name in cache if _CONTROL.fullmatch(name)] if command.control else []
    assert sum(name.count("/") == 3 for name in controls) == command.control
    drives = command.control or command.name in ("run", "traffic")
    runs = [name for name in cache if _RUNS.fullmatch(name)] if drives else []
    assert set(cache) <= {*controls, *runs}, cache
