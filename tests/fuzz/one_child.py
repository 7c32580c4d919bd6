"""What a child does: reads one bad file after the other, and says what came of each."""

import contextlib
import faulthandler
import json
import os
import resource
import shutil
import tempfile
import traceback
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

from urbantwin.errors import InputError, StageError

from .mutation import mutation
from .reader import Reader

__all__ = ["MEMORY", "read_all"]

#: Bytes that reading may take, of private writable memory beyond what the process has.
MEMORY = 2 << 30
#: Characters that a person is ready to read.
LONGEST_MESSAGE = 1200


def _limit_memory() -> None:
    """Let more than ``MEMORY`` be refused.

    RLIMIT_DATA counts private writable pages as they are asked for, whether touched or not; and
    not, as RLIMIT_AS does, the address space that Embree and Arrow reserve.
    """
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    data = next(line for line in status.splitlines() if line.startswith("VmData"))
    limit = int(data.split()[1]) * 1024 + MEMORY
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def read_all(
    reader: Reader,
    seeds: Sequence[bytes],
    beside: Mapping[str, bytes],
    first: int,
    last: int,
    say: int,
) -> None:
    """Read mutations ``first`` to ``last`` - 1; say by one JSON line each what came of it.

    Args:
        reader: what reads.
        seeds: sound files.
        beside: files beside it.
        first: number of a mutation.
        last: one more than the number of the last one.
        say: file descriptor that lines are written to: ``{"begin": 3}`` (with ``warm`` when
            it is a sound file that is read), ``{"end": 3}`` with a problem if there is one, at
            last ``{"done": true}``.
    """
    faulthandler.enable()
    warnings.simplefilter("ignore")
    # What compiles or is looked up but once is no one file's fault.
    os.write(say, json.dumps({"begin": first, "warm": True}).encode() + b"\n")
    with contextlib.suppress(Exception):
        _problem_of(reader, seeds[0], beside)
    _limit_memory()
    for number in range(first, last):
        bad = mutation(reader.name, number, seeds)
        os.write(say, json.dumps({"begin": number}).encode() + b"\n")
        problem = _problem_of(reader, bad.data, beside)
        line: dict[str, object] = {"end": number}
        if problem is not None:
            line["problem"] = problem
        os.write(say, json.dumps(line).encode() + b"\n")
    os.write(say, b'{"done": true}\n')


def _problem_of(reader: Reader, data: bytes, beside: Mapping[str, bytes]) -> str | None:
    # In memory where there is such a place: disks are slow where others use them too.
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    folder = Path(tempfile.mkdtemp(prefix="fuzz-", dir=memory))
    try:
        place(folder, reader, data, beside)
        return _problem_with(reader, folder)
    finally:
        with contextlib.suppress(MemoryError):
            shutil.rmtree(folder, ignore_errors=True)


def place(folder: Path, reader: Reader, data: bytes, beside: Mapping[str, bytes]) -> None:
    """Write a bad file and those beside it into a folder."""
    for name, content in {**beside, reader.file: data}.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def _problem_with(reader: Reader, folder: Path) -> str | None:
    """Read a file; return what is wrong with how the reader took it."""
    try:
        reader.read(folder / reader.file)
    except (InputError, StageError) as error:
        text = str(error)
        if len(text) > LONGEST_MESSAGE:
            return f"a message of {len(text)} characters: {text[:200]}"
        if not text.strip() or not text.isprintable():
            return f"a message that is no line: {text!r}"
    except MemoryError:
        return _where("MemoryError")
    except BaseException as error:
        return _where(f"{type(error).__module__}.{type(error).__name__}: {str(error)[:200]!r}")
    return None


def _where(what: str) -> str:
    """Return what was raised, and the last of our own lines that it went through."""
    lines = traceback.format_exc(limit=-40).splitlines()
    places = [line.strip() for line in lines if line.lstrip().startswith('File "')]
    own = [place for place in places if "/urbantwin/" in place]
    return f"{what} at {'; '.join((own or places)[-1:])}"
