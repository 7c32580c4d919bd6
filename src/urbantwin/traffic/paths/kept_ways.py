"""Paths of all actors in a long motion, kept on disk and read stretch by stretch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.traffic.demand.demand import Trip

__all__ = ["KeptColumns", "KeptWays", "some_actors"]

#: Number of rows processed together.
_ROWS_AT_ONCE = 500_000

Columns = dict[str, NDArray[Any]]


class KeptColumns:
    """Columns to which rows are appended.

    Args:
        folder: folder of the columns; ``None`` keeps them in memory.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._parts: list[Columns] = []
        self._kinds: dict[str, tuple[np.dtype[Any], tuple[int, ...]]] = {}
        self._count = 0

    def add(self, columns: Columns) -> None:
        """Append rows."""
        if self._folder is None:
            self._parts.append(columns)
            return
        for name, values in columns.items():
            self._kinds[name] = values.dtype, values.shape[1:]
            with self._file(name).open("ab") as file:
                file.write(np.ascontiguousarray(values).data)
        self._count += len(columns["trip"])

    def opened(self) -> Columns:
        """Return all columns, memory-mapped if on disk."""
        if self._folder is not None:
            return {
                name: np.memmap(self._file(name), kind, "r", shape=(self._count, *shape))
                for name, (kind, shape) in self._kinds.items()
            }
        if len(self._parts) > 1:
            names = self._parts[0]
            self._parts = [{x: np.concatenate([part[x] for part in self._parts]) for x in names}]
        return self._parts[0]

    def span(self, name: str, first: int, last: int) -> NDArray[Any]:
        """Return a column between two rows, the second excluded."""
        if self._folder is None:
            return np.asarray(self.opened()[name][first:last])
        kind, shape = self._kinds[name]
        each = int(np.prod(shape, dtype=np.int64))
        begin = first * each * kind.itemsize
        values = np.fromfile(self._file(name), kind, (last - first) * each, offset=begin)
        return values.reshape(-1, *shape)

    def rows(self, rows: NDArray[np.integer]) -> Columns:
        """Return some rows; on disk, only these are read."""
        if self._folder is None:
            return {name: values[rows] for name, values in self.opened().items()}
        begins = np.flatnonzero(np.diff(rows, prepend=-2) != 1)
        runs = list(zip(rows[begins].tolist(), np.diff(begins, append=len(rows)), strict=True))
        columns = {}
        for name, (kind, shape) in self._kinds.items():
            values = np.empty((len(rows), *shape), kind)
            each, done = int(np.prod(shape, dtype=np.int64)), 0
            with self._file(name).open("rb") as file:
                for first, count in runs:
                    file.seek(first * each * kind.itemsize)
                    part = np.fromfile(file, kind, count * each)
                    values[done : done + count] = part.reshape(-1, *shape)
                    done += count
            columns[name] = values
        return columns

    def _file(self, name: str) -> Path:
        assert self._folder is not None
        return self._folder / f"{name}.bin"


@dataclass(frozen=True, eq=False)
class KeptWays:
    """Paths of all actors before conflicts are resolved.

    Attributes:
        columns: poses by actor and step; rows before ``since`` of actors in ``gone`` are void.
        trips: their trips.
        who: their identities (`bending.with_bodies`).
        rigid: vehicles that are rigid although their trips have articulated ones.
        gone: bodies of these vehicles before they were replaced.
        since: see ``columns``.
        steps: the first step, and the one after the last.
    """

    columns: KeptColumns
    trips: tuple[Trip, ...]
    who: NDArray[np.int64]
    rigid: frozenset[int]
    gone: frozenset[int]
    since: int
    steps: tuple[int, int]


def some_actors(actor: NDArray[np.integer]) -> Iterator[NDArray[np.int64]]:
    """Yield the rows of groups of actors, each actor's in their order.

    Args:
        actor: (N,) actor of each row.
    """
    order = np.argsort(actor, kind="stable")
    ends = np.append(np.flatnonzero(np.diff(actor[order])) + 1, len(order))
    first = 0
    while first < len(order):
        fit = ends[(ends > first) & (ends <= first + _ROWS_AT_ONCE)]
        last = int(fit[-1] if len(fit) else ends[ends > first][0])
        yield order[first:last]
        first = last
