"""Feature tables and batch tables of 3D Tiles 1.0: JSON with numbers in a binary body."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.reconstruct.gltf.features import NAMING
from urbantwin.reconstruct.gltf.untrusted_values import (
    MalformedError,
    numbers,
    parse_json,
    whole,
)

__all__ = ["FeatureTable", "batch_names"]

_COMPONENTS: dict[str, str] = {
    "BYTE": "<i1",
    "UNSIGNED_BYTE": "<u1",
    "SHORT": "<i2",
    "UNSIGNED_SHORT": "<u2",
    "INT": "<i4",
    "UNSIGNED_INT": "<u4",
    "FLOAT": "<f4",
    "DOUBLE": "<f8",
}
_MOST_FEATURES = 1 << 25


class FeatureTable:
    """A table whose JSON is ``fields`` and whose binary body is ``body``.

    Source: 3D Tiles 1.0, section "Feature Table".
    """

    def __init__(self, header: bytes, body: bytes) -> None:
        self.fields = parse_json(header, "its feature table") if header.strip(b" \0") else {}
        self.body = body

    def count(self, key: str) -> int:
        """Return a count of features."""
        count = whole(self.fields, key, 0)
        if count > _MOST_FEATURES:
            raise MalformedError(f"claims {key} {count}")
        return count

    def vector(self, key: str, size: int) -> NDArray[np.float64] | None:
        """Return a global property, such as ``RTC_CENTER``, or ``None``."""
        value = self.fields.get(key)
        if value is None:
            return None
        if isinstance(value, dict):
            row = self.column(key, "FLOAT", size, 1)
            return None if row is None else row[0].astype(np.float64)
        return numbers(self.fields, key, size)

    def positions(self, count: int) -> NDArray[np.float64]:
        """Return (N, 3) POSITION or POSITION_QUANTIZED of all features."""
        exact = self.column("POSITION", "FLOAT", 3, count)
        if exact is not None:
            return exact.astype(np.float64)
        steps = self.column("POSITION_QUANTIZED", "UNSIGNED_SHORT", 3, count)
        offset = self.vector("QUANTIZED_VOLUME_OFFSET", 3)
        scale = self.vector("QUANTIZED_VOLUME_SCALE", 3)
        if steps is None or offset is None or scale is None:
            raise MalformedError("has neither POSITION nor POSITION_QUANTIZED with its volume")
        return np.asarray(steps.astype(np.float64) / 65535.0 * scale + offset)

    def column(self, key: str, kind: str, width: int, count: int) -> NDArray[Any] | None:
        """Return ``count`` rows of ``width`` numbers, or ``None`` where there is no such column."""
        where = self.fields.get(key)
        if where is None:
            return None
        if isinstance(where, list):
            flat = numbers({key: where}, key, count * width)
            return flat.reshape(count, width)
        if not isinstance(where, dict):
            raise MalformedError(f"{key} is not a place in the table")
        dtype = (
            np.dtype(_COMPONENTS[str(where.get("componentType", kind))])
            if (where.get("componentType", kind) in _COMPONENTS)
            else None
        )
        if dtype is None:
            raise MalformedError(f"{key} has components of a type that is not known")
        start = whole(where, "byteOffset")
        if start + count * width * dtype.itemsize > len(self.body):
            raise MalformedError(f"{key} runs beyond its table")
        return np.frombuffer(self.body, dtype, count * width, start).reshape(count, width)


def batch_names(header: bytes, body: bytes, count: int) -> list[str]:
    """Return a name for each of ``count`` features; none where no property names them.

    Source: 3D Tiles 1.0, section "Batch Table".
    """
    if not header.strip(b" \0"):
        return []
    table = FeatureTable(header, body)
    by_name = {key.lower(): key for key in table.fields}
    for wanted in NAMING:
        key = by_name.get(wanted)
        if key is None:
            continue
        value = table.fields[key]
        if isinstance(value, list) and len(value) >= count:
            return [_shown(key, item) for item in value[:count]]
        if isinstance(value, dict) and value.get("type", "SCALAR") == "SCALAR":
            column = table.column(key, "UNSIGNED_INT", 1, count)
            if column is not None:
                return [_shown(key, item) for item in column[:, 0].tolist()]
    return []


def _shown(key: str, value: object) -> str:
    """Return a name as text: numbers with the property that they are of."""
    if isinstance(value, str):
        return " ".join(value.split())[:80]
    if isinstance(value, int | float) and not isinstance(value, bool):
        return f"{key} {value:.12g}"
    return ""
