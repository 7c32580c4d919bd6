"""Wavefront OBJ with its materials (Wavefront Advanced Visualizer manual, appendix B)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numba
import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
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
from urbantwin.number_text import plain_number

__all__ = ["read_obj"]

_SPACE, _SLASH, _MINUS, _PLUS, _ZERO, _NINE = (ord(letter) for letter in " /-+09")
#: Maximum vertex number.
_MOST = 1 << 40


def face_corners(
    body: NDArray[np.uint8], starts: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the numbers in the lines of faces.

    Args:
        body: bytes of the lines without their ``f``.
        starts: start of each line in it.

    Returns:
        vertex (C,) and texture coordinate (C,; 0 for none) of every corner as written, and the
        number of corners of each line.

    Raises:
        ValueError: a corner is not a number; its argument is the index among the lines.
    """
    # A corner takes at least two bytes: a digit and a separator.
    vertex = np.zeros(len(body) // 2 + 1, np.int64)
    texture = np.zeros(len(vertex), np.int64)
    sizes = np.zeros(len(starts), np.int64)
    ends = np.append(starts[1:], len(body))
    count, wrong = _scan(body, starts, ends, vertex, texture, sizes)
    if wrong >= 0:
        raise ValueError(int(wrong))
    return vertex[:count].copy(), texture[:count].copy(), sizes


@numba.njit(cache=True)
def _scan(body, starts, ends, vertex, texture, sizes):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Fill the numbers; return the number of corners, and the first wrong line or -1."""
    count = 0
    numbers = np.zeros(3, np.int64)
    for line in range(len(starts)):
        at, end = starts[line], ends[line]
        while True:
            while at < end and body[at] <= _SPACE:
                at += 1
            if at >= end:
                break
            at = _corner(body, at, end, numbers)
            if at < 0:
                return count, line
            vertex[count], texture[count] = numbers[0], numbers[1]
            count += 1
            sizes[line] += 1
    return count, -1


@numba.njit(cache=True)
def _corner(body, at, end, numbers):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Fill the numbers of a corner, 0 for none; return its end, or -1 if invalid."""
    numbers[:] = 0
    for part in range(3):
        sign = 1
        if at < end and (body[at] == _MINUS or body[at] == _PLUS):
            sign = -1 if body[at] == _MINUS else 1
            at += 1
        first = at
        while at < end and _ZERO <= body[at] <= _NINE and numbers[part] < _MOST:
            numbers[part] = numbers[part] * 10 + (int(body[at]) - _ZERO)
            at += 1
        if at == first and (part == 0 or sign < 0):
            return -1
        numbers[part] *= sign
        if at >= end or body[at] != _SLASH:
            break
        at += 1
    return at if at >= end or body[at] <= _SPACE else -1


#: Maximum size of a material library, bytes.
LONGEST = 50_000_000
#: Options of ``map_Kd`` and their number of arguments (MTL specification, "Options").
_OPTIONS = {"-blendu": 1, "-blendv": 1, "-cc": 1, "-clamp": 1, "-mm": 2, "-texres": 1, "-bm": 1}
_UP_TO_THREE = ("-o", "-s", "-t")


@dataclass
class MtlMaterial:
    """A material.

    Attributes:
        colour: diffuse colour (3,) as sRGB 0..255, or ``None``.
        picture: name of its texture image, or empty.
    """

    colour: NDArray[np.uint8] | None = None
    picture: str = ""


def read_materials(path: Path) -> dict[str, MtlMaterial]:
    """Return the materials of a library; unknown statements are ignored.

    ``Kd`` is interpreted as sRGB, as viewers of OBJ do.
    """
    if path.stat().st_size > LONGEST:
        return {}
    found: dict[str, MtlMaterial] = {}
    current = MtlMaterial()
    for line in path.read_bytes().decode("utf-8", "replace").splitlines():
        word, _, rest = line.strip().partition(" ")
        rest = rest.strip()
        if word.lower() == "newmtl":
            current = found.setdefault(rest, MtlMaterial())
        elif word == "Kd":
            try:
                values = np.array([plain_number(text) for text in rest.split()[:3]])
            except ValueError:
                continue
            if values.shape == (3,) and np.isfinite(values).all():
                current.colour = np.round(np.clip(values, 0, 1) * 255).astype(np.uint8)
        elif word.lower() == "map_kd":
            current.picture = _without_options(rest)
    return found


def _without_options(rest: str) -> str:
    """Return the file name, which may contain blanks, after the options."""
    words = rest.split(" ")
    while words and words[0] in (*_OPTIONS, *_UP_TO_THREE):
        option = words.pop(0)
        count = _OPTIONS.get(option, 3)
        while words and count:
            if option in _UP_TO_THREE and not _is_number(words[0]):
                break
            words.pop(0)
            count -= 1
    return " ".join(words).strip()


def _is_number(word: str) -> bool:
    try:
        plain_number(word)
    except ValueError:
        return False
    return True


#: Keywords that change the object or material of the following faces.
_STATES = (b"o", b"g", b"usemtl", b"mtllib")
_GREY = 128
State = tuple[str, str, str]


@dataclass
class _Gathered:
    """Contents of the pieces of a file read so far."""

    path: Path
    vertices: list[NDArray[np.float64]] = field(default_factory=list)
    colours: list[NDArray[np.float64]] = field(default_factory=list)
    texture: list[NDArray[np.float64]] = field(default_factory=list)
    corners: list[NDArray[np.int32]] = field(default_factory=list)
    corner_texture: list[NDArray[np.int32]] = field(default_factory=list)
    sizes: list[NDArray[np.int64]] = field(default_factory=list)
    objects: list[NDArray[np.int64]] = field(default_factory=list)
    known: dict[State, int] = field(default_factory=dict)
    state: State = ("", "", "")
    libraries: list[str] = field(default_factory=list)
    vertex_count: int = 0
    texture_count: int = 0
    triangle_count: int = 0


def read_obj(path: Path) -> ImportedModel:
    """Read the triangles of an OBJ, or its points if it has no faces.

    Faces form an object per combination of ``o``, ``g`` and ``usemtl``. A triangle's colour is the
    mean of its texture, otherwise of its vertices' colours, otherwise its material's ``Kd``. OBJ
    states neither units nor axes.

    Raises:
        InputError: a line is wrong, or the file is empty.
    """
    found = _Gathered(path)
    for data, line in text_chunks(path):
        _take(TextLines(data), line, found)
    vertices = np.concatenate(found.vertices) if found.vertices else np.zeros((0, 3))
    check_coordinates(vertices, path)
    files = content_of(path)
    coloured = bool(found.colours) and len(found.colours) == len(found.vertices)
    painted = _eight_bit(np.concatenate(found.colours)) if coloured else None
    if not found.sizes:
        if not len(vertices):
            raise InputError("holds no face and no vertex", file=path, expected="an OBJ model")
        cloud = PointCloud(vertices, painted)
        return ImportedModel(cloud=cloud, notes={"points": len(vertices)}, files=files)
    corners, face, texture = _triangles(vertices, found)
    faces, kept = valid_faces(corners, len(vertices), path)
    if not len(faces):
        raise InputError("holds no triangle", file=path, expected="an OBJ model")
    number = np.concatenate(found.objects)[face[kept]]
    states = tuple(found.known)
    problems: list[str] = []
    library, more = _library(found, problems)
    colour = _material_colours(found, states, library, problems, number, texture[kept])
    if painted is not None and not any(m.picture for m in library.values()):
        colour = painted[faces].mean(axis=1).round().astype(np.uint8)
    names = tuple(" / ".join(dict.fromkeys(part for part in s if part)) for s in states)
    mesh = TriangleMesh(vertices, faces, colour, number.astype(np.int32), names)
    notes: dict[str, object] = {
        "triangles": len(faces),
        "faces_without_area_dropped": int((~kept).sum()),
        "objects": len(names),
    }
    return ImportedModel(mesh, problems=tuple(problems), notes=notes, files={**files, **more})


def _take(lines: TextLines, before: int, found: _Gathered) -> None:
    """Add the contents of a piece of the file."""
    is_vertex, is_texture = lines.word_is(b"v"), lines.word_is(b"vt")
    vertex_lines, texture_lines = np.flatnonzero(is_vertex), np.flatnonzero(is_texture)
    if len(vertex_lines):
        values, counts = _numbers(lines, before, vertex_lines, 1, 3, found.path)
        at = np.cumsum(counts) - counts
        found.vertices.append(values[at[:, None] + np.arange(3)])
        if (counts >= 6).all():
            found.colours.append(values[at[:, None] + np.arange(3, 6)])
    if len(texture_lines):
        values, counts = _numbers(lines, before, texture_lines, 2, 1, found.path)
        at = np.cumsum(counts) - counts
        second = np.where(counts > 1, values[at + (counts > 1)], 0.0)
        found.texture.append(np.column_stack([values[at], second]))
    earlier, earlier_texture = found.vertex_count, found.texture_count
    found.vertex_count += len(vertex_lines)
    found.texture_count += len(texture_lines)
    count_within(found.vertex_count, MOST_POINTS, "vertices", found.path)
    face_lines = np.flatnonzero(lines.word_is(b"f"))
    state_lines = np.flatnonzero(np.any([lines.word_is(word) for word in _STATES], axis=0))
    states = [found.state]
    for state_line in state_lines:
        _change(lines.text(int(state_line)), found)
        states.append(found.state)
    if not len(face_lines):
        return
    corner, texture, sizes = _corners(lines, before, face_lines, found.path)
    line = np.repeat(face_lines, sizes)
    seen = earlier + np.cumsum(is_vertex)[line]
    seen_texture = earlier_texture + np.cumsum(is_texture)[line]
    found.corners.append(_fitting(np.where(corner < 0, seen + corner, corner - 1)))
    relative = np.where(texture < 0, seen_texture + texture, texture - 1)
    found.corner_texture.append(_fitting(np.where(texture == 0, -1, relative)))
    found.sizes.append(sizes)
    found.triangle_count += int((sizes - 2).sum())
    count_within(found.triangle_count, MOST_TRIANGLES, "triangles", found.path)
    segment = np.searchsorted(state_lines, face_lines)
    used, which = np.unique(segment, return_inverse=True)
    numbers = [found.known.setdefault(states[k], len(found.known)) for k in used]
    found.objects.append(np.array(numbers, np.int64)[which.ravel()])


def _numbers(
    lines: TextLines, before: int, which: NDArray[np.int64], skip: int, least: int, path: Path
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    try:
        values, counts = lines.numbers(which, skip)
        if (counts >= least).all():
            return values, counts
        bad = int(np.argmax(counts < least))
    except ValueError as error:
        bad = int(error.args[0])
    raise _wrong_line(lines, before, int(which[bad]), path, f"{least} numbers")


def _corners(
    lines: TextLines, before: int, which: NDArray[np.int64], path: Path
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    body, starts = lines.body(which, 1)
    try:
        corner, texture, sizes = face_corners(body, starts)
        if (sizes >= 3).all() and (corner != 0).all():
            return corner, texture, sizes
        zero = np.repeat(np.arange(len(sizes)), sizes)[corner == 0]
        bad = int(np.argmax(sizes < 3)) if (sizes < 3).any() else int(zero[0])
    except ValueError as error:
        bad = int(error.args[0])
    raise _wrong_line(lines, before, int(which[bad]), path, "three or more vertices, from 1")


def _wrong_line(lines: TextLines, before: int, line: int, path: Path, expected: str) -> InputError:
    text = lines.text(line)[:40]
    return InputError(
        f"has {text!r}", file=path, place=f"line {before + line + 1}", expected=expected
    )


def _change(text: str, found: _Gathered) -> None:
    word, _, rest = text.partition(" ")
    rest = rest.strip()
    name, group, material = found.state
    if word == "o":
        found.state = (rest, "", material)
    elif word == "g":
        found.state = (name, "" if rest in ("default", "off") else rest, material)
    elif word == "usemtl":
        found.state = (name, group, rest)
    else:
        found.libraries.append(rest)


def _triangles(
    vertices: NDArray[np.float64], found: _Gathered
) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.int32]]:
    """Return triangles (F, 3), the face (F,) of each, and numbers of texture coordinates (F, 3)."""
    corner = np.concatenate(found.corners)
    texture = np.concatenate(found.corner_texture)
    sizes = np.concatenate(found.sizes)
    if not len(vertices):  # faces without vertices
        none = np.zeros((0, 3), np.int32)
        return none, np.zeros(0, np.int64), none
    if (sizes == 3).all():
        return corner.reshape(-1, 3), np.arange(len(sizes)), texture.reshape(-1, 3)
    face = np.repeat(np.arange(len(sizes)), sizes)
    inside = np.clip(corner, 0, len(vertices) - 1)
    index, owner = triangulated(vertices[inside], face, np.arange(len(sizes)))
    return corner[index], owner, texture[index]


def _fitting(numbers: NDArray[np.int64]) -> NDArray[np.int32]:
    """Return numbers as int32; larger ones are clipped to indices that do not exist."""
    return np.clip(numbers, -1, np.iinfo(np.int32).max).astype(np.int32)


def _library(
    found: _Gathered, problems: list[str]
) -> tuple[dict[str, MtlMaterial], dict[str, str]]:
    """Return the libraries that the file names; missing ones are added to the problems."""
    library: dict[str, MtlMaterial] = {}
    files: dict[str, str] = {}
    for name in dict.fromkeys(found.libraries):
        path = beside(found.path.parent, name)
        if path is None:
            problems.append(f"{found.path.name}: its materials {name} are not beside it")
            continue
        library.update(read_materials(path))
        files.update(content_of(path))
    return library, files


def _material_colours(
    found: _Gathered,
    states: Sequence[State],
    library: dict[str, MtlMaterial],
    problems: list[str],
    number: NDArray[np.int64],
    texture: NDArray[np.int32],
) -> NDArray[np.uint8] | None:
    """Return colours (F, 3) by material, ``None`` if no material has any."""
    materials = [library.get(state[2], MtlMaterial()) for state in states]
    if all(m.colour is None and not m.picture for m in materials):
        return None
    plain = np.array([[_GREY] * 3 if m.colour is None else m.colour for m in materials])
    colour = plain.astype(np.uint8)[number]
    table = np.concatenate(found.texture) if found.texture else np.zeros((0, 2))
    named = ((texture >= 0) & (texture < len(table))).all(axis=1)
    for name in dict.fromkeys(m.picture for m in materials if m.picture):
        file = beside(found.path.parent, name)
        picture = None if file is None else picture_of(file)
        if picture is None:
            wrong = "is not beside it" if file is None else "cannot be read"
            problems.append(f"{found.path.name}: its picture {name} {wrong}; plain colours instead")
            continue
        own = np.array([m.picture == name for m in materials])[number] & named
        colour[own] = texture_colours(table[texture[own]], picture)
    return colour


def _eight_bit(colours: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return colours 0..1 (or already 0..255) as bytes."""
    scale = 255.0 if colours.max(initial=0.0) <= 1.0 else 1.0
    return np.clip(np.round(np.nan_to_num(colours) * scale), 0, 255).astype(np.uint8)
