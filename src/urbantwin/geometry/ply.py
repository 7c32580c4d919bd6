"""PLY, ASCII and binary, as tables of its elements (Turk, "The PLY Polygon File Format", 1994)."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.number_text import leading_numbers

__all__ = ["Element", "Header", "Table", "read_header", "read_tables"]

#: A header is not longer than this, bytes.
LONGEST_HEADER = 1 << 20
_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
    **dict.fromkeys(("int64", "long"), "i8"),
    **dict.fromkeys(("uint64", "ulong"), "u8"),
}
#: Encoding -> numpy's character of its byte order; empty for text.
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


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


@dataclass(frozen=True)
class Header:
    """Contents of a header.

    Attributes:
        order: numpy's character of the byte order; empty for text.
        elements: in their order in the file.
        comments: texts of ``comment`` and ``obj_info``.
        length: bytes before the first row.
    """

    order: str
    elements: list[Element]
    comments: list[str]
    length: int


@dataclass
class Table:
    """An element's values: (rows,) columns; lists as all values and the length (rows,) of each."""

    count: int
    columns: dict[str, NDArray[np.generic]] = field(default_factory=dict)
    lists: dict[str, tuple[NDArray[np.generic], NDArray[np.int64]]] = field(default_factory=dict)

    @classmethod
    def empty(cls, element: Element) -> Table:
        """Return the table of an element without rows or without properties."""
        columns = {name: np.zeros(0, kind) for name, kind, size in element.properties if not size}
        return cls(0, columns)


def read_header(path: Path) -> Header:
    """Read the header of a PLY.

    Raises:
        InputError: it is missing, has no end, or is not valid.
    """
    with path.open("rb") as stream:
        start = stream.read(LONGEST_HEADER)
    end = re.search(rb"\nend_header[ \t]*\r?\n", start)
    if not re.match(rb"ply\s", start) or end is None:
        what = "has a header without an end" if start.startswith(b"ply") else "is not a PLY"
        raise InputError(what, file=path, expected="the whole header of a PLY: ply ... end_header")
    encoding, elements, comments = "", list[Element](), list[str]()
    for number, line in enumerate(start[: end.start()].decode("latin-1").splitlines(), 1):
        words = line.split()
        try:
            match words:
                case ["format", name, _]:
                    encoding = name
                case ["comment" | "obj_info", *_]:
                    comments.append(line.partition(" ")[2].strip())
                case ["element", name, count]:
                    if int(count) < 0:
                        raise ValueError
                    elements.append(Element(name, int(count), []))
                case ["property", "list", size, kind, name]:
                    _declare(elements[-1], name, _TYPES[kind], _TYPES[size])
                case ["property", kind, name]:
                    _declare(elements[-1], name, _TYPES[kind], None)
                case ["ply"] | []:
                    pass
                case _:
                    raise ValueError
        except (ValueError, KeyError, IndexError):
            raise InputError(
                f"has {line[:40]!r}", file=path, place=f"line {number}", expected="a PLY header"
            ) from None
    if encoding not in _ORDERS:
        raise InputError(f"has format {encoding!r}", file=path, expected="ascii or binary_*_endian")
    return Header(_ORDERS[encoding], elements, comments, end.end())


def _declare(element: Element, name: str, kind: str, size: str | None) -> None:
    if any(name == known for known, _, _ in element.properties):
        raise ValueError
    element.properties.append((name, kind, size))


def read_tables(path: Path, header: Header, last: str | None = None) -> dict[str, Table]:
    """Read the elements of a PLY by their names; if a name is repeated, the first.

    Args:
        path: the file.
        header: its header.
        last: the last element to read; later ones are skipped. By default all are read.

    Raises:
        InputError: the file ends before its last row, or a value in a text file is not a number.
    """
    names = [element.name for element in header.elements]
    wanted = header.elements[: names.index(last) + 1] if last in names else header.elements
    if not header.order:
        return _ascii_tables(path, header.length, wanted)
    return _binary_tables(path, header.length, wanted, header.order)


def _binary_tables(path: Path, start: int, elements: list[Element], order: str) -> dict[str, Table]:
    data = np.memmap(path, np.uint8, "r") if path.stat().st_size else np.zeros(0, np.uint8)
    found: dict[str, Table] = {}
    at = start
    for element in elements:
        if not element.properties or not element.count:
            found.setdefault(element.name, Table.empty(element))
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
    row = int(np.where(counts > 0, counts, sizes).sum())
    if element.count * row > len(data) - at:
        raise _cut_short(path, element, (len(data) - at) // row)
    end = at + int(sizes.sum()) * element.count
    has_lists = bool((counts > 0).any())
    lengths = np.ones((element.count if has_lists else 1, len(sizes)), np.int64)
    if has_lists:
        from urbantwin.geometry.ply_lists import binary_lengths

        rows, end = binary_lengths(data, at, lengths, sizes, counts, order == ">")
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
        f"ends after {rows} of {element.count} rows of {element.name}",
        file=path,
        expected="the whole file",
    )


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


def _ascii_tables(path: Path, start: int, elements: list[Element]) -> dict[str, Table]:
    with path.open("rb") as stream:
        stream.seek(start)
        values = leading_numbers(stream.read())
    found: dict[str, Table] = {}
    at = 0
    for element in elements:
        if not element.properties or not element.count:
            found.setdefault(element.name, Table.empty(element))
            continue
        table = found.setdefault(element.name, Table(element.count))
        is_list = np.array([size is not None for _, _, size in element.properties])
        if element.count * len(is_list) > len(values) - at:
            raise _cut_short(path, element, (len(values) - at) // len(is_list))
        lengths = np.ones((element.count, len(is_list)), np.int64)
        end = at + lengths.size
        if is_list.any():
            from urbantwin.geometry.ply_lists import ascii_lengths

            rows, end = ascii_lengths(values, at, lengths, is_list)
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
