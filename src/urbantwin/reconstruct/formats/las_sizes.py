"""Sizes and counts of a LAS or LAZ, checked against the file before memory is allocated.

laspy and its decompressor believe them: a few bytes changed in a small file ask for gigabytes, and
the decompressor ends the process when it does not get them. Sources: LAS 1.4 R15, tables 3, 5 and
29; LASzip 2.2, "laszip.hpp" and the chunk table of "lasreadpoint.cpp"; the layers of a chunk,
LASzip 3, "lasreaditemcompressed_v3.cpp".
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import lazrs

from urbantwin.errors import InputError

__all__ = ["LasSizes", "checked_sizes", "layers_fit"]

#: Of a header of version 1.0 to 1.3, and of 1.4.
_SHORT, _LONG = 227, 375
_VLR, _EVLR = 54, 60
_LASZIP = (b"laszip encoded", 22204)
_VARIABLE = 2**32 - 1
#: Layers of a chunk by the type of item (LASzip 3): point, colours, colours with infrared, waves;
#: of extra bytes (14) there are as many as bytes.
_LAYERED, _LAYERS = 3, {10: 9, 11: 1, 12: 2, 13: 1}
#: A point takes this at least, bytes.
_SMALLEST = 20


@dataclass(frozen=True)
class LasSizes:
    """What a header says.

    Attributes:
        points: how many.
        record: bytes of a point, unpacked.
        chunk: points that are packed together, 0 of what is not packed.
    """

    points: int
    record: int
    chunk: int


def checked_sizes(path: Path) -> LasSizes | None:
    """Return the sizes of a file whose header can be believed; ``None`` where it has none.

    Raises:
        InputError: it names more records, chunks or bytes than the file has.
    """
    size = path.stat().st_size
    with path.open("rb") as stream:
        head = stream.read(_LONG)
        if len(head) < _SHORT or not head.startswith(b"LASF"):
            return None
        header_size, first_point, records = struct.unpack_from("<HII", head, 94)
        kind, record, points = struct.unpack_from("<BHI", head, 104)
        if head[25] >= 4 and len(head) >= 255:
            extended, extended_count, points = struct.unpack_from("<QIQ", head, 235)
            _check_extended(stream, extended, extended_count, size, path)
        # Two marks in the two highest bits say that points are packed (LASzip).
        packed = _check_records(stream, header_size, records, min(first_point, size), path)
        if not kind & 0x80:
            return LasSizes(points, record, 0)
        if packed is None:
            raise _wrong(path, "has packed points but no record that says how")
        return _packed(stream, packed, first_point, LasSizes(points, record, 0), path)


def _wrong(path: Path, problem: str) -> InputError:
    return InputError(f"cannot be read as LAS ({problem})", file=path, expected="LAS or LAZ")


def _check_records(stream: BinaryIO, start: int, count: int, end: int, path: Path) -> bytes | None:
    """Walk the records before the points; return the one that says how points are packed."""
    packed, at = None, start
    if count * _VLR > end - start:
        raise _wrong(path, f"its header names {count} records, more than it has room for")
    for _ in range(count):
        stream.seek(at)
        row = stream.read(_VLR)
        if len(row) < _VLR:
            raise _wrong(path, "its header names more records than it has")
        user, number, length = struct.unpack_from("<2x16sHH", row)
        at += _VLR + length
        if at > end:
            raise _wrong(path, "a record of its header runs into its points")
        if (user.rstrip(b"\0"), number) == _LASZIP:
            packed = stream.read(length)
    return packed


def _check_extended(stream: BinaryIO, start: int, count: int, size: int, path: Path) -> None:
    at = start
    for _ in range(count):
        stream.seek(min(at, size))
        row = stream.read(_EVLR)
        length = struct.unpack_from("<Q", row, 20)[0] if len(row) == _EVLR else size
        at += _EVLR + length
        if at > size:
            raise _wrong(path, "its header names more records than it has")


def _packed(
    stream: BinaryIO, record: bytes, first_point: int, said: LasSizes, path: Path
) -> LasSizes:
    """Check how points are packed and the table of their chunks."""
    size = path.stat().st_size
    items = struct.unpack_from("<H", record, 32)[0] if len(record) >= 34 else 0
    if not items or len(record) < 34 + 6 * items:
        raise _wrong(path, "does not say how its points are packed")
    chunk = struct.unpack_from("<I", record, 12)[0]
    unpacked = sum(struct.unpack_from("<H", record, 36 + 6 * k)[0] for k in range(items))
    if unpacked != said.record or said.record < _SMALLEST or not chunk:
        raise _wrong(path, f"packs points of {unpacked} bytes, and not of {said.record}")
    most = max(1, min(said.points, size // _SMALLEST))  # without a point, an empty one
    if chunk != _VARIABLE:
        most = min(most, -(-said.points // chunk) + 1)
    if _chunk_count(stream, first_point, size) > most:
        raise _wrong(path, "its table of chunks is longer than its points")
    stream.seek(first_point)
    try:
        table = lazrs.read_chunk_table(stream, lazrs.LazVlr(record))
    except (lazrs.LazrsError, OSError, ValueError, TypeError, OverflowError):
        raise _wrong(path, "is cut short or damaged: its table of chunks is not whole") from None
    if sum(bytes_ for _, bytes_ in table) > size:
        raise _wrong(path, "its table of chunks names more bytes than it has")
    at = first_point + 8
    for _, length in table:
        if not layers_fit(_bytes_at(stream, at, min(length, 1 << 16)), length, record):
            raise _wrong(path, "a chunk of its points is damaged")
        at += length
    if chunk == _VARIABLE:
        chunk = max((points for points, _ in table), default=0)
    return LasSizes(said.points, said.record, chunk)


def layers_fit(chunk: bytes, size: int, record: bytes) -> bool:
    """Return whether the layers of a packed chunk can be believed.

    Args:
        chunk: its first bytes, 64 KiB or all of it.
        size: how many it has.
        record: what says how points are packed (LASzip's record).
    """
    if struct.unpack_from("<H", record, 0)[0] != _LAYERED or not size:
        return True  # points one after the other, of which no sizes are told
    items = struct.unpack_from("<H", record, 32)[0]
    layers = point = 0
    for k in range(items):
        kind, length = struct.unpack_from("<HH", record, 34 + 6 * k)
        layers += length if kind == 14 else _LAYERS.get(kind, 1)
        point += length
    # The first point as it is, how many points there are, and the size of every layer.
    before = point + 4 + 4 * layers
    if len(chunk) < before:
        return False
    sizes = struct.unpack_from(f"<{layers}I", chunk, point + 4)
    return bool(before + sum(sizes) <= size)


def _bytes_at(stream: BinaryIO, at: int, length: int) -> bytes:
    stream.seek(at)
    return stream.read(length)


def _chunk_count(stream: BinaryIO, first_point: int, size: int) -> int:
    """Return the number of chunks that the table names, 0 where there is none."""
    stream.seek(min(first_point, size))
    place = stream.read(8)
    at = struct.unpack("<q", place)[0] if len(place) == 8 else -1
    if at == -1 and size > 8:  # written by a program that could not go back: it is at the end
        stream.seek(size - 8)
        at = struct.unpack("<q", stream.read(8))[0]
    if not 0 <= at <= size - 8:
        return 0
    stream.seek(at + 4)
    return int(struct.unpack("<I", stream.read(4))[0])
