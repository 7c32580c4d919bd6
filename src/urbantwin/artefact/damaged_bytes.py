"""Which bytes of a damaged file are wrong, as exactly as its format tells."""

from __future__ import annotations

import math
import re
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pyarrow.parquet as pq

__all__ = [
    "column_bytes", "column_paths", "header_place", "is_parquet", "member_place", "parquet_place",
    "picture_place", "span",
]  # fmt: skip

_NPY, _PARQUET = b"\x93NUMPY", b"PAR1"
#: Of a file of Parquet: its footer's length, and its mark.
_TAIL = 8


def span(begin: int, end: int) -> str:
    """Return the name of the bytes of a file from ``begin`` to before ``end``, counted from 0."""
    return f"byte {begin}" if end <= begin + 1 else f"bytes {begin} to {end - 1}"


def header_place(path: Path) -> str | None:
    """Return where the header of a ``.npy`` is wrong (NEP 1), or None where it looks right."""
    with path.open("rb") as stream:
        head = stream.read(1 << 16)
    for byte, right in enumerate(_NPY):
        if head[byte : byte + 1] != bytes([right]):
            return f"byte {byte}"
    if head[6:8] not in (b"\1\0", b"\2\0", b"\3\0"):
        return "bytes 6 to 7, its version"
    begin = min(10 if head[6] == 1 else 12, len(head))
    end = begin + int.from_bytes(head[8:begin], "little")
    if end > len(head):
        return f"bytes 8 to {begin - 1}, or byte {len(head)}: its header has {end} bytes"
    # No printable letter, a line that ends early, or anything but blanks behind the mapping.
    odd = re.search(rb"[^ -~\n]|\n(?=.)|(?<=, \}) *[^ \n]", head[begin:end], re.DOTALL)
    if odd:
        return f"byte {begin + odd.end() - 1}"
    return f"{span(begin, end)}, its header"


def member_place(packed: zipfile.ZipFile, member: zipfile.ZipInfo, _: object = None) -> str:
    """Return the name of a member of a zip, and which bytes of the file are its."""
    begin = member.header_offset
    behind = [one.header_offset for one in packed.infolist() if one.header_offset > begin]
    end = min(behind, default=packed.start_dir)
    if not 0 <= begin < end:  # by a directory that is damaged itself
        return f"its directory, from byte {packed.start_dir} on"
    return f"{member.filename[:60]} ({span(begin, end)})"


def picture_place(path: Path) -> str | None:
    """Return the first chunk of a PNG that is wrong by its own checksum, or None (RFC 2083)."""
    data = path.read_bytes()
    if data[:8] != b"\x89PNG\r\n\x1a\n":
        return span(0, 8)
    begin = 8
    while begin < len(data):
        end = begin + 12 + int.from_bytes(data[begin : begin + 4], "big")
        if end > len(data):
            return f"{span(begin, begin + 4)}, or byte {len(data)}, where it ends"
        if zlib.crc32(data[begin + 4 : end - 4]) != int.from_bytes(data[end - 4 : end], "big"):
            return span(begin, end)
        if data[begin + 4 : begin + 8] == b"IEND":
            return None if end == len(data) else f"byte {end}"
        begin = end
    return f"byte {len(data)}"


#: What Arrow says of a column whose statistics of sizes are wrong. It says so where the column is
#: read; where its place in the file is asked for, it ends the process.
_WRONG_SIZES = ("histogram size mismatch", "Unencoded byte array")


def is_parquet(path: Path) -> bool:
    """Return whether a file begins as Parquet does, which Arrow does not look at."""
    with path.open("rb") as stream:
        return stream.read(len(_PARQUET)) == _PARQUET


def parquet_place(path: Path, file: pq.ParquetFile | None) -> str | None:
    """Return where a file of Parquet is wrong, or None where every part of it can be read.

    Args:
        path: the file.
        file: the file, if its footer could be read.
    """
    if file is not None:
        return _damaged_column(file)
    size = path.stat().st_size
    with path.open("rb") as stream:
        head = stream.read(len(_PARQUET))
        stream.seek(max(size - _TAIL, 0))
        tail = stream.read()
    if head != _PARQUET:
        return span(0, len(_PARQUET))
    if tail[4:] != _PARQUET:
        return f"{span(size - len(_PARQUET), size)}, its end"
    length = int.from_bytes(tail[:4], "little")
    begin = size - _TAIL - length
    if begin < len(_PARQUET):
        return f"{span(size - _TAIL, size - len(_PARQUET))}, the length of its footer"
    return f"{span(begin, size - len(_PARQUET))}, its footer and the length of that"


def column_paths(file: pq.ParquetFile) -> list[str]:
    """Return the names of the columns, those within others after a dot, by the schema.

    What a column's own place says of its name may be what is damaged.
    """
    return [file.schema.column(number).path for number in range(file.metadata.num_columns)]


def column_bytes(
    file: pq.ParquetFile, group: int, numbers: Sequence[int], error: Exception
) -> str | None:
    """Return the bytes of columns of a group of rows, or None where Arrow cannot tell them.

    Args:
        file: of Parquet.
        group: of rows.
        numbers: of the columns.
        error: that reading them raised.
    """
    if not numbers or any(said in str(error) for said in _WRONG_SIZES):
        return None
    told = [file.metadata.row_group(group).column(number) for number in numbers]
    begin = [min(one.dictionary_page_offset or math.inf, one.data_page_offset) for one in told]
    end = [at + one.total_compressed_size for at, one in zip(begin, told, strict=True)]
    return span(int(min(begin)), int(max(end)))


def _damaged_column(file: pq.ParquetFile) -> str | None:
    """Return the first column of a group of rows that cannot be read, and its bytes."""
    names = column_paths(file)
    for group in range(file.metadata.num_row_groups):
        for number, name in enumerate(names):
            try:
                file.read_row_group(group, columns=[name]).validate(full=True)
            except Exception as error:  # whatever Arrow raises: this is the one
                where = column_bytes(file, group, [number], error)
                place = f"group {group + 1} of rows, column {name[:60]}"
                return place if where is None else f"{place} ({where})"
    return None
