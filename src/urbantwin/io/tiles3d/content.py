"""The content of a tile in its own frame, z up: glTF, b3dm and pnts with their tables."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.io.decoders import unpack_draco
from urbantwin.io.gltf.features import NAMING
from urbantwin.io.gltf.primitive import FARTHEST
from urbantwin.io.gltf.scene import read_scene
from urbantwin.io.model import PointCloud, TriangleMesh
from urbantwin.io.values import (
    MalformedError,
    numbers,
    parse_json,
    table,
    whole,
)

__all__ = [
    "Content",
    "Context",
    "FeatureTable",
    "batch_names",
    "read_batched",
    "read_model",
    "read_points",
    "split_tables",
]


@dataclass
class Content:
    """The content of a tile.

    Attributes:
        meshes: triangles, z up, in the tile's frame.
        clouds: points, z up, in the tile's frame.
        problems: omissions, a line each.
        copyright: copyright statements of the files.
    """

    meshes: list[TriangleMesh] = field(default_factory=list)
    clouds: list[PointCloud] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    copyright: set[str] = field(default_factory=set)

    def add(self, other: Content) -> None:
        """Add another content."""
        self.meshes += other.meshes
        self.clouds += other.clouds
        self.problems += other.problems
        self.copyright |= other.copyright


@dataclass(frozen=True, eq=False)
class Context:
    """Context for reading a tile's content.

    Attributes:
        resolve: returns the bytes of a URI relative to the tile.
        axis: (3, 3) from glTF's axes to z up.
        transform: (4, 4) from the tile to the tileset's frame.
        spend: called with the number of new triangles and points; raises an error above the limit.
    """

    resolve: Callable[[str], bytes]
    axis: NDArray[np.float64]
    transform: NDArray[np.float64]
    spend: Callable[[int], None]


def read_model(
    data: bytes,
    context: Context,
    *,
    feature_names: Sequence[str] = (),
    centre: NDArray[np.float64] | None = None,
) -> Content:
    """Read the glTF of a tile, convert it to z up, and shift it to its centre.

    Source: 3D Tiles 1.1, sections "y-up to z-up" and "Transforms"; the centre (``RTC_CENTER`` or
    ``CESIUM_RTC``) is added after the conversion.

    Raises:
        MalformedError: nothing can be read.
    """
    scene = read_scene(data, context.resolve, feature_names=feature_names)
    offset = np.zeros(3)
    for part in (centre, scene.centre):
        if part is not None:
            offset = offset + part
    content = Content(problems=list(scene.problems))
    if scene.copyright:
        content.copyright.add(scene.copyright)
    context.spend(
        sum(len(mesh.faces) for mesh in scene.meshes)
        + sum(len(cloud.points) for cloud in scene.clouds)
    )
    for mesh in scene.meshes:
        vertices = mesh.vertices @ context.axis.T + offset
        content.meshes.append(
            TriangleMesh(vertices, mesh.faces, mesh.colour, mesh.object, mesh.names)
        )
    for cloud in scene.clouds:
        content.clouds.append(PointCloud(cloud.points @ context.axis.T + offset, cloud.colour))
    if scene.problems and not content.meshes and not content.clouds:
        raise MalformedError(scene.problems[0])
    return content


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
    """A table with its JSON in ``fields`` and its binary body in ``body``.

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
        """Return ``count`` rows of ``width`` numbers, or ``None`` if there is no such column."""
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
    """Return a name for each of ``count`` features; empty if no property names them.

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
    """Return a name as text; numbers are prefixed with their property."""
    if isinstance(value, str):
        return " ".join(value.split())[:80]
    if isinstance(value, int | float) and not isinstance(value, bool):
        return f"{key} {value:.12g}"
    return ""


def split_tables(
    data: bytes, start: int, lengths: tuple[int, int, int, int]
) -> tuple[list[bytes], bytes]:
    """Return the four parts of a tile's two tables, and the remaining bytes.

    Raises:
        MalformedError: they exceed the tile.
    """
    parts, at = [], start
    for length in lengths:
        if at + length > len(data):
            raise MalformedError("has tables that run beyond its end")
        parts.append(data[at : at + length])
        at += length
    return parts, data[at:]


def read_batched(data: bytes, context: Context) -> Content:
    """Read a b3dm from exactly its bytes.

    Source: 3D Tiles 1.0, section "Batched 3D Model".

    Raises:
        MalformedError: nothing can be read.
    """
    if len(data) < 28:
        raise MalformedError("ends within its header")
    parts, model = split_tables(data, 28, struct.unpack_from("<4I", data, 12))
    table = FeatureTable(parts[0], parts[1])
    problems = []
    try:
        names = batch_names(parts[2], parts[3], table.count("BATCH_LENGTH"))
    except MalformedError as error:
        names, problems = [], [f"{error}; its features have no names"]
    content = read_model(model, context, feature_names=names, centre=table.vector("RTC_CENTER", 3))
    content.problems += problems
    return content


def read_points(data: bytes, context: Context) -> Content:
    """Read a pnts from exactly its bytes; it is z up.

    Source: 3D Tiles 1.0, section "Point Cloud"; ``3DTILES_draco_point_compression``.

    Raises:
        MalformedError: nothing can be read.
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
    """Return the columns compressed by Draco, by name."""
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
