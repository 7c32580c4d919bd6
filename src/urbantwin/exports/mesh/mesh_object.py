"""An object of triangles with materials, and how a material looks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = ["Look", "MeshObject"]


@dataclass(frozen=True, eq=False)
class MeshObject:
    """One mesh with a name.

    Attributes:
        name: what other programs show.
        vertices: (V, 3) site frame, metres.
        faces: (F, 3) indices, counter-clockwise seen from outside.
        material: (F,) index into ``materials``.
        materials: names of the materials of its faces.
        extras: what else is known of it; JSON values.
        normals: (V, 3) of the vertices, for formats that ask for them.
        uv: (V, 2) texture coordinates, v upwards, likewise.
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
    """How a material looks.

    Attributes:
        colour: linear RGB, 0..1.
        alpha: share of light that it stops.
        extras: what else is known of it; JSON values.
    """

    colour: tuple[float, float, float]
    alpha: float = 1.0
    extras: Mapping[str, object] = field(default_factory=dict)
