"""Devices of NVIDIA Warp, and meshes on them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError

__all__ = ["device_meshes", "device_tree", "warp_device"]


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


def device_tree(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    device: Any,  # noqa: ANN401
) -> Any:  # noqa: ANN401
    """Return the hierarchy of triangles' boxes on a device.

    Args:
        vertices: (V, 3) metres, within kilometres of zero.
        faces: (F, 3) indices of vertices; without any, a box that no ray meets.
        device: see `warp_device`.
    """
    import warp as wp

    corners = np.asarray(vertices, np.float64)[faces] if len(faces) else np.full((1, 1, 3), 1e30)
    # Rounded outward: a box in single precision holds its triangle in double precision.
    low = np.nextafter(corners.min(axis=1).astype(np.float32), np.float32(-np.inf))
    high = np.nextafter(corners.max(axis=1).astype(np.float32), np.float32(np.inf))
    return wp.Bvh(
        wp.array(low, dtype=wp.vec3, device=device),
        wp.array(high, dtype=wp.vec3, device=device),
        constructor="sah",
    )


def device_meshes(
    trees: Sequence[Any],
    meshes: Sequence[tuple[NDArray[np.float64], NDArray[np.int32]]],
    device: Any,  # noqa: ANN401
) -> Any:  # noqa: ANN401
    """Return meshes on a device, as ``device.triangles`` takes them.

    Args:
        trees: of each mesh, from `device_tree`; they must outlive what is returned.
        meshes: vertices (V, 3) and faces (F, 3) of each.
        device: see `warp_device`.
    """
    import warp as wp

    from urbantwin.lidar.casting.device.triangles import Meshes

    vertex_count = np.array([len(vertices) for vertices, _ in meshes])
    face_count = np.array([len(faces) for _, faces in meshes])
    first_vertex = np.cumsum(vertex_count) - vertex_count
    every = np.concatenate(
        [faces + first for (_, faces), first in zip(meshes, first_vertex, strict=True)]
    )
    extent = [np.linalg.norm(vertices, axis=1).max(initial=0.0) for vertices, _ in meshes]
    result = Meshes()
    result.tree = wp.array([tree.id for tree in trees], dtype=wp.uint64, device=device)
    result.first_face = wp.array(np.cumsum(face_count) - face_count, dtype=wp.int32, device=device)
    result.extent = wp.array(extent, dtype=wp.float64, device=device)
    result.vertices = wp.array(
        np.concatenate([vertices for vertices, _ in meshes]), dtype=wp.vec3d, device=device
    )
    result.faces = wp.array(every.astype(np.int32), dtype=wp.vec3i, device=device)
    return result
