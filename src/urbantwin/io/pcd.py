"""PCD files (Point Cloud Library, format 0.7): ascii, binary and binary_compressed.

Compressed points are LZF (Lehmann, LibLZF 3.6): a control byte below 32 is followed by that many
plus one literal bytes; otherwise its upper three bits are the length of a copy less two (seven: one
more byte is added), and its lower five bits with the next byte are the distance back less one.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError

__all__ = ["read_pcd"]

_KINDS = {"F": "f", "I": "i", "U": "u"}


def read_pcd(path: Path) -> tuple[dict[str, NDArray[np.float64]], tuple[int, int]]:
    """Return every field with one value per point as float64 (N,); VIEWPOINT is not applied.

    Returns:
        The fields by name, and height and width of the organised cloud, row by row: 1 and N if it
            is unorganised.

    Raises:
        InputError: not a PCD file, an inconsistent header, or less data than it states.
    """
    data = path.read_bytes()
    header, body = _split(path, data)
    try:
        names = header["FIELDS"]
        sizes = [int(size) for size in header["SIZE"]]
        kinds = [_KINDS[kind] for kind in header["TYPE"]]
        counts = [int(count) for count in header.get("COUNT", ["1"] * len(names))]
        points = int(header.get("POINTS", ["-1"])[0])
        if points < 0:
            points = int(header["WIDTH"][0]) * int(header["HEIGHT"][0])
        shape = int(header.get("HEIGHT", ["1"])[0]), int(header.get("WIDTH", [points])[0])
        encoding = header["DATA"][0]
        if points < 0 or min(counts) < 0:
            raise ValueError
        columns = [
            (f"{index}", f"<{kind}{size}", (count,))
            for index, (kind, size, count) in enumerate(zip(kinds, sizes, counts, strict=True))
        ]
        record = np.dtype(columns)
        if len(names) != len(columns):
            raise ValueError
    except (KeyError, ValueError, IndexError, TypeError):
        raise InputError(
            "the header is not valid", file=path, expected="a PCD 0.7 header"
        ) from None

    # padding fields share one name
    twice = sorted({name for name in names if name != "_" and names.count(name) > 1})
    if twice:
        raise InputError(
            f"has two fields {twice[0]}", file=path, expected="each field once, as in FIELDS x y z"
        )
    if shape[0] * shape[1] != points:
        shape = 1, points
    if encoding == "ascii":
        return _ascii(path, body, names, counts, points), shape
    if encoding == "binary":
        _check_size(path, len(body), points * record.itemsize)
        if points and len(body) >= points * (record.itemsize + 1):
            raise InputError(
                f"has {len(body) / points:.4g} bytes for each of its {points} points",
                file=path,
                expected=f"{record.itemsize}, as SIZE and COUNT of its header say",
            )
        table = np.frombuffer(body, record, count=points)
        arrays = [table[f"{index}"] for index in range(len(names))]
    elif encoding == "binary_compressed":
        raw = _decompressed(path, body, points * record.itemsize)
        arrays, at = [], 0
        for _, kind, (count,) in columns:  # stored field by field, not point by point
            length = points * count
            array = np.frombuffer(raw, np.dtype(kind), count=length, offset=at)
            arrays.append(array.reshape(points, count))
            at += array.nbytes
    else:
        raise InputError(
            f"DATA {encoding} is unknown",
            file=path,
            expected="ascii, binary or binary_compressed",
        )
    with np.errstate(invalid="ignore"):  # non-numbers become NaN
        fields = {
            name: array[:, 0].astype(np.float64)
            for name, array in zip(names, arrays, strict=True)
            if array.shape[1] == 1
        }
    return fields, shape


def _split(path: Path, data: bytes) -> tuple[dict[str, list[str]], bytes]:
    """Return the header's lines by keyword, and the data after it."""
    header: dict[str, list[str]] = {}
    at = 0
    while "DATA" not in header:
        end = data.find(b"\n", at)
        if end < 0 or at > 65_536:
            raise InputError("has no DATA line", file=path, expected="a PCD file")
        line = data[at:end].decode("ascii", errors="replace").split("#")[0].split()
        if line:
            header[line[0].upper()] = line[1:]
        at = end + 1
    return header, data[at:]


def _check_size(path: Path, have: int, need: int) -> None:
    if have < need:
        raise InputError(f"is truncated: {have} bytes of points", file=path, expected=f"{need}")


def _ascii(
    path: Path, body: bytes, names: list[str], counts: list[int], points: int
) -> dict[str, NDArray[np.float64]]:
    if points == 0:
        return {name: np.zeros(0) for name in names}
    if not body.strip():
        raise InputError("is truncated: 0 points", file=path, expected=f"{points}")
    try:
        table = np.loadtxt(io.BytesIO(body), np.float64, ndmin=2, max_rows=points)
    except ValueError as error:
        why = str(error).partition(";")[0]
        raise InputError(
            f"has a line that is not valid ({why})", file=path, expected=f"{sum(counts)} numbers"
        ) from None
    if len(table) < points:
        raise InputError(f"is truncated: {len(table)} points", file=path, expected=f"{points}")
    if table.shape[1] != sum(counts):
        raise InputError(
            f"has {table.shape[1]} values a line", file=path, expected=f"{sum(counts)}"
        )
    starts = np.cumsum([0, *counts])
    return {name: table[:, starts[index]] for index, name in enumerate(names) if counts[index] == 1}


def _decompressed(path: Path, body: bytes, size: int) -> bytes:
    """Return the bytes of a compressed body: its two sizes, then LZF data.

    If both sizes are equal the points may be uncompressed, as pypcd4 writes data that LZF does not
    reduce.
    """
    if len(body) < 8:
        raise InputError("is truncated", file=path, expected="compressed points")
    packed, unpacked = (int(value) for value in np.frombuffer(body, "<u4", count=2))
    _check_size(path, len(body) - 8, packed)
    if unpacked != size:
        raise InputError(
            f"holds {unpacked} bytes of points", file=path, expected=f"{size}, as its header says"
        )
    try:
        return lzf_decompress(body[8 : 8 + packed], unpacked)
    except ValueError as error:
        if packed == unpacked:
            return body[8 : 8 + packed]
        raise InputError(f"its compressed points are damaged ({error})", file=path) from None


def lzf_decompress(data: bytes, size: int) -> bytes:
    """Return the ``size`` bytes of compressed ``data``.

    Raises:
        ValueError: the data ends early, refers before its start or gives another size.
    """
    out = bytearray()
    at, end = 0, len(data)
    try:
        while at < end:
            control = data[at]
            at += 1
            if control < 32:
                if at + control + 1 > end:
                    raise ValueError("ends inside a run of bytes")
                out += data[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += data[at]
                at += 1
            length += 2
            back = ((control & 0x1F) << 8) + data[at] + 1
            at += 1
            start = len(out) - back
            if start < 0:
                raise ValueError("copies from before its start")
            if back >= length:
                out += out[start : start + length]
            else:  # the copy overlaps its output: the last `back` bytes repeat
                out += (bytes(out[start:]) * (length // back + 1))[:length]
    except IndexError:
        raise ValueError("ends inside a code") from None
    if len(out) != size:
        raise ValueError(f"holds {len(out)} bytes, not {size}")
    return bytes(out)
