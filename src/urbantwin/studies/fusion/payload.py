"""Payloads: arrays in Zstandard (RFC 8878), read back without trusting them."""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

import numpy as np
import zstandard
from numpy.typing import NDArray

from urbantwin.errors import InputError

__all__ = ["bad_payload", "byte_planes", "compressed", "decompressed", "of_byte_planes", "unpacked"]

_LEVEL = 19
#: Nothing that a packet of 65 kB may hold is larger than this, bytes.
_MOST = 1 << 24


def compressed(data: bytes) -> bytes:
    """Return data as a Zstandard frame without magic number, size and checksum.

    A message's header says and checks what these would.
    """
    return _packer().compress(data)


def decompressed(data: bytes, size: int) -> bytes:
    """Return what `compressed` was given.

    Args:
        data: the frame.
        size: bytes that it must have.

    Raises:
        InputError: it is no such frame, or of another size.
    """
    if not 0 <= size <= _MOST:
        raise bad_payload(f"says that it has {size} bytes")
    if not size and not data:
        return b""
    try:
        found = _unpacker().decompress(data, max_output_size=max(size, 1))
    except zstandard.ZstdError as error:
        raise bad_payload(f"cannot be decompressed ({str(error)[:80]})") from None
    if len(found) != size:
        raise bad_payload(f"has {len(found)} bytes where {size} are said")
    return found


@cache
def _packer() -> zstandard.ZstdCompressor:
    how = zstandard.ZstdCompressionParameters.from_level(
        _LEVEL, write_content_size=False, format=zstandard.FORMAT_ZSTD1_MAGICLESS
    )
    return zstandard.ZstdCompressor(compression_params=how)


@cache
def _unpacker() -> zstandard.ZstdDecompressor:
    return zstandard.ZstdDecompressor(format=zstandard.FORMAT_ZSTD1_MAGICLESS)


def byte_planes(values: NDArray[np.unsignedinteger], size: int) -> bytes:
    """Return whole numbers (N,) by the significance of their bytes: all lowest bytes first."""
    table = values.astype("<u8").view(np.uint8).reshape(-1, 8)[:, :size]
    return np.ascontiguousarray(table.T).tobytes()


def of_byte_planes(data: bytes, size: int) -> NDArray[np.uint64]:
    """Return the numbers (N,) that `byte_planes` was given."""
    table = np.frombuffer(data, np.uint8).reshape(size, -1)
    whole = np.zeros((table.shape[1], 8), np.uint8)
    whole[:, :size] = table.T
    return whole.reshape(-1).view("<u8").astype(np.uint64)


def unpacked(form: struct.Struct, data: bytes) -> tuple[tuple[Any, ...], bytes]:
    """Return the numbers at the start of a payload, and the rest of it.

    Raises:
        InputError: it is too short.
    """
    if len(data) < form.size:
        raise bad_payload(f"has {len(data)} bytes, fewer than {form.size}")
    return form.unpack_from(data), data[form.size :]


def bad_payload(problem: str) -> InputError:
    """Return the error of a payload that is not what its codec writes."""
    return InputError(problem, place="payload of a message", expected="what its codec writes")
