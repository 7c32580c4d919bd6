"""Casting on a CUDA device, or on the processor, through NVIDIA Warp: the extra ``warp``."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.lidar.casting.hits import Hits

__all__ = ["WarpCaster", "WarpMesh", "warp_device"]

#: Single precision tells apart numbers that differ by this share; a box test rounds a few times.
_ROUNDING = 2.0**-24
_ROUNDINGS = 16


@cache
def warp_device(name: str | None = None) -> Any:  # noqa: ANN401 - Warp is an extra
    """Return a device of Warp's.

    Args:
        name: ``cpu``, ``cuda``, ``cuda:1``, ...; ``None``: the first CUDA device, else ``cpu``.

    Raises:
        InputError: Warp is not installed, or this machine has no such device.
    """
    try:
        import warp as wp
    except ImportError:
        raise InputError(
            "casting on a device needs the package warp-lang",
            expected="pip install 'urbantwin[warp]'",
        ) from None
    # Warp greets at its first call; what goes wrong it says at any level.
    wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)
    wp.init()
    try:
        return wp.get_preferred_device() if name is None else wp.get_device(name)
    except (ValueError, RuntimeError):
        known = ", ".join(str(device) for device in wp.get_devices())
        raise InputError(f"this machine has no device {name!r}", expected=known) from None


class WarpMesh:
    """Triangles on a device, with the tree of their boxes.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3) indices of vertices; at least one face.
        device: see `warp_device`.

    Attributes:
        vertices: the same on the device, from ``centre``.
        faces: the same on the device.
        tree: the hierarchy of the triangles' boxes.
        centre: (3,) middle of the bounds, so that single precision loses little.
        extent: the farthest that any vertex is from ``centre``, metres.
    """

    def __init__(
        self, vertices: NDArray[np.float64], faces: NDArray[np.int32], device: str | None = None
    ) -> None:
        place = warp_device(device)
        import warp as wp

        corners = np.asarray(vertices, np.float64)[faces]
        low, high = corners.min(axis=1), corners.max(axis=1)
        self.centre = (low.min(axis=0) + high.max(axis=0)) / 2
        self.extent = float(np.linalg.norm(high.max(axis=0) - low.min(axis=0))) / 2
        self.vertices = wp.array(vertices - self.centre, dtype=wp.vec3d, device=place)
        self.faces = wp.array(np.ascontiguousarray(faces, np.int32), dtype=wp.vec3i, device=place)
        # Rounded outward: a box in single precision holds its triangle in double precision.
        lowest = np.nextafter((low - self.centre).astype(np.float32), np.float32(-np.inf))
        highest = np.nextafter((high - self.centre).astype(np.float32), np.float32(np.inf))
        self.tree = wp.Bvh(
            wp.array(lowest, dtype=wp.vec3, device=place),
            wp.array(highest, dtype=wp.vec3, device=place),
            constructor="sah",
        )

    def radius(self, farthest_m: float) -> float:
        """Return what boxes are to be grown by for rays that leave so far from ``centre``."""
        return 1e-6 + _ROUNDINGS * _ROUNDING * (self.extent + farthest_m)


class WarpCaster:
    """First hits on a device, decided in double precision; see `hits.RayCaster`.

    Both sides of a triangle are hit, and no ray slips through the edge of two. Triangles may be
    anywhere: places are told from their middle. Of several triangles at the same range, the one
    that is numbered first is hit, on every device.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3) indices of vertices.
        device: see `warp_device`.

    Raises:
        InputError: Warp is not installed, or this machine has no such device.
    """

    def __init__(
        self, vertices: NDArray[np.float64], faces: NDArray[np.int32], device: str | None = None
    ) -> None:
        self._device = warp_device(device)
        self._mesh = WarpMesh(vertices, faces, device) if len(faces) else None

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float32]) -> Hits:
        """Return the first hit of each ray; see `hits.RayCaster`."""
        count, mesh = len(directions), self._mesh
        if mesh is None or count == 0:
            return Hits(np.full(count, np.inf, np.float32), np.full(count, -1, np.int32))
        import warp as wp

        from urbantwin.lidar.casting.device.triangles import cast_rays

        place = self._device
        starts = np.asarray(origins, np.float64).reshape(-1, 3)
        farthest = float(np.linalg.norm(starts - mesh.centre, axis=1).max())
        range_m = wp.empty(count, dtype=wp.float32, device=place)
        face = wp.empty(count, dtype=wp.int32, device=place)
        wp.launch(
            cast_rays,
            dim=count,
            inputs=[
                mesh.tree.id,
                mesh.vertices,
                mesh.faces,
                wp.vec3d(*mesh.centre),
                mesh.radius(farthest),
                wp.array(starts, dtype=wp.vec3d, device=place),
                wp.array(np.asarray(directions, np.float32), dtype=wp.vec3, device=place),
            ],
            outputs=[range_m, face],
            device=place,
        )
        return Hits(range_m.numpy(), face.numpy())
