"""Meshes of assets in other sizes: bodies are stretched, wheels stay round."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from urbantwin.geometry import LabelledMesh
from urbantwin.traffic.assets.asset_name import AssetName

__all__ = ["mesh_among", "scaled_mesh"]

#: What comes so near to the ground stands on it, metres.
_ON_GROUND_M = 1e-3


def scaled_mesh(mesh: LabelledMesh, factors: tuple[float, float, float]) -> LabelledMesh:
    """Return a mesh stretched along x, y and z.

    Solids that stand on the ground are wheels and shoes: along x they are stretched as much as in
    height, about their middle.
    """
    if factors == (1.0, 1.0, 1.0):
        return mesh
    vertices = mesh.vertices * np.asarray(factors, mesh.vertices.dtype)
    part = np.zeros(len(vertices), np.int64)
    part[mesh.faces.reshape(-1)] = np.repeat(mesh.part, 3)
    for number in np.unique(part[mesh.vertices[:, 2] < _ON_GROUND_M]):
        mine = part == number
        x = mesh.vertices[mine, 0].astype(np.float64)
        middle = (x.min() + x.max()) / 2
        vertices[mine, 0] = middle * factors[0] + (x - middle) * factors[2]
    return replace(mesh, vertices=vertices)


def mesh_among(
    meshes: Mapping[tuple[str, int], LabelledMesh],
    name: str,
    phase: int,
    otherwise: Callable[[str, int], LabelledMesh],
) -> LabelledMesh:
    """Return the mesh of an asset among those by name and phase: itself, or its body to scale.

    Args:
        meshes: by name and phase.
        name: of the asset.
        phase: of its movement.
        otherwise: gives the mesh where neither is there.
    """
    own = meshes.get((name, phase))
    if own is not None:
        return own
    unsized = AssetName.of(name).unsized
    body, first = meshes.get((unsized, phase)), meshes.get((unsized, 0))
    size = AssetName.of(name).size
    if body is None or first is None or size is None:
        return otherwise(name, phase)
    x, y, z = np.asarray(size) / np.ptp(first.vertices, axis=0)
    return scaled_mesh(body, (float(x), float(y), float(z)))
