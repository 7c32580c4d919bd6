"""STL, ASCII and binary (3D Systems, "StereoLithography Interface Specification", 1989)."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.reconstruct.formats.text_lines import TextLines, text_chunks
from urbantwin.reconstruct.formats.validity import (
    MOST_TRIANGLES,
    check_coordinates,
    content_of,
    count_within,
    valid_faces,
)
from urbantwin.reconstruct.model import ImportedModel, TriangleMesh

__all__ = ["read_stl"]

_HEADER, _ROW = 84, 50


def read_stl(path: Path) -> ImportedModel:
    """Read an STL; corners at one place become one vertex. It knows no units, axes or colours.

    Raises:
        InputError: it is truncated, wrong, or holds nothing.
    """
    size = path.stat().st_size
    with path.open("rb") as stream:
        start = stream.read(_HEADER)
    count = struct.unpack("<I", start[80:84])[0] if len(start) == _HEADER else -1
    if size == _HEADER + _ROW * count and count >= 0:
        corners, solid, names = _binary(path, count)
    elif start.lstrip()[:5].lower() == b"solid":
        corners, solid, names = _text(path)
    else:
        found = "is not an STL" if count < 0 else f"says {count:,} triangles in {size:,} bytes"
        raise InputError(
            found, file=path, expected=f"84 bytes and {_ROW} a triangle, or text from 'solid' on"
        )
    if not len(corners):
        raise InputError("holds no triangle", file=path, expected="an STL model")
    check_coordinates(corners.reshape(-1, 3), path, "corner")
    vertices, index = np.unique(corners.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)
    faces, kept = valid_faces(index.reshape(-1, 3).astype(np.int64), len(vertices), path)
    if not len(faces):
        raise InputError("holds no triangle with an area", file=path, expected="an STL model")
    mesh = TriangleMesh(vertices, faces, None, solid[kept].astype(np.int32), names)
    notes: dict[str, object] = {
        "triangles": len(faces),
        "faces_without_area_dropped": int((~kept).sum()),
    }
    return ImportedModel(mesh, notes=notes, files=content_of(path))


def _binary(
    path: Path, count: int
) -> tuple[NDArray[np.float64], NDArray[np.int64], tuple[str, ...]]:
    count_within(count, MOST_TRIANGLES, "triangles", path)
    row = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    rows = np.fromfile(path, row, count, offset=_HEADER)
    return rows["corners"].astype(np.float64), np.zeros(len(rows), np.int64), ("",)


def _text(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64], tuple[str, ...]]:
    corners: list[NDArray[np.float64]] = []
    solids: list[NDArray[np.int64]] = []
    names: list[str] = []
    total = ends = 0
    for data, before in text_chunks(path):
        lines = TextLines(data.lower())
        vertex = np.flatnonzero(lines.word_is(b"vertex"))
        new = np.flatnonzero(lines.word_is(b"solid"))
        ends += int(lines.word_is(b"endsolid").sum())
        plain = TextLines(data)
        earlier = len(names)
        names += [plain.text(int(line))[5:].strip() for line in new]
        total += len(vertex)
        count_within(total // 3, MOST_TRIANGLES, "triangles", path)
        try:
            values, counts = lines.numbers(vertex, 6)
            bad = -1 if (counts == 3).all() else int(np.argmax(counts != 3))
        except ValueError as error:
            bad = int(error.args[0])
        if bad >= 0:
            line = int(vertex[bad])
            raise InputError(
                f"has {plain.text(line)[:40]!r}",
                file=path,
                place=f"line {before + line + 1}",
                expected="vertex x y z",
            )
        corners.append(values.reshape(-1, 3))
        solids.append(earlier + np.searchsorted(new, vertex) - 1)
    if not names or ends < len(names) or total % 3:
        raise InputError("ends before its last endsolid", file=path, expected="the whole file")
    solid = np.concatenate(solids)[::3]
    return np.concatenate(corners).reshape(-1, 3, 3), np.maximum(solid, 0), tuple(names)
