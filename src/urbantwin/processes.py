"""Processors and processes: how many there are, and workers that end as they should."""

from __future__ import annotations

import atexit
import gc
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import (
    ALL_COMPLETED,
    FIRST_COMPLETED,
    Future,
    ProcessPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing import active_children, get_context, parent_process
from types import ModuleType
from typing import Any, ParamSpec, TypeVar

from urbantwin.errors import LimitError, limit_of_process
from urbantwin.interruption import deferred

__all__ = [
    "Helpers",
    "begun",
    "calculate_as_worker",
    "check_addresses",
    "handed",
    "helpers",
    "over",
    "pool_of",
    "received",
    "settle",
    "threads",
    "usable_processors",
    "worker_pool",
]

_T = TypeVar("_T")
_P = ParamSpec("_P")

_a_worker = False
#: Addresses that a process needs to trace rays, most of which never become memory, bytes.
LEAST_ADDRESSES = 3_200_000_000
#: So often it is looked whether any worker is left, seconds.
_LOOK_S = 0.2
#: Within this a pool knows that a worker was killed, seconds.
_MOMENT_S = 0.1


def usable_processors() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def check_addresses() -> None:
    """Refuse long work where a limit of addresses (``ulimit -v``) leaves too few of them.

    Compiled libraries end the whole process where an allocation fails, so that nothing could be
    said or cleaned up.

    Raises:
        LimitError: the limit is lower.
    """
    most = limit_of_process("RLIMIT_AS")
    if most is not None and most < LEAST_ADDRESSES:
        raise LimitError(
            f"out of memory: this process may use {most / 1e9:.1f} GB of addresses (ulimit -v); "
            f"it needs {LEAST_ADDRESSES / 1e9:.1f} GB; allow more (ulimit -v unlimited)"
        )


def threads() -> int:
    """Return on how many threads this process should calculate: on one if it is a worker."""
    return 1 if _a_worker or parent_process() is not None else usable_processors()


def calculate_as_worker() -> None:
    """Let this process calculate on one thread: something else than a pool of ours started it."""
    global _a_worker  # noqa: PLW0603
    _a_worker = True


@contextmanager
def worker_pool(
    workers: int, start: Callable[..., None], *arguments: object
) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of processes; what nobody has begun when the block ends is dropped.

    Workers calculate with one thread each, as they are many. They leave an interrupt to the
    process that has the pool, and end with it even when it is killed.

    Args:
        workers: how many processes.
        start: called in every worker before its work.
        arguments: of ``start``.
    """
    check_addresses()
    # Spawned, not forked: a fork copies the threads' locks but not the threads that hold them.
    with ExitStack() as given:
        place = given.enter_context(handed((start, arguments)))
        pool = ProcessPoolExecutor(workers, get_context("spawn"), partial(_start, place))
        try:
            with ExitStack() as here:
                # Deferred: a worker that is told half of it ends with a traceback.
                for surroundings in (deferred, _one_thread_each, _uninterrupted, _without_script):
                    here.enter_context(surroundings())
                for _ in range(workers):  # a worker starts when there is work for it
                    pool.submit(os.getpid)
            yield pool
        finally:
            given.close()  # who is still beginning sees it
            try:
                pool.shutdown(wait=True, cancel_futures=True)
            except BaseException:  # interrupted once more: what they write to will be taken away
                _kill_workers()
                raise


@dataclass(frozen=True, eq=False)
class Helpers:
    """Processes that work beside this one.

    Attributes:
        workers: how many work, this one among them.
        pool: of the others; ``None`` where there are none.
        first: the first task of the pool: it is done once a helper is ready.
    """

    workers: int
    pool: ProcessPoolExecutor | None
    first: Future[int] | None = None

    @property
    def ready(self) -> ProcessPoolExecutor | None:
        """The pool once a helper is ready; ``None`` before, and where there is no pool."""
        return self.pool if self.first is not None and self.first.done() else None


@contextmanager
def helpers(
    workers: int | None, start: Callable[..., None], *arguments: object
) -> Iterator[Helpers]:
    """Yield processes that get ready while this one does: what they work on may come later.

    Args:
        workers: how many are to work, this one among them; as many as there are processors if not
            given.
        start: see `worker_pool`.
        arguments: of ``start``.
    """
    check_addresses()
    workers = usable_processors() if workers is None else workers
    if workers < 2:
        yield Helpers(workers, None)
        return
    with worker_pool(workers - 1, start, *arguments) as pool:
        yield Helpers(workers, pool, pool.submit(os.getpid))


def pool_of(crew: object) -> ProcessPoolExecutor | None:
    """Return the pool of helpers of whoever works; ``None`` where they are no helpers of ours."""
    return crew.pool if isinstance(crew, Helpers) else None


@contextmanager
def begun(
    pool: ProcessPoolExecutor | None,
    function: Callable[_P, _T],
    *arguments: _P.args,
    **named: _P.kwargs,
) -> Iterator[Callable[[], _T]]:
    """Yield what returns the result of a function, which a helper calls while this process goes on.

    Where there is no helper, or it was killed, the function is called here when it is asked for.

    Args:
        pool: of helpers; ``None`` where there are none.
        function: what is called.
        arguments: of the function.
        named: its arguments by name.
    """
    future: Future[_T] | None = None
    if pool is not None:
        with suppress(BrokenProcessPool):
            future = pool.submit(function, *arguments, **named)

    def result() -> _T:
        if future is not None and over([future]):
            with suppress(BrokenProcessPool):
                return future.result()
        return function(*arguments, **named)

    try:
        yield result
    finally:
        settle([] if future is None else [future])


def over(under_way: Collection[Future[Any]], *, every: bool = False) -> set[Future[Any]]:
    """Wait until a future of a pool is over; return those that are, or none if none will be.

    None will be when no worker is left: what is handed to a pool just as its last worker is killed
    may never be told that it was (CPython 3.11 looks through what waits once).

    Args:
        under_way: futures of a pool of this process.
        every: wait for all of them.
    """
    until = ALL_COMPLETED if every else FIRST_COMPLETED
    while True:
        found = wait(under_way, timeout=_LOOK_S, return_when=until)
        if not found.not_done or (found.done and not every) or not active_children():
            return found.done


def settle(under_way: Collection[Future[Any]]) -> None:
    """Drop what nobody has begun, and wait until the rest of it is over."""
    try:
        # A signal to all ends workers, too. Where a pool of CPython 3.11 finds something cancelled
        # then, it tells the others nothing: it is left a moment to tell them first.
        wait(under_way, timeout=_MOMENT_S)
        for future in under_way:
            future.cancel()
        over(under_way, every=True)
    except BaseException:  # interrupted once more
        _kill_workers()
        raise


def _kill_workers() -> None:
    for worker in active_children():
        worker.kill()
        worker.join()


@contextmanager
def handed(value: object) -> Iterator[str]:
    """Yield where processes of this machine receive a value as long as the block runs.

    It is in memory of this process, which goes with it: much would not fit into the pipe by which
    workers are started, and who writes there waits for ever if one is killed.
    """
    memory = os.memfd_create("urbantwin-workers")
    try:
        with os.fdopen(memory, "wb", closefd=False) as stream:
            pickle.dump(value, stream, pickle.HIGHEST_PROTOCOL)
        yield f"/proc/{os.getpid()}/fd/{memory}"
    finally:
        os.close(memory)


def received(place: str) -> Any:  # noqa: ANN401 - whatever was handed
    """Return what another process handed.

    Raises:
        FileNotFoundError: its block has ended.
    """
    with open(place, "rb") as stream:  # noqa: PTH123 - a link that is no file's name
        return pickle.load(stream)


def _start(place: str) -> None:
    # Python is not taken apart at the end, for which the pool would wait: nothing is left to do.
    atexit.register(os._exit, 0)
    begun = threading.Event()
    threading.Thread(target=_end_with_the_run, daemon=True).start()
    threading.Thread(target=_end_with_the_pool, args=(place, begun), daemon=True).start()
    # What is imported stays: an eighth of this would go into looking for what of it is garbage.
    gc.disable()
    try:
        start, arguments = received(place)
    except FileNotFoundError:
        os._exit(1)
    start(*arguments)
    gc.freeze()
    gc.enable()
    begun.set()


def _end_with_the_pool(place: str, begun: threading.Event) -> None:
    """End this worker if the pool ends while it begins, which may take long."""
    while not begun.wait(0.1):
        if not os.path.lexists(place):
            os._exit(1)


def _end_with_the_run() -> None:
    """End this worker when the run that started it is killed.

    It would wait for work for ever: it holds the other end of the pipe that work comes by itself.
    And it would write files while a run that goes on writes the same.
    """
    run = parent_process()
    assert run is not None
    run.join()
    os._exit(1)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Let processes that start in the block calculate with one thread."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Let processes that start in the block never hear of Ctrl-C, from their first moment."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # Held back, not ignored: they inherit that, and here it comes when the block has ended.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _without_script() -> Iterator[None]:
    """Hide what runs as ``__main__`` from processes that start in the block.

    They have no use for it, but would import it: a person's script without a guard
    (``if __name__ == "__main__"``) would run again in each of them.
    """
    script = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script
