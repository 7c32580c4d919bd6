"""Devices of NVIDIA Warp."""

from __future__ import annotations

from functools import cache
from typing import Any

from urbantwin.errors import InputError
from urbantwin.extras import check_extra

__all__ = ["warp_device"]


@cache
def warp_device(name: str | None = None) -> Any:  # noqa: ANN401 - Warp is an extra
    """Return a device of Warp's.

    Args:
        name: ``cpu``, ``cuda``, ``cuda:1``, ...; ``None``: the first CUDA device, else ``cpu``.

    Raises:
        InputError: Warp is not installed, or this machine has no such device.
    """
    check_extra("warp", "casting on a device")
    import warp as wp

    # Warp greets at its first call; what goes wrong it says at any level.
    wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)
    wp.init()
    try:
        return wp.get_preferred_device() if name is None else wp.get_device(name)
    except (ValueError, RuntimeError):
        known = ", ".join(str(device) for device in wp.get_devices())
        raise InputError(f"this machine has no device {name!r}", expected=known) from None
