"""Decompress a map from standard input to standard output; run as a script, never imported.

The map reader holds Python's lock while it waits for bytes, so decompression runs in a separate
process. The parent sees its progress by the position of the shared file. Decompression stops at an
output limit.
"""

from __future__ import annotations

import bz2
import gzip
import os
import sys
import zlib
from typing import IO, cast

#: Exit codes: output limit exceeded; file truncated or damaged.
TOO_MUCH, DAMAGED = 3, 4
#: Output below this never exceeds the limit, bytes.
_SMALL = 64 << 20
_CHUNK = 1 << 20


def main(packing: str, most: int, ratio: float) -> int:
    """Decompress until the end or a limit.

    Args:
        packing: ``gz``, ``bz2`` or empty.
        most: largest output, bytes.
        ratio: largest ratio of output to input bytes.
    """
    source: IO[bytes] = os.fdopen(0, "rb", buffering=1 << 16)
    stream = source
    if packing == "gz":
        stream = cast(IO[bytes], gzip.GzipFile(fileobj=source))
    elif packing == "bz2":
        stream = cast(IO[bytes], bz2.BZ2File(source))
    out = 0
    try:
        while chunk := stream.read(_CHUNK):
            out += len(chunk)
            if out > most or out > max(_SMALL, ratio * os.lseek(0, 0, os.SEEK_CUR)):
                return TOO_MUCH
            _write(chunk)
    except BrokenPipeError:
        return 0
    except (OSError, EOFError, zlib.error):
        return DAMAGED
    return 0


def _write(chunk: bytes) -> None:
    rest = memoryview(chunk)
    while rest:
        rest = rest[os.write(1, rest) :]


if __name__ == "__main__":
    # Not sys.exit, which would flush and close the streams.
    os._exit(main(sys.argv[1], int(sys.argv[2]), float(sys.argv[3])))
