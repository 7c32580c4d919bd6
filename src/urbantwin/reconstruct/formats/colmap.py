"""COLMAP: dense points, meshes, sparse models (text and binary), placed by the images' places.

The formats are those of COLMAP's documentation ("Output Format"): ``points3D`` and ``images`` as
``.txt`` and ``.bin``; little-endian.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numba
import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.number_text import plain_number
from urbantwin.reconstruct.formats.validity import (
    MOST_POINTS,
    check_coordinates,
    content_of,
    count_within,
)
from urbantwin.reconstruct.model import ImportedModel, PointCloud

__all__ = ["camera_centres", "read_sparse_points", "sparse_folder"]

_IMAGE = struct.Struct("<I7dI")
_MOST_IMAGES = 1_000_000


def sparse_folder(folder: Path) -> Path | None:
    """Return the folder of a sparse model in or below a COLMAP folder."""
    for name in (".", "sparse/0", "sparse", "dense/sparse", "dense/0/sparse", "0"):
        here = folder / name
        if any((here / f"images{e}").is_file() for e in (".bin", ".txt")) and any(
            (here / f"points3D{e}").is_file() for e in (".bin", ".txt")
        ):
            return here
    return None


def read_sparse_points(folder: Path) -> ImportedModel:
    """Read the points of a sparse model with their colours.

    Raises:
        InputError: the file is wrong or holds none.
    """
    binary = folder / "points3D.bin"
    if binary.is_file():
        points, colour = _binary_points(binary)
        path = binary
    else:
        path = folder / "points3D.txt"
        points, colour = _text_points(path)
    if not len(points):
        raise InputError("holds no point", file=path, expected="a sparse model")
    check_coordinates(points, path, "point")
    cloud = PointCloud(points, colour)
    return ImportedModel(cloud=cloud, notes={"points": len(points)}, files=content_of(path))


def camera_centres(folder: Path) -> dict[str, NDArray[np.float64]]:
    """Return where each image of a sparse model was taken from, by its name.

    The centre is ``-R^T t`` of the image's rotation (a quaternion w x y z) and translation.

    Raises:
        InputError: the file is wrong.
    """
    binary = folder / "images.bin"
    path = binary if binary.is_file() else folder / "images.txt"
    try:
        rows = _binary_images(binary) if binary.is_file() else _text_images(path)
    except (struct.error, ValueError, IndexError, UnicodeDecodeError):
        raise InputError("is truncated or damaged", file=path, expected="COLMAP's images") from None
    return {name: -_rotation(values[:4]).T @ values[4:7] for name, values in rows}


def _binary_points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    data = np.fromfile(path, np.uint8)
    count = int(data[:8].view("<u8")[0]) if len(data) >= 8 else -1
    count_within(count, MOST_POINTS, "points", path)
    starts = np.zeros(count, np.int64)
    if count * 51 > len(data) or _starts(data, starts) < count:
        raise InputError("is truncated", file=path, expected=f"{count:,} points")
    row = np.dtype([("xyz", "<f8", 3), ("rgb", "u1", 3)])
    taken = data[starts[:, None] + 8 + np.arange(row.itemsize)]
    rows = np.frombuffer(taken.tobytes(), row)
    return rows["xyz"].astype(np.float64), rows["rgb"].copy()


@numba.njit(cache=True)
def _starts(data, starts):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Fill where each point's row starts; return how many are whole."""
    at = 8
    for row in range(len(starts)):
        if at + 51 > len(data):
            return row
        starts[row] = at
        length = 0
        for byte in range(8):
            length += int(data[at + 43 + byte]) << (8 * byte)
        if length < 0 or length > (len(data) - at - 51) // 8:
            return row
        at += 51 + 8 * length
    return len(starts)


def _text_points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    found = []
    with path.open(encoding="utf-8", errors="replace") as stream:
        for number, line in enumerate(stream, 1):
            if line.startswith("#") or not line.strip():
                continue
            try:
                found.append([plain_number(word) for word in line.split(None, 7)[1:7]])
            except ValueError:
                found.append([])
            if len(found[-1]) != 6:
                raise InputError(
                    f"has {line[:40]!r}",
                    file=path,
                    place=f"line {number}",
                    expected="POINT3D_ID X Y Z R G B ERROR",
                )
    table = np.array(found).reshape(-1, 6)
    return table[:, :3], np.clip(table[:, 3:], 0, 255).astype(np.uint8)


def _binary_images(path: Path) -> list[tuple[str, NDArray[np.float64]]]:
    data = path.read_bytes()
    (count,) = struct.unpack_from("<Q", data)
    if count > _MOST_IMAGES:
        raise ValueError(count)
    at, found = 8, []
    for _ in range(count):
        values = _IMAGE.unpack_from(data, at)
        at += _IMAGE.size
        end = data.index(b"\0", at)
        name = data[at:end].decode()
        (points,) = struct.unpack_from("<Q", data, end + 1)
        at = end + 9 + 24 * points
        if at > len(data):
            raise ValueError(points)
        found.append((name, np.array(values[1:8])))
    return found


def _text_images(path: Path) -> list[tuple[str, NDArray[np.float64]]]:
    lines = [
        line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")
    ]
    found = []
    for line in lines[::2]:
        words = line.split(None, 9)
        if words:
            found.append((words[9].strip(), np.array([plain_number(word) for word in words[1:8]])))
    return found


def _rotation(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
