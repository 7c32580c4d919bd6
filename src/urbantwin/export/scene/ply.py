"""The whole scene as one binary PLY: x east, y north, z up, metres."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from urbantwin.export.scene.materials import look_of
from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import materials, semantic_classes

__all__ = ["write_ply"]


def write_ply(mesh: LabelledMesh, path: Path, comments: Mapping[str, object]) -> None:
    """Write a PLY whose faces carry colour, class, material and part; vertices are double.

    Comments name the classes and the materials by their numbers.

    Args:
        mesh: the scene, site frame.
        path: the file.
        comments: further comments, key and value.
    """
    pairs, which = np.unique(
        mesh.semantic.astype(np.int64) * 256 + mesh.material, return_inverse=True
    )
    colours = [_srgb(look_of(int(pair) // 256, int(pair) % 256)[1].colour) for pair in pairs]
    face = np.dtype(
        [
            ("count", "u1"),
            ("corners", "<i4", 3),
            ("colour", "u1", 3),
            ("semantic", "<u2"),
            ("material", "u1"),
            ("part", "<i4"),
        ]
    )
    rows = np.zeros(len(mesh.faces), face)
    rows["count"], rows["corners"] = 3, mesh.faces
    rows["colour"] = np.array(colours, np.uint8).reshape(-1, 3)[which.ravel()]
    rows["semantic"], rows["material"], rows["part"] = mesh.semantic, mesh.material, mesh.part
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {key} {value}" for key, value in comments.items()),
        *_legend("semantic", mesh.semantic, {o.id: o.name for o in semantic_classes().values()}),
        *_legend("material", mesh.material, {o.id: o.name for o in materials().values()}),
        f"element vertex {len(mesh.vertices)}",
        *(f"property double {axis}" for axis in "xyz"),
        f"element face {len(mesh.faces)}",
        "property list uchar int vertex_indices",
        *(f"property uchar {channel}" for channel in ("red", "green", "blue")),
        "property ushort semantic",
        "property uchar material",
        "property int part",
        "end_header",
    ]
    with path.open("wb") as stream:
        stream.write(("\n".join(lines) + "\n").encode("ascii", "replace"))
        stream.write(mesh.vertices.astype("<f8").tobytes())
        stream.write(rows.tobytes())


def _legend(
    word: str, values: np.ndarray[tuple[int], np.dtype[np.generic]], names: Mapping[int, str]
) -> list[str]:
    return [f"comment {word} {int(one)} {names[int(one)]}" for one in np.unique(values)]


def _srgb(linear: tuple[float, float, float]) -> list[int]:
    value = np.array(linear)
    curved = np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
    return [int(one) for one in np.round(curved * 255)]
