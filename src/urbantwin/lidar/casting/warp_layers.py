"""The layers of a turn, found on a device: in place of ``compiled.layers.cast_blocks``."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from threading import Lock
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.casting.warp import device_meshes, device_tree, warp_device

__all__ = ["DeviceLayers", "Meshes", "WarpLayers"]

#: Sets of shapes, beams and footprints that are kept on the device.
_MOST_KEPT = 32
_ALIGNED = 64


class Meshes(Protocol):
    """What the device needs of S shapes; see ``shapes.ShapeArrays``."""

    @property
    def meshes(self) -> Sequence[tuple[NDArray[np.float64], NDArray[np.int32]]]:
        """Vertices (V, 3) and faces (F, 3) of each shape."""

    @property
    def normals(self) -> NDArray[np.float64]:
        """Unit normals (F, 3) of all shapes' faces, end to end."""

    @property
    def offsets(self) -> NDArray[np.float64]:
        """Where the faces' planes (F,) lie along their normals."""

    @property
    def panes(self) -> NDArray[np.bool_]:
        """Faces (F,) that let light through."""

    @property
    def low(self) -> NDArray[np.float64]:
        """Lower corners (S, 3) of the bounds."""

    @property
    def high(self) -> NDArray[np.float64]:
        """Upper corners (S, 3) of the bounds."""


class DeviceLayers(NamedTuple):
    """L layers in the order of their beams, and how many axes met each of A actors, and when.

    Attributes:
        ray: (L,) int32.
        actor: (L,) int32.
        mask: (L,) uint8.
        range_m: (L,) float32.
        cosine: (L,) float32.
        face: (L,) int32.
        seen_s: (A,) float64, sum of the times, seconds.
        seen: (A,) int64.
    """

    ray: NDArray[np.int32]
    actor: NDArray[np.int32]
    mask: NDArray[np.uint8]
    range_m: NDArray[np.float32]
    cosine: NDArray[np.float32]
    face: NDArray[np.int32]
    seen_s: NDArray[np.float64]
    seen: NDArray[np.int64]


class WarpLayers:
    """Casts turns on a device. Shapes and beams stay there; a turn sends its poses and rays.

    Args:
        device: see `warp.warp_device`.

    Raises:
        InputError: Warp is not installed, or this machine has no such device.
    """

    def __init__(self, device: str | None = None) -> None:
        self._device = warp_device(device)
        self._staging = _Staging(self._device)
        self._lock = Lock()  # Frames may be scanned by several threads.
        self._kept: OrderedDict[tuple[str, int], tuple[Any, Any]] = OrderedDict()
        self._trees: dict[int, tuple[Any, Any]] = {}

    def cast(
        self,
        shapes: Meshes,
        shape: NDArray[np.int64],
        path: tuple[NDArray[np.float64], ...],
        blocks: NDArray[np.int64],
        rays: NDArray[np.int32],
        turn: tuple[NDArray[np.float64], ...],
        beams: tuple[NDArray[np.float64], NDArray[np.float64]],
        options: tuple[bool, int, bool],
    ) -> DeviceLayers:
        """Return the layers that blocks of rays meet.

        Args:
            shapes: every shape.
            shape: (A,) the shape of each actor.
            path: of the actors, see ``layers.Paths``.
            blocks: see ``compiled.layers.cast_blocks``, as are the others.
            rays: of the blocks.
            turn: times of columns and channels, rotations and places of the sensor.
            beams: directions and footprint.
            options: glass, spread, around.
        """
        import warp as wp

        from urbantwin.lidar.casting.device import layers, poses

        with self._lock:
            device, count = self._device, len(rays)
            if not count:
                return _none(len(shape))
            meshes, surfaces = self._shapes(shapes)
            directions = self._keep("beams", beams[0], wp.vec3d)
            footprint = self._keep("footprint", beams[1], wp.vec2d)
            f8, i4 = wp.float64, wp.int32
            knots = zip(path, (f8, wp.mat33d, wp.vec3d, wp.vec3d), strict=True)
            fired = zip(turn, (f8, f8, wp.mat33d, wp.vec3d), strict=True)
            stands = [(np.asarray(column, np.int32), i4) for column in (*blocks.T, rays, shape)]
            there = self._staging.sent([*knots, *fired, *stands])
            motion, when, lie = poses.Motion(), poses.Turn(), layers.Blocks()
            motion.time, motion.rotation, motion.place, motion.turn = there[:4]
            when.column_time, when.ring_time, when.rotation, when.place = there[4:8]
            lie.actor, lie.rows, lie.wide, lie.start, lie.ray, surfaces.shape = there[8:]

            actors = len(shape)
            tally = wp.zeros(1 + 2 * actors, dtype=wp.int64, device=device)
            pose = wp.empty(count, dtype=poses.RayPose, device=device)
            range_m = wp.empty(count, dtype=wp.float32, device=device)
            face, first, many, place = (wp.empty(count, dtype=i4, device=device) for _ in range(4))
            wp.launch(
                layers.cast_axes,
                dim=count,
                inputs=[meshes, surfaces.shape, motion, when, lie, directions],
                outputs=[pose, range_m, face, tally],
                device=device,
            )
            glass, spread, around = options
            room = count + count // 2 + 1024
            while True:
                found = wp.empty(room, dtype=layers.Layer, device=device)
                wp.launch(
                    layers.find_layers,
                    dim=count,
                    inputs=[
                        meshes, surfaces, lie, directions, footprint, glass, spread, around,
                        len(turn[0]), pose, range_m, face,
                    ],
                    outputs=[tally, found, first, many],
                    device=device,
                )  # fmt: skip
                counts = self._staging.received(tally)
                if counts[0] <= room:
                    break
                room = int(counts[0])
                tally[:1].zero_()
            used = int(counts[0])
            if not used:
                return _none(actors)
            whole = wp.empty((4, used), dtype=i4, device=device)
            real = wp.empty((2, used), dtype=wp.float32, device=device)
            wp.utils.array_scan(many, place, inclusive=False)
            wp.launch(
                layers.put_in_order,
                dim=count,
                inputs=[found, first, many, place],
                outputs=[whole, real],
                device=device,
            )
            ray, actor, mask, own_face = self._staging.received(whole)
            at, cosine = self._staging.received(real)
            seen_s = counts[1 + actors :].astype(np.float64) / 1e12
            return DeviceLayers(
                ray,
                actor,
                mask.astype(np.uint8),
                at,
                cosine,
                own_face,
                seen_s,
                counts[1 : 1 + actors],
            )

    def _shapes(self, shapes: Meshes) -> tuple[Any, Any]:
        """Return the shapes on the device; those that came before are not sent again."""
        import warp as wp

        from urbantwin.lidar.casting.device.layers import Surfaces

        key = ("shapes", id(shapes.normals))
        if key in self._kept:
            meshes, surfaces = self._kept[key][1]
            return meshes, surfaces
        device = self._device
        for vertices, faces in shapes.meshes:
            if id(vertices) not in self._trees:
                tree = device_tree(vertices, faces, device)
                self._trees[id(vertices)] = (vertices, tree)
        trees = [self._trees[id(vertices)][1] for vertices, _ in shapes.meshes]
        surfaces = Surfaces()
        for name, dtype in (("normal", "normals"), ("low", "low"), ("high", "high")):
            values = np.ascontiguousarray(getattr(shapes, dtype), np.float64)
            setattr(surfaces, name, wp.array(values, dtype=wp.vec3d, device=device))
        surfaces.offset = wp.array(shapes.offsets, dtype=wp.float64, device=device)
        surfaces.pane = wp.array(shapes.panes.astype(np.uint8), dtype=wp.uint8, device=device)
        made = (device_meshes(trees, shapes.meshes, device), surfaces)
        self._remember(key, shapes.normals, made)
        return made

    def _keep(self, name: str, values: NDArray[np.float64], dtype: Any) -> Any:  # noqa: ANN401
        """Return an array that does not change between turns, on the device."""
        import warp as wp

        key = (name, id(values))
        if key not in self._kept:
            sent = wp.array(np.ascontiguousarray(values), dtype=dtype, device=self._device)
            self._remember(key, values, sent)
        return self._kept[key][1]

    def _remember(self, key: tuple[str, int], owner: object, value: object) -> None:
        """Keep a value with what it was made from, whose id stays taken that way."""
        self._kept[key] = (owner, value)
        while len(self._kept) > _MOST_KEPT:
            self._kept.popitem(last=False)


