"""glTF files: the container, its buffers and views, and accessors of typed numbers in them."""

from __future__ import annotations

import base64
import binascii
import struct
from collections.abc import Callable
from typing import Any
from urllib.parse import unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from urbantwin.io.decoders import unpack_meshopt
from urbantwin.io.values import (
    MalformedError,
    entry,
    flag,
    items,
    parse_json,
    table,
    text,
    whole,
)

__all__ = ["Accessors", "Buffers", "fractions", "open_container"]

_JSON, _BIN = 0x4E4F534A, 0x004E4942


def open_container(data: bytes) -> tuple[dict[str, Any], bytes | None]:
    """Split a ``.gltf`` or ``.glb`` of version 2 into its JSON and its binary chunk.

    Source: glTF 2.0 (ISO/IEC 12113:2022), section 4 "GLB File Format".

    Raises:
        MalformedError: it is neither, of another version, truncated, or has wrong lengths.
    """
    if data[:4] != b"glTF":
        return _checked(parse_json(data, "it"), None)
    if len(data) < 20:
        raise MalformedError("ends within its header")
    version, length = struct.unpack_from("<2I", data, 4)
    if length > len(data):
        raise MalformedError(f"ends after {len(data)} of {length} bytes")
    if version != 2:
        raise MalformedError(f"is glTF of version {version}, and not 2")
    chunks = _chunks(data, length)
    if not chunks or chunks[0][0] != _JSON:
        raise MalformedError("does not begin with a JSON chunk")
    document = parse_json(chunks[0][1], "its JSON chunk")
    binary = next((content for kind, content in chunks[1:] if kind == _BIN), None)
    return _checked(document, binary)


def _chunks(data: bytes, length: int) -> list[tuple[int, bytes]]:
    """Return the chunks of a GLB: kind and content."""
    at, chunks = 12, []
    while at + 8 <= length:
        size, kind = struct.unpack_from("<2I", data, at)
        at += 8
        if at + size > length:
            raise MalformedError("has a chunk that runs beyond its end")
        chunks.append((kind, data[at : at + size]))
        at += size
    return chunks


def _checked(document: dict[str, Any], binary: bytes | None) -> tuple[dict[str, Any], bytes | None]:
    version = text(table(document, "asset"), "version")
    if not version:
        raise MalformedError("is not glTF: it has no asset.version")
    if not version.startswith("2"):
        raise MalformedError(f"is glTF of version {version[:20]}, and not 2")
    return document, binary


#: Maximum decompressed size of a view, bytes; a tile of a city has a hundredth of it.
_LARGEST_VIEW = 1 << 29


def data_uri(uri: str) -> bytes:
    """Return the bytes of a ``data:`` URI (RFC 2397)."""
    head, comma, body = uri.partition(",")
    if not comma:
        raise MalformedError("a data: URI has no comma")
    raw = unquote_to_bytes(body)
    if not head.endswith(";base64"):
        return raw
    try:
        return base64.b64decode(raw, validate=False)
    except (binascii.Error, ValueError):
        raise MalformedError("a data: URI is not base64") from None


