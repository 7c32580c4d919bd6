"""Interruption: Ctrl-C, SIGTERM and SIGHUP end a command in the same way at any time.

While Python starts and imports, nothing has been written yet and the process simply ends
(`ends_at_once`). While a command works, ``KeyboardInterrupt`` unwinds it, which removes its scratch
files (`unwinds`). Some libraries swallow it (pyarrow while it searches for pandas, many
``except:``), as Python does in callbacks. So a timer checks every tenth of a second whether it
still unwinds, and raises it again if not. While compiled code runs, it is raised afterwards. While
a result is moved to its place, the signal waits (`deferred`). At the end the process ends without
waiting for threads (`leave`).
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, NoReturn

__all__ = [
    "EXIT_CODE",
    "Interruptions",
    "deferred",
    "ends_at_once",
    "leave",
    "unless_swallowed",
    "unwinds",
]

#: Exit code as in shells: 128 + SIGINT.
EXIT_CODE = 130
_SIGNALS: tuple[signal.Signals, ...] = (signal.SIGINT, signal.SIGTERM)
if hasattr(signal, "SIGHUP"):  # not on Windows
    _SIGNALS += (signal.SIGHUP,)
#: Time between checks whether an interruption still unwinds, seconds.
_LOOK_S = 0.1

Handler = Callable[[int, FrameType | None], object]


class _Interrupted(KeyboardInterrupt):
    """A deliberate interruption.

    A plain ``KeyboardInterrupt`` that leaves executed text (as dataclasses use) is recorded by
    Python, which then ends by SIGINT although the exception was caught (``Py_RunMain``).
    """


class Interruptions:
    """Counter of a block's interruptions, including those that a library swallowed.

    Attributes:
        count: number of interruptions.
        heard: whether an interruption raises; false once its report has begun.
    """

    def __init__(self) -> None:
        self.count = 0
        self.heard = True


#: Exit code of the process, once known.
_code: int | None = None


def ends_at_once() -> None:
    """From now on let an interruption end the process with one line; nothing needs cleaning up."""
    for number in _heard():
        signal.signal(number, _end)
    atexit.register(_end_of_all)  # registered first, so called last


def leave(code: int) -> NoReturn:
    """End the process: run exit handlers, but skip Python's finalisation.

    Finalisation takes up to a second with much in memory. A thread may also still run in compiled
    code after an interrupted wait (CPython 3.11 then considers it ended) and would abort the
    process when it returns.

    Args:
        code: exit code; with that of an interruption (already reported) no thread is waited for.
    """
    global _code  # noqa: PLW0603 - a process ends once
    _code = code
    for number in _heard():
        signal.signal(number, _end_silently if code == EXIT_CODE else _end)
    if code == EXIT_CODE:
        atexit._run_exitfuncs()
    raise SystemExit(code)


def _end_of_all() -> None:
    if _code is not None:
        for stream in (sys.stdout, sys.stderr):
            with suppress(AttributeError, OSError, ValueError):  # closed, or the reader is gone
                stream.flush()
        os._exit(_code)
    # After a traceback: a signal during Python's finalisation would end it silently and with
    # another exit code.
    for number in _heard():
        signal.signal(number, signal.SIG_IGN)


#: One entry per block of the main thread that currently defers interruptions.
_deferring: list[int] = []
#: Counters of the active `unwinds` blocks, innermost last.
_at_work: list[Interruptions] = []


@contextmanager
def unwinds() -> Iterator[Interruptions]:
    """Let an interruption raise ``KeyboardInterrupt`` in the block."""
    interruptions = Interruptions()
    former: list[Any] = []  # the handler of SIGALRM, and its timer

    def interrupt(_number: int, frame: FrameType | None) -> None:
        interruptions.count += 1
        if not former and hasattr(signal, "setitimer"):  # not on Windows
            former.append(signal.signal(signal.SIGALRM, look))
            former.append(signal.setitimer(signal.ITIMER_REAL, _LOOK_S, _LOOK_S))
        if interruptions.heard and not _called_by_compiler(frame):
            raise _Interrupted

    def look(_number: int, frame: FrameType | None) -> None:
        if _deferring or _called_by_compiler(frame) or _unwinding():
            return
        if interruptions.heard:
            raise _Interrupted

    _at_work.append(interruptions)
    try:
        with _handled(interrupt), _not_lost():
            yield interruptions
    finally:
        _at_work.pop()
        if former:
            signal.setitimer(signal.ITIMER_REAL, *former[1])
            signal.signal(signal.SIGALRM, former[0])


def _unwinding() -> bool:
    """Return whether this thread is unwinding because of an interruption.

    Clean-up code in ``finally``, ``except`` and ``with`` runs while the exception is handled.
    """
    error = sys.exception()
    for _ in range(100):  # the chain may be circular
        if error is None or isinstance(error, _Interrupted):
            break
        error = error.__cause__ or error.__context__
    return isinstance(error, _Interrupted)


@contextmanager
def _not_lost() -> Iterator[None]:
    """Suppress printing of interruptions that Python drops in weak-reference callbacks."""
    before = sys.unraisablehook

    def hear(dropped: sys.UnraisableHookArgs) -> None:
        if not isinstance(dropped.exc_value, _Interrupted):
            before(dropped)

    sys.unraisablehook = hear
    try:
        yield
    finally:
        sys.unraisablehook = before


def unless_swallowed() -> None:
    """Raise ``KeyboardInterrupt`` again if a library swallowed it.

    Python itself swallows it in callbacks during imports and garbage collection.
    """
    if any(one.count and one.heard for one in _at_work):
        raise _Interrupted


@contextmanager
def deferred() -> Iterator[None]:
    """Defer interruptions until the block has ended."""
    waiting: list[int] = []
    here = [1] if _in_main_thread() else []
    try:
        with _handled(lambda number, _frame: waiting.append(number)):
            _deferring.extend(here)
            try:
                yield
            finally:
                del _deferring[: len(here)]
    finally:
        if waiting:
            signal.raise_signal(waiting[0])


def _called_by_compiler(frame: FrameType | None) -> bool:
    """Return whether LLVM called the running code, through which an exception would crash."""
    while frame is not None:
        if frame.f_code.co_name.startswith("_raw_object_cache_"):
            return frame.f_globals.get("__name__") == "llvmlite.binding.executionengine"
        frame = frame.f_back
    return False


def _end(_number: int, _frame: FrameType | None) -> None:
    # Print one line instead of Python's traceback out of an import.
    os.write(2, b"error: interrupted\n")
    os._exit(EXIT_CODE)


def _end_silently(_number: int, _frame: FrameType | None) -> None:
    os._exit(EXIT_CODE)


def _in_main_thread() -> bool:
    import threading  # not above: `ends_at_once` is called as early as can be

    return threading.current_thread() is threading.main_thread()


def _heard() -> list[signal.Signals]:
    """Return the signals that are not ignored, as under `nohup`."""
    return [one for one in _SIGNALS if signal.getsignal(one) not in (signal.SIG_IGN, None)]


@contextmanager
def _handled(handler: Handler) -> Iterator[None]:
    if not _in_main_thread():  # signal handlers belong to the main thread
        yield
        return
    before = {number: signal.getsignal(number) for number in _heard()}
    for number in before:
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number, former in before.items():
            signal.signal(number, former)
