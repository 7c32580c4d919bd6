"""Hashes of a motion's values, independent of the compression of its files."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping

import numpy as np
import pyarrow as pa

from urbantwin.geometry import LabelledMesh
from urbantwin.traffic.motion_rows import ActorRows

__all__ = ["mesh_sha256", "meshes_sha256", "table_sha256"]


def mesh_sha256(mesh: LabelledMesh) -> str:
    """Return the SHA-256 of a mesh's arrays, independent of how a file packs them."""
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


def table_sha256(table: pa.Table | ActorRows) -> str:
    """Return the SHA-256 of a table's values, independent of how a file packs them."""
    digest = hashlib.sha256()
    for field in table.schema:
        digest.update(f"{field.name} {field.type} {table.num_rows}".encode())
        chunks: Iterable[pa.Array]
        if str(field.type) == "string":
            texts, chunks = _dictionary_encoded(table, field.name)
            digest.update(json.dumps(texts).encode())
        else:
            chunks = (chunk for part in _parts(table, field.name) for chunk in part.chunks)
        for chunk in chunks:
            digest.update(np.ascontiguousarray(chunk.to_numpy(zero_copy_only=False)).data)
    return digest.hexdigest()


def _parts(table: pa.Table | ActorRows, name: str) -> Iterator[pa.ChunkedArray]:
    """Yield a column part by part, to limit memory."""
    for part in table.parts([name]) if isinstance(table, ActorRows) else [table]:
        yield part[name]


def _dictionary_encoded(table: pa.Table | ActorRows, name: str) -> tuple[list[str], list[pa.Array]]:
    """Return the distinct texts of a column in order of appearance, and the column as indices."""
    parts = _parts(table, name)
    encoded = [chunk for part in parts for chunk in part.dictionary_encode().chunks]
    chunks = pa.chunked_array(encoded, pa.dictionary(pa.int32(), pa.string()))
    chunks = chunks.unify_dictionaries().chunks
    texts = chunks[0].dictionary.to_pylist() if chunks else []
    return texts, [chunk.indices for chunk in chunks]
