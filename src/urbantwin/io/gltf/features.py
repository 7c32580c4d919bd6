"""Features (a building, a roof) of the triangles of a primitive, and their names."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.io.gltf.data import Buffers
from urbantwin.io.values import MalformedError, items, table, text, whole

__all__ = ["NAMING", "FeatureSet", "feature_set", "property_names"]

#: Properties that name a feature, in order of preference.
NAMING = ("name", "label", "gml_name", "id", "gml_id", "gml:id", "identifier", "objectid")
_MOST_FEATURES = 1 << 22
_NUMBERS = {
    "INT8": "<i1",
    "UINT8": "<u1",
    "INT16": "<i2",
    "UINT16": "<u2",
    "INT32": "<i4",
    "UINT32": "<u4",
    "INT64": "<i8",
    "UINT64": "<u8",
}


class FeatureSet:
    """Source of a primitive's feature ids.

    Attributes:
        attribute: name of the vertex attribute with the ids, or "".
        texture: the ``textureInfo`` whose texels hold them, or ``None``.
        channels: channels of the texels, least significant first.
        null: the id that means none, or -1.
        table: index of the table of their properties, or ``None``.
    """

    def __init__(self, spec: dict[str, Any]) -> None:
        self.attribute = ""
        self.texture: dict[str, Any] | None = None
        self.channels = [0]
        if spec.get("attribute") is not None:
            self.attribute = f"_FEATURE_ID_{whole(spec, 'attribute')}"
        elif spec.get("texture") is not None:
            self.texture = table(spec, "texture")
            self.channels = [c for c in items(self.texture, "channels") if c in (0, 1, 2, 3)] or [0]
        self.null = whole(spec, "nullFeatureId") if "nullFeatureId" in spec else -1
        self.table = whole(spec, "propertyTable") if "propertyTable" in spec else None


def feature_set(primitive: dict[str, Any]) -> FeatureSet | None:
    """Return a primitive's first set of feature ids.

    Source: ``EXT_mesh_features``; 3D Tiles 1.0, "Batched 3D Model" (``_BATCHID``).
    """
    extension = table(table(primitive, "extensions"), "EXT_mesh_features")
    sets = items(extension, "featureIds")
    if sets and isinstance(sets[0], dict):
        return FeatureSet(sets[0])
    for name in ("_BATCHID", "BATCHID", "_FEATURE_ID_0"):
        if name in table(primitive, "attributes"):
            result = FeatureSet({})
            result.attribute = name
            return result
    return None


def property_names(document: dict[str, Any], buffers: Buffers, number: int) -> list[str]:
    """Return a name for each feature of a property table; empty if no property names them.

    Source: ``EXT_structural_metadata``, section "Binary Property Storage".
    """
    extension = table(table(document, "extensions"), "EXT_structural_metadata")
    tables = items(extension, "propertyTables")
    if number >= len(tables) or not isinstance(tables[number], dict):
        return []
    spec = tables[number]
    count = whole(spec, "count")
    if count > _MOST_FEATURES:
        raise MalformedError(f"a table of properties claims {count} features")
    classes = table(table(extension, "schema"), "classes")
    schema = table(table(classes, text(spec, "class")), "properties")
    stored = table(spec, "properties")
    by_name = {
        **{key.lower(): key for key in stored},
        **{text(table(schema, key), "semantic").lower(): key for key in stored if key in schema},
    }
    for wanted in NAMING:
        key = by_name.get(wanted)
        if key is None or table(schema, key).get("array"):
            continue
        kind, where = table(schema, key), table(stored, key)
        if kind.get("type") == "STRING":
            return _strings(buffers, where, count)
        if kind.get("type") == "SCALAR" and kind.get("componentType") in _NUMBERS:
            dtype = np.dtype(_NUMBERS[kind["componentType"]])
            data = buffers.view(whole(where, "values"))[0]
            if len(data) >= count * dtype.itemsize:
                return [str(value) for value in np.frombuffer(data, dtype, count).tolist()]
    return []


def _strings(buffers: Buffers, where: dict[str, Any], count: int) -> list[str]:
    data = bytes(buffers.view(whole(where, "values"))[0])
    dtype = np.dtype(_NUMBERS.get(text(where, "stringOffsetType", "UINT32"), "<u4"))
    raw = buffers.view(whole(where, "stringOffsets"))[0]
    if len(raw) < (count + 1) * dtype.itemsize:
        raise MalformedError("a table of properties has fewer names than it claims")
    ends: NDArray[Any] = np.frombuffer(raw, dtype, count + 1)
    if (np.diff(ends.astype(np.int64)) < 0).any() or int(ends[-1]) > len(data):
        raise MalformedError("a table of properties has names beyond its end")
    bounds = ends.tolist()
    return [data[a:b].decode("utf-8", "replace") for a, b in pairwise(bounds)]
