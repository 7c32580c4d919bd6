"""Training batches, prepared ahead by a thread of this process or by several processes.

A batch is a mapping of names to arrays. Worker processes write them into shared memory, which is
reused after each step, so no array passes through a pipe.
"""

from __future__ import annotations

import mmap
import os
from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import StageError
from urbantwin.processes import worker_pool

__all__ = ["Arrays", "Source", "batches"]

#: A batch: its arrays by name.
Arrays = dict[str, NDArray[Any]]
#: Alignment of arrays in shared memory, bytes.
_ALIGNED = 64
#: Number of finished batches that may wait.
_WAITING = 2


class Source(Protocol):
    """Makes batches; each worker process gets a copy."""

    def batch(self, step: int) -> Arrays:
        """Return the batch of a step; its randomness depends on the seed and the step alone."""


class _Placed(NamedTuple):
    """Location of an array in shared memory."""

    name: str
    dtype: str
    shape: tuple[int, ...]
    start: int


def batches(source: Source, first: int, last: int | None, workers: int) -> Generator[Arrays]:
    """Yield the batches of steps in order; a batch is valid until the next is requested.

    Args:
        source: maker of the batches.
        first: first step.
        last: step after the last; ``None``: endless.
        workers: number of processes; with 1, a thread of this process.

    Raises:
        StageError: a worker process was killed.
    """
    if first == last:
        return
    if workers == 1:
        yield from _of_a_thread(source, first, last)
        return
    try:
        yield from _of_processes(source, first, last, workers)
    except BrokenProcessPool:
        raise StageError(
            "a process that makes samples was killed (out of memory?); the training state is kept: "
            "give the same command again, with fewer workers"
        ) from None


def _of_a_thread(source: Source, first: int, last: int | None) -> Generator[Arrays]:
    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(source.batch, first)
        step = first
        while last is None or step < last:
            made = coming.result()
            step += 1
            if step != last:
                coming = pool.submit(source.batch, step)
            yield made


def _of_processes(source: Source, first: int, last: int | None, workers: int) -> Generator[Arrays]:
    with ExitStack() as here:
        rooms = [here.enter_context(_Room()) for _ in range(workers + _WAITING)]
        pool = here.enter_context(worker_pool(workers, _start, source))
        coming: deque[tuple[Future[list[_Placed]], _Room]] = deque()
        step = asked = first
        while last is None or step < last:
            while rooms and asked != last:
                room = rooms.pop()
                coming.append((pool.submit(_written, asked, room.path), room))
                asked += 1
            future, room = coming.popleft()
            yield room.arrays(future.result())
            rooms.append(room)
            step += 1


class _Room:
    """Shared memory for one batch."""

    def __init__(self) -> None:
        self._file = os.memfd_create("urbantwin-batch")
        self.path = f"/proc/{os.getpid()}/fd/{self._file}"
        self._memory: NDArray[np.uint8] = np.zeros(0, np.uint8)

    def __enter__(self) -> _Room:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._file)

    def arrays(self, placed: Sequence[_Placed]) -> Arrays:
        """Return the arrays of the batch as views."""
        if len(self._memory) < os.fstat(self._file).st_size:
            self._memory = np.frombuffer(mmap.mmap(self._file, 0), np.uint8)
        return _views(self._memory, placed)


def _views(memory: NDArray[np.uint8], placed: Sequence[_Placed]) -> Arrays:
    found = {}
    for one in placed:
        kind = np.dtype(one.dtype)
        size = int(np.prod(one.shape)) * kind.itemsize
        found[one.name] = memory[one.start : one.start + size].view(kind).reshape(one.shape)
    return found


_source: Source | None = None


def _start(source: Source) -> None:
    global _source  # noqa: PLW0603 - state of a worker process: its source
    _source = source


def _written(step: int, path: str) -> list[_Placed]:
    """Write a batch into the shared memory at ``path``; return the location of its arrays."""
    assert _source is not None
    made = _source.batch(step)
    placed, size = [], 0
    for name, values in made.items():
        placed.append(_Placed(name, values.dtype.str, values.shape, size))
        size += -(-values.nbytes // _ALIGNED) * _ALIGNED
    with open(path, "r+b") as file:  # noqa: PTH123 - a link that is no file's name
        if os.fstat(file.fileno()).st_size < size:
            os.ftruncate(file.fileno(), size + size // 4)
        memory = np.frombuffer(mmap.mmap(file.fileno(), 0), np.uint8)
    for name, there in _views(memory, placed).items():
        there[...] = made[name]
    return placed
