"""Meshes and point clouds of PLY and STL files."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry.ply import Table, read_header, read_tables
from urbantwin.io.model import ImportedModel, PointCloud, TriangleMesh
from urbantwin.io.polygons import triangulated
from urbantwin.io.text import TextLines, text_chunks
from urbantwin.io.texture import beside, picture_of, texture_colours
from urbantwin.io.trust import (
    MOST_POINTS,
    MOST_TRIANGLES,
    check_coordinates,
    content_of,
    count_within,
    valid_faces,
)

__all__ = ["read_ply", "read_stl"]

_COLOURS = (
    ("red", "green", "blue"),
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
    ("r", "g", "b"),
)


def read_ply(path: Path) -> ImportedModel:
    """Read the triangles of a PLY, or its points if it has no faces.

    A triangle's colour is the mean of its texture (``comment TextureFile``), otherwise its own,
    otherwise its vertices'. Points keep ``classification`` if present. PLY states neither units nor
    axes.

    Raises:
        InputError: the header is wrong, or the file is truncated or empty.
    """
    header = read_header(path)
    limits = {"vertex": MOST_POINTS, "face": MOST_TRIANGLES}
    for element in header.elements:
        count_within(
            element.count, limits.get(element.name, MOST_POINTS), f"of {element.name}", path
        )
    tables = read_tables(path, header)
    vertex = tables.get("vertex")
    if vertex is None or not vertex.count:
        raise InputError("holds no vertex", file=path, expected="a PLY model")
    if not {"x", "y", "z"} <= vertex.columns.keys():
        raise InputError("has vertices without x, y and z", file=path, expected="them")
    points = np.column_stack([vertex.columns[name].astype(np.float64) for name in "xyz"])
    check_coordinates(points, path)
    painted = _painted(vertex)
    face = tables.get("face")
    files = content_of(path)
    if face is None or not face.count:
        label = vertex.columns.get("classification", vertex.columns.get("scalar_Classification"))
        cloud = PointCloud(points, painted, None if label is None else label.astype(np.uint8))
        return ImportedModel(cloud=cloud, notes={"points": len(points)}, files=files)
    problems: list[str] = []
    mesh, kept, more = _mesh(path, points, painted, face, vertex, header.comments, problems)
    notes: dict[str, object] = {
        "triangles": len(mesh.faces),
        "faces_without_area_dropped": int((~kept).sum()),
    }
    return ImportedModel(mesh, problems=tuple(problems), notes=notes, files={**files, **more})


def _painted(table: Table) -> NDArray[np.uint8] | None:
    for names in _COLOURS:
        if all(name in table.columns for name in names):
            values = np.column_stack([table.columns[name] for name in names])
            if values.dtype.kind == "f":
                values = values * (255.0 if values.max(initial=0.0) <= 1.0 else 1.0)
            elif values.dtype.itemsize == 2:
                values = values // 257
            return np.clip(np.round(values), 0, 255).astype(np.uint8)
    return None


def _mesh(
    path: Path,
    points: NDArray[np.float64],
    painted: NDArray[np.uint8] | None,
    face: Table,
    vertex: Table,
    comments: list[str],
    problems: list[str],
) -> tuple[TriangleMesh, NDArray[np.bool_], dict[str, str]]:
    name = next((n for n in ("vertex_indices", "vertex_index") if n in face.lists), None)
    if name is None:
        raise InputError("has faces without vertex_indices", file=path, expected="them")
    named, sizes = face.lists[name]
    corner = named.astype(np.int64)
    large = sizes >= 3
    owner_of = np.repeat(np.arange(len(sizes)), sizes)
    if (sizes == 3).all():
        index, owner = np.arange(len(corner)).reshape(-1, 3), np.arange(len(sizes))
    else:
        used = np.flatnonzero(large[owner_of])
        inside = np.clip(corner[used], 0, len(points) - 1)
        _, ring = np.unique(owner_of[used], return_inverse=True)
        which = np.flatnonzero(large)
        index, owner = triangulated(points[inside], ring, np.arange(len(which)))
        index, owner = used[index], which[owner]
    faces, kept = valid_faces(corner[index], len(points), path)
    if not len(faces):
        raise InputError("holds no triangle", file=path, expected="a PLY model")
    owner = owner[kept]
    own = _painted(face)
    colour = None
    if own is not None:
        colour = own[owner]
    elif painted is not None:
        colour = painted[faces].mean(axis=1).round().astype(np.uint8)
    textured, more = _textured(path, face, vertex, corner, index[kept], owner, comments, problems)
    mesh = TriangleMesh.build(points, faces, colour=colour if textured is None else textured)
    return mesh, kept, more


def _textured(
    path: Path,
    face: Table,
    vertex: Table,
    corner: NDArray[np.int64],
    index: NDArray[np.int64],
    owner: NDArray[np.int64],
    comments: list[str],
    problems: list[str],
) -> tuple[NDArray[np.uint8] | None, dict[str, str]]:
    """Return colours (F, 3) of the images named by ``comment TextureFile``."""
    names = [c.split(None, 1)[1] for c in comments if c.lower().startswith("texturefile ")]
    if not names:
        return None, {}
    uv = None
    if "texcoord" in face.lists:
        values, counts = face.lists["texcoord"]
        if len(values) == 2 * len(corner) and (counts % 2 == 0).all():
            uv = values.reshape(-1, 2)[index]
    for pair in (("texture_u", "texture_v"), ("s", "t"), ("u", "v")):
        if uv is None and all(name in vertex.columns for name in pair):
            table = np.column_stack([vertex.columns[name] for name in pair]).astype(np.float64)
            uv = table[corner[index]]
    if uv is None:
        return None, {}
    number = face.columns.get("texnumber")
    which = np.zeros(len(index), np.int64) if number is None else number[owner].astype(np.int64)
    colour = np.full((len(index), 3), 128, np.uint8)
    files: dict[str, str] = {}
    for k, name in enumerate(names):
        file = beside(path.parent, name)
        picture = None if file is None else picture_of(file)
        if picture is None or file is None:
            problems.append(f"{path.name}: its picture {name} is not beside it or cannot be read")
            continue
        files.update(content_of(file))
        colour[which == k] = texture_colours(uv[which == k].astype(np.float64), picture)
    return (colour, files) if files else (None, {})


_HEADER, _ROW = 84, 50


def read_stl(path: Path) -> ImportedModel:
    """Read an STL, with coincident corners merged; it states no units, axes or colours.

    Raises:
        InputError: it is truncated, wrong, or empty.
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
