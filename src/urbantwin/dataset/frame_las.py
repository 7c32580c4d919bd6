"""A frame as a LAZ file: LAS 1.4, point format 6, readable by any LAS reader.

Coordinates are rounded to `SCALE_M`, so a point moves by half of it at most along each axis, and
intensities to 1/65535. Everything else is lossless: ring, column, sensor, echo, class and track are
extra bytes; ``gps_time`` is the ray's time, seconds relative to the frame's; ``classification`` is
the nearest standard class.

The project GUID is a digest of the bytes after it: on a damaged file the decoder would return wrong
numbers, or abort the process.

Source: ASPRS, LAS Specification 1.4 R15 (2019).
"""

from __future__ import annotations

import hashlib
import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError

if TYPE_CHECKING:
    pass

__all__ = ["SCALE_M", "laz_bytes", "read_laz"]

#: Resolution of coordinates, metres.
SCALE_M = 0.001
_MOST = 65_535
_EXTRA = {"ring": "u2", "column": "u2", "sensor": "u1", "echo": "u1", "semantic": "u2",
          "instance": "u2"}  # fmt: skip
#: Standard classes (table 17): 1 unclassified, 2 ground, 5 high vegetation, 6 building, 7 low
#: noise, 11 road surface.
_STANDARD = {
    "outlier": 7, "road": 11, "parking": 11, "sidewalk": 2, "other-ground": 2, "terrain": 2,
    "building": 6, "vegetation": 5, "trunk": 5,
}  # fmt: skip
#: Header bytes of the project GUID, which is free to use.
_GUID = slice(8, 24)
#: Header bytes of the creation day and year.
_WRITTEN = slice(90, 94)
_EXPECTED = "a frame as LAZ, as `urbantwin record --storage laz` writes it"


def laz_bytes(columns: dict[str, NDArray[Any]]) -> bytes:
    """Return the LAZ file of the columns `frame_columns.COLUMNS`.

    Raises:
        InputError: a coordinate exceeds the format's range.
    """
    import laspy

    from urbantwin.taxonomy import semantic_classes

    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, SCALE_M), np.zeros(3)
    header.generating_software = "urbantwin"
    header.global_encoding.wkt = True  # required for this point format
    header.add_extra_dims([laspy.ExtraBytesParams(name, kind) for name, kind in _EXTRA.items()])
    record = laspy.ScaleAwarePointRecord.zeros(len(columns["x"]), header=header)
    for axis in "xyz":
        steps = np.round(columns[axis].astype(np.float64) / SCALE_M)
        if np.abs(steps).max(initial=0) >= 2**31:
            far = np.abs(columns[axis]).max()
            raise InputError(f"a point is {far:g} m away", expected="--storage npy or zstd")
        record[axis.upper()] = steps.astype(np.int32)
    bright = np.clip(columns["intensity"].astype(np.float64), 0, 1)
    record["intensity"] = np.round(bright * _MOST).astype(np.uint16)
    record["gps_time"] = columns["time"].astype(np.float64)
    standard = np.ones(1 << 16, np.uint8)
    for entry in semantic_classes().values():
        standard[entry.id] = _STANDARD.get(entry.name, 1)
    record["classification"] = standard[columns["semantic"]]
    record["return_number"] = columns["echo"] + 1
    record["number_of_returns"] = _returns(columns)
    for name in _EXTRA:
        record[name] = columns[name]
    file = io.BytesIO()
    cloud = laspy.LasData(header, record)
    cloud.update_header()
    cloud.write(file, do_compress=True, laz_backend=laspy.LazBackend.Lazrs)
    written = bytearray(file.getvalue())
    written[_WRITTEN] = bytes(4)  # independent of the date
    written[_GUID] = _digest(written)
    return bytes(written)


def _digest(file: bytes | bytearray) -> bytes:
    return hashlib.sha256(memoryview(file)[_GUID.stop :]).digest()[: _GUID.stop - _GUID.start]


def _returns(columns: dict[str, NDArray[Any]]) -> NDArray[np.uint8]:
    """Return the number of returns (N,) of each point's ray."""
    second = columns["echo"] > 0
    returns = np.ones(len(second), np.uint8)
    if second.any():
        key = columns["sensor"].astype(np.uint64) << np.uint64(32)
        key |= columns["ring"].astype(np.uint64) << np.uint64(16)
        key |= columns["column"].astype(np.uint64)
        returns[np.isin(key, key[second])] = 2
        returns = np.maximum(returns, columns["echo"] + 1).astype(np.uint8)
    return returns


def read_laz(path: Path) -> dict[str, NDArray[Any]]:
    """Return the columns of a file, as `frame_columns.COLUMNS`.

    Raises:
        InputError: missing or damaged file, or without the fields that `laz_bytes` writes.
    """
    fields = _read(path)
    lacking = sorted({*_EXTRA, "gps_time", "intensity"} - set(fields))
    if lacking:
        raise InputError("is missing", file=path, place=lacking[0], expected=_EXPECTED)
    time_s = np.asarray(fields["gps_time"], np.float64)
    columns: dict[str, NDArray[Any]] = {axis: fields[axis].astype("f4") for axis in "xyz"}
    columns["intensity"] = (np.asarray(fields["intensity"], np.float64) / _MOST).astype("f4")
    with np.errstate(over="ignore", invalid="ignore"):
        columns["time"] = time_s.astype("f4")
    for name, kind in _EXTRA.items():
        values = fields[name]
        if values.dtype != np.dtype(kind) or values.shape != time_s.shape:
            raise InputError(f"holds {values.dtype}", file=path, place=name, expected=kind)
        columns[name] = values
    return columns


def _read(path: Path) -> dict[str, NDArray[Any]]:
    from urbantwin.io.las import read_las_fields

    if not path.is_file():
        raise InputError("not found", file=path, expected=_EXPECTED)
    content = path.read_bytes()
    if any(content[_GUID]) and content[_GUID] != _digest(content):  # earlier versions wrote zeros
        problem = "is damaged (its bytes are not those that were written)"
        raise InputError(problem, file=path, expected=_EXPECTED)
    try:
        return read_las_fields(path)
    except InputError as error:
        raise InputError(error.problem, file=path, expected=_EXPECTED) from None
