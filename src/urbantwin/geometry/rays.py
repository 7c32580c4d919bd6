"""Rays cast at triangles on the processor, by one of two libraries.

- ``embree``: Embree 4, of the ``embreex`` wheel, which exists for x86-64 alone (`geometry.embree`);
- ``bvh``: the built-in one, which numba compiles for any processor (`geometry.bvh`).

Both offer two C functions with the same arguments, for one ray and for eight. Whatever casts rays
calls them by their address, so nothing else differs between the two. Embree is used wherever it is
installed. numba is loaded, and compiles, when the first ray is cast.
"""

from __future__ import annotations

import platform
from functools import cache
from importlib import import_module
from threading import Lock
from typing import Any, NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry.embree import is_installed

__all__ = [
    "LIBRARIES",
    "Hits",
    "RayLibrary",
    "RayScene",
    "default_library",
    "library_named",
    "missing_embree",
]

#: Names of the libraries.
LIBRARIES = ("embree", "bvh")
#: How much longer the built-in library takes to record a dataset, see docs/ray_tracers.md.
_TIMES_SLOWER = 2


class Tree(Protocol):
    """Triangles as a library casts rays at them; they are freed with it.

    Attributes:
        address: what the library's functions take for it.
    """

    address: int


class RayLibrary(Protocol):
    """What `geometry.embree` and `geometry.bvh` have."""

    def intersect_address(self) -> int:
        """Return the address of the function for one ray, see `compiled.intersect`."""
        ...

    def packet_address(self) -> int:
        """Return the address of the function for eight rays, see `compiled.packet`."""
        ...

    def build(
        self, vertices: NDArray[np.float32], faces: NDArray[np.int32], *, many_rays: bool
    ) -> Tree:
        """Return a tree of triangles.

        Args:
            vertices: (V, 3) metres.
            faces: (F, 3) indices of vertices, at least one face.
            many_rays: take longer over the tree, which pays off for millions of rays.
        """
        ...


@cache
def default_library() -> str:
    """Return the name of the library that casts rays here: Embree's where it is installed."""
    return "embree" if is_installed() else "bvh"


def missing_embree() -> str:
    """Return a line for a person where Embree is not installed, an empty text where it is."""
    if is_installed():
        return ""
    return (
        f"Embree is not installed (embreex has no wheel for every system; this is "
        f"{platform.system()} {platform.machine()}): the built-in ray tracer casts the rays, "
        f"to the same points, in about {_TIMES_SLOWER} times as long"
    )


@cache
def library_named(name: str) -> RayLibrary:
    """Return a library.

    Raises:
        InputError: Embree is asked for and not installed.
    """
    if name == "embree" and not is_installed():
        raise InputError(
            "the backend embree needs the package embreex, which is not installed",
            expected="pip install embreex (x86-64 only), or the backend bvh",
        )
    return cast(RayLibrary, import_module(f"urbantwin.geometry.{name}"))


class Hits(NamedTuple):
    """What N rays hit first.

    Attributes:
        range_m: (N,) float32, distance to the first hit; ``inf`` where a ray hits nothing.
        face: (N,) int32, the face that was hit; -1 where a ray hits nothing.
    """

    range_m: NDArray[np.float32]
    face: NDArray[np.int32]


class RayScene:
    """Triangles to cast rays at; no ray slips through the edge of two.

    Triangles are found in single precision: keep vertices and origins within a few hundred
    metres of zero. Both sides of a triangle are hit. Threads may cast at the same time.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3) indices of vertices.
        many_rays: take longer over the tree, which pays off for millions of rays.
        library: which library casts; `default_library` if not given.

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
        self._many_rays, self._library = many_rays, library
        self._trees: dict[str, Tree] = {}
        self._lock = Lock()

    def tree(self, library: str | None = None) -> int:
        """Return the address of the triangles' tree; 0 where there are no triangles.

        A tree is built when it is first asked for.

        Args:
            library: which library is to cast at it; `default_library` if not given.

        Raises:
            StageError: there is no memory for it.
        """
        if not len(self.faces):
            return 0
        name = library or default_library()
        if name not in self._trees:
            with self._lock:
                if name not in self._trees:
                    self._trees[name] = library_named(name).build(
                        np.asarray(self.vertices, np.float32), self.faces, many_rays=self._many_rays
                    )
        return self._trees[name].address

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float32]) -> Hits:
        """Return the first hit of each ray, confirmed and its range found in double precision.

        Args:
            origins: (3,) where all rays leave, or (N, 3) where each does, metres.
            directions: (N, 3) unit vectors.
        """
        from urbantwin.geometry.compiled.planes import cast_rays

        starts = np.broadcast_to(np.asarray(origins, np.float64), (len(directions), 3))
        return self._cast(cast_rays, starts, directions, self.vertices, self.faces)

    def cast_single(
        self, origins: NDArray[Any], directions: NDArray[Any], *, beside: bool = False
    ) -> Hits:
        """Return the first hit of each ray as the library finds it, in single precision.

        Args:
            origins: (N, 3) where the rays leave, metres.
            directions: (N, 3) unit vectors.
            beside: each ray runs beside the one before it, as those of a picture do: they are cast
                in packets, in half the time.
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
        tree = self.tree(self._library)
        if tree and count:
            library = library_named(self._library or default_library())
            address = library.packet_address() if packets else library.intersect_address()
            aims = np.ascontiguousarray(directions, np.float32)
            cast_rays(address, tree, *triangles, origins, aims, hits)
        return hits