class Buffers:
    """Buffers and views of a document, each fetched and decompressed once.

    Args:
        document: the JSON of glTF 2.0.
        binary: the GLB's binary chunk.
        resolve: returns the bytes of a relative URI of the document.
    """

    def __init__(
        self, document: dict[str, Any], binary: bytes | None, resolve: Callable[[str], bytes]
    ) -> None:
        self._document = document
        self._required = items(document, "extensionsRequired")
        self._binary = binary
        self._resolve = resolve
        self._bytes: dict[int, bytes] = {}
        self._unpacked: dict[int, memoryview] = {}

    def fetch(self, uri: str) -> bytes:
        """Return the bytes of a URI of the document, embedded or beside it."""
        return data_uri(uri) if uri.startswith("data:") else self._resolve(uri)

    def buffer(self, number: int) -> bytes:
        """Return a whole buffer."""
        if number not in self._bytes:
            spec = entry(self._document, "buffers", number)
            uri = text(spec, "uri")
            if uri:
                self._bytes[number] = self.fetch(uri)
            elif number == 0 and self._binary is not None:
                self._bytes[number] = self._binary
            else:
                raise MalformedError(f"buffer {number} has no uri and there is no binary chunk")
            if len(self._bytes[number]) < whole(spec, "byteLength", 0):
                raise MalformedError(
                    f"buffer {number} has {len(self._bytes[number])} bytes, and not the "
                    f"{spec['byteLength']} that its byteLength says"
                )
        return self._bytes[number]

    def view(self, number: int) -> tuple[memoryview, int]:
        """Return the bytes of a view and its stride (0: tightly packed)."""
        spec = entry(self._document, "bufferViews", number)
        extensions = table(spec, "extensions")
        for name in ("EXT_meshopt_compression", "KHR_meshopt_compression"):
            if name in extensions:
                packed = table(extensions, name)
                if number not in self._unpacked:
                    try:
                        self._unpacked[number] = self._meshopt(packed)
                    except MalformedError:
                        # files that do not require the extension also have uncompressed bytes
                        if name in self._required or not self._has_plain(spec):
                            raise
                        break
                return self._unpacked[number], whole(packed, "byteStride")
        return self._slice(spec, f"bufferView {number}"), whole(spec, "byteStride", 0)

    def _has_plain(self, spec: dict[str, Any]) -> bool:
        number = whole(spec, "buffer")
        named = bool(text(entry(self._document, "buffers", number), "uri"))
        return named or (number == 0 and self._binary is not None)

    def _slice(self, spec: dict[str, Any], name: str) -> memoryview:
        start, length = whole(spec, "byteOffset", 0), whole(spec, "byteLength")
        data = self.buffer(whole(spec, "buffer"))
        if start + length > len(data):
            raise MalformedError(f"{name} runs to byte {start + length} of a buffer of {len(data)}")
        return memoryview(data)[start : start + length]

    def _meshopt(self, spec: dict[str, Any]) -> memoryview:
        data = self._slice(spec, "a packed view")
        count, stride = whole(spec, "count"), whole(spec, "byteStride")
        if count * stride > _LARGEST_VIEW or not 1 <= stride <= 256:
            raise MalformedError(f"a packed view claims {count} rows of {stride} bytes")
        mode, filter_name = text(spec, "mode"), text(spec, "filter", "NONE")
        return unpack_meshopt(bytes(data), count, stride, mode, filter_name)


_TYPES: dict[int, np.dtype[Any]] = {
    5120: np.dtype("<i1"),
    5121: np.dtype("<u1"),
    5122: np.dtype("<i2"),
    5123: np.dtype("<u2"),
    5125: np.dtype("<u4"),
    5126: np.dtype("<f4"),
}
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
#: Maximum rows of an accessor: those without a view can claim any number.
LARGEST_COUNT = 1 << 25


class Accessors:
    """Reads accessors: stride, offset, sparse replacements and normalised integers undone.

    Source: glTF 2.0, section 3.6 "Binary Data Storage", and ``KHR_mesh_quantization``, which
    only allows further component types.
    """

    def __init__(self, document: dict[str, Any], buffers: Buffers) -> None:
        self._document = document
        self._buffers = buffers

    def spec(self, number: int) -> dict[str, Any]:
        """Return the JSON of an accessor."""
        return entry(self._document, "accessors", number)

    def count(self, number: int) -> int:
        """Return the declared number of rows of an accessor."""
        count = whole(self.spec(number), "count")
        if count > LARGEST_COUNT:
            raise MalformedError(f"accessor {number} claims {count} elements")
        return count

    def raw(self, number: int) -> NDArray[Any]:
        """Return (N, C) numbers as stored."""
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
        stride = stride or packed
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
