"""A process without threads that has everything imported: children are forked from it.

Run by hand, it reads many mutations and tells what it found:

    python tests/fuzz/server.py test_input_readers --mutations 2000 [--reader NAME] [--first 0]
    python tests/fuzz/server.py test_input_readers --reader NAME --show 17 > bad-file
"""

import argparse
import gc
import importlib
import json
import os
import select
import signal
import sys
import tempfile
import time
import traceback
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numba

ROOT = Path(__file__).parents[2]
#: What readers import when they are called: once here, and not in every child.
LATE = [
    *("urbantwin.roads.imported", "urbantwin.reconstruct.describe", "urbantwin.fidelity.clouds"),
    *("urbantwin.lidar.scanner", "rasterio.warp", "rasterio.windows", "scipy.ndimage"),
]
#: Seconds of the clock for one mutation; the limit is one of the processor, which others use too.
PATIENCE = 60.0


@cache
def _begin() -> None:
    """Import what all tables need."""
    # A package of this name may be installed by others; ours is a folder.
    sys.path[0] = str(ROOT / "src")
    package = ModuleType("tests")
    package.__path__ = [str(ROOT / "tests")]
    sys.modules["tests"] = package
    for name in LATE:
        importlib.import_module(name)
    numba.njit(lambda number: number)(0)  # what any first call sets up


@cache
def _load(table: str) -> list[Any]:
    """Return the readers of a file of this folder, as its package would import it."""
    _begin()
    readers = importlib.import_module(f"tests.fuzz.{table}").READERS
    # What is imported is no garbage: no child looks through it, which copies it.
    gc.collect()
    gc.freeze()
    return readers


def _processor_time(pid: int) -> float:
    """Seconds of processor time that a process has had."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def run_reader(reader: Any, first: int, last: int) -> dict[str, Any]:
    """Read mutations ``first`` to ``last`` - 1 in children; a child that dies is replaced.

    Returns:
        ``problems``: number -> what went wrong; ``wall_s``; ``slowest_s`` (of the processor), and
        which one it was, ``slowest``.
    """
    began = time.monotonic()
    problems: dict[int, str] = {}
    state: dict[str, Any] = {"slowest_s": 0.0, "slowest": None}
    seeds, beside = list(reader.seeds()), reader.files_beside()
    while first < last:
        first = _run_child(reader, seeds, beside, first, last, problems, state)
    return {"problems": problems, "wall_s": round(time.monotonic() - began, 2), **state}


def _run_child(  # noqa: PLR0912, PLR0915
    reader: Any,
    seeds: list[bytes],
    beside: Any,
    first: int,
    last: int,
    problems: dict[int, str],
    state: dict[str, Any],
) -> int:
    """Read until all is read or a mutation ends the child; return which is the next one."""
    from tests.fuzz.one_child import read_all

    hear, say = os.pipe()
    with tempfile.TemporaryFile() as output:
        pid = os.fork()
        if pid == 0:
            code = 1
            try:
                os.close(hear)
                for stream in (1, 2):
                    os.dup2(output.fileno(), stream)
                read_all(reader, seeds, beside, first, last, say)
                code = 0
            except BaseException:
                traceback.print_exc()
                sys.stderr.flush()
            finally:
                os._exit(code)
        os.close(say)
        now, pending, killed, done = None, b"", "", False
        spent = started = limit = 0.0
        while True:
            ready, _, _ = select.select([hear], [], [], 0.5)
            if ready:
                piece = os.read(hear, 1 << 16)
                if not piece:
                    break
                *lines, pending = (pending + piece).split(b"\n")
                for line in map(json.loads, lines):
                    done = done or "done" in line
                    if "begin" in line:
                        limit = reader.seconds * (6 if "warm" in line else 1)
                        now, spent, started = line["begin"], _processor_time(pid), time.monotonic()
                    if "end" in line:
                        took = _processor_time(pid) - spent
                        if took > state["slowest_s"]:
                            state.update(slowest_s=round(took, 2), slowest=now)
                        if "problem" in line:
                            problems[line["end"]] = line["problem"]
                        now, first = None, line["end"] + 1
            elif now is not None and (
                _processor_time(pid) - spent > limit or time.monotonic() - started > PATIENCE
            ):
                killed = f"took more than {limit:g} s"
                os.kill(pid, signal.SIGKILL)
        os.close(hear)
        _, status = os.waitpid(pid, 0)
        if done:
            return last
        output.seek(0)
        said = output.read()[-3000:].decode(errors="replace")
    if now is None:
        raise RuntimeError(f"{reader.name}: the harness itself failed at mutation {first}: {said}")
    ended = os.waitstatus_to_exitcode(status)
    problems[now] = killed or f"ended the process ({ended}): {' '.join(said.split())[-700:]}"
    return now + 1


def _serve() -> None:
    """Answer lines ``{"table": NAME, "reader": NAME, "first": 0, "last": 50}`` until the last."""
    answers = os.dup(1)
    os.dup2(2, 1)
    _begin()
    from tests.fuzz.artefact_set import PLACE

    for line in sys.stdin:
        asked = json.loads(line)
        if asked["artefacts"]:
            os.environ[PLACE] = asked["artefacts"]
        try:
            readers = {reader.name: reader for reader in _load(asked["table"])}
            answer = run_reader(readers[asked["reader"]], asked["first"], asked["last"])
        except Exception as error:
            answer = {"failed": f"{type(error).__name__}: {error}"}
        os.write(answers, json.dumps(answer).encode() + b"\n")


def _by_hand(arguments: argparse.Namespace) -> None:
    readers = _load(arguments.table)
    from tests.fuzz.mutation import mutation

    for reader in readers:
        if arguments.reader and arguments.reader != reader.name:
            continue
        if arguments.show is not None:
            sys.stdout.buffer.write(mutation(reader.name, arguments.show, reader.seeds()).data)
            continue
        first = arguments.first
        found = run_reader(reader, first, first + arguments.mutations)
        problems = found["problems"]
        print(
            f"{reader.name}: {arguments.mutations} mutations in {found['wall_s']} s, slowest "
            f"{found['slowest_s']} s ({found['slowest']}), {len(problems)} failures",
            flush=True,
        )
        kinds: dict[str, list[int]] = {}
        for number, problem in problems.items():
            kinds.setdefault(problem.rpartition(" at ")[2], []).append(number)
        for numbers in sorted(kinds.values(), key=len, reverse=True):
            shown = ", ".join(map(str, numbers[:5]))
            print(f"  {len(numbers)} x [{shown}] {problems[numbers[0]]}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("table", nargs="?")
    parser.add_argument("--serve", action="store_true")
    parser.add_argument("--reader")
    parser.add_argument("--mutations", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--show", type=int)
    wanted = parser.parse_args()
    if wanted.serve:
        _serve()
    else:
        _by_hand(wanted)
