"""Wavefront OBJ with its materials beside it: metres, y up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from urbantwin.exports.mesh.gltf import y_up
from urbantwin.exports.mesh.mesh_object import Look, MeshObject

__all__ = ["write_obj"]

#: Rows that are put into text at once.
_ROWS = 100_000


def write_obj(
    objects: Sequence[MeshObject],
    path: Path,
    looks: Mapping[str, Look],
    comments: Sequence[str] = (),
) -> None:
    """Write OBJ: an ``o`` per object (blanks in names become ``_``); x east, y up, z south.

    Args:
        objects: objects to write.
        path: the file; materials are written to a ``.mtl`` of the same name.
        looks: appearance of the objects' materials, by name.
        comments: comment lines at the beginning.
    """
    library = path.with_suffix(".mtl")
    names = sorted({name for one in objects for name in one.materials})
    library.write_text("\n".join(_entry(name, looks[name]) for name in names), encoding="utf-8")
    first = 1
    with path.open("w", encoding="utf-8") as stream:
        stream.write("# metres, x east, y up, z south\n")
        stream.writelines(f"# {line}\n" for line in comments)
        stream.write(f"mtllib {library.name}\n")
        for one in objects:
            stream.write(f"o {_word(one.name)}\n")
            _rows(stream, "v %.4f %.4f %.4f\n", y_up(one.vertices))
            for number, material in enumerate(one.materials):
                stream.write(f"usemtl {_word(material)}\n")
                faces = one.faces[one.material == number].astype(np.int64) + first
                _rows(stream, "f %d %d %d\n", faces)
            first += len(one.vertices)


def _entry(name: str, look: Look) -> str:
    colour = " ".join(f"{value:.3f}" for value in look.colour)
    opacity = f"d {look.alpha:.3f}\n" if look.alpha < 1.0 else ""
    return f"newmtl {_word(name)}\nKd {colour}\n{opacity}"


def _word(name: str) -> str:
    return "_".join(name.split())


def _rows(stream: TextIO, form: str, rows: NDArray[np.float64] | NDArray[np.int64]) -> None:
    for begin in range(0, len(rows), _ROWS):
        piece = rows[begin : begin + _ROWS]
        stream.write((form * len(piece)) % tuple(piece.ravel().tolist()))
