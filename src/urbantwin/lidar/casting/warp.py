"""Casting on a CUDA device, or on the processor, through NVIDIA Warp: the extra ``warp``."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.casting.tracer import Blocks, Casting, Firing, Layers
from urbantwin.lidar.casting.warp_device import device_meshes, device_tree, warp_device
from urbantwin.lidar.shapes import PresentActors, Shapes

__all__ = ["WarpTracer"]

#: Sets of shapes, beams and footprints that are kept on the device.
_MOST_KEPT = 32
_ALIGNED = 64


class WarpTracer:
    """Casts on a device, where shapes and beams stay; a turn sends its poses and rays.

    Several threads may cast a turn each: while one waits for the device, another sends the next.
    See `tracer.RayTracer`.

    Args:
        device: see `warp_device.warp_device`.

    Raises:
        InputError: Warp is not installed, or this machine has no such device.
    """

    def __init__(self, device: str | None = None) -> None:
        self._device = warp_device(device)
        self._lock = Lock()  # Warp has one current stream, and what is kept is for all threads.
        self._lanes: list[_Lane] = []  # that no thread uses at the moment
        self._kept: OrderedDict[tuple[str, int], tuple[Any, Any]] = OrderedDict()
        self._trees: dict[int, tuple[Any, Any]] = {}

    def layers(
        self, firing: Firing, actors: PresentActors, blocks: Blocks, casting: Casting
    ) -> Layers:
        """Return the layers that blocks of rays meet, in the order of their beams."""
        import warp as wp

        from urbantwin.lidar.casting.device import cast, poses

        device, count, shape = self._device, len(blocks.ray), actors.shape
        if not count:
            return Layers.room(0, len(shape)).found(0)
        several = len(shape)
        with self._lane() as lane:
            staging, work = lane.staging, lane.work
            with self._lock, lane.current():
                meshes, surfaces = self._shapes(actors.shapes)
                directions = self._keep("beams", firing.directions, wp.vec3d)
                footprint = self._keep("footprint", firing.footprint, wp.vec2d)
                f8, i4 = wp.float64, wp.int32
                knots = zip(actors.paths, (f8, wp.mat33d, wp.vec3d, wp.vec3d), strict=True)
                fired = zip(firing[:4], (f8, f8, wp.mat33d, wp.vec3d), strict=True)
                stands = [(np.asarray(column, np.int32), i4) for column in (*blocks, shape)]
                there = staging.sent([*knots, *fired, *stands])
                motion, when, lie = poses.Motion(), poses.Turn(), cast.Blocks()
                motion.time, motion.rotation, motion.place, motion.turn = there[:4]
                when.column_time, when.ring_time, when.rotation, when.place = there[4:8]
                lie.actor, lie.rows, lie.wide, lie.start, lie.ray, shape_there = there[8:]
                work.room_for(count, several)
                work.tally.zero_()
                wp.launch(
                    cast.cast_axes,
                    dim=count,
                    inputs=[meshes, shape_there, motion, when, lie, directions],
                    outputs=[work.pose, work.range_m, work.face, work.tally],
                    device=device,
                )
            while True:
                with self._lock, lane.current():
                    wp.launch(
                        cast.find_layers,
                        dim=count,
                        inputs=[
                            meshes, surfaces, shape_there, lie, directions, footprint,
                            casting.glass, casting.spread, casting.around, work.pose,
                            work.range_m, work.face,
                        ],
                        outputs=[work.tally, work.found, work.first, work.many],
                        device=device,
                    )  # fmt: skip
                    wp.utils.array_scan(work.many, work.place, inclusive=False)
                    wp.launch(
                        cast.put_in_order,
                        dim=count,
                        inputs=[work.found, work.first, work.many, work.place],
                        outputs=[work.ordered],
                        device=device,
                    )
                    # How many there are comes with as many as there may be: the device is waited
                    # for once, unless there are more.
                    staging.ask([(work.tally, 1 + 2 * several), (work.ordered, lane.expected)])
                counts, ordered = staging.received()
                used = int(counts[0])
                if used <= work.layers:
                    break
                with self._lock, lane.current():
                    work.more_layers(used)
                    work.tally[:1].zero_()
            if used > len(ordered):
                with self._lock, lane.current():
                    staging.ask([(work.ordered, used)])
                (ordered,) = staging.received()
            lane.expected = min(used + used // 4 + 64, work.layers)
        seen = counts[1 : 1 + several]
        seen_s = counts[1 + several :].astype(np.float64) / cast.PICOSECONDS
        ray, actor, mask, own_face, at, cosine = (
            np.ascontiguousarray(ordered[name][:used])
            for name in ("ray", "actor", "mask", "face", "range_m", "cosine")
        )
        return Layers(ray, actor, mask.astype(np.uint8), at, cosine, own_face, seen_s, seen).found(
            used
        )

    @contextmanager
    def _lane(self) -> Iterator[_Lane]:
        """Lend a lane to one turn."""
        with self._lock:
            lane = self._lanes.pop() if self._lanes else _Lane(self._device)
        yield lane
        # Where a turn failed, what the device still does with its lane is not known: it is left.
        with self._lock:
            self._lanes.append(lane)

    def _shapes(self, shapes: Shapes) -> tuple[Any, Any]:
        """Return the shapes on the device; those that came before are not sent again."""
        import warp as wp

        from urbantwin.lidar.casting.device.cast import Surfaces

        key = ("shapes", id(shapes.triangles.planes))
        if key in self._kept:
            kept: tuple[Any, Any] = self._kept[key][1]
            return kept
        device = self._device
        meshes = [(scene.vertices, scene.faces) for scene in shapes.scenes]
        for vertices, faces in meshes:
            if id(vertices) not in self._trees:
                tree = device_tree(vertices, faces, device)
                self._trees[id(vertices)] = (vertices, tree)
        trees = [self._trees[id(vertices)][1] for vertices, _ in meshes]
        planes, surfaces = shapes.triangles.planes, Surfaces()
        for name, values in (
            ("normal", np.column_stack([planes["x"], planes["y"], planes["z"]])),
            ("low", shapes.low),
            ("high", shapes.high),
        ):
            corners = np.ascontiguousarray(values, np.float64)
            setattr(surfaces, name, wp.array(corners, dtype=wp.vec3d, device=device))
        surfaces.offset = wp.array(planes["offset"], dtype=wp.float64, device=device)
        surfaces.pane = wp.array(planes["pane"].astype(np.uint8), dtype=wp.uint8, device=device)
        made = (device_meshes(trees, meshes, device), surfaces)
        self._settle()
        self._remember(key, shapes.triangles.planes, made)
        return made

    def _keep(self, name: str, values: NDArray[np.float64], dtype: Any) -> Any:  # noqa: ANN401
        """Return an array that does not change between turns, on the device."""
        import warp as wp

        key = (name, id(values))
        if key not in self._kept:
            sent = wp.array(np.ascontiguousarray(values), dtype=dtype, device=self._device)
            self._settle()
            self._remember(key, values, sent)
        return self._kept[key][1]

    def _settle(self) -> None:
        """Wait for what was sent to stay: other threads' streams do not."""
        import warp as wp

        if self._device.is_cuda:
            wp.synchronize_device(self._device)

    def _remember(self, key: tuple[str, int], owner: object, value: object) -> None:
        """Keep a value with what it was made from, whose id stays taken that way."""
        self._kept[key] = (owner, value)
        while len(self._kept) > _MOST_KEPT:
            self._kept.popitem(last=False)


