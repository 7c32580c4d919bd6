"""Embree 4 through its C interface: the one place that knows of it.

The library is the one that the ``embreex`` wheel carries. ``embreex`` itself takes arrays of rays
only; a frame's rays at its actors depend on each other (what a beam's edge meets, what stands
behind glass), and are cast, one or eight at a time, from code that numba compiles. numba is loaded,
and compiles, when the first ray is cast.

Numbers of the C interface are those of ``embree4/rtcore_{scene,geometry,buffer,common}.h``.
"""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import StageError, limit_reached

__all__ = ["EmbreeScene", "Hits", "intersect_address", "packet_address"]

_TRIANGLES, _INDEX, _VERTEX = 0, 0, 1
_UINT3, _FLOAT3 = 0x5003, 0x9003
#: RTC_ERROR_OUT_OF_MEMORY
_OUT_OF_MEMORY = 4
_ROBUST, _QUALITY_MEDIUM, _QUALITY_HIGH = 1 << 2, 1, 2
_POINTER = ctypes.c_size_t
#: Functions of the library that we call: what they return and take.
_FUNCTIONS: dict[str, tuple[Any, list[Any]]] = {
    "rtcNewDevice": (_POINTER, [ctypes.c_char_p]),
    "rtcNewScene": (_POINTER, [_POINTER]),
    "rtcSetSceneFlags": (None, [_POINTER, ctypes.c_int]),
    "rtcSetSceneBuildQuality": (None, [_POINTER, ctypes.c_int]),
    "rtcNewGeometry": (_POINTER, [_POINTER, ctypes.c_int]),
    "rtcSetNewGeometryBuffer": (
        _POINTER,
        [_POINTER, ctypes.c_int, ctypes.c_uint, ctypes.c_int, ctypes.c_size_t, ctypes.c_size_t],
    ),
    "rtcCommitGeometry": (None, [_POINTER]),
    "rtcAttachGeometry": (ctypes.c_uint, [_POINTER, _POINTER]),
    "rtcReleaseGeometry": (None, [_POINTER]),
    "rtcCommitScene": (None, [_POINTER]),
    "rtcReleaseScene": (None, [_POINTER]),
    "rtcGetDeviceError": (ctypes.c_int, [_POINTER]),
    "rtcIntersect1": (None, [_POINTER, _POINTER, _POINTER]),
    "rtcIntersect8": (None, [_POINTER, _POINTER, _POINTER, _POINTER]),
}


@cache
def _library() -> Any:  # noqa: ANN401 - ctypes has no type for it
    """Return the library that lies beside the ``embreex`` package."""
    spec = find_spec("embreex")
    if spec is None or spec.origin is None:
        raise StageError("the embreex package is not installed; install it from PyPI")
    package = Path(spec.origin).parent
    folders = (package.with_name("embreex.libs"), package / ".dylibs", package)
    found = [path for folder in folders for path in sorted(folder.glob("*embree4*"))]
    for path in found:
        try:
            library = ctypes.CDLL(str(path))
        except OSError:
            continue
        for name, (result, arguments) in _FUNCTIONS.items():
            function = getattr(library, name)
            function.restype, function.argtypes = result, arguments
        return library
    raise StageError("the embreex package carries no Embree 4 library; install it from PyPI")


@cache
def _device() -> int:
    device = int(_library().rtcNewDevice(b"verbose=0"))
    if not device:
        raise StageError("Embree does not start on this processor")
    return device


@cache
def intersect_address() -> int:
    """Return where ``rtcIntersect1`` is, for `geometry.compiled.intersect`."""
    return int(ctypes.cast(_library().rtcIntersect1, ctypes.c_void_p).value or 0)


@cache
def packet_address() -> int:
    """Return where ``rtcIntersect8`` is, for `geometry.compiled.packet`."""
    return int(ctypes.cast(_library().rtcIntersect8, ctypes.c_void_p).value or 0)


