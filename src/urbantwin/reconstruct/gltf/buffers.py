"""Buffers of a glTF document and the views into them."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Callable
from typing import Any
from urllib.parse import unquote_to_bytes

from urbantwin.extras import check_extra
from urbantwin.reconstruct.gltf.untrusted_values import MalformedError, items, table, text, whole

__all__ = ["Buffers", "data_uri"]

#: A view may unpack to this many bytes; a tile of a city has a hundredth of it.
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
    """Gives bytes of buffers and views of a document, each fetched and unpacked once.

    Args:
        document: the JSON of glTF 2.0.
        binary: the GLB's binary chunk.
        resolve: gives the bytes of a relative URI of the document.
    """

    def __init__(
        self, document: dict[str, Any], binary: bytes | None, resolve: Callable[[str], bytes]
    ) -> None:
        self._buffers = items(document, "buffers")
        self._views = items(document, "bufferViews")
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
            spec = _entry(self._buffers, number, "buffer")
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
        spec = _entry(self._views, number, "bufferView")
        extensions = table(spec, "extensions")
        for name in ("EXT_meshopt_compression", "KHR_meshopt_compression"):
            if name in extensions:
                packed = table(extensions, name)
                if number not in self._unpacked:
                    try:
                        self._unpacked[number] = self._meshopt(packed)
                    except MalformedError:
                        # Whoever does not require the extension has the plain bytes as well.
                        if name in self._required or not self._has_plain(spec):
                            raise
                        break
                return self._unpacked[number], whole(packed, "byteStride")
        return self._slice(spec, f"bufferView {number}"), whole(spec, "byteStride", 0)

    def _has_plain(self, spec: dict[str, Any]) -> bool:
        number = whole(spec, "buffer")
        named = bool(text(_entry(self._buffers, number, "buffer"), "uri"))
        return named or (number == 0 and self._binary is not None)

    def _slice(self, spec: dict[str, Any], name: str) -> memoryview:
        start, length = whole(spec, "byteOffset", 0), whole(spec, "byteLength")
        data = self.buffer(whole(spec, "buffer"))
        if start + length > len(data):
            raise MalformedError(f"{name} runs to byte {start + length} of a buffer of {len(data)}")
        return memoryview(data)[start : start + length]

    def _meshopt(self, spec: dict[str, Any]) -> memoryview:
        """Unpack a view packed by meshoptimizer.

        Source: the glTF extension ``EXT_meshopt_compression`` (Khronos, vendor extension).
        """
        data = self._slice(spec, "a packed view")
        count, stride = whole(spec, "count"), whole(spec, "byteStride")
        if count * stride > _LARGEST_VIEW or not 1 <= stride <= 256:
            raise MalformedError(f"a packed view claims {count} rows of {stride} bytes")
        check_extra("gltf", "reading meshes packed by meshopt")
        from meshopt import decode_gltf_buffer

        try:
            rows = decode_gltf_buffer(
                bytes(data), count, stride, text(spec, "mode"), text(spec, "filter", "NONE")
            )
        except Exception as error:
            raise MalformedError(f"a view packed by meshopt cannot be unpacked ({error})") from None
        return memoryview(bytes(rows))


def _entry(entries: list[Any], number: int, what: str) -> dict[str, Any]:
    """Return entry ``number`` of a list of objects of the document."""
    if number >= len(entries) or not isinstance(entries[number], dict):
        raise MalformedError(f"refers to {what} {number}, which it does not have")
    entry: dict[str, Any] = entries[number]
    return entry
