"""A child process that reads formats with native code, within limits of memory and time.

A damaged file can terminate or stall a native library: here only the child ends, and the parent
raises a one-line error. The child is started at the first call and serves all calls of its process.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib
import os
import pickle
import select
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import IO, Any

from urbantwin.artefact.arrays import one_line
from urbantwin.errors import InputError

__all__ = ["read_in_child"]

#: Memory limit in addition to the child's own: constant in bytes, and per byte of the file.
_MEMORY_BYTES, _MEMORY_PER_BYTE = 1 << 30, 40
#: Limit of processor time: constant in seconds, and per byte of the file.
_SECONDS, _SECONDS_PER_BYTE = 8.0, 5e-6
#: Limit of wall-clock time, in multiples of the processor time, as other programs use processors,
#: too.
_PATIENCE = 10.0
_START = (
    "import sys, pickle; sys.path[:] = pickle.loads(bytes.fromhex(sys.argv[1])); "
    "from urbantwin.io.child import serve; serve()"
)


class _Child:
    """The running child of a process."""

    def __init__(self) -> None:
        names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", _START, pickle.dumps(sys.path).hex()],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **dict.fromkeys(names, "1")},
            start_new_session=True,  # Ctrl-C ends the parent, whose end the child notices
        )
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.ask: IO[bytes] = self.process.stdin
        self.answer: IO[bytes] = self.process.stdout

    def call(self, request: tuple[Any, ...], patience_s: float) -> tuple[str, Any]:
        """Return the kind of the answer and its value; "ended" if the child ended."""
        try:
            pickle.dump(request, self.ask, protocol=5)
            self.ask.flush()
            ready, _, _ = select.select([self.answer], [], [], patience_s)
            if ready:
                answer: tuple[str, Any] = pickle.load(self.answer)
                return answer
        except (EOFError, OSError, pickle.UnpicklingError):
            pass
        return "ended", None

    def close(self) -> None:
        """End the child."""
        for stream in (self.ask, self.answer):
            with contextlib.suppress(OSError):
                stream.close()
        self.process.kill()
        self.process.wait()


_lock = threading.Lock()
#: Children by the process that started them: a forked process starts its own.
_children: dict[int, _Child] = {}


def _new_lock() -> None:
    """Replace the lock in a forked process, where a thread of the parent may have held it."""
    global _lock  # noqa: PLW0603
    _lock = threading.Lock()


if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(after_in_child=_new_lock)


@atexit.register
def _close() -> None:
    child = _children.pop(os.getpid(), None)
    if child is not None:
        child.close()


def read_in_child(
    function: str,
    *arguments: Any,  # noqa: ANN401
    file: Path | str,
    size: int,
    expected: str,
) -> Any:  # noqa: ANN401 - whatever the function returns
    """Call a function in the child process and return its result.

    Args:
        function: module and name, ``urbantwin.io.las:read_fields``.
        arguments: arguments of the function; they and its result are pickled.
        file: the file that is read, for errors.
        size: size of the file in bytes, which sets the limits of memory and time.
        expected: format of the file, for errors.

    Raises:
        InputError: raised by the function; or the library raised an exception, ended its process,
            or exceeded the limits of memory or time.
    """
    memory = _MEMORY_BYTES + _MEMORY_PER_BYTE * size
    seconds = _SECONDS + _SECONDS_PER_BYTE * size
    with _lock:
        child = _children.get(os.getpid()) or _Child()
        _children[os.getpid()] = child
        kind, value = "ended", None
        try:
            kind, value = child.call((function, arguments, memory, seconds), _PATIENCE * seconds)
        finally:
            if kind == "ended":  # also if the parent was interrupted, which leaves an unread answer
                _children.pop(os.getpid()).close()
    if kind == "result":
        return value
    if kind == "input":
        raise InputError(value[0], file=value[1], place=value[2], expected=value[3])
    problem = value or "its reader ended, or needed more memory or time than the file's size allows"
    raise InputError(f"cannot be read as {expected} ({problem})", file=file, expected=expected)


def serve() -> None:
    """Answer the calls of the parent until it ends."""
    import resource  # not on Windows, where this module must still be importable

    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # libraries may print
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    while True:
        try:
            function, arguments, memory, seconds = pickle.load(sys.stdin.buffer)
        except EOFError:
            os._exit(0)  # without cleanup by libraries
        answer = _called(function, arguments, memory, seconds)
        try:
            pickle.dump(answer, answers, protocol=5)
            answers.flush()
        except BrokenPipeError:
            os._exit(0)


def _called(
    function: str, arguments: tuple[Any, ...], memory: int, seconds: float
) -> tuple[str, Any]:
    try:
        module, _, name = function.partition(":")
        call = getattr(importlib.import_module(module), name)
        _limit(memory, seconds)
        return "result", call(*arguments)
    except InputError as error:
        return "input", (error.problem, error.file, error.place, error.expected)
    except MemoryError:
        return "error", "it needs more memory than a file of its size may"
    except BaseException as error:  # panics of Rust are not derived from Exception
        return "error", one_line(error)


def _limit(memory: int, seconds: float) -> None:
    """Set the limits of the next call.

    RLIMIT_DATA counts private writable pages when they are requested. Unlike RLIMIT_AS, it excludes
    the address space that libraries reserve.
    """
    import resource

    used = 0
    with contextlib.suppress(OSError, StopIteration):
        status = Path("/proc/self/status").read_text(encoding="utf-8")
        used = next(int(line.split()[1]) for line in status.splitlines() if line[:7] == "VmData:")
    for kind, wanted in (
        (resource.RLIMIT_DATA, used * 1024 + memory),
        (resource.RLIMIT_CPU, int(time.process_time() + seconds) + 1),
    ):
        hard = resource.getrlimit(kind)[1]
        soft = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
        resource.setrlimit(kind, (soft, hard))
