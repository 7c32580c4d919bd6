"""Devices of NVIDIA Warp, and shapes on them."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.extras import check_extra
from urbantwin.lidar.shapes import Shapes

__all__ = ["DeviceShapes", "warp_device"]


@cache
def warp_device(name: str | None = None) -> Any:  # noqa: ANN401 - Warp is an extra
    """Return a Warp device.

    Args:
        name: ``cpu``, ``cuda``, ``cuda:1``, ...; ``None``: the first CUDA device, else ``cpu``.

    Raises:
        InputError: Warp is not installed, or this machine has no such device.
    """
    check_extra("warp", "casting on a device")
    import warp as wp

    # Without Warp's greeting; errors are raised at any level.
    wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)
    wp.init()
    try:
        return wp.get_preferred_device() if name is None else wp.get_device(name)
    except (ValueError, RuntimeError):
        devices = ", ".join(str(device) for device in wp.get_devices())
        raise InputError(f"this machine has no device {name!r}", expected=devices) from None


class DeviceShapes:
    """Concatenated shapes on a device; each shape is sent once.

    Attributes:
        meshes: all shapes, as ``device.triangles`` takes them.
        surfaces: all shapes, as ``device.cast`` takes them.
        moved: number of reallocations: `meshes` and `surfaces` are then new.

    Args:
        device: see `warp_device`.
    """

    def __init__(self, device: Any) -> None:  # noqa: ANN401
        self._device = device
        self._trees: list[Any] = []
        self._scenes: tuple[object, ...] = ()
        self._faces = self._vertices = self.moved = 0
        self._columns: dict[str, _DeviceColumn] = {}
        self.meshes: Any = None
        self.surfaces: Any = None

    def goes_on(self, shapes: Shapes) -> bool:
        """Return whether shapes begin with those that are here, or are the first of them."""
        return all(
            present is other for present, other in zip(self._scenes, shapes.scenes, strict=False)
        )

    def add(self, shapes: Shapes) -> None:
        """Send the shapes that are not here yet."""
        import warp as wp

        present, triangles = len(self._scenes), shapes.triangles
        if len(shapes.scenes) <= present:
            return
        planes, corners = triangles.planes[self._faces :], triangles.corners[self._faces :]
        vertices = triangles.vertices[self._vertices :]
        extent = []
        for scene in shapes.scenes[present:]:
            self._trees.append(_tree(scene.vertices, scene.faces, self._device))
            extent.append(np.linalg.norm(scene.vertices, axis=1).max(initial=0.0))
        tree = np.array([tree.id for tree in self._trees[present:]], np.uint64)
        normal = np.column_stack([planes[axis] for axis in "xyz"])
        pane = planes["pane"].astype(np.uint8)
        moved = [
            self._add("tree", tree, wp.uint64),
            self._add("first_face", shapes.first_face[present:].astype(np.int32), wp.int32),
            self._add("extent", np.array(extent), wp.float64),
            self._add("vertices", vertices, wp.vec3d),
            self._add("faces", corners, wp.vec3i),
            self._add("low", shapes.low[present:], wp.vec3d),
            self._add("high", shapes.high[present:], wp.vec3d),
            self._add("normal", normal, wp.vec3d),
            self._add("offset", planes["offset"], wp.float64),
            self._add("pane", pane, wp.uint8),
        ]
        self._scenes = shapes.scenes
        self._faces, self._vertices = len(triangles.planes), len(triangles.vertices)
        if any(moved):
            self._settle()

    def _add(self, name: str, values: NDArray[Any], dtype: Any) -> bool:  # noqa: ANN401
        column = self._columns.setdefault(name, _DeviceColumn(dtype, self._device))
        return column.append(np.ascontiguousarray(values))

    def _settle(self) -> None:
        """Set `meshes` and `surfaces` to the current arrays."""
        from urbantwin.lidar.casting.device.cast import Surfaces
        from urbantwin.lidar.casting.device.triangles import Meshes

        self.moved += 1
        self.meshes, self.surfaces = Meshes(), Surfaces()
        for owner, names in (
            (self.meshes, ("tree", "first_face", "extent", "vertices", "faces")),
            (self.surfaces, ("low", "high", "normal", "offset", "pane")),
        ):
            for name in names:
                setattr(owner, name, self._columns[name].values)


class _DeviceColumn:
    """An array on a device that grows at its end."""

    def __init__(self, dtype: Any, device: Any) -> None:  # noqa: ANN401
        import warp as wp

        self._length = 0
        self.values = wp.empty(0, dtype=dtype, device=device)

    def append(self, values: NDArray[Any]) -> bool:
        """Append rows; return whether the array was reallocated."""
        import warp as wp

        until, room = self._length + len(values), self.values.size
        moved = until > room
        if moved:
            # The first allocation is exact: a street does not grow.
            size = max(until, 2 * room)
            before = self.values
            self.values = wp.empty(size, dtype=before.dtype, device=before.device)
            if self._length:
                wp.copy(self.values, before, count=self._length)
        if len(values):
            sent = wp.array(values, dtype=self.values.dtype, device="cpu", copy=False)
            wp.copy(self.values, sent, dest_offset=self._length, count=len(values))
        self._length = until
        return bool(moved)


def _tree(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    device: Any,  # noqa: ANN401
) -> Any:  # noqa: ANN401
    """Return a bounding volume hierarchy on a device.

    Args:
        vertices: (V, 3) metres, within kilometres of zero.
        faces: (F, 3) vertex indices; without any, a box that no ray hits.
        device: see `warp_device`.
    """
    import warp as wp

    corners = np.asarray(vertices, np.float64)[faces] if len(faces) else np.full((1, 1, 3), 1e30)
    # Rounded outwards: a float32 box contains its float64 triangle.
    low = np.nextafter(corners.min(axis=1).astype(np.float32), np.float32(-np.inf))
    high = np.nextafter(corners.max(axis=1).astype(np.float32), np.float32(np.inf))
    return wp.Bvh(
        wp.array(low, dtype=wp.vec3, device=device),
        wp.array(high, dtype=wp.vec3, device=device),
        constructor="sah",
    )
