"""Which ray tracer casts the frames, by its name."""

from __future__ import annotations

from urbantwin.errors import InputError
from urbantwin.lidar.casting.tracer import RayTracer

__all__ = ["tracer_on"]


def tracer_on(backend: str) -> RayTracer:
    """Return a ray tracer.

    Args:
        backend: ``embree``, ``warp`` (the first CUDA device, else the processor), or Warp with a
            device: ``warp:cpu``, ``warp:cuda:1``.

    Raises:
        InputError: no such backend, Warp is not installed, or this machine has no such device.
    """
    name, _, device = backend.partition(":")
    if backend == "embree":
        from urbantwin.lidar.casting.embree import EmbreeTracer

        return EmbreeTracer()
    if name == "warp" and (device or backend == "warp"):
        from urbantwin.lidar.casting.warp import WarpTracer

        return WarpTracer(device or None)
    raise InputError(f"there is no backend {backend!r}", expected="embree, warp or warp:DEVICE")
