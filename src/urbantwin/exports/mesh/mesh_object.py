"""Mesh objects with materials, and the appearance of materials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = ["Look", "MeshObject"]


@dataclass(frozen=True, eq=False)
class MeshObject:
    """A named mesh.

    Attributes:
        name: name shown by other programs.
        vertices: (V, 3) site frame, metres.
        faces: (F, 3) indices, counter-clockwise seen from outside.
        material: (F,) index into ``materials``.
        materials: names of the materials of its faces.
        extras: further properties, JSON-compatible.
        normals: (V, 3) vertex normals, for formats that need them.
        uv: (V, 2) texture coordinates, v upwards, for formats that need them.
    """

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    material: NDArray[np.int32]
    materials: tuple[str, ...]
    extras: Mapping[str, object] = field(default_factory=dict)
    normals: NDArray[np.float64] | None = None
    uv: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class Look:
    """Appearance of a material.

    Attributes:
        colour: linear RGB, 0..1.
        alpha: opacity, 0..1.
        extras: further properties, JSON-compatible.
    """

    colour: tuple[float, float, float]
    alpha: float = 1.0
    extras: Mapping[str, object] = field(default_factory=dict)