class Hits(NamedTuple):
    """What N rays hit first.

    Attributes:
        range_m: (N,) float32, distance to the first hit; ``inf`` where a ray hits nothing.
        face: (N,) int32, the face that was hit; -1 where a ray hits nothing.
    """

    range_m: NDArray[np.float32]
    face: NDArray[np.int32]


class EmbreeScene:
    """Triangles in Embree's robust mode, in which no ray slips through the edge of two.

    Embree finds triangles in single precision: keep vertices and origins within a few hundred
    metres of zero. Both sides of a triangle are hit. Threads may cast at the same time.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3) indices of vertices.
        many_rays: take longer over the tree, which pays off for millions of rays.

    Attributes:
        vertices: (V, 3) float64, as given.
        faces: (F, 3) int32, as given.
    """

    def __init__(
        self, vertices: NDArray[Any], faces: NDArray[Any], *, many_rays: bool = False
    ) -> None:
        self.vertices = np.ascontiguousarray(vertices, np.float64)
        self.faces = np.ascontiguousarray(faces, np.int32)
        self._many_rays = many_rays
        self._scene: int | None = None
        self._lock = Lock()

    @property
    def scene(self) -> int:
        """The scene for `geometry.compiled.intersect`; 0 where there are no triangles.

        Its tree is built when it is first asked for.

        Raises:
            LimitError: there is no memory for it.
        """
        if self._scene is None:
            with self._lock:
                if self._scene is None:
                    self._scene = self._built() if len(self.faces) else 0
        return self._scene

    def _built(self) -> int:
        library, device = _library(), _device()
        scene = int(library.rtcNewScene(device))
        library.rtcSetSceneFlags(scene, _ROBUST)
        quality = _QUALITY_HIGH if self._many_rays else _QUALITY_MEDIUM
        library.rtcSetSceneBuildQuality(scene, quality)
        geometry = library.rtcNewGeometry(device, _TRIANGLES)
        for kind, form, values in (
            (_VERTEX, _FLOAT3, np.ascontiguousarray(self.vertices, np.float32)),
            (_INDEX, _UINT3, np.ascontiguousarray(self.faces, np.uint32)),
        ):
            # Embree's own buffer, which it pads as its vector instructions need.
            target = library.rtcSetNewGeometryBuffer(geometry, kind, 0, form, 12, len(values))
            if not target:
                raise limit_reached(MemoryError()) or StageError("Embree has no memory")
            ctypes.memmove(target, values.ctypes.data, values.nbytes)
        library.rtcCommitGeometry(geometry)
        library.rtcAttachGeometry(scene, geometry)
        library.rtcReleaseGeometry(geometry)
        library.rtcCommitScene(scene)
        if problem := library.rtcGetDeviceError(device):
            told = StageError(f"Embree cannot build its tree of the triangles (error {problem})")
            limit = limit_reached(MemoryError()) if problem == _OUT_OF_MEMORY else None
            raise limit or told
        weakref.finalize(self, library.rtcReleaseScene, scene).atexit = False
        return scene

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
        """Return the first hit of each ray as Embree finds it, in single precision.

        Args:
            origins: (N, 3) where the rays leave, metres.
            directions: (N, 3) unit vectors.
            beside: each ray runs beside the one before it, as those of a picture do: they are cast
                in packets, in half the time.
        """
        starts = np.ascontiguousarray(origins, np.float32)
        if beside:
            from urbantwin.geometry.compiled.packet import cast_beside

            return self._cast(cast_beside, starts, directions, address=packet_address)
        from urbantwin.geometry.compiled.intersect import cast_rays

        return self._cast(cast_rays, starts, directions)

    def _cast(
        self,
        cast_rays: Any,  # noqa: ANN401 - numba compiles it
        origins: NDArray[Any],
        directions: NDArray[Any],
        *triangles: NDArray[Any],
        address: Callable[[], int] = intersect_address,
    ) -> Hits:
        count = len(directions)
        hits = Hits(np.full(count, np.inf, np.float32), np.full(count, -1, np.int32))
        if self.scene and count:
            aims = np.ascontiguousarray(directions, np.float32)
            cast_rays(address(), self.scene, *triangles, origins, aims, hits)
        return hits
