"""Interruption: Ctrl-C, SIGTERM and SIGHUP end a command in the same way, wherever it is.

While Python starts and imports, nothing is made yet and the process just ends (`ends_at_once`).
While a command works, ``KeyboardInterrupt`` unwinds it, so that its scratch goes (`unwinds`). Some
libraries swallow it (pyarrow does while it looks for pandas, and so do many ``except:``), and
Python itself in callbacks: it is looked every tenth of a second whether it still unwinds, and if
not, it comes again. Where compiled code is on its way, it comes a moment later. While a result
takes its place, the signal waits (`deferred`). Then the process ends without waiting for threads
(`leave`).
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

#: As shells have it: 128 + SIGINT.
EXIT_CODE = 130
_SIGNALS: tuple[signal.Signals, ...] = (signal.SIGINT, signal.SIGTERM)
if hasattr(signal, "SIGHUP"):  # not on Windows
    _SIGNALS += (signal.SIGHUP,)
#: How often it is looked whether an interruption still unwinds, seconds.
_LOOK_S = 0.1

Handler = Callable[[int, FrameType | None], object]


class _Interrupted(KeyboardInterrupt):
    """An interruption that was asked for.

    Python notes a plain ``KeyboardInterrupt`` that leaves a text which is executed (dataclasses are
    made so), and then ends by SIGINT in the end, although it was caught (``Py_RunMain``).
    """


class Interruptions:
    """How often a block was interrupted, even where a library swallowed the exception.

    Attributes:
        count: so often.
        heard: whether one raises; who has begun to say that there was one listens no more.
    """

    def __init__(self) -> None:
        self.count = 0
        self.heard = True


#: What the process is to end with, once that is known.
_code: int | None = None


def ends_at_once() -> None:
    """From now on let an interruption end the process with one line: there is nothing to undo."""
    for number in _heard():
        signal.signal(number, _end)
    atexit.register(_end_of_all)  # what is registered first is called last


def leave(code: int) -> NoReturn:
    """End the process: what is registered for its end runs, but Python is not taken apart.

    That takes most of a second where much is in memory. And a thread may still be at work in
    compiled code where an interruption cut the wait for it (CPython 3.11 takes it for ended then):
    it would abort the process when it comes back.

    Args:
        code: the exit code; with that of an interruption, which was said, no thread is waited for.
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
            with suppress(AttributeError, OSError, ValueError):  # closed, or nobody reads any more
                stream.flush()
        os._exit(_code)
    # A traceback: nobody hears signals while Python takes itself apart, and one would end it
    # without a word, and with another exit code.
    for number in _heard():
        signal.signal(number, signal.SIG_IGN)


#: One for each block of the main thread that defers interruptions now.
_deferring: list[int] = []
#: Those of the blocks that are at work (`unwinds`), the innermost last.
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
    """Return whether this thread is on its way out because of an interruption.

    What cleans up in ``finally``, ``except`` and ``with`` does so while it handles the exception.
    """
    error = sys.exception()
    for _ in range(100):  # a chain may be a circle
        if error is None or isinstance(error, _Interrupted):
            break
        error = error.__cause__ or error.__context__
    return isinstance(error, _Interrupted)


@contextmanager
def _not_lost() -> Iterator[None]:
    """Let what Python drops, in a callback of a weak reference, not be printed: it comes again."""
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
    """Raise ``KeyboardInterrupt`` again where a library swallowed it.

    Python itself does, in what it calls while it imports or collects garbage.
    """
    if any(one.count and one.heard for one in _at_work):
        raise _Interrupted


@contextmanager
def deferred() -> Iterator[None]:
    """Let an interruption wait until the block has ended: for moments that must not be cut."""
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
    """Return whether LLVM called what runs now: no exception gets through it, and it crashes."""
    while frame is not None:
        if frame.f_code.co_name.startswith("_raw_object_cache_"):
            return frame.f_globals.get("__name__") == "llvmlite.binding.executionengine"
        frame = frame.f_back
    return False


def _end(_number: int, _frame: FrameType | None) -> None:
    # No line of Python's own, no traceback out of half an import.
    os.write(2, b"error: interrupted\n")
    os._exit(EXIT_CODE)


def _end_silently(_number: int, _frame: FrameType | None) -> None:
    os._exit(EXIT_CODE)


def _in_main_thread() -> bool:
    import threading  # not above: `ends_at_once` is called as early as can be

    return threading.current_thread() is threading.main_thread()


def _heard() -> list[signal.Signals]:
    """Return the signals that whoever started this process wants heard: not `nohup`'s."""
    return [one for one in _SIGNALS if signal.getsignal(one) not in (signal.SIG_IGN, None)]


@contextmanager
def _handled(handler: Handler) -> Iterator[None]:
    if not _in_main_thread():  # Python's rule
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