class _Lane:
    """What one turn after another needs for itself: a stream of the device, and memory."""

    def __init__(self, device: Any) -> None:  # noqa: ANN401
        import warp as wp

        self._stream = wp.Stream(device) if device.is_cuda else None
        self.staging = _Staging(device, self._stream)
        self.work = _Work(device)
        self.expected = 1  # layers of a turn, by the one before

    def current(self) -> Any:  # noqa: ANN401
        """Return a context in which the device works on this lane's stream."""
        import warp as wp

        return wp.ScopedStream(self._stream, sync_enter=False)


class _Work:
    """What a turn needs of the device's memory beside what is sent; it grows and stays.

    Kernels are told how many rays there are: arrays may be longer.
    """

    def __init__(self, device: Any) -> None:  # noqa: ANN401
        self._device = device
        self._rays = self._actors = self.layers = 0
        self.tally: Any = None
        self.pose: Any = None
        self.range_m: Any = None
        self.face: Any = None
        self.first: Any = None
        self.many: Any = None
        self.place: Any = None
        self.found: Any = None
        self.ordered: Any = None

    def room_for(self, rays: int, actors: int) -> _Work:
        """Return this, with room for so many rays, actors, and the layers that they may have."""
        import warp as wp

        from urbantwin.lidar.casting.device import poses

        device = self._device
        if actors > self._actors:
            self._actors = 2 * actors
            self.tally = wp.zeros(1 + 2 * self._actors, dtype=wp.int64, device=device)
        if rays > self._rays:
            self._rays = rays + rays // 2
            self.pose = wp.empty(self._rays, dtype=poses.RayPose, device=device)
            self.range_m = wp.empty(self._rays, dtype=wp.float32, device=device)
            self.face, self.first, self.many, self.place = (
                wp.zeros(self._rays, dtype=wp.int32, device=device) for _ in range(4)
            )
        if rays + rays // 2 > self.layers:
            self.more_layers(rays + rays // 2)
        return self

    def more_layers(self, layers: int) -> None:
        """Make room for so many layers."""
        import warp as wp

        from urbantwin.lidar.casting.device.cast import Layer

        self.layers = layers + 1024
        self.found, self.ordered = (
            wp.empty(self.layers, dtype=Layer, device=self._device) for _ in range(2)
        )


class _Staging:
    """Host memory that the device copies from and to at full speed; it grows and stays."""

    def __init__(self, device: Any, stream: Any) -> None:  # noqa: ANN401
        self._device, self._stream = device, stream
        self._host: dict[str, Any] = {}
        self._there: Any = None
        self._asked: list[NDArray[Any]] = []

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

    def ask(self, wanted: Sequence[tuple[Any, int]]) -> None:
        """Have the first values of arrays copied to the host when the device gets there.

        Args:
            wanted: arrays, and how many values of each.
        """
        import warp as wp

        if not self._device.is_cuda:
            self._asked = [array.numpy()[:count] for array, count in wanted]
            return
        kinds = [_numpy_type(array.dtype) for array, _ in wanted]
        sizes = [count * kind.itemsize for (_, count), kind in zip(wanted, kinds, strict=True)]
        starts = np.cumsum([0, *(-(-size // _ALIGNED) * _ALIGNED for size in sizes)])
        host = self._room("down", int(starts[-1]))
        for (array, count), start in zip(wanted, starts[:-1], strict=True):
            there = wp.array(
                ptr=host.ptr + int(start),
                dtype=array.dtype,
                shape=(count,),
                device="cpu",
                copy=False,
                pinned=True,
            )
            wp.copy(there, array, count=count)
        block = host.numpy()
        self._asked = [
            block[start : start + size].view(kind)
            for start, size, kind in zip(starts[:-1], sizes, kinds, strict=True)
        ]

    def received(self) -> list[NDArray[Any]]:
        """Return what was asked for, once it is there."""
        import warp as wp

        if self._stream is not None:
            wp.synchronize_stream(self._stream)
        return [values.copy() for values in self._asked]

    def _room(self, way: str, size: int) -> Any:  # noqa: ANN401
        import warp as wp

        if way not in self._host or self._host[way].size < size:
            pinned = bool(self._device.is_cuda)
            self._host[way] = wp.empty(2 * size, dtype=wp.uint8, device="cpu", pinned=pinned)
        return self._host[way]


def _numpy_type(dtype: Any) -> np.dtype[Any]:  # noqa: ANN401
    """Return the NumPy type of a value on the device, of a structure, too."""
    import warp as wp

    of_structure = hasattr(dtype, "numpy_dtype")
    found: np.dtype[Any] = np.dtype(
        dtype.numpy_dtype() if of_structure else wp.dtype_to_numpy(dtype)
    )
    return found
