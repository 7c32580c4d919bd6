"""Accessors of a glTF document: typed rows of numbers in buffers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.reconstruct.gltf.buffers import Buffers
from urbantwin.reconstruct.gltf.untrusted_values import (
    MalformedError,
    flag,
    items,
    table,
    text,
    whole,
)

__all__ = ["LARGEST_COUNT", "Accessors"]

_TYPES: dict[int, np.dtype[Any]] = {
    5120: np.dtype("<i1"),
    5121: np.dtype("<u1"),
    5122: np.dtype("<i2"),
    5123: np.dtype("<u2"),
    5125: np.dtype("<u4"),
    5126: np.dtype("<f4"),
}
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
#: Rows that an accessor may have: those without a view need no bytes to claim any number.
LARGEST_COUNT = 1 << 25


class Accessors:
    """Reads accessors: stride, offset, sparse replacements and normalised integers undone.

    Source: glTF 2.0, section 3.6 "Binary Data Storage", and ``KHR_mesh_quantization``, which
    only allows further component types.
    """

    def __init__(self, document: dict[str, Any], buffers: Buffers) -> None:
        self._accessors = items(document, "accessors")
        self._buffers = buffers

    def spec(self, number: int) -> dict[str, Any]:
        """Return the JSON of an accessor."""
        if number >= len(self._accessors) or not isinstance(self._accessors[number], dict):
            raise MalformedError(f"refers to accessor {number}, which it does not have")
        value: dict[str, Any] = self._accessors[number]
        return value

    def count(self, number: int) -> int:
        """Return how many rows an accessor claims."""
        count = whole(self.spec(number), "count")
        if count > LARGEST_COUNT:
            raise MalformedError(f"accessor {number} claims {count} elements")
        return count

    def raw(self, number: int) -> NDArray[Any]:
        """Return (N, C) numbers as they are stored."""
        spec, name = self.spec(number), f"accessor {number}"
        count, columns = self.count(number), _COMPONENTS.get(text(spec, "type"))
        dtype = _dtype(spec, name)
        if columns is None:
            raise MalformedError(f"{name} is of type {spec.get('type')!r:.40}")
        if spec.get("bufferView") is None:
            rows = np.zeros((count, columns), dtype)
        else:
            rows = self._rows(spec, count, columns, dtype, name)
        sparse = table(spec, "sparse")
        if sparse:
            rows = self._replaced(rows.copy(), sparse, name)
        return rows

    def values(self, number: int) -> NDArray[Any]:
        """Return (N, C) float64 numbers, normalised integers as fractions (section 3.6.2.2)."""
        rows = self.raw(number)
        if flag(self.spec(number), "normalized") and rows.dtype.kind in "iu":
            return fractions(rows)
        return rows.astype(np.float64)

    def _rows(
        self, spec: dict[str, Any], count: int, columns: int, dtype: np.dtype[Any], name: str
    ) -> NDArray[Any]:
        data, stride = self._buffers.view(whole(spec, "bufferView"))
        start = whole(spec, "byteOffset", 0)
        packed = columns * dtype.itemsize
        # glTF 1.0 keeps the stride in the accessor.
        stride = stride or whole(spec, "byteStride", 0) or packed
        if count and start + stride * (count - 1) + packed > len(data):
            raise MalformedError(
                f"{name} claims {count} elements, which its bufferView of {len(data)} bytes "
                "does not hold"
            )
        rows: NDArray[Any] = np.ndarray(
            (count, columns), dtype, data, start if count else 0, (stride, dtype.itemsize)
        )
        return rows

    def _replaced(self, rows: NDArray[Any], sparse: dict[str, Any], name: str) -> NDArray[Any]:
        count = whole(sparse, "count")
        if count > len(rows):
            raise MalformedError(f"{name} replaces {count} of {len(rows)} elements")
        where, what = table(sparse, "indices"), table(sparse, "values")
        indices = self._rows(where, count, 1, _dtype(where, name), f"{name} (sparse)")[:, 0]
        if count and int(indices.max()) >= len(rows):
            raise MalformedError(f"{name} replaces element {int(indices.max())} of {len(rows)}")
        rows[indices] = self._rows(what, count, rows.shape[1], rows.dtype, f"{name} (sparse)")
        return rows


def fractions(rows: NDArray[Any]) -> NDArray[np.float64]:
    """Return normalised integers as fractions: unsigned 0..1, signed -1..1."""
    top = float(np.iinfo(rows.dtype).max)
    return np.maximum(rows.astype(np.float64) / top, -1.0)


def _dtype(spec: dict[str, Any], name: str) -> np.dtype[Any]:
    kind = whole(spec, "componentType")
    if kind not in _TYPES:
        raise MalformedError(f"{name} has components of type {kind}")
    return _TYPES[kind]
