"""The tables of a data set, read and checked against their columns."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.tables import columns_of, read_parquet
from urbantwin.dataset.reading.columns import TABLES, arrow_schema
from urbantwin.errors import InputError

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["frames_of", "read_table", "rows_by_frame"]

#: No place in a site and no time of a motion is farther from 0.
_FURTHEST = 1e10
_LARGEST_TRACK = 2**31


def frames_of(table: pa.Table) -> tuple[list[str], NDArray[np.int64]]:
    """Return the names of the frames in a table, and the number of the name of each row (N,)."""
    frames = table["frame"].combine_chunks().dictionary_encode()
    codes = frames.indices.to_numpy(zero_copy_only=False).astype(np.int64)
    return frames.dictionary.to_pylist(), codes


def rows_by_frame(table: pa.Table) -> dict[str, NDArray[np.int64]]:
    """Return the numbers of the rows of each frame in a table, by the name of the frame."""
    names, codes = frames_of(table)
    order = np.argsort(codes, kind="stable")
    cuts = np.flatnonzero(np.diff(codes[order])) + 1
    return {names[codes[own[0]]]: own for own in np.split(order, cuts) if len(own)}


def read_table(path: Path, columns: Mapping[str, str] | None = None) -> pa.Table:
    """Read a table of a data set.

    Args:
        path: the file.
        columns: its columns; those of a data set's table of this name when not given.

    Raises:
        InputError: the file is missing or damaged, or a column is missing, of another kind, without
            a value, or out of bounds; the error names it.
    """
    import pyarrow as pa

    expected = f"{path.name} of a dataset"
    table = read_parquet(path, expected)
    columns = TABLES[path.name] if columns is None else columns
    schema = arrow_schema(columns)
    lists = [one.name for one in schema if pa.types.is_list(one.type)]
    kinds = {
        one.name: "number" if pa.types.is_floating(one.type) else "text"
        if pa.types.is_string(one.type) else "whole"
        for one in schema
        if not columns[one.name].endswith("?") and one.name not in lists
    }  # fmt: skip
    for name, values in columns_of(table, kinds, path, expected).items():
        if values.dtype.kind not in "fi" or not len(values):
            continue
        most = _LARGEST_TRACK if values.dtype.kind == "i" else _FURTHEST
        if np.abs(values).max() > most:
            raise InputError("has a value that is out of bounds", file=path, place=name)
    for name in lists:
        there = name in table.column_names
        if not columns[name].endswith("?") and not (there and pa.types.is_list(table[name].type)):
            raise InputError("is no list", file=path, place=name, expected="a list of metres")
    for name in table.column_names:
        if not columns.get(name, "").endswith("?"):
            continue
        kind, found = schema.field(name).type, table[name].type
        for is_kind, what in ((pa.types.is_floating, "number"), (pa.types.is_string, "text")):
            if is_kind(kind) and not is_kind(found):
                raise InputError(f"holds {found}", file=path, place=name, expected=what)
    return table
