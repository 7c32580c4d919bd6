"""The layers of a turn, found on a device: in place of ``compiled.layers.cast_blocks``."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
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

        device, count = self._device, len(rays)
        if not count or not len(shape):
            return _layers(np.zeros(0, _LAYER), np.zeros(1 + 2 * len(shape), np.int64))
        meshes, surfaces = self._shapes(shapes)
        directions = self._keep("beams", beams[0], wp.vec3d)
        footprint = self._keep("footprint", beams[1], wp.vec2d)
        f8, i4 = wp.float64, wp.int32
        sent = _Sent(device)
        knots = [
            sent.add(a, d) for a, d in zip(path, (f8, wp.mat33d, wp.vec3d, wp.vec3d), strict=True)
        ]
        fired = [sent.add(a, d) for a, d in zip(turn, (f8, f8, wp.mat33d, wp.vec3d), strict=True)]
        block = [sent.add(column.astype(np.int32), i4) for column in blocks.T]
        every = sent.add(rays, i4)
        own = sent.add(shape.astype(np.int32), i4)
        send = sent.send()

        motion, when, lie = poses.Motion(), poses.Turn(), layers.Blocks()
        motion.time, motion.rotation, motion.place, motion.turn = (send(one) for one in knots)
        when.column_time, when.ring_time, when.rotation, when.place = (send(one) for one in fired)
        lie.actor, lie.rows, lie.wide, lie.start = (send(one) for one in block)
        lie.ray = send(every)
        surfaces.shape = send(own)

        tally = wp.zeros(1 + 2 * len(shape), dtype=wp.int64, device=device)
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
            ordered = wp.empty(room, dtype=layers.Layer, device=device)
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
            wp.utils.array_scan(many, place, inclusive=False)
            wp.launch(
                layers.put_in_order,
                dim=count,
                inputs=[found, first, many, place],
                outputs=[ordered],
                device=device,
            )
            counts = tally.numpy()
            if counts[0] <= room:
                break
            room = int(counts[0])
            counts[0] = 0
            tally.assign(counts)
        used = int(counts[0])
        return _layers(ordered[:used].numpy() if used else np.zeros(0, _LAYER), counts)

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


class _Sent:
    """Arrays that travel to the device together, in one copy."""

    def __init__(self, device: Any) -> None:  # noqa: ANN401
        self._device = device
        self._parts: list[tuple[int, NDArray[Any], Any]] = []
        self._size = 0

    def add(self, values: NDArray[Any], dtype: Any) -> int:  # noqa: ANN401
        """Return the number of an array that is to be sent."""
        whole = np.ascontiguousarray(values)
        self._parts.append((self._size, whole, dtype))
        self._size += -(-max(whole.nbytes, 1) // _ALIGNED) * _ALIGNED
        return len(self._parts) - 1

    def send(self) -> Any:  # noqa: ANN401
        """Send them, and return what gives an array on the device by its number."""
        import warp as wp

        pinned = self._device.is_cuda
        host = wp.empty(self._size, dtype=wp.uint8, device="cpu", pinned=pinned)
        block = host.numpy()
        for start, values, _ in self._parts:
            block[start : start + values.nbytes] = values.reshape(-1).view(np.uint8)
        there = host if not pinned else wp.empty(self._size, dtype=wp.uint8, device=self._device)
        if pinned:
            wp.copy(there, host)

        def on_device(number: int) -> Any:  # noqa: ANN401
            start, values, dtype = self._parts[number]
            own = len(getattr(dtype, "_shape_", ()))
            shape = values.shape[: values.ndim - own]
            view = wp.array(
                ptr=there.ptr + start, dtype=dtype, shape=shape, device=self._device, copy=False
            )
            view._urbantwin_owner = (there, host)  # The memory lives as long as its views.
            return view

        return on_device


_LAYER = np.dtype(
    [
        ("ray", "i4"),
        ("actor", "i4"),
        ("mask", "i4"),
        ("face", "i4"),
        ("range_m", "f4"),
        ("cosine", "f4"),
    ]
)


def _layers(rows: NDArray[Any], tally: NDArray[np.int64]) -> DeviceLayers:
    actors = (len(tally) - 1) // 2
    return DeviceLayers(
        np.ascontiguousarray(rows["ray"]),
        np.ascontiguousarray(rows["actor"]),
        rows["mask"].astype(np.uint8),
        np.ascontiguousarray(rows["range_m"]),
        np.ascontiguousarray(rows["cosine"]),
        np.ascontiguousarray(rows["face"]),
        tally[1 + actors :].astype(np.float64) / 1e12,
        tally[1 : 1 + actors].copy(),
    )
