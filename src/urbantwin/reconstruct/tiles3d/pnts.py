"""Point clouds (pnts)."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.reconstruct.gltf.draco import unpack_draco
from urbantwin.reconstruct.gltf.primitive import FARTHEST
from urbantwin.reconstruct.gltf.untrusted_values import MalformedError, numbers, table, whole
from urbantwin.reconstruct.model import PointCloud
from urbantwin.reconstruct.tiles3d.b3dm import split_tables
from urbantwin.reconstruct.tiles3d.content import Content, Context
from urbantwin.reconstruct.tiles3d.feature_table import FeatureTable

__all__ = ["read_points"]


def read_points(data: bytes, context: Context) -> Content:
    """Read a pnts, of which ``data`` is all of its bytes and no more; it is z up.

    Source: 3D Tiles 1.0, section "Point Cloud"; ``3DTILES_draco_point_compression``.

    Raises:
        MalformedError: nothing of it can be read.
    """
    if len(data) < 28:
        raise MalformedError("ends within its header")
    a, b, c, d = struct.unpack_from("<4I", data, 12)
    parts, _ = split_tables(data, 28, (a, b, c, d))
    features = FeatureTable(parts[0], parts[1])
    count = features.count("POINTS_LENGTH")
    unpacked = _unpacked(features, count)
    points = unpacked.get("POSITION")
    if points is None:
        points = features.positions(count)
    points = np.asarray(points, np.float64)
    centre = features.vector("RTC_CENTER", 3)
    if centre is not None:
        points = points + centre
    colour = unpacked.get("RGB", unpacked.get("RGBA"))
    colour = _colours(features, count) if colour is None else colour[:, :3].astype(np.uint8)
    finite = (np.abs(points) < FARTHEST).all(axis=1)
    content = Content()
    if not finite.all():
        content.problems.append(f"{int((~finite).sum())} of {count} points are not finite numbers")
        points, colour = points[finite], None if colour is None else colour[finite]
    context.spend(len(points))
    content.clouds.append(PointCloud(points, colour))
    return content


def _colours(features: FeatureTable, count: int) -> NDArray[np.uint8] | None:
    """Return (N, 3) RGBA, RGB, RGB565 or CONSTANT_RGBA, in this order of precedence."""
    for key, width in (("RGBA", 4), ("RGB", 3)):
        column = features.column(key, "UNSIGNED_BYTE", width, count)
        if column is not None:
            return np.ascontiguousarray(column[:, :3]).astype(np.uint8)
    packed = features.column("RGB565", "UNSIGNED_SHORT", 1, count)
    if packed is not None:
        value = packed[:, 0].astype(np.float64).astype(np.uint16)
        parts = [(value >> 11, 31.0), (value >> 5 & 63, 63.0), (value & 31, 31.0)]
        return np.stack([np.rint(p / top * 255.0) for p, top in parts], axis=1).astype(np.uint8)
    constant = features.fields.get("CONSTANT_RGBA")
    if isinstance(constant, list):
        rgba = numbers(features.fields, "CONSTANT_RGBA", 4)
    elif constant is not None:
        column = features.column("CONSTANT_RGBA", "UNSIGNED_BYTE", 4, 1)
        rgba = np.zeros(4) if column is None else column[0].astype(np.float64)
    else:
        return None
    return np.tile(np.clip(rgba[:3], 0, 255).astype(np.uint8), (count, 1))


def _unpacked(features: FeatureTable, count: int) -> dict[str, NDArray[Any]]:
    """Return the columns that Draco packs, by name."""
    extension = table(table(features.fields, "extensions"), "3DTILES_draco_point_compression")
    if not extension:
        return {}
    start, length = whole(extension, "byteOffset"), whole(extension, "byteLength")
    if start + length > len(features.body):
        raise MalformedError("its Draco data runs beyond its table")
    by_id, _ = unpack_draco(features.body[start : start + length])
    ids = table(extension, "properties")
    result = {key: by_id[whole(ids, key)] for key in ids if whole(ids, key) in by_id}
    if any(len(rows) != count for rows in result.values()):
        raise MalformedError(f"its Draco data does not hold the {count} points that it claims")
    return result
