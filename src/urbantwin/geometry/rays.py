"""Rays cast on triangles on the CPU, by Embree or by the built-in tracer.

- ``embree``: Embree 4, from the ``embreex`` wheel, which exists only for x86-64
  (`geometry.embree`);
- ``bvh``: the built-in tracer, compiled by numba for any processor (`compiled.bvh`).

Both are two C functions with the same arguments, for one ray and for eight. Compiled code that
casts rays calls them by their address, so there is no other difference between the two. Embree is
used if it is installed. numba is loaded, and compiles, when the first ray is cast.
"""

from __future__ import annotations

import platform
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import embree

__all__ = [
    "LIBRARIES",
    "Hits",
    "RayScene",
    "cast_addresses",
    "library_named",
    "missing_embree",
]

#: Names of the two.
LIBRARIES = ("embree", "bvh")
#: Cost of the built-in tracer: processor time by docs/method/lidar.md.
_COST = "rays take twice as long, recording with a fixed sensor 1.2 times as long"


def library_named(name: str | None = None) -> str:
    """Return the name of the ray casting library; by default ``embree`` or, without it, ``bvh``.

    Raises:
        InputError: Embree is requested and missing.
    """
    why = embree.why_missing() if name in {None, "embree"} else ""
    if name and why:
        raise InputError(
            f"no backend embree: {why}", expected="pip install embreex (x86-64), or the backend bvh"
        )
    return name or ("bvh" if why else "embree")


def missing_embree() -> str:
    """Return a line that names the replacement of Embree; empty if Embree is available."""
    why = embree.why_missing()
    if not why:
        return ""
    return (
        f"no Embree on this {platform.system()} {platform.machine()} ({why}): the built-in ray "
        f"tracer bvh takes over: the same points; {_COST}"
    )


def cast_addresses(library: str) -> tuple[int, int]:
    """Return the addresses of the functions for one ray and for eight.

    `compiled.intersect` and `compiled.packet` call them.
    """
    if library == "embree":
        return embree.intersect_address(), embree.packet_address()
    from urbantwin.geometry.compiled.bvh import intersect1, intersect8

    return int(intersect1.address or 0), int(intersect8.address or 0)


class _Tree(NamedTuple):
    """Triangles in the form used by a library.

    Attributes:
        address: argument of the library's functions.
        owner: object that frees the memory when it is deleted.
    """

    address: int
    owner: object


def _built(
    library: str, vertices: NDArray[np.float32], faces: NDArray[np.int32], *, many_rays: bool
) -> _Tree:
    """Return the tree of F > 0 triangles; see `RayScene` for the arguments."""
    if library == "embree":
        scene = embree.Scene(vertices, faces, many_rays=many_rays)
        return _Tree(scene.address, scene)
    from urbantwin.geometry.compiled.bvh import build_tree

    words = build_tree(vertices, faces)
    return _Tree(words.ctypes.data, words)


class Hits(NamedTuple):
    """First hits of N rays.

    Attributes:
        range_m: (N,) float32, distance to the first hit; ``inf`` without a hit.
        face: (N,) int32, the face that was hit; -1 without a hit.
    """

    range_m: NDArray[np.float32]
    face: NDArray[np.int32]


class RayScene:
    """Triangles for ray casting; no ray passes between two adjacent triangles.

    Hits are found in single precision: vertices and origins should be within a few hundred metres
    of zero. Both sides of a triangle are hit. Several threads may cast at the same time.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3) indices of vertices.
        many_rays: spend more time on the tree, which is worthwhile for millions of rays.
        library: ``embree`` or ``bvh``; default: see `library_named`.

    Attributes:
        vertices: (V, 3) float64, as given.
        faces: (F, 3) int32, as given.
    """

    def __init__(
        self,
        vertices: NDArray[Any],
        faces: NDArray[Any],
        *,
        many_rays: bool = False,
        library: str | None = None,
    ) -> None:
        self.vertices = np.ascontiguousarray(vertices, np.float64)
        self.faces = np.ascontiguousarray(faces, np.int32)
        self._many_rays = many_rays
        self._library = library
        self._trees: dict[str, _Tree] = {}
        self._lock = Lock()

    def tree(self, library: str | None = None) -> int:
        """Return the address of the triangles' tree; 0 without triangles.

        A tree is built when it is first needed.

        Args:
            library: the library; default: the scene's own.

        Raises:
            InputError: Embree is requested and not installed.
            StageError: there is not enough memory.
        """
        if not len(self.faces):
            return 0
        name = library_named(library or self._library)
        if name not in self._trees:
            with self._lock:
                if name not in self._trees:
                    vertices = np.ascontiguousarray(self.vertices, np.float32)
                    self._trees[name] = _built(
                        name, vertices, self.faces, many_rays=self._many_rays
                    )
        return self._trees[name].address

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float32]) -> Hits:
        """Return the first hit of each ray, confirmed and with its range in double precision.

        Args:
            origins: (3,) origin of all rays, or (N, 3) origin of each, metres.
            directions: (N, 3) unit vectors.
        """
        from urbantwin.geometry.compiled.planes import cast_rays

        starts = np.broadcast_to(np.asarray(origins, np.float64), (len(directions), 3))
        return self._cast(cast_rays, starts, directions, self.vertices, self.faces)

    def cast_single(
        self, origins: NDArray[Any], directions: NDArray[Any], *, beside: bool = False
    ) -> Hits:
        """Return the first hit of each ray as the tracer finds it, in single precision.

        Args:
            origins: (N, 3) origins of the rays, metres.
            directions: (N, 3) unit vectors.
            beside: consecutive rays are close to each other, as in a picture: they are cast in
                packets, in half the time.
        """
        starts = np.ascontiguousarray(origins, np.float32)
        if beside:
            from urbantwin.geometry.compiled.packet import cast_beside

            return self._cast(cast_beside, starts, directions, packets=True)
        from urbantwin.geometry.compiled.intersect import cast_rays

        return self._cast(cast_rays, starts, directions)

    def _cast(
        self,
        cast_rays: Any,  # noqa: ANN401 - numba compiles it
        origins: NDArray[Any],
        directions: NDArray[Any],
        *triangles: NDArray[Any],
        packets: bool = False,
    ) -> Hits:
        count = len(directions)
        hits = Hits(np.full(count, np.inf, np.float32), np.full(count, -1, np.int32))
        tree = self.tree()
        if tree and count:
            one_ray, eight_rays = cast_addresses(library_named(self._library))
            address = eight_rays if packets else one_ray
            aims = np.ascontiguousarray(directions, np.float32)
            cast_rays(address, tree, *triangles, origins, aims, hits)
        return hits
