"""Meshes and point clouds of a PLY, with their colours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry.ply import Table, read_header, read_tables
from urbantwin.reconstruct.formats.texture import beside, picture_of, texture_colours
from urbantwin.reconstruct.formats.triangulation import triangulated
from urbantwin.reconstruct.formats.validity import (
    MOST_POINTS,
    MOST_TRIANGLES,
    check_coordinates,
    content_of,
    count_within,
    valid_faces,
)
from urbantwin.reconstruct.model import ImportedModel, PointCloud, TriangleMesh

__all__ = ["read_ply"]

_COLOURS = (
    ("red", "green", "blue"),
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
    ("r", "g", "b"),
)


def read_ply(path: Path) -> ImportedModel:
    """Read the triangles of a PLY, or its points where it has no faces.

    A triangle's colour is the mean of its texture (``comment TextureFile``), else its own, else
    its vertices'. Points keep ``classification`` where they have it. PLY knows neither units nor
    axes.

    Raises:
        InputError: the header is wrong, the file is truncated or holds nothing.
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
    """Return colours (F, 3) of the pictures that ``comment TextureFile`` names."""
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
