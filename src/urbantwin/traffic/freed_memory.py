"""Freed memory, handed back to the system.

glibc keeps what is free between arrays that live (malloc_trim(3)): of an hour of traffic hundreds
of megabytes by the time that its rows are written.
"""

from __future__ import annotations

import ctypes
from contextlib import suppress

import pyarrow as pa

__all__ = ["hand_back_freed_memory"]


def hand_back_freed_memory() -> None:
    """Hand back what nobody uses, where the system's C library can."""
    pa.default_memory_pool().release_unused()
    # Windows has no library of that name, and others no such function.
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)
