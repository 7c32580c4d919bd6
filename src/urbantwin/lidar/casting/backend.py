"""Ray tracers by name."""

from __future__ import annotations

from urbantwin.errors import InputError
from urbantwin.geometry.rays import LIBRARIES, library_named
from urbantwin.lidar.casting.tracer import RayTracer

__all__ = ["tracer_on"]


def tracer_on(backend: str | None = None) -> RayTracer:
    """Return a ray tracer.

    Args:
        backend: ``embree``; ``bvh``, built in; ``warp`` (the first CUDA device, else the
            processor), or Warp with a device: ``warp:cpu``, ``warp:cuda:1``. By default Embree, or
            ``bvh`` if
                Embree is
            missing.

    Raises:
        InputError: no such backend, its package is missing, or this machine has no such device.
    """
    name, _, device = (backend or "").partition(":")
    if backend is None or backend in LIBRARIES:
        from urbantwin.lidar.casting.processor import ProcessorTracer

        return ProcessorTracer(library_named(backend))
    if name == "warp" and (device or backend == "warp"):
        from urbantwin.lidar.casting.warp import WarpTracer

        return WarpTracer(device or None)
    raise InputError(
        f"there is no backend {backend!r}", expected="embree, bvh, warp or warp:DEVICE"
    )
