"""Validity of what a file holds: limits, finite vertices, vertex numbers in range."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError

__all__ = [
    "FARTHEST",
    "MOST_POINTS",
    "MOST_TRIANGLES",
    "check_coordinates",
    "content_of",
    "count_within",
    "valid_faces",
]

#: More of them do not fit into memory beside the rest (2 GB).
MOST_TRIANGLES = 12_000_000
MOST_POINTS = 40_000_000
#: Larger coordinates are none, in any unit that anybody draws in.
FARTHEST = 1e12


def content_of(path: Path) -> dict[str, str]:
    """Return the name of a file and its SHA-256."""
    with path.open("rb") as stream:
        return {path.name: hashlib.file_digest(stream, "sha256").hexdigest()}


def count_within(count: int, most: int, what: str, path: Path) -> None:
    """Refuse a count that no machine can hold, before anything is reserved for it.

    Raises:
        InputError: there are more than ``most``, or fewer than none.
    """
    if not 0 <= count <= most:
        raise InputError(
            f"holds {count:,} {what}",
            file=path,
            expected=f"at most {most:,}; crop or thin it first",
        )


def check_coordinates(points: NDArray[np.float64], path: Path, what: str = "vertex") -> None:
    """Refuse coordinates that are not finite, or implausibly large in any unit.

    Raises:
        InputError: one is nan, infinite or beyond ``FARTHEST``.
    """
    bad = ~(np.abs(points) <= FARTHEST).all(axis=1)
    if bad.any():
        raise InputError(
            f"has {what} {int(np.argmax(bad)) + 1} of {len(points)} that is not a place "
            f"(nan, infinite or beyond {FARTHEST:g}; {int(bad.sum())} in all)",
            file=path,
            expected="finite coordinates",
        )


def valid_faces(
    faces: NDArray[np.int64] | NDArray[np.int32], vertices: int, path: Path
) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Return faces as int32 without those that use a vertex twice, and which (F,) were kept.

    Raises:
        InputError: a face names a vertex that is not there.
    """
    wrong = ((faces < 0) | (faces >= vertices)).any(axis=1)
    if wrong.any():
        first = int(np.argmax(wrong))
        raise InputError(
            f"has face {first + 1} with vertex {int(faces[first].max()) + 1} of {vertices}",
            file=path,
            expected="faces between the vertices that it holds",
        )
    a, b, c = faces.T
    kept = (a != b) & (b != c) & (c != a)
    return faces[kept].astype(np.int32), kept
