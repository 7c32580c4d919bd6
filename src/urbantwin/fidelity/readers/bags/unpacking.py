"""What ROS 2 packed with zstd: every message for itself, or files as a whole."""

from __future__ import annotations

import shutil
from pathlib import Path
from tempfile import mkdtemp

from urbantwin.artefact.arrays import may_unpack
from urbantwin.errors import InputError

__all__ = ["PACKED", "ZSTD", "unpacked_bytes", "unpacked_file"]

#: What a packed file's name ends in, and what packed bytes begin with.
PACKED = ".zstd"
ZSTD = b"\x28\xb5\x2f\xfd"
_PIECE = 1 << 20


def unpacked_bytes(data: bytes) -> bytes:
    """Return what was packed.

    Raises:
        ValueError: it does not say how large it is, or says more than it can be.
        Exception: of the library, where it is damaged.
    """
    import zstandard

    size = zstandard.frame_content_size(data)
    if size < 0 or not may_unpack(size, len(data)):
        raise ValueError("does not say how large it is, or far too large")
    unpacked: bytes = zstandard.ZstdDecompressor().decompress(data)
    return unpacked


def unpacked_file(file: Path) -> Path | None:
    """Unpack a file into a folder of its own; None where it is not packed.

    Raises:
        InputError: it is damaged, or unpacks to far more than its size.
    """
    if file.suffix.lower() != PACKED:
        return None
    import zstandard

    size, written = file.stat().st_size, 0
    folder = Path(mkdtemp(prefix="urbantwin-"))
    at = folder / file.stem
    try:
        with file.open("rb") as packed, at.open("wb") as stream:
            for piece in zstandard.ZstdDecompressor().read_to_iter(packed, write_size=_PIECE):
                written += len(piece)
                if not may_unpack(written, size):
                    raise InputError("unpacks to far more than its size", file=file)
                stream.write(piece)
    except BaseException as error:
        shutil.rmtree(folder, ignore_errors=True)
        if isinstance(error, zstandard.ZstdError):
            problem = f"is damaged ({error})"
            raise InputError(problem, file=file, expected="a file of zstd") from None
        raise
    return at
