"""Meshes of a site's own actors in its twin: ``assets.npz``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.artefact.arrays import checked_arrays, read_arrays
from urbantwin.geometry import LabelledMesh
from urbantwin.geometry.mesh import MESH_FORM, checked_mesh

__all__ = ["OWN_MESHES", "read_own_meshes", "write_own_meshes"]

OWN_MESHES = "assets.npz"
_EXPECTED = "the actors of a site"


def write_own_meshes(folder: Path, meshes: Mapping[str, LabelledMesh]) -> None:
    """Write meshes by name into a twin's folder, if there are any."""
    if not meshes:
        return
    np.savez_compressed(
        folder / OWN_MESHES,
        allow_pickle=False,
        **{
            f"{name}/{field}": getattr(mesh, field)
            for name, mesh in sorted(meshes.items())
            for field in MESH_FORM
        },
    )


def read_own_meshes(path: Path) -> dict[str, LabelledMesh]:
    """Return the meshes by name.

    Raises:
        InputError: missing, damaged, or no meshes.
    """
    parts: dict[str, dict[str, Any]] = {}
    for key, array in read_arrays(path, _EXPECTED).items():
        name, _, field = key.rpartition("/")
        parts.setdefault(name, {})[field] = array
    meshes = {}
    for name, arrays in parts.items():
        checked_arrays(arrays, MESH_FORM, file=path, expected=_EXPECTED, within=f"{name}/")
        meshes[name] = LabelledMesh(**checked_mesh(arrays, path, _EXPECTED))
    return meshes
