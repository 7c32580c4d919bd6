"""Tables of a dataset, read and checked against their columns."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.tables import columns_of, read_parquet
from urbantwin.dataset.reading.columns import BOX, TABLES, arrow_schema
from urbantwin.errors import InputError

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["box_array", "frames_of", "read_table", "rows_by_frame", "rows_by_name"]

#: Limit of coordinates and times.
_FURTHEST = 1e10
_LARGEST_TRACK = 2**31


def frames_of(table: pa.Table) -> tuple[list[str], NDArray[np.int64]]:
    """Return the names of the frames in a table, and the index of the name of each row (N,)."""
    frames = table["frame"].combine_chunks().dictionary_encode()
    codes = frames.indices.to_numpy(zero_copy_only=False).astype(np.int64)
    return frames.dictionary.to_pylist(), codes


def rows_by_frame(table: pa.Table) -> dict[str, NDArray[np.int64]]:
    """Return the row numbers of each frame in a table, by name of the frame."""
    names, codes = frames_of(table)
    order = np.argsort(codes, kind="stable")
    cuts = np.flatnonzero(np.diff(codes[order])) + 1
    return {names[codes[own[0]]]: own for own in np.split(order, cuts) if len(own)}


def rows_by_name(frame: NDArray[np.object_]) -> dict[str, NDArray[np.int64]]:
    """Return the row numbers of each frame, from the name of the frame of each row (N,)."""
    import pyarrow as pa

    return rows_by_frame(pa.table({"frame": pa.array(frame, pa.string())}))


def box_array(table: pa.Table) -> NDArray[np.float64]:
    """Return the boxes (B, 7) of a table."""
    return np.column_stack([table[name].to_numpy() for name in BOX]).reshape(-1, len(BOX))


def read_table(path: Path, columns: Mapping[str, str] | None = None) -> pa.Table:
    """Read a table of a dataset.

    Args:
        path: the file.
        columns: its columns; by default those of a dataset's table of this name.

    Raises:
        InputError: missing or damaged file; or a column that is missing, of another type,
            incomplete or out of bounds, which is named.
    """
    import pyarrow as pa

    expected = f"{path.name} of a dataset"
    table = read_parquet(path, expected)
    columns = TABLES[path.name] if columns is None else columns
    schema = arrow_schema(columns)
    lists = [field.name for field in schema if pa.types.is_list(field.type)]
    kinds = {
        field.name: "number" if pa.types.is_floating(field.type) else "text"
        if pa.types.is_string(field.type) else "whole"
        for field in schema
        if not columns[field.name].endswith("?") and field.name not in lists
    }  # fmt: skip
    for name, values in columns_of(table, kinds, path, expected).items():
        if values.dtype.kind not in "fi" or not len(values):
            continue
        most = _LARGEST_TRACK if values.dtype.kind == "i" else _FURTHEST
        if np.abs(values).max() > most:
            raise InputError("has a value that is out of bounds", file=path, place=name)
    for name in lists:
        is_present = name in table.column_names
        if not columns[name].endswith("?") and not (
            is_present and pa.types.is_list(table[name].type)
        ):
            raise InputError("is no list", file=path, place=name, expected="a list of metres")
    for name in table.column_names:
        if not columns.get(name, "").endswith("?"):
            continue
        expected_type, actual = schema.field(name).type, table[name].type
        for is_kind, what in ((pa.types.is_floating, "number"), (pa.types.is_string, "text")):
            if is_kind(expected_type) and not is_kind(actual):
                raise InputError(f"holds {actual}", file=path, place=name, expected=what)
    return table
