"""Which ray tracer casts the frames, by its name."""

from __future__ import annotations

from urbantwin.errors import InputError
from urbantwin.geometry.rays import LIBRARIES, default_library
from urbantwin.lidar.casting.tracer import RayTracer

__all__ = ["backend_name", "tracer_on"]


def backend_name(backend: str | None = None) -> str:
    """Return the name of a backend; if none is given, ``embree`` where installed, else ``bvh``."""
    return default_library() if backend is None else backend


def tracer_on(backend: str | None = None) -> RayTracer:
    """Return a ray tracer.

    Args:
        backend: ``embree``; ``bvh``, the built-in one; ``warp`` (the first CUDA device, else the
            processor), or Warp with a device: ``warp:cpu``, ``warp:cuda:1``. See `backend_name`
            if not given.

    Raises:
        InputError: no such backend, its package is not installed, or this machine has no such
            device.
    """
    backend = backend_name(backend)
    name, _, device = backend.partition(":")
    if backend in LIBRARIES:
        from urbantwin.lidar.casting.processor import ProcessorTracer

        return ProcessorTracer(backend)
    if name == "warp" and (device or backend == "warp"):
        from urbantwin.lidar.casting.warp import WarpTracer

        return WarpTracer(device or None)
    raise InputError(
        f"there is no backend {backend!r}", expected="embree, bvh, warp or warp:DEVICE"
    )
