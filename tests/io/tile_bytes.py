"""Bytes of glTF and 3D Tiles, put together with struct as the standards prescribe."""

import json
import struct

import numpy as np
from scipy.spatial import cKDTree

COMPONENT = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPE = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


class Gltf:
    """A glTF document in the making: accessors are appended to one binary chunk."""

    def __init__(self) -> None:
        self.document = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": []}
        self.binary = b""

    def view(self, data: bytes, **more) -> int:
        self.binary += b"\0" * (-len(self.binary) % 4)
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data), **more}
        self.document["bufferViews"].append(view)
        self.binary += data
        return len(self.document["bufferViews"]) - 1

    def accessor(self, rows, kind: str, **more) -> int:
        rows = np.asarray(rows, dtype=f"<{kind}")
        rows = rows.reshape(len(rows), -1)
        spec = {
            "bufferView": self.view(rows.tobytes()),
            "componentType": COMPONENT[kind],
            "count": len(rows),
            "type": TYPE[rows.shape[1]],
            **more,
        }
        return self.add("accessors", spec)

    def add(self, kind: str, spec: dict) -> int:
        self.document.setdefault(kind, []).append(spec)
        return len(self.document[kind]) - 1

    def mesh(self, points, indices=None, *, mode=4, attributes=None, **more) -> int:
        primitive = {"attributes": {"POSITION": self.accessor(points, "f4")}, "mode": mode, **more}
        primitive["attributes"].update(attributes or {})
        if indices is not None:
            primitive["indices"] = self.accessor(np.ravel(indices), "u4")
        return self.add("meshes", {"primitives": [primitive]})

    def scene(self, *nodes: dict) -> "Gltf":
        self.document["nodes"] = list(nodes)
        self.document["scenes"] = [{"nodes": list(range(len(nodes)))}]
        self.document["scene"] = 0
        return self

    def glb(self) -> bytes:
        self.document["buffers"] = [{"byteLength": len(self.binary)}]
        return glb(self.document, self.binary)


def glb(document: dict, binary: bytes) -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<2I", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<2I", len(binary), 0x004E4942) + binary
    return struct.pack("<4s2I", b"glTF", 2, 12 + len(chunks)) + chunks


def _table(fields: dict, body: bytes = b"") -> tuple[bytes, bytes]:
    text = json.dumps(fields).encode() if fields else b""
    return text + b" " * (-len(text) % 8), body + b"\0" * (-len(body) % 8)


def b3dm(model: bytes, features: dict | None = None, batch: dict | None = None) -> bytes:
    head, body = _table(features or {"BATCH_LENGTH": 0})
    names, more = _table(batch or {})
    parts = head + body + names + more + model
    lengths = (len(head), len(body), len(names), len(more))
    return struct.pack("<4s6I", b"b3dm", 1, 28 + len(parts), *lengths) + parts


def i3dm(model: bytes, features: dict, columns: dict, batch=None, *, embedded=True) -> bytes:
    """``columns``: name -> array; they are put into the binary body, each at a multiple of 8."""
    fields, body = dict(features), b""
    for name, rows in columns.items():
        body += b"\0" * (-len(body) % 8)
        fields[name] = {"byteOffset": len(body)}
        body += np.ascontiguousarray(rows).tobytes()
    head, body = _table(fields, body)
    names, _ = _table(batch or {})
    parts = head + body + names + model
    lengths = (len(head), len(body), len(names), 0, int(embedded))
    return struct.pack("<4s7I", b"i3dm", 1, 32 + len(parts), *lengths) + parts


def pnts(features: dict, columns: dict) -> bytes:
    fields, body = dict(features), b""
    for name, rows in columns.items():
        body += b"\0" * (-len(body) % 8)
        fields[name] = {"byteOffset": len(body)}
        body += np.ascontiguousarray(rows).tobytes()
    head, body = _table(fields, body)
    lengths = (len(head), len(body), 0, 0)
    return struct.pack("<4s6I", b"pnts", 1, 28 + len(head + body), *lengths) + head + body


def cmpt(*tiles: bytes) -> bytes:
    inner = b"".join(tiles)
    return struct.pack("<4s3I", b"cmpt", 1, 16 + len(inner), len(tiles)) + inner


def same_triangles(mesh, other, within: float = 1e-4) -> bool:
    """Whether two meshes have the same triangles facing the same way, however they are stored."""
    rows = []
    for side in (mesh, other):
        a, b, c = np.moveaxis(np.asarray(side.vertices)[np.asarray(side.faces)], 1, 0)
        rows.append(np.concatenate([(a + b + c) / 3, np.cross(b - a, c - a)], axis=1))
    there, back = cKDTree(rows[1]).query(rows[0])[0], cKDTree(rows[0]).query(rows[1])[0]
    return len(rows[0]) == len(rows[1]) and max(there.max(), back.max()) < within
