"""Fingerprints of a motion: hashes of its values, whatever the files' compression."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping

import numpy as np
import pyarrow as pa

from urbantwin.geometry import LabelledMesh

__all__ = ["mesh_sha256", "meshes_sha256", "table_sha256"]


def mesh_sha256(mesh: LabelledMesh) -> str:
    """Return the SHA-256 of a mesh's arrays, which does not depend on how a file packs them."""
    digest = hashlib.sha256()
    for field in dataclasses.fields(mesh):
        array = np.ascontiguousarray(getattr(mesh, field.name))
        digest.update(f"{field.name} {array.dtype.str} {array.shape}".encode())
        digest.update(array.data)
    return digest.hexdigest()


def meshes_sha256(meshes: Mapping[tuple[str, int], LabelledMesh]) -> str:
    """Return the SHA-256 of the actors' meshes by asset and phase."""
    parts = [(*key, mesh_sha256(mesh)) for key, mesh in sorted(meshes.items())]
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


def table_sha256(table: pa.Table) -> str:
    """Return the SHA-256 of a table's values, which does not depend on how a file packs them."""
    digest = hashlib.sha256()
    for name in table.column_names:
        column = table[name].combine_chunks()
        digest.update(f"{name} {column.type} {len(column)}".encode())
        if str(column.type) == "string":
            column = column.dictionary_encode()
            digest.update(json.dumps(column.dictionary.to_pylist()).encode())
            column = column.indices
        digest.update(np.ascontiguousarray(column.to_numpy(zero_copy_only=False)).data)
    return digest.hexdigest()
