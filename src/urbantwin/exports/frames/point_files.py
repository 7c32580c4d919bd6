"""Points as files of other programs: PCD 0.7 and PLY, binary, a value of each field per point."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ["write_pcd_file", "write_ply_file"]

_Columns = Mapping[str, NDArray[np.generic]]

_PLY_TYPES = {
    "f4": "float",
    "f8": "double",
    "u1": "uchar",
    "u2": "ushort",
    "u4": "uint",
    "i1": "char",
    "i2": "short",
    "i4": "int",
}


def write_pcd_file(path: Path, columns: _Columns) -> None:
    """Write points as ``DATA binary`` (Point Cloud Library, "The PCD file format").

    Args:
        path: the file.
        columns: arrays (N,) by name, in the order of the fields, each in its own type.
    """
    table = _table(columns)
    kinds = [table.dtype[name] for name in columns]
    head = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
        f"FIELDS {' '.join(columns)}\n"
        f"SIZE {' '.join(str(kind.itemsize) for kind in kinds)}\n"
        f"TYPE {' '.join(kind.kind.upper() for kind in kinds)}\n"
        f"COUNT {' '.join('1' for _ in kinds)}\n"
        f"WIDTH {len(table)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
        f"POINTS {len(table)}\nDATA binary\n"
    )
    path.write_bytes(head.encode() + table.tobytes())


def write_ply_file(path: Path, columns: _Columns) -> None:
    """Write points as ``vertex`` of a little-endian PLY.

    Args:
        path: the file.
        columns: arrays (N,) by name, in the order of the properties, each in its own type.
    """
    table = _table(columns)
    lines = [f"property {_PLY_TYPES[table.dtype[name].str[1:]]} {name}\n" for name in columns]
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(table)}\n"
        f"{''.join(lines)}end_header\n"
    )
    path.write_bytes(head.encode() + table.tobytes())


def _table(columns: _Columns) -> NDArray[np.void]:
    """Return rows of the columns, packed, little-endian."""
    kinds = [(name, values.dtype.newbyteorder("<")) for name, values in columns.items()]
    table = np.empty(len(next(iter(columns.values()))), np.dtype(kinds))
    for name, values in columns.items():
        table[name] = values
    return table
