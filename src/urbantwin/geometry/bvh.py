"""The built-in ray tracer, for processors without Embree. A `rays.RayLibrary`.

`geometry.compiled.bvh` has the tree and its traversal.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["build", "intersect_address", "packet_address"]


class _Tree(NamedTuple):
    """A tree, and the memory that holds it."""

    address: int
    words: NDArray[np.int32]


def intersect_address() -> int:
    """Return the address of the function that casts one ray."""
    from urbantwin.geometry.compiled.bvh import intersect1

    return int(intersect1.address)


def packet_address() -> int:
    """Return the address of the function that casts eight rays."""
    from urbantwin.geometry.compiled.bvh import intersect8

    return int(intersect8.address)


def build(vertices: NDArray[np.float32], faces: NDArray[np.int32], *, many_rays: bool) -> _Tree:
    """Return a tree of triangles, see `rays.RayLibrary`; one kind serves few rays and many."""
    from urbantwin.geometry.compiled.bvh import build_tree

    words = build_tree(np.ascontiguousarray(vertices), np.ascontiguousarray(faces))
    return _Tree(words.ctypes.data, words)
