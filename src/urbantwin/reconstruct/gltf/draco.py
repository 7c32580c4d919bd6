"""Draco-compressed meshes and points."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.extras import check_extra
from urbantwin.reconstruct.gltf.accessors import LARGEST_COUNT
from urbantwin.reconstruct.gltf.untrusted_values import MalformedError

__all__ = ["unpack_draco"]


def unpack_draco(data: bytes) -> tuple[dict[int, NDArray[Any]], NDArray[np.int64] | None]:
    """Return a Draco buffer's attributes by their unique id, (N, C) each, and its triangles.

    Source: Draco Bitstream Specification 2.2; the library is Google's, by way of DracoPy.

    Raises:
        MalformedError: it is not Draco, it is broken, or it claims more than any tile holds.
    """
    check_extra("gltf", "reading meshes packed by Draco")
    import DracoPy

    for claimed in _claimed_counts(data):
        if claimed > LARGEST_COUNT:
            raise MalformedError(f"its Draco data claims {claimed} elements")
    try:
        decoded = DracoPy.decode(data)
    except Exception:
        raise MalformedError("its Draco data cannot be unpacked") from None
    attributes = {
        int(attribute["unique_id"]): np.asarray(attribute["data"])
        for attribute in decoded.attributes
    }
    faces = getattr(decoded, "faces", None)
    if faces is None:
        return attributes, None
    return attributes, np.asarray(faces, np.int64).reshape(-1, 3)


def _claimed_counts(data: bytes) -> list[int]:
    """Return the counts that a Draco header claims, so that a lie allocates nothing.

    Bitstream 2.2, sections "Header" and "Connectivity"; nothing for older streams and those with
    metadata, where the counts stand elsewhere.
    """
    if len(data) < 16 or data[:5] != b"DRACO":
        raise MalformedError("its Draco data has no Draco header")
    major, minor, kind, method, flags = struct.unpack_from("<4BH", data, 5)
    if (major, minor) < (2, 2) or flags & 0x8000:
        return []
    if kind == 0:
        return [struct.unpack_from("<I", data, 11)[0]]
    at, counts = 11 + (method == 1), []
    for _ in range(2):
        value = shift = 0
        while at < len(data) and shift < 64:
            byte = data[at]
            value, shift, at = value | (byte & 0x7F) << shift, shift + 7, at + 1
            if byte < 0x80:
                break
        counts.append(value)
    return counts
