"""The two outer forms of a glTF file: JSON alone, or a binary container (GLB) around it."""

from __future__ import annotations

import struct
from typing import Any

from urbantwin.reconstruct.gltf.untrusted_values import MalformedError, parse_json, table, text
from urbantwin.reconstruct.gltf.version1 import upgraded

__all__ = ["open_container"]

_JSON, _BIN = 0x4E4F534A, 0x004E4942


def open_container(data: bytes) -> tuple[dict[str, Any], bytes | None]:
    """Split a ``.gltf`` or ``.glb`` into its JSON, as of glTF 2.0, and its binary chunk.

    Source: glTF 2.0 (ISO/IEC 12113:2022), section 4 "GLB File Format"; glTF 1.0 with
    ``KHR_binary_glTF``, whose documents are rewritten as 2.0.

    Raises:
        MalformedError: it is neither, it ends early, or its lengths lie.
    """
    if data[:4] != b"glTF":
        return _checked(parse_json(data, "it"), None)
    if len(data) < 20:
        raise MalformedError("ends within its header")
    version, length = struct.unpack_from("<2I", data, 4)
    if length > len(data):
        raise MalformedError(f"ends after {len(data)} of {length} bytes")
    if version == 1:
        size, kind = struct.unpack_from("<2I", data, 12)
        if kind != 0:
            raise MalformedError(f"has content of kind {kind}, and not JSON")
        if 20 + size > length:
            raise MalformedError("has a JSON part that runs beyond its end")
        return _checked(parse_json(data[20 : 20 + size], "its JSON part"), data[20 + size : length])
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
    version = text(table(document, "asset"), "version", "1.0")
    if version.startswith("1"):
        if not isinstance(document.get("meshes"), dict):
            raise MalformedError("is not glTF: it has no asset.version")
        return upgraded(document), binary
    if not version.startswith("2"):
        raise MalformedError(f"is glTF of version {version[:20]}, and not 2")
    return document, binary
