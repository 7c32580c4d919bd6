"""Tables: validated reading of Parquet and Feather with one-line errors, and writing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.arrays import may_unpack, one_line
from urbantwin.errors import InputError, limit_reached

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = [
    "PARQUET",
    "ParquetGroups",
    "check_finite",
    "columns_of",
    "read_feather",
    "read_parquet",
    "write_parquet_and_csv",
]

#: Options of written tables. Page checksums let readers detect damage, since zstd has none here.
PARQUET: dict[str, Any] = {"compression": "zstd", "write_page_checksum": True}


def write_parquet_and_csv(stem: Path, table: pa.Table) -> None:
    """Write a table as Parquet and as CSV.

    Args:
        stem: the file's name without ``.parquet`` and ``.csv``.
        table: table to write.
    """
    import pyarrow.csv
    import pyarrow.parquet as pq

    pq.write_table(table, stem.with_name(f"{stem.name}.parquet"), **PARQUET)
    pyarrow.csv.write_csv(table, stem.with_name(f"{stem.name}.csv"))


def read_parquet(
    path: Path, expected: str, *, columns: Sequence[str] | None = None, schema: pa.Schema = None
) -> pa.Table:
    """Read a Parquet file.

    Args:
        path: the file.
        expected: expected content, for errors.
        columns: columns to read, all if not given; columns that the file lacks are omitted.
        schema: required columns; then values must not be missing, and numbers must be finite.

    Raises:
        InputError: missing, damaged, larger than its size allows, or with other columns.
    """
    with ParquetGroups(path, expected, schema) as file:
        wanted = None if columns is None else [one for one in columns if one in file.column_names]
        return file.read(wanted)


class ParquetGroups:
    """A Parquet file that is read by row groups, each validated when read.

    Args:
        path: the file.
        expected: expected content, for errors.
        schema: required columns; then values must not be missing, and numbers must be finite.

    Attributes:
        count: number of row groups.
        num_rows: number of rows.
        rows: number of rows of each group.
        column_names: names of its columns.

    Raises:
        InputError: missing, damaged, larger than its size allows, or with other columns.
    """

    def __init__(self, path: Path, expected: str, schema: pa.Schema = None) -> None:
        import pyarrow.parquet as pq

        self._path, self._expected, self._schema = path, expected, schema
        try:
            # Not memory-mapped: an unreadable page would kill the process.
            self._file = pq.ParquetFile(path, memory_map=False, page_checksum_verification=True)
            with path.open("rb") as stream:  # Arrow does not check this
                if stream.read(4) != b"PAR1":
                    raise ValueError("its first bytes are not those of Parquet")
        # Arrow's, and UnicodeError, OverflowError, MemoryError of its names
        except Exception as error:
            raise _damaged(error, path, expected) from None
        try:
            told, size = self._file.metadata, path.stat().st_size
            groups = [told.row_group(k) for k in range(told.num_row_groups)]
            rows = sum(group.num_rows for group in groups)
            unpacked = sum(group.total_byte_size for group in groups)
            if (
                rows != told.num_rows
                or min((group.num_rows for group in groups), default=0) < 0
                or not may_unpack(max(unpacked, rows * max(told.num_columns, 1)), size)
            ):
                raise InputError(
                    "does not have the rows that its header says", file=path, expected=expected
                )
            found = self._file.schema_arrow
            if schema is not None and not found.equals(schema, check_metadata=False):
                raise InputError(
                    "has other columns",
                    file=path,
                    expected=", ".join(f"{one.name} ({one.type})" for one in schema),
                )
            self.count, self.num_rows = len(groups), rows
            self.rows: tuple[int, ...] = tuple(group.num_rows for group in groups)
            self.column_names: tuple[str, ...] = tuple(found.names)
        except InputError:
            raise
        except Exception as error:  # see above
            raise _damaged(error, path, expected) from None

    def read(self, columns: Sequence[str] | None = None, *, group: int | None = None) -> pa.Table:
        """Return all rows, or those of a group, of all or some columns.

        Raises:
            InputError: the rows are damaged.
        """
        wanted = None if columns is None else list(columns)
        try:
            if group is None:
                table = self._file.read(columns=wanted)
            else:
                table = self._file.read_row_group(group, columns=wanted)
            whole = _whole(table, self._path, self._expected, self._schema)
            return whole if wanted is None else whole.select(wanted)
        except InputError:
            raise
        except Exception as error:  # see above
            raise _damaged(error, self._path, self._expected) from None

    def each_row(self, columns: Sequence[str], group: int) -> Iterator[pa.RecordBatch]:
        """Yield the rows of a group one by one, decompressing only what is requested.

        Raises:
            InputError: a row is damaged; names it.
        """
        row = sum(self.rows[:group])
        try:
            for batch in self._file.iter_batches(
                batch_size=1, row_groups=[group], columns=list(columns), use_threads=False
            ):
                batch.validate(full=True)
                yield batch
                row += 1
        except Exception as error:  # see above
            raise InputError(
                _problem(error), file=self._path, place=f"row {row}", expected=self._expected
            ) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self._file.close()


def read_feather(path: Path, expected: str) -> pa.Table:
    """Read a Feather file.

    Raises:
        InputError: missing or damaged.
    """
    from pyarrow import feather

    try:
        return _whole(feather.read_table(path, memory_map=False), path, expected, None)
    except InputError:
        raise
    except Exception as error:  # see above
        raise InputError(_problem(error), file=path, expected=expected) from None


def columns_of(
    table: pa.Table, kinds: Mapping[str, str], path: Path, expected: str
) -> dict[str, NDArray[Any]]:
    """Return columns of a table as arrays.

    Args:
        table: table as read.
        kinds: column -> ``number`` (float64, finite), ``whole`` (int64), ``text`` (objects) or
            ``text or none``.
        path: file, for errors.
        expected: expected content, for errors.

    Raises:
        InputError: a column is missing, is of another kind, or lacks a value; names it.
    """
    import pyarrow as pa

    found: dict[str, NDArray[Any]] = {}
    for name, kind in kinds.items():
        if name not in table.column_names:
            raise InputError("is missing", file=path, place=name, expected=expected)
        column = table[name]
        types = {
            "number": pa.types.is_floating(column.type) or pa.types.is_integer(column.type),
            "whole": pa.types.is_integer(column.type),
        }
        fits = types.get(kind, pa.types.is_string(column.type))
        if not fits:
            raise InputError(f"holds {column.type}", file=path, place=name, expected=kind)
        if kind != "text or none":
            check_finite(table, [name], path)
        array = column.to_numpy(zero_copy_only=False)
        if kind in ("number", "whole"):
            array = array.astype(np.float64 if kind == "number" else np.int64)
        found[name] = array
    return found


def check_finite(table: pa.Table, columns: Iterable[str], path: Path) -> None:
    """Check that columns have no missing values and only finite numbers.

    Raises:
        InputError: a column fails; names it.
    """
    for name in columns:
        column = table[name]
        if column.null_count:
            row = int(np.argmax(column.is_null().to_numpy()))
            place = f"{name}, row {row}"
            raise InputError("lacks values", file=path, place=place, expected="one in every row")
        number = str(column.type) in ("double", "float", "halffloat")
        if number and not (finite := np.isfinite(column.to_numpy())).all():
            place = f"{name}, row {int(np.argmin(finite))}"
            raise InputError("has a value that is not finite", file=path, place=place)


def _whole(table: pa.Table, path: Path, expected: str, schema: pa.Schema) -> pa.Table:
    """Return a validated table in contiguous chunks."""
    table.validate(full=True)
    names = table.column_names
    if len(set(names)) < len(names):
        raise InputError("has a column twice", file=path, expected=expected)
    if schema is not None:
        check_finite(table, names, path)
    return table.combine_chunks()


def _damaged(error: Exception, path: Path, expected: str) -> InputError:
    """Return the error for a Parquet file that cannot be read.

    Raises:
        LimitError: a system limit is the cause, not the file.
    """
    limit = limit_reached(error)
    if limit is not None:
        raise limit from error
    return InputError(_problem(error), file=path, expected=expected)


def _problem(error: Exception) -> str:
    if isinstance(error, FileNotFoundError):
        return "not found"
    if isinstance(error, MemoryError):
        return "needs more memory than there is"
    return f"is not readable ({one_line(error)})"
