"""Rows of a motion's actors: in memory or, for a long motion, read from its file in parts."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from urbantwin.artefact.tables import PARQUET, ParquetGroups

__all__ = [
    "ACTOR_SCHEMA",
    "ActorRows",
    "RowsInFile",
    "RowsInMemory",
    "as_rows",
    "read_rows",
    "write_rows",
]

ACTOR_SCHEMA = pa.schema(
    [
        ("time_s", pa.float64()),
        ("track", pa.int32()),
        ("class", pa.string()),
        ("asset", pa.string()),
        ("phase", pa.int16()),
        ("x", pa.float64()),
        ("y", pa.float64()),
        ("z", pa.float64()),
        ("yaw", pa.float64()),
        ("pitch", pa.float64()),
        ("roll", pa.float64()),
        ("length", pa.float64()),
        ("width", pa.float64()),
        ("height", pa.float64()),
        ("speed", pa.float64()),
        ("lane", pa.string()),
    ]
)

#: Number of rows written and read together, to limit memory.
_ROWS_PER_GROUP = 1 << 16
#: Files with more rows are read in parts.
_MAX_ROWS_AT_ONCE = 1 << 20
#: Number of row groups kept after reading: a frame needs the steps on both sides of its time.
_CACHED_GROUPS = 4
_EXPECTED = "a table of the motion"


class ActorRows(ABC):
    """Rows of a motion's actors, columns of ``ACTOR_SCHEMA``, sorted by time, then track.

    Attributes:
        num_rows: number of rows.
        schema: ``ACTOR_SCHEMA``.
    """

    num_rows: int
    schema: pa.Schema = ACTOR_SCHEMA

    @abstractmethod
    def table(self, columns: Sequence[str] | None = None) -> pa.Table:
        """Return all rows, with all columns or those given."""

    @abstractmethod
    def between(self, from_s: float, until_s: float) -> pa.Table:
        """Return the rows of the steps between two times, both included, seconds."""

    @abstractmethod
    def _groups(self, columns: Sequence[str] | None) -> Iterator[pa.Table]:
        """Yield the rows in groups."""

    def __getitem__(self, column: str) -> pa.ChunkedArray:
        """Return a column of all rows."""
        return self.table([column])[column]

    def parts(self, columns: Sequence[str] | None = None) -> Iterator[pa.Table]:
        """Yield the rows in groups of whole steps."""
        wanted = None if columns is None else list(dict.fromkeys([*columns, "time_s"]))
        for part in _whole_steps(self._groups(wanted)):
            yield part if columns is None else part.select(list(columns))

    def distinct(self, columns: Sequence[str]) -> pa.Table:
        """Return the distinct combinations of values of some columns, unordered."""
        names = list(columns)
        parts = [group.group_by(names).aggregate([]) for group in self._groups(names)]
        empty = pa.schema([ACTOR_SCHEMA.field(name) for name in names]).empty_table()
        return pa.concat_tables([empty, *parts]).group_by(names).aggregate([])

    def where(self, column: str, values: Sequence[Any]) -> pa.Table:
        """Return the rows whose column has one of the given values."""
        wanted = pa.array(list(values), ACTOR_SCHEMA.field(column).type)
        selected = [group.filter(pc.is_in(group[column], wanted)) for group in self._groups(None)]
        return pa.concat_tables([ACTOR_SCHEMA.empty_table(), *selected])

    def write(self, to: Path | pa.NativeFile) -> None:
        """Write a Parquet file; the same rows give the same bytes."""
        write_rows(self._groups(None), to)


class RowsInMemory(ActorRows):
    """Rows of actors in memory.

    Args:
        table: columns of ``ACTOR_SCHEMA``, sorted by time, then track.
    """

    def __init__(self, table: pa.Table) -> None:
        self._table = table
        self.num_rows = int(table.num_rows)

    def table(self, columns: Sequence[str] | None = None) -> pa.Table:
        """Return all rows, with all columns or those given."""
        return self._table if columns is None else self._table.select(list(columns))

    def between(self, from_s: float, until_s: float) -> pa.Table:
        """Return the rows of the steps between two times, both included, seconds."""
        return _between(self._table, from_s, until_s)

    def _groups(self, columns: Sequence[str] | None) -> Iterator[pa.Table]:
        table = self.table(columns)
        for first in range(0, self.num_rows, _ROWS_PER_GROUP):
            yield table.slice(first, _ROWS_PER_GROUP)


class RowsInFile(ActorRows):
    """Rows of actors in a Parquet file, read by row groups.

    The file stays open, so that it can be read even after it is moved or deleted.

    Args:
        path: the file.

    Raises:
        InputError: it is missing, damaged, or has other columns.
    """

    def __init__(self, path: Path) -> None:
        self._file = ParquetGroups(path, _EXPECTED, ACTOR_SCHEMA)
        self._stat = path.stat()
        self._read: dict[int, pa.Table] = {}
        self.num_rows = self._file.num_rows
        ends = [_ends(group["time_s"].to_numpy()) for group in self._groups(["time_s"])]
        self._ends = np.array(ends, np.float64).reshape(-1, 2)

    def table(self, columns: Sequence[str] | None = None) -> pa.Table:
        """Return all rows, with all columns or those given."""
        return self._file.read(columns)

    def between(self, from_s: float, until_s: float) -> pa.Table:
        """Return the rows of the steps between two times, both included, seconds."""
        meets = (self._ends[:, 1] >= from_s) & (self._ends[:, 0] <= until_s)
        parts = [ACTOR_SCHEMA.empty_table()]
        for number in np.flatnonzero(meets).tolist():
            if number not in self._read:
                for old in list(self._read)[: 1 - _CACHED_GROUPS]:
                    del self._read[old]
                self._read[number] = self._file.read(group=number)
            parts.append(_between(self._read[number], from_s, until_s))
        return pa.concat_tables(parts)

    def write(self, to: Path | pa.NativeFile) -> None:
        """Write a Parquet file, unless it is the source; the same rows give the same bytes."""
        own = isinstance(to, Path) and to.exists() and os.path.samestat(to.stat(), self._stat)
        if not own:
            super().write(to)

    def _groups(self, columns: Sequence[str] | None) -> Iterator[pa.Table]:
        for number in range(self._file.count):
            yield self._file.read(columns, group=number)


def _ends(time_s: NDArray[np.float64]) -> tuple[float, float]:
    """Return the first and last of some times; (inf, -inf) if there are none."""
    return (float(time_s[0]), float(time_s[-1])) if len(time_s) else (np.inf, -np.inf)


def as_rows(table: pa.Table | ActorRows) -> ActorRows:
    """Return the rows of a table; rows are returned as they are."""
    return RowsInMemory(table) if isinstance(table, pa.Table) else table


def read_rows(path: Path) -> ActorRows:
    """Read the rows of a file: at once or, for a long motion, on demand.

    Raises:
        InputError: it is missing, damaged, or has other columns.
    """
    rows = RowsInFile(path)
    return rows if rows.num_rows > _MAX_ROWS_AT_ONCE else RowsInMemory(rows.table())


def write_rows(
    parts: Iterable[pa.Table], to: Path | pa.NativeFile, schema: pa.Schema = ACTOR_SCHEMA
) -> None:
    """Write consecutive tables as one Parquet file, row group by row group."""
    with pq.ParquetWriter(to, schema, **PARQUET) as writer:
        left, written = schema.empty_table(), 0
        for part in parts:
            left = pa.concat_tables([left, part])
            while left.num_rows >= _ROWS_PER_GROUP:
                writer.write_table(left.slice(0, _ROWS_PER_GROUP).combine_chunks())
                left, written = left.slice(_ROWS_PER_GROUP), written + _ROWS_PER_GROUP
        if left.num_rows or not written:
            writer.write_table(left.combine_chunks())


def _whole_steps(groups: Iterable[pa.Table]) -> Iterator[pa.Table]:
    """Yield the rows of consecutive groups, cut between steps."""
    left = None
    for group in groups:
        both = group if left is None else pa.concat_tables([left, group])
        times = both["time_s"].to_numpy()
        cut = int(np.searchsorted(times, times[-1])) if len(times) else 0
        if cut:
            yield both.slice(0, cut)
        left = both.slice(cut)
    if left is not None and left.num_rows:
        yield left


def _between(table: pa.Table, from_s: float, until_s: float) -> pa.Table:
    times = table["time_s"].to_numpy()
    first = int(np.searchsorted(times, from_s))
    last = int(np.searchsorted(times, until_s, side="right"))
    return table.slice(first, last - first)
