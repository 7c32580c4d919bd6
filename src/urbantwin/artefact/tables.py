"""Tables of columns, Parquet and Feather, read so that a damaged one is one clear line."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from urbantwin.artefact.arrays import may_unpack, one_line
from urbantwin.errors import InputError

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["check_finite", "read_feather", "read_parquet"]


def read_parquet(
    path: Path, expected: str, *, columns: Sequence[str] | None = None, schema: pa.Schema = None
) -> pa.Table:
    """Read a Parquet file.

    Args:
        path: the file.
        expected: what it should be, for errors.
        columns: the columns to read; all without it. Those that the file lacks are left out.
        schema: what it must have, column for column; then no value may be missing, and no number
            may be other than finite.

    Raises:
        InputError: missing, damaged, larger than its size allows, or with other columns.
    """
    import pyarrow.parquet as pq

    try:
        size = path.stat().st_size
        # Not mapped: a page that a damaged disk cannot read would end the process.
        with pq.ParquetFile(path, memory_map=False) as file:
            told = file.metadata
            groups = [told.row_group(k) for k in range(told.num_row_groups)]
            rows = sum(group.num_rows for group in groups)
            unpacked = sum(group.total_byte_size for group in groups)
            if (
                rows != told.num_rows
                or min((group.num_rows for group in groups), default=0) < 0
                or not may_unpack(max(unpacked, rows * max(told.num_columns, 1)), size)
            ):
                raise InputError("has other rows than it says", file=path, expected=expected)
            found = file.schema_arrow
            if schema is not None and not found.equals(schema, check_metadata=False):
                raise InputError(
                    "has other columns",
                    file=path,
                    expected=", ".join(f"{one.name} ({one.type})" for one in schema),
                )
            wanted = None if columns is None else [one for one in columns if one in found.names]
            table = file.read(columns=wanted)
        return _whole(table, path, expected, schema)
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError("not found", file=path, expected=expected) from None
    except Exception as error:  # Arrow's, and UnicodeError, OverflowError, MemoryError of its names
        raise _damaged(error, path, expected) from None


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
    except FileNotFoundError:
        raise InputError("not found", file=path, expected=expected) from None
    except Exception as error:  # see above
        raise _damaged(error, path, expected) from None


def check_finite(table: pa.Table, columns: Iterable[str], path: Path) -> None:
    """Refuse columns of numbers in which a value is missing or not finite.

    Raises:
        InputError: one is; the column is named.
    """
    for name in columns:
        column = table[name]
        if column.null_count:
            raise InputError("lacks values", file=path, place=name, expected="one in every row")
        if str(column.type) in ("double", "float") and not np.isfinite(column.to_numpy()).all():
            raise InputError("has a value that is not finite", file=path, place=name)


def _whole(table: pa.Table, path: Path, expected: str, schema: pa.Schema) -> pa.Table:
    """Return a table in one piece; offsets, lengths and text are checked before they are used."""
    table.validate(full=True)
    names = table.column_names
    if len(set(names)) < len(names):
        raise InputError("has a column twice", file=path, expected=expected)
    if schema is not None:
        check_finite(table, names, path)
    return table.combine_chunks()


def _damaged(error: Exception, path: Path, expected: str) -> InputError:
    if isinstance(error, MemoryError):
        return InputError("needs more memory than there is", file=path, expected=expected)
    return InputError(f"is damaged ({one_line(error)})", file=path, expected=expected)
