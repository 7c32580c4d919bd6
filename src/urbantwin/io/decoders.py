"""Draco and meshopt: compressed arrays of glTF and 3D Tiles, decoded in a child process."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.extras import check_extra
from urbantwin.io.child import read_in_child
from urbantwin.io.values import MalformedError

__all__ = ["unpack_draco", "unpack_meshopt"]


def unpack_draco(data: bytes) -> tuple[dict[int, NDArray[Any]], NDArray[np.int64] | None]:
    """Return a Draco buffer's attributes (N, C) by their unique id, and its triangles (F, 3).

    Source: Draco Bitstream Specification 2.2; the library is Google's, by way of DracoPy.

    Raises:
        MalformedError: it is not Draco, is damaged, or unpacks to more than its size allows.
    """
    check_extra("gltf", "reading meshes packed by Draco")
    if data[:5] != b"DRACO":
        raise MalformedError("its Draco data has no Draco header")
    unpacked: tuple[dict[int, NDArray[Any]], NDArray[np.int64] | None] = _decoded(
        "_draco", data, size=len(data), expected="Draco"
    )
    return unpacked


def unpack_meshopt(data: bytes, count: int, stride: int, mode: str, filter_name: str) -> memoryview:
    """Return the rows of a buffer view compressed by meshoptimizer.

    Args:
        data: the compressed bytes.
        count: number of rows.
        stride: bytes per row.
        mode: ``ATTRIBUTES``, ``TRIANGLES`` or ``INDICES``.
        filter_name: ``NONE``, ``OCTAHEDRAL``, ``QUATERNION`` or ``EXPONENTIAL``.

    Source: the glTF extension ``EXT_meshopt_compression`` (Khronos, vendor extension).

    Raises:
        MalformedError: the data are damaged.
    """
    check_extra("gltf", "reading meshes packed by meshopt")
    rows = _decoded(
        "_meshopt", data, count, stride, mode, filter_name,
        size=count * stride, expected="a view packed by meshopt",
    )  # fmt: skip
    return memoryview(rows)


def _decoded(name: str, *arguments: Any, size: int, expected: str) -> Any:  # noqa: ANN401
    try:
        return read_in_child(
            f"{__name__}:{name}", *arguments, file="", size=size, expected=expected
        )
    except InputError as error:
        raise MalformedError(error.problem) from None


def _draco(data: bytes) -> tuple[dict[int, NDArray[Any]], NDArray[np.int64] | None]:
    import DracoPy

    decoded = DracoPy.decode(data)
    attributes = {
        int(attribute["unique_id"]): np.array(attribute["data"]) for attribute in decoded.attributes
    }
    faces = getattr(decoded, "faces", None)
    return attributes, None if faces is None else np.array(faces, np.int64).reshape(-1, 3)


def _meshopt(data: bytes, count: int, stride: int, mode: str, filter_name: str) -> bytes:
    from meshopt import decode_gltf_buffer

    return bytes(decode_gltf_buffer(data, count, stride, mode, filter_name))
