"""Subtrees of implicit tilings: which of their tiles there are."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from urbantwin.reconstruct.gltf.untrusted_values import (
    MalformedError,
    items,
    parse_json,
    table,
    text,
    whole,
)

__all__ = ["Availability", "Subtree", "morton", "read_subtree"]


@dataclass(frozen=True)
class Availability:
    """One bit per tile, in the order of levels and along the Morton curve.

    Attributes:
        constant: the same for all, or ``None``.
        bits: packed, the least significant first.
    """

    constant: bool | None
    bits: bytes

    def __getitem__(self, index: int) -> bool:
        """Return whether tile ``index`` is available."""
        if self.constant is not None:
            return self.constant
        return bool(self.bits[index >> 3] >> (index & 7) & 1)


@dataclass(frozen=True)
class Subtree:
    """Which tiles of a subtree, which contents and which subtrees below it are available."""

    tiles: Availability
    contents: tuple[Availability, ...]
    children: Availability


def morton(place: tuple[int, ...]) -> int:
    """Return the Morton index of x, y (and z): bits interleaved, those of x least significant."""
    result, width = 0, len(place)
    for axis, value in enumerate(place):
        bit = 0
        while value >> bit:
            result |= (value >> bit & 1) << (bit * width + axis)
            bit += 1
    return result


def read_subtree(
    data: bytes, levels: int, branches: int, resolve: Callable[[str], bytes]
) -> Subtree:
    """Read a subtree, binary or JSON.

    Args:
        data: its bytes.
        levels: how many levels it has.
        branches: children of a tile: 4 or 8.
        resolve: gives the bytes of external buffers.

    Source: 3D Tiles 1.1, section "Subtrees"; ``3DTILES_implicit_tiling`` of 1.0, whose
    ``bufferView`` became ``bitstream``.

    Raises:
        MalformedError: it cannot be understood, or is too short for its levels.
    """
    binary = b""
    if data[:4] == b"subt":
        if len(data) < 24:
            raise MalformedError("ends within its header")
        version, json_length, binary_length = struct.unpack_from("<IQQ", data, 4)
        if version != 1:
            raise MalformedError(f"is a subtree of version {version}, and not 1")
        if 24 + json_length + binary_length > len(data):
            raise MalformedError("ends early")
        document = parse_json(data[24 : 24 + json_length].rstrip(b" \0"), "its JSON part")
        binary = data[24 + json_length : 24 + json_length + binary_length]
    else:
        document = parse_json(data, "it")
    tiles = (branches**levels - 1) // (branches - 1)
    views = _Views(document, binary, resolve)
    content = document.get("contentAvailability")
    if isinstance(content, dict):
        content = [content]
    several = table(table(document, "extensions"), "3DTILES_multiple_contents")
    contents = (content or []) + items(several, "contentAvailability")
    return Subtree(
        views.availability(document.get("tileAvailability"), tiles),
        tuple(views.availability(entry, tiles) for entry in contents),
        views.availability(document.get("childSubtreeAvailability"), branches**levels),
    )


class _Views:
    """Views of a subtree's buffers."""

    def __init__(
        self, document: dict[str, Any], binary: bytes, resolve: Callable[[str], bytes]
    ) -> None:
        self._document = document
        self._binary = binary
        self._resolve = resolve
        self._buffers: dict[int, bytes] = {}

    def availability(self, spec: object, count: int) -> Availability:
        """Return an availability of ``count`` bits."""
        if not isinstance(spec, dict):
            raise MalformedError("has an availability that is not an object")
        if spec.get("constant") is not None:
            return Availability(bool(spec["constant"]), b"")
        key = "bitstream" if "bitstream" in spec else "bufferView"
        bits = self._view(whole(spec, key))
        if len(bits) * 8 < count:
            raise MalformedError(f"has {len(bits) * 8} bits for {count} tiles")
        return Availability(None, bits)

    def _view(self, number: int) -> bytes:
        view = _entry(self._document, "bufferViews", number)
        which = whole(view, "buffer")
        if which not in self._buffers:
            uri = text(_entry(self._document, "buffers", which), "uri")
            self._buffers[which] = self._resolve(uri) if uri else self._binary
        start, length = whole(view, "byteOffset", 0), whole(view, "byteLength")
        data = self._buffers[which]
        if start + length > len(data):
            raise MalformedError("has a bufferView that runs beyond its buffer")
        return data[start : start + length]


def _entry(document: dict[str, Any], key: str, number: int) -> dict[str, Any]:
    entries = items(document, key)
    if number >= len(entries) or not isinstance(entries[number], dict):
        raise MalformedError(f"refers to {key} {number}, which it does not have")
    entry: dict[str, Any] = entries[number]
    return entry
