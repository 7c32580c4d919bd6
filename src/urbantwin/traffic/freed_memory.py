"""Return of freed memory to the operating system.

glibc keeps freed memory between live arrays (malloc_trim(3)); after an hour of traffic that is
hundreds of megabytes.
"""

from __future__ import annotations

import ctypes
from contextlib import suppress

import pyarrow as pa

__all__ = ["hand_back_freed_memory"]


def hand_back_freed_memory() -> None:
    """Return unused memory to the operating system, if its C library supports that."""
    pa.default_memory_pool().release_unused()
    # Windows has no such library, other systems may lack the function.
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)
