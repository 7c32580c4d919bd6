"""Point files of other programs: PCD 0.7 and PLY, binary, a value of each field per point."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ["record_of", "write_pcd_file", "write_ply_file"]

_PCD_LETTERS = {"f": "F", "u": "U", "i": "I"}
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


def record_of(columns: Mapping[str, NDArray[np.generic]]) -> NDArray[np.void]:
    """Return a record array (N,) of columns (N,) by name, in their order and types."""
    kinds = [(name, values.dtype.newbyteorder("<")) for name, values in columns.items()]
    record = np.empty(len(next(iter(columns.values()))), np.dtype(kinds))
    for name, values in columns.items():
        record[name] = values
    return record


def write_pcd_file(path: Path, points: NDArray[np.void], viewpoint: str = "0 0 0 1 0 0 0") -> None:
    """Write points as ``DATA binary`` (Point Cloud Library, "The PCD file format").

    Args:
        path: the file.
        points: (N,) packed, little-endian; fields of the record become fields of the file.
        viewpoint: x, y, z, then the quaternion w, x, y, z.
    """
    names = points.dtype.names or ()
    kinds = [points.dtype[name] for name in names]
    lines = (
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        f"FIELDS {' '.join(names)}",
        f"SIZE {' '.join(str(kind.itemsize) for kind in kinds)}",
        f"TYPE {' '.join(_PCD_LETTERS[kind.kind] for kind in kinds)}",
        f"COUNT {' '.join('1' for _ in names)}",
        f"WIDTH {len(points)}",
        "HEIGHT 1",
        f"VIEWPOINT {viewpoint}",
        f"POINTS {len(points)}",
        "DATA binary",
    )
    path.write_bytes(("\n".join(lines) + "\n").encode() + points.tobytes())


def write_ply_file(path: Path, points: NDArray[np.void]) -> None:
    """Write points as ``vertex`` of a little-endian PLY.

    Args:
        path: the file.
        points: (N,) packed, little-endian; fields of the record become properties.
    """
    names = points.dtype.names or ()
    lines = [f"property {_PLY_TYPES[points.dtype[name].str[1:]]} {name}\n" for name in names]
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        f"{''.join(lines)}end_header\n"
    )
    path.write_bytes(head.encode() + points.tobytes())
