"""Rows of a PLY's elements as columns; rows with lists may differ in length."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numba
import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.reconstruct.formats.text_lines import numbers_of

__all__ = ["Element", "Table", "ascii_tables", "binary_tables"]


@dataclass
class Element:
    """An element of the header: its name, its rows and their properties.

    Attributes:
        name: ``vertex``, ``face``, ...
        count: number of rows.
        properties: name, numpy type, and numpy type of a list's length (``None``: not a list).
    """

    name: str
    count: int
    properties: list[tuple[str, str, str | None]]


@dataclass
class Table:
    """An element's values: (rows,) columns; lists as all values and the length (rows,) of each."""

    count: int
    columns: dict[str, NDArray[np.generic]] = field(default_factory=dict)
    lists: dict[str, tuple[NDArray[np.generic], NDArray[np.int64]]] = field(default_factory=dict)


def binary_tables(path: Path, start: int, elements: list[Element], order: str) -> dict[str, Table]:
    """Read the elements of a binary PLY; ``order`` is numpy's sign of the byte order.

    Raises:
        InputError: the file ends before its last row.
    """
    data = np.memmap(path, np.uint8, "r") if path.stat().st_size else np.zeros(0, np.uint8)
    found: dict[str, Table] = {}
    at = start
    for element in elements:
        if not element.properties or not element.count:
            found[element.name] = Table(element.count if element.properties else 0)
            continue
        table, at = _binary_table(data, at, element, order, path)
        found.setdefault(element.name, table)
    return found


def _binary_table(
    data: NDArray[np.uint8], at: int, element: Element, order: str, path: Path
) -> tuple[Table, int]:
    sizes = np.array([np.dtype(kind).itemsize for _, kind, _ in element.properties])
    counts = np.array(
        [0 if size is None else np.dtype(size).itemsize for _, _, size in element.properties]
    )
    lengths = np.ones((element.count, len(sizes)), np.int64)
    row = int(np.where(counts > 0, counts, sizes).sum())
    if element.count * row > len(data) - at:
        raise _cut_short(path, element, (len(data) - at) // row)
    end = at + int(sizes.sum()) * element.count
    if (counts > 0).any():
        rows, end = _list_lengths(data, at, lengths, sizes, counts, order == ">")
        if rows < element.count:
            raise _cut_short(path, element, rows)
    table = Table(element.count)
    if (lengths == lengths[0]).all():
        _same_rows(table, data[at:end], element, lengths[0], order)
    else:
        _differing_rows(table, data[at:end], element, lengths, sizes, counts, order)
    return table, end


def _cut_short(path: Path, element: Element, rows: int) -> InputError:
    return InputError(
        f"ends after {max(rows, 0)} of {element.count} rows of {element.name}",
        file=path,
        expected="the whole file",
    )


@numba.njit(cache=True)
def _list_lengths(data, at, lengths, sizes, counts, big):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Fill the lengths of lists; return the number of whole rows and where they end."""
    last = len(data)
    for row in range(lengths.shape[0]):
        for column in range(len(sizes)):
            length = 1
            if counts[column]:
                if at + counts[column] > last:
                    return row, at
                length = 0
                for byte in range(counts[column]):
                    shift = counts[column] - 1 - byte if big else byte
                    length += int(data[at + byte]) << (8 * shift)
                at += counts[column]
                lengths[row, column] = length
            if length < 0 or length > (last - at) // sizes[column]:
                return row, at
            at += length * sizes[column]
    return lengths.shape[0], at


def _same_rows(
    table: Table,
    data: NDArray[np.uint8],
    element: Element,
    lengths: NDArray[np.int64],
    order: str,
) -> None:
    fields: list[tuple[str, object]] = []
    for number, (_, kind, size) in enumerate(element.properties):
        if size is not None:
            fields.append((f"n{number}", order + size))
            fields.append((f"v{number}", (order + kind, (int(lengths[number]),))))
        else:
            fields.append((f"v{number}", order + kind))
    rows = np.frombuffer(data.tobytes(), np.dtype(fields))
    for number, (name, kind, size) in enumerate(element.properties):
        values = rows[f"v{number}"].astype(kind)
        if size is None:
            table.columns[name] = values
        else:
            table.lists[name] = (values.ravel(), np.full(len(rows), lengths[number], np.int64))


def _differing_rows(
    table: Table,
    data: NDArray[np.uint8],
    element: Element,
    lengths: NDArray[np.int64],
    sizes: NDArray[np.int64],
    counts: NDArray[np.int64],
    order: str,
) -> None:
    spans = counts + lengths * sizes
    ends = np.cumsum(spans.ravel()).reshape(spans.shape)
    begins = ends - lengths * sizes
    for number, (name, kind, size) in enumerate(element.properties):
        length = lengths[:, number] * sizes[number]
        total = np.cumsum(length) - length
        where = np.repeat(begins[:, number] - total, length) + np.arange(int(length.sum()))
        values = np.frombuffer(data[where].tobytes(), order + kind).astype(kind)
        if size is None:
            table.columns[name] = values
        else:
            table.lists[name] = (values, lengths[:, number].copy())


def ascii_tables(path: Path, start: int, elements: list[Element]) -> dict[str, Table]:
    """Read the elements of an ASCII PLY.

    Raises:
        InputError: something is not a number, or the file ends before its last row.
    """
    with path.open("rb") as stream:
        stream.seek(start)
        values = numbers_of(stream.read())
    found: dict[str, Table] = {}
    at = 0
    for element in elements:
        table = Table(element.count if element.properties else 0)
        found.setdefault(element.name, table)
        if not element.count or not element.properties:
            continue
        is_list = np.array([size is not None for _, _, size in element.properties])
        lengths = np.ones((element.count, len(is_list)), np.int64)
        if element.count * len(is_list) > len(values) - at:
            raise _cut_short(path, element, (len(values) - at) // len(is_list))
        rows, end = _ascii_lengths(values, at, lengths, is_list)
        if rows < element.count:
            raise _cut_short(path, element, rows)
        spans = is_list + lengths
        ends = at + np.cumsum(spans.ravel()).reshape(spans.shape)
        for number, (name, kind, size) in enumerate(element.properties):
            length = lengths[:, number]
            total = np.cumsum(length) - length
            begin = ends[:, number] - length
            where = np.repeat(begin - total, length) + np.arange(int(length.sum()))
            column = values[where] if kind[0] == "f" else values[where].astype(np.int64)
            if size is None:
                table.columns[name] = column
            else:
                table.lists[name] = (column, length.copy())
        at = end
    return found


@numba.njit(cache=True)
def _ascii_lengths(values, at, lengths, is_list):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Fill the lengths of lists; return the number of whole rows and where they end."""
    for row in range(lengths.shape[0]):
        for column in range(len(is_list)):
            length = 1
            if is_list[column]:
                if at >= len(values):
                    return row, at
                length = int(values[at])
                at += 1
                lengths[row, column] = length
            if length < 0 or length > len(values) - at:
                return row, at
            at += length
    return lengths.shape[0], at
