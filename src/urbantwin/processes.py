"""Processors and worker processes."""

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
#: Address space that a process needs to trace rays, bytes; most of it is never used.
LEAST_ADDRESSES = 3_200_000_000
#: Time between checks for remaining workers, seconds.
_LOOK_S = 0.2
#: Time within which a pool notices a killed worker, seconds.
_MOMENT_S = 0.1


def usable_processors() -> int:
    """Return the number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def check_addresses() -> None:
    """Check that the address-space limit (``ulimit -v``) suffices for long work.

    Compiled libraries end the process on a failed allocation, without a message or clean-up.

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
    """Return the number of threads for calculations: one in a worker process."""
    return 1 if _a_worker or parent_process() is not None else usable_processors()


def calculate_as_worker() -> None:
    """Make this process calculate on one thread, as a worker that no pool of ours started."""
    global _a_worker  # noqa: PLW0603
    _a_worker = True


@contextmanager
def worker_pool(
    workers: int, start: Callable[..., None], *arguments: object
) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of processes; tasks not begun at the end of the block are dropped.

    Workers use one thread each. They ignore interrupts, and end with the pool's process even if it
    is killed.

    Args:
        workers: number of processes.
        start: called in every worker before its work.
        arguments: arguments of ``start``.
    """
    check_addresses()
    # Spawned, not forked: a fork copies locks of threads but not the threads that hold them.
    with ExitStack() as given:
        place = given.enter_context(handed((start, arguments)))
        pool = ProcessPoolExecutor(workers, get_context("spawn"), partial(_start, place))
        try:
            with ExitStack() as here:
                # Interruptions are deferred: a worker that gets half of its start data ends with a
                # traceback.
                for surroundings in (deferred, _one_thread_each, _uninterrupted, _without_script):
                    here.enter_context(surroundings())
                for _ in range(workers):  # each task starts one worker
                    pool.submit(os.getpid)
            yield pool
        finally:
            given.close()  # workers that are still starting notice it
            try:
                pool.shutdown(wait=True, cancel_futures=True)
            except BaseException:  # interrupted again: the workers' output folder will be removed
                _kill_workers()
                raise


@dataclass(frozen=True, eq=False)
class Helpers:
    """Worker processes beside this one.

    Attributes:
        workers: number of working processes, this one included.
        pool: pool of the other processes; ``None`` if there are none.
        first: first task of the pool, done once a helper is ready.
    """

    workers: int
    pool: ProcessPoolExecutor | None
    first: Future[int] | None = None

    @property
    def ready(self) -> ProcessPoolExecutor | None:
        """The pool once a helper is ready; ``None`` before, and without a pool."""
        return self.pool if self.first is not None and self.first.done() else None


@contextmanager
def helpers(
    workers: int | None, start: Callable[..., None], *arguments: object
) -> Iterator[Helpers]:
    """Yield helper processes, which start up while this process continues.

    Args:
        workers: number of working processes, this one included; all processors if not given.
        start: see `worker_pool`.
        arguments: arguments of ``start``.
    """
    check_addresses()
    workers = usable_processors() if workers is None else workers
    if workers < 2:
        yield Helpers(workers, None)
        return
    with worker_pool(workers - 1, start, *arguments) as pool:
        yield Helpers(workers, pool, pool.submit(os.getpid))


def pool_of(crew: object) -> ProcessPoolExecutor | None:
    """Return the pool of helpers; ``None`` for other kinds of workers."""
    return crew.pool if isinstance(crew, Helpers) else None


@contextmanager
def begun(
    pool: ProcessPoolExecutor | None,
    function: Callable[_P, _T],
    *arguments: _P.args,
    **named: _P.kwargs,
) -> Iterator[Callable[[], _T]]:
    """Yield a function that returns the result of a call made by a helper in the background.

    Without a helper, or if it was killed, the function is called here on demand.

    Args:
        pool: pool of helpers; ``None`` if there are none.
        function: function to call.
        arguments: its positional arguments.
        named: its keyword arguments.
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
    """Wait until a pool's future is done; return the done ones, empty if none can be.

    None can be done once no worker is left: a task submitted just as the last worker is killed may
    never be notified (CPython 3.11 checks pending tasks once).

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
    """Cancel tasks that have not begun, and wait for the others."""
    try:
        # A signal to the process group ends workers, too. A pool of CPython 3.11 that then finds a
        # cancelled task does not notify the others, so it gets a moment to notify them first.
        wait(under_way, timeout=_MOMENT_S)
        for future in under_way:
            future.cancel()
        over(under_way, every=True)
    except BaseException:  # interrupted again
        _kill_workers()
        raise


def _kill_workers() -> None:
    for worker in active_children():
        worker.kill()
        worker.join()


@contextmanager
def handed(value: object) -> Iterator[str]:
    """Yield a path at which processes of this machine can read a value during the block.

    The value is in anonymous memory of this process. A large value would not fit into the pipe that
    starts workers, and writing to it would block forever if a worker is killed.
    """
    memory = os.memfd_create("urbantwin-workers")
    try:
        with os.fdopen(memory, "wb", closefd=False) as stream:
            pickle.dump(value, stream, pickle.HIGHEST_PROTOCOL)
        yield f"/proc/{os.getpid()}/fd/{memory}"
    finally:
        os.close(memory)


def received(place: str) -> Any:  # noqa: ANN401 - whatever was handed
    """Return the value that another process provided with `handed`.

    Raises:
        FileNotFoundError: its block has ended.
    """
    with open(place, "rb") as stream:  # noqa: PTH123 - a link that is no file's name
        return pickle.load(stream)


def _start(place: str) -> None:
    # Skip Python's finalisation, for which the pool would wait.
    atexit.register(os._exit, 0)
    begun = threading.Event()
    threading.Thread(target=_end_with_the_run, daemon=True).start()
    threading.Thread(target=_end_with_the_pool, args=(place, begun), daemon=True).start()
    # Imported objects stay alive: searching them for garbage would take an eighth of the time.
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
    """End this worker if the pool ends during a long start."""
    while not begun.wait(0.1):
        if not os.path.lexists(place):
            os._exit(1)


def _end_with_the_run() -> None:
    """End this worker when the process that started it is killed.

    It would otherwise wait forever, since it holds the other end of its own task pipe, and could
    write files while a new run writes the same ones.
    """
    run = parent_process()
    assert run is not None
    run.join()
    os._exit(1)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Make processes started in the block calculate with one thread."""
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
    """Make processes started in the block ignore Ctrl-C from the start."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # Blocked, not ignored: children inherit the mask, and here the signal arrives after the block.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _without_script() -> Iterator[None]:
    """Hide the ``__main__`` module from processes started in the block.

    They would import it: a user's script without the guard ``if __name__ == "__main__"`` would run
    again in each of them.
    """
    script = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script