class _Staging:
    """Host memory that the device copies from and to at full speed; it grows and stays."""

    def __init__(self, device: Any) -> None:  # noqa: ANN401
        self._device = device
        self._host: dict[str, Any] = {}
        self._there: Any = None

    def sent(self, arrays: Sequence[tuple[NDArray[Any], Any]]) -> list[Any]:
        """Return arrays on the device, after one copy; they are overwritten by the next call.

        Args:
            arrays: values, and what Warp calls their type.
        """
        import warp as wp

        parts = [(np.ascontiguousarray(values), dtype) for values, dtype in arrays]
        sizes = [-(-max(values.nbytes, 1) // _ALIGNED) * _ALIGNED for values, _ in parts]
        starts = np.cumsum([0, *sizes])
        host = self._room("up", int(starts[-1]))
        block = host.numpy()
        for (values, _), start in zip(parts, starts[:-1], strict=True):
            block[start : start + values.nbytes] = values.reshape(-1).view(np.uint8)
        if self._device.is_cuda:
            if self._there is None or self._there.size < host.size:
                self._there = wp.empty(host.size, dtype=wp.uint8, device=self._device)
            wp.copy(self._there, host, count=int(starts[-1]))
        else:
            self._there = host
        return [
            wp.array(
                ptr=self._there.ptr + int(start),
                dtype=dtype,
                shape=values.shape[: values.ndim - len(getattr(dtype, "_shape_", ()))],
                device=self._device,
                copy=False,
            )
            for (values, dtype), start in zip(parts, starts[:-1], strict=True)
        ]

    def received(self, array: Any) -> NDArray[Any]:  # noqa: ANN401
        """Return the values of an array on the device, once it has them."""
        import warp as wp

        if not self._device.is_cuda:
            return np.array(array.numpy())
        kind = np.dtype(wp.dtype_to_numpy(array.dtype))
        size = array.size * kind.itemsize
        host = self._room("down", max(size, 1))
        block = wp.array(
            ptr=host.ptr,
            dtype=array.dtype,
            shape=array.shape,
            device="cpu",
            copy=False,
            pinned=True,
        )
        wp.copy(block, array)
        wp.synchronize_stream(self._device)
        return np.array(host.numpy()[:size].view(kind).reshape(array.shape))

    def _room(self, way: str, size: int) -> Any:  # noqa: ANN401
        import warp as wp

        if way not in self._host or self._host[way].size < size:
            pinned = bool(self._device.is_cuda)
            self._host[way] = wp.empty(2 * size, dtype=wp.uint8, device="cpu", pinned=pinned)
        return self._host[way]


def _none(actors: int) -> DeviceLayers:
    whole, real = np.zeros(0, np.int32), np.zeros(0, np.float32)
    seen = np.zeros(actors, np.int64)
    mask = np.zeros(0, np.uint8)
    return DeviceLayers(whole, whole, mask, real, real, whole, seen.astype(np.float64), seen)
