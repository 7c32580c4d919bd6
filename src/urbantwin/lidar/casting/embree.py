"""Embree 4 through its C interface, so that compiled code can cast ray after ray.

The library is the one that the ``embreex`` wheel carries. ``embreex`` itself takes arrays of rays
only; a frame's rays at its actors depend on each other (what a beam's edge meets, what stands
behind glass), and are cast one by one from code that numba compiles.

Numbers of the C interface are those of ``embree4/rtcore_{scene,geometry,buffer,common}.h``.
"""

from __future__ import annotations

import ctypes
import weakref
from functools import cache
from pathlib import Path
from typing import Any

import embreex
import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import StageError
from urbantwin.lidar.casting.hits import Hits
from urbantwin.lidar.compiled.planes import cast_rays

__all__ = ["EmbreeCaster", "intersect_address"]

_TRIANGLES, _INDEX, _VERTEX = 0, 0, 1
_UINT3, _FLOAT3 = 0x5003, 0x9003
_ROBUST, _QUALITY_HIGH = 1 << 2, 2
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
}


@cache
def _library() -> Any:  # noqa: ANN401 - ctypes has no type for it
    """Return the library that lies beside the ``embreex`` package."""
    package = Path(next(iter(embreex.__path__)))
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
    """Return where ``rtcIntersect1`` is, for ``compiled.intersect``."""
    return int(ctypes.cast(_library().rtcIntersect1, ctypes.c_void_p).value or 0)


class EmbreeCaster:
    """Embree 4 in robust mode, in which no ray slips through the edge of two triangles.

    Embree finds triangles in single precision: keep vertices and origins within a few hundred
    metres of zero. Each is then confirmed, and its range found, in double precision. Both sides of
    a triangle are hit.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3) indices of vertices.

    Attributes:
        vertices: (V, 3) float64, as given.
        faces: (F, 3) int32, as given.
        scene: the scene for ``compiled.intersect``; 0 where there are no triangles.
    """

    def __init__(self, vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> None:
        self.scene = 0
        self.vertices = np.ascontiguousarray(vertices, np.float64)
        self.faces = np.ascontiguousarray(faces, np.int32)
        if not len(faces):
            return
        library, device = _library(), _device()
        self.scene = int(library.rtcNewScene(device))
        library.rtcSetSceneFlags(self.scene, _ROBUST)
        library.rtcSetSceneBuildQuality(self.scene, _QUALITY_HIGH)
        geometry = library.rtcNewGeometry(device, _TRIANGLES)
        for kind, form, values in (
            (_VERTEX, _FLOAT3, np.ascontiguousarray(vertices, np.float32)),
            (_INDEX, _UINT3, np.ascontiguousarray(faces, np.uint32)),
        ):
            # Embree's own buffer, which it pads as its vector instructions need.
            target = library.rtcSetNewGeometryBuffer(geometry, kind, 0, form, 12, len(values))
            if not target:
                raise StageError("Embree has no memory for the triangles")
            ctypes.memmove(target, values.ctypes.data, values.nbytes)
        library.rtcCommitGeometry(geometry)
        library.rtcAttachGeometry(self.scene, geometry)
        library.rtcReleaseGeometry(geometry)
        library.rtcCommitScene(self.scene)
        if library.rtcGetDeviceError(device):
            raise StageError("Embree cannot build its tree of the triangles")
        weakref.finalize(self, library.rtcReleaseScene, self.scene).atexit = False

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float32]) -> Hits:
        """Return the first hit of each ray; see `hits.RayCaster`."""
        count = len(directions)
        range_m, face = np.full(count, np.inf, np.float32), np.full(count, -1, np.int32)
        if self.scene and count:
            starts = np.broadcast_to(np.asarray(origins, np.float64), (count, 3))
            aims = np.ascontiguousarray(directions, np.float32)
            cast_rays(
                intersect_address(),
                self.scene,
                self.vertices,
                self.faces,
                starts,
                aims,
                range_m,
                face,
            )
        return Hits(range_m, face)
