"""Embree 4 through its C interface; no other module uses it directly.

The library is the one in the ``embreex`` wheel. ``embreex`` itself only casts arrays of rays. The
rays of a frame at its actors depend on each other (hits of a beam's edge, surfaces behind glass).
They are cast, one or eight at a time, from code compiled by numba.

Numbers of the C interface are from ``embree4/rtcore_{scene,geometry,buffer,common}.h``.
"""

from __future__ import annotations

import ctypes
import weakref
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import StageError, limit_reached

__all__ = ["Scene", "intersect_address", "packet_address", "why_missing"]

_TRIANGLES, _INDEX, _VERTEX = 0, 0, 1
_UINT3, _FLOAT3 = 0x5003, 0x9003
#: RTC_ERROR_OUT_OF_MEMORY
_OUT_OF_MEMORY = 4
_ROBUST, _QUALITY_MEDIUM, _QUALITY_HIGH = 1 << 2, 1, 2
_POINTER = ctypes.c_size_t
#: Functions of the library that are called: their result and argument types.
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
    """Return the library next to the ``embreex`` package."""
    try:
        spec = find_spec("embreex")
    except ImportError:
        spec = None
    if spec is None or spec.origin is None:
        raise StageError("the package embreex is not installed")
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
    raise StageError("the package embreex carries no Embree 4 library that this system can load")


@cache
def _device() -> int:
    device = int(_library().rtcNewDevice(b"verbose=0"))
    if not device:
        raise StageError("Embree does not start on this processor")
    return device


@cache
def why_missing() -> str:
    """Return the reason why Embree is not available; empty if it is."""
    try:
        _device()
    except StageError as error:
        return str(error)
    return ""


@cache
def intersect_address() -> int:
    """Return the address of ``rtcIntersect1``."""
    return int(ctypes.cast(_library().rtcIntersect1, ctypes.c_void_p).value or 0)


@cache
def packet_address() -> int:
    """Return the address of ``rtcIntersect8``."""
    return int(ctypes.cast(_library().rtcIntersect8, ctypes.c_void_p).value or 0)


class Scene:
    """Triangles as an Embree scene in its robust mode; it is released with this object.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3) indices of vertices.
        many_rays: spend more time on the tree, which is worthwhile for millions of rays.

    Attributes:
        address: address of the scene.
    """

    def __init__(
        self, vertices: NDArray[np.float32], faces: NDArray[np.int32], *, many_rays: bool
    ) -> None:
        library, device = _library(), _device()
        scene = int(library.rtcNewScene(device))
        library.rtcSetSceneFlags(scene, _ROBUST)
        quality = _QUALITY_HIGH if many_rays else _QUALITY_MEDIUM
        library.rtcSetSceneBuildQuality(scene, quality)
        geometry = library.rtcNewGeometry(device, _TRIANGLES)
        for kind, form, values in (
            (_VERTEX, _FLOAT3, np.ascontiguousarray(vertices)),
            (_INDEX, _UINT3, np.ascontiguousarray(faces)),
        ):
            # Embree's own buffer, which it pads for its vector instructions.
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
        self.address = scene
