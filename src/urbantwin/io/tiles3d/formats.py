"""Instanced models (i3dm), composites (cmpt), and dispatch of tile contents by magic bytes."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from urbantwin.io.gltf.primitive import FARTHEST
from urbantwin.io.model import PointCloud, TriangleMesh
from urbantwin.io.tiles3d.content import (
    Content,
    Context,
    FeatureTable,
    batch_names,
    read_batched,
    read_model,
    read_points,
    split_tables,
)
from urbantwin.io.tiles3d.tile import geodetic_from_ecef
from urbantwin.io.values import MalformedError, flag

__all__ = ["read_content"]


def read_instanced(data: bytes, context: Context) -> Content:
    """Read an i3dm from exactly its bytes.

    Source: 3D Tiles 1.0, section "Instanced 3D Model": instance = RTC_CENTER + POSITION, rotated by
    [right, up, right x up], scaled; in the tile's frame, after the conversion of the glTF to z up.

    Raises:
        MalformedError: nothing can be read.
    """
    if len(data) < 32:
        raise MalformedError("ends within its header")
    a, b, c, d, form = struct.unpack_from("<5I", data, 12)
    parts, model = split_tables(data, 32, (a, b, c, d))
    table = FeatureTable(parts[0], parts[1])
    count = table.count("INSTANCES_LENGTH")
    places = table.positions(count)
    centre = table.vector("RTC_CENTER", 3)
    if centre is not None:
        places = places + centre
    linear = _orientations(table, count, places, context) * _scales(table, count)[:, None, :]
    if not ((np.abs(places) < FARTHEST).all() and (np.abs(linear) < FARTHEST).all()):
        raise MalformedError("has instances whose places are not finite")
    if form == 0:
        uri = model.split(b"\0")[0].decode("utf-8", "replace").strip()
        model = context.resolve(uri)
    elif form != 1:
        raise MalformedError(f"has a model of format {form}")
    single = read_model(model, context)
    # the model itself is already counted once
    triangles = sum(len(mesh.faces) for mesh in single.meshes)
    points = sum(len(cloud.points) for cloud in single.clouds)
    context.spend((triangles + points) * max(count - 1, 0))
    names = _names(table, parts[2], parts[3], count)
    single.meshes = [_repeated(mesh, places, linear, names) for mesh in single.meshes]
    single.clouds = [_scattered(cloud, places, linear) for cloud in single.clouds]
    return single


def _scales(table: FeatureTable, count: int) -> NDArray[np.float64]:
    """Return (N, 3) scales: SCALE times SCALE_NON_UNIFORM."""
    result = np.ones((count, 3))
    for key, width in (("SCALE", 1), ("SCALE_NON_UNIFORM", 3)):
        column = table.column(key, "FLOAT", width, count)
        if column is not None:
            result = result * column.astype(np.float64)
    return result


def _orientations(
    table: FeatureTable, count: int, places: NDArray[np.float64], context: Context
) -> NDArray[np.float64]:
    """Return (N, 3, 3) rotations of the instances in the tile's frame."""
    up = _directions(table, "NORMAL_UP", count)
    right = _directions(table, "NORMAL_RIGHT", count)
    if up is not None and right is not None:
        return np.stack([right, up, np.cross(right, up)], axis=2)
    if not flag(table.fields, "EAST_NORTH_UP"):
        return np.broadcast_to(np.eye(3), (count, 3, 3))
    # Earth-centred are either the tile's own coordinates or the transformed ones.
    if count and np.linalg.norm(places, axis=1).min() > 6.2e6:
        return _east_north_up(places)
    linear = context.transform[:3, :3]
    frames = _east_north_up(places @ linear.T + context.transform[:3, 3])
    scale = np.cbrt(abs(np.linalg.det(linear))) or 1.0
    return np.asarray(np.linalg.pinv(linear / scale) @ frames)


