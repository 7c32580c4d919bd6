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
        column = table[name]
        digest.update(f"{name} {column.type} {len(column)}".encode())
        parts = column.chunks
        if str(column.type) == "string":
            # Chunk by chunk: a whole column of texts would take hundreds of megabytes once more.
            parts = column.dictionary_encode().unify_dictionaries().chunks
            texts = parts[0].dictionary.to_pylist() if parts else []
            digest.update(json.dumps(texts).encode())
            parts = [one.indices for one in parts]
        for part in parts:
            digest.update(np.ascontiguousarray(part.to_numpy(zero_copy_only=False)).data)
    return digest.hexdigest()
