"""Which ray tracer casts the frames, by its name."""

from __future__ import annotations

from urbantwin.errors import InputError
from urbantwin.lidar.casting.warp_layers import WarpLayers

__all__ = ["layers_on"]


def layers_on(backend: str) -> WarpLayers | None:
    """Return what finds the layers of turns on a device; ``None`` for Embree, on the processor.

    Args:
        backend: ``embree``, ``warp`` (the first CUDA device, else the processor), or Warp with a
            device: ``warp:cpu``, ``warp:cuda:1``.

    Raises:
        InputError: no such backend, Warp is not installed, or this machine has no such device.
    """
    name, _, device = backend.partition(":")
    if backend == "embree":
        return None
    if name == "warp" and (device or backend == "warp"):
        return WarpLayers(device or None)
    raise InputError(f"there is no backend {backend!r}", expected="embree, warp or warp:DEVICE")