def _east_north_up(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (N, 3, 3) columns east, north, up of WGS84 at (N, 3) Earth-centred points."""
    lon, lat, _ = geodetic_from_ecef(points).T
    east = np.stack([-np.sin(lon), np.cos(lon), np.zeros_like(lon)], axis=1)
    up = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=1)
    return np.stack([east, np.cross(up, east), up], axis=2)


def _directions(table: FeatureTable, key: str, count: int) -> NDArray[np.float64] | None:
    """Return (N, 3) unit vectors, plain or oct-encoded in 2 x 16 bits, or ``None``."""
    plain = table.column(key, "FLOAT", 3, count)
    if plain is None:
        packed = table.column(f"{key}_OCT32P", "UNSIGNED_SHORT", 2, count)
        if packed is None:
            return None
        plain = _from_octahedron(packed.astype(np.float64) / 65535.0 * 2.0 - 1.0)
    vectors = plain.astype(np.float64)
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    if not (length > 1e-9).all():
        raise MalformedError(f"has a {key} of no length")
    return np.asarray(vectors / length)


def _from_octahedron(xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return unit vectors from oct-encoded ones, -1..1.

    Source: Cigolle et al. 2014, "A Survey of Efficient Representations for Independent Unit
    Vectors", which the standard refers to.
    """
    x, y = xy[:, 0], xy[:, 1]
    z = 1.0 - np.abs(x) - np.abs(y)
    folded_x = (1.0 - np.abs(y)) * np.where(x >= 0, 1.0, -1.0)
    folded_y = (1.0 - np.abs(x)) * np.where(y >= 0, 1.0, -1.0)
    below = z < 0
    return np.stack([np.where(below, folded_x, x), np.where(below, folded_y, y), z], axis=1)


def _names(table: FeatureTable, header: bytes, body: bytes, count: int) -> list[str]:
    """Return a name for each instance: its feature's, or its number."""
    column = table.column("BATCH_ID", "UNSIGNED_SHORT", 1, count)
    batch = np.arange(count) if column is None else column[:, 0].astype(np.int64)
    try:
        known = batch_names(header, body, int(batch.max(initial=-1)) + 1)
    except MalformedError:
        known = []
    plain = [f"instance {number}" for number in range(count)]
    if not known:
        return plain
    return [known[b] or name for b, name in zip(batch.tolist(), plain, strict=True)]


def _repeated(
    mesh: TriangleMesh,
    places: NDArray[np.float64],
    linear: NDArray[np.float64],
    names: list[str],
) -> TriangleMesh:
    """Return a mesh at every position; every instance has its own objects."""
    count, size = len(places), len(mesh.vertices)
    vertices = np.einsum("nij,vj->nvi", linear, mesh.vertices) + places[:, None, :]
    faces = np.broadcast_to(mesh.faces, (count, *mesh.faces.shape)).copy()
    mirrored = np.linalg.det(linear) < 0
    faces[mirrored] = faces[mirrored][:, :, ::-1]
    faces += (np.arange(count, dtype=np.int32) * size)[:, None, None]
    objects = mesh.object + (np.arange(count, dtype=np.int32) * len(mesh.names))[:, None]
    return TriangleMesh(
        vertices.reshape(-1, 3),
        faces.reshape(-1, 3),
        None if mesh.colour is None else np.tile(mesh.colour, (count, 1)),
        objects.reshape(-1),
        tuple(f"{instance} / {name}" for instance in names for name in mesh.names),
    )


def _scattered(
    cloud: PointCloud, places: NDArray[np.float64], linear: NDArray[np.float64]
) -> PointCloud:
    """Return a cloud at every position."""
    points = np.einsum("nij,vj->nvi", linear, cloud.points) + places[:, None, :]
    colour = None if cloud.colour is None else np.tile(cloud.colour, (len(places), 1))
    return PointCloud(points.reshape(-1, 3), colour)


_DEEPEST = 8
_READERS = {b"b3dm": read_batched, b"i3dm": read_instanced, b"pnts": read_points}


@np.errstate(all="ignore")  # non-numbers are detected and reported
def read_content(data: bytes, context: Context, depth: int = 0) -> Content:
    """Read a b3dm, i3dm, pnts, cmpt, glb or glTF.

    Args:
        data: its decompressed bytes, possibly followed by others within a composite.
        context: context of the tile.
        depth: number of enclosing composites.

    Raises:
        MalformedError: nothing can be read.
    """
    magic = data[:4]
    if magic == b"glTF" or data[:64].lstrip()[:1] == b"{" or data[:3] == b"\xef\xbb\xbf":
        return read_model(data, context)
    if len(data) < 16:
        raise MalformedError("ends within its header" if data else "is empty")
    version, length = struct.unpack_from("<2I", data, 4)
    if magic not in (*_READERS, b"cmpt"):
        raise MalformedError(f"is of a format that is not known ({magic!r:.20})")
    if version != 1:
        raise MalformedError(f"is {magic.decode()} of version {version}, and not 1")
    if length > len(data):
        raise MalformedError(f"ends after {len(data)} of {length} bytes")
    if length < 16:
        raise MalformedError(f"says that it has {length} bytes, less than its header")
    if magic != b"cmpt":
        return _READERS[magic](data[:length], context)
    if depth >= _DEEPEST:
        raise MalformedError("is a composite in a composite beyond reason")
    return _read_composite(data[:length], context, depth)


def _read_composite(data: bytes, context: Context, depth: int) -> Content:
    """Read the tiles inside a cmpt; invalid ones are skipped.

    Source: 3D Tiles 1.0, section "Composite".
    """
    (count,) = struct.unpack_from("<I", data, 12)
    result, at, read = Content(), 16, 0
    for number in range(count):
        if at + 12 > len(data):
            result.problems.append(f"ends after {number} of {count} inner tiles")
            break
        (length,) = struct.unpack_from("<I", data, at + 8)
        if length < 12 or at + length > len(data):
            result.problems.append(f"inner tile {number} runs beyond the composite's end")
            break
        try:
            result.add(read_content(data[at : at + length], context, depth + 1))
            read += 1
        except MalformedError as error:
            result.problems.append(f"inner tile {number}: {error}")
        at += length
    if count and not read:
        raise MalformedError(result.problems[0])
    return result
