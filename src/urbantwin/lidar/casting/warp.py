"""Ray casting with NVIDIA Warp on a CUDA device or the processor (extra ``warp``)."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.casting.tracer import Blocks, Casting, Firing, Layers
from urbantwin.lidar.casting.warp_shapes import DeviceShapes, warp_device
from urbantwin.lidar.compiled.order import in_order
from urbantwin.lidar.shapes import PresentActors, Shapes

__all__ = ["WarpTracer"]

#: Most arrays of shapes, beams and footprints kept on the device.
_MOST_KEPT = 32
#: Most recorded plans per lane.
_MOST_PLANS = 16
_ALIGNED = 64
#: Start of an unused block: after all rays.
_NEVER = np.iinfo(np.int32).max


class WarpTracer:
    """Casts on a device, which keeps shapes and beams; a turn sends its poses and rays.

    The kernel launches of a turn of some size are recorded once and replayed: packing arguments in
    Python takes longer than casting. Several threads may cast a turn each: while one waits for the
    device, another sends the next. See `tracer.RayTracer`.

    Args:
        device: see `warp_shapes.warp_device`.

    Raises:
        InputError: Warp is not installed, or this machine has no such device.
    """

    def __init__(self, device: str | None = None) -> None:
        self._device = warp_device(device)
        self._lock = Lock()  # Warp has one current stream, and all threads share the cache.
        self._lanes: list[_Lane] = []  # idle lanes
        self._kept: OrderedDict[tuple[str, int], tuple[Any, Any]] = OrderedDict()

    def layers(
        self, firing: Firing, actors: PresentActors, blocks: Blocks, casting: Casting
    ) -> Layers:
        """Return the layers of blocks of rays, in the order of their beams."""
        count, several = len(blocks.ray), len(actors.shape)
        if not count:
            return Layers.room(0, several).found(0)
        with self._lane() as lane:
            while True:
                plan = self._plan(lane, firing, actors, blocks, casting)
                tally = plan.cast(firing, actors, blocks)
                used = int(tally[0])
                if used <= lane.layers:
                    break
                with self._lock:
                    lane.more_layers(used)
            layers = Layers.room(used, several)
            in_order(plan.found(used), blocks.ray, layers)
            seen, times = tally[1 : 1 + several], tally[1 + plan.actors :][:several]
            layers.seen[:], layers.seen_s[:] = seen, times / plan.ticks_per_s
        return layers.found(used)

    @contextmanager
    def _lane(self) -> Iterator[_Lane]:
        """Lend a lane to one turn."""
        with self._lock:
            lane = self._lanes.pop() if self._lanes else _Lane(self._device)
        yield lane
        # After a failure the state of the lane is unknown: it is dropped.
        with self._lock:
            self._lanes.append(lane)

    def _plan(
        self,
        lane: _Lane,
        firing: Firing,
        actors: PresentActors,
        blocks: Blocks,
        casting: Casting,
    ) -> _Plan:
        """Return the recorded plan of a turn of this size."""
        import warp as wp

        with self._lock:
            there = self._shapes(actors.shapes)
            owners = (there, firing.directions, firing.footprint)
            sizes = _Sizes.of(firing, actors, blocks)
            key = (sizes, casting, there.moved, *map(id, owners))
            if key not in lane.plans:
                given = _Given(
                    there.meshes,
                    there.surfaces,
                    self._keep("beams", firing.directions, wp.vec3d),
                    self._keep("footprint", firing.footprint, wp.vec2d),
                )
                lane.plans[key] = lane.recorded(sizes, casting, given, owners)
                self._settle()
        lane.plans.move_to_end(key)
        while len(lane.plans) > _MOST_PLANS:
            lane.plans.popitem(last=False)
        return lane.plans[key]

    def _shapes(self, shapes: Shapes) -> DeviceShapes:
        """Return the shapes on the device, extended by new ones."""
        key = ("shapes", id(shapes.triangles.planes))
        if key not in self._kept:
            device_shapes = [
                value for _, value in self._kept.values() if isinstance(value, DeviceShapes)
            ]
            shapes_there = next((value for value in device_shapes if value.goes_on(shapes)), None)
            shapes_there = shapes_there or DeviceShapes(self._device)
            shapes_there.add(shapes)
            self._settle()
            self._remember(key, shapes.triangles.planes, shapes_there)
        self._kept.move_to_end(key)
        result: DeviceShapes = self._kept[key][1]
        return result

    def _keep(self, name: str, values: NDArray[np.float64], dtype: Any) -> Any:  # noqa: ANN401
        """Return a constant array on the device."""
        import warp as wp

        key = (name, id(values))
        if key not in self._kept:
            sent = wp.array(np.ascontiguousarray(values), dtype=dtype, device=self._device)
            self._remember(key, values, sent)
        self._kept.move_to_end(key)
        return self._kept[key][1]

    def _settle(self) -> None:
        """Wait until kept arrays are complete: the streams of lanes do not."""
        import warp as wp

        if self._device.is_cuda:
            wp.synchronize_device(self._device)

    def _remember(self, key: tuple[str, int], owner: object, value: object) -> None:
        """Keep a value together with its source, whose id then stays in use."""
        self._kept[key] = (owner, value)
        while len(self._kept) > _MOST_KEPT:
            self._kept.popitem(last=False)


class _Sizes(NamedTuple):
    """Sizes of the arrays of a turn.

    Variable ones are rounded up to powers of two, so that most turns of a recording share a few
    sizes.
    """

    actors: int
    knots: int
    columns: int
    rings: int
    poses: int
    blocks: int
    rays: int

    @classmethod
    def of(cls, firing: Firing, actors: PresentActors, blocks: Blocks) -> _Sizes:
        return cls(
            _room(len(actors.shape)),
            actors.paths.time_s.shape[1],
            len(firing.column_time_s),
            len(firing.ring_time_s),
            len(firing.translation),
            _room(len(blocks.actor)),
            _room(len(blocks.ray)),
        )


class _Given(NamedTuple):
    """Arrays that stay on the device between turns, as ``device.cast`` takes them."""

    meshes: Any
    surfaces: Any
    beams: Any
    footprint: Any


class _Lane:
    """Stream and memory for one turn after another.

    Memory grows only; when it grows, recorded plans are dropped.
    """

    def __init__(self, device: Any) -> None:  # noqa: ANN401
        import warp as wp

        self.device = device
        self.stream = wp.Stream(device) if device.is_cuda else None
        self.plans: OrderedDict[object, _Plan] = OrderedDict()
        self.rays = self.layers = 0
        self.pose: Any = None
        self.range_m: Any = None
        self.face: Any = None
        self.found: Any = None
        self.found_here: Any = None
        self.sent: Any = None  # data of a turn, on the host and on the device
        self.sent_there: Any = None
        self.tally_here: Any = None

    def more_layers(self, layers: int) -> None:
        """Make room for a number of layers."""
        from urbantwin.lidar.casting.device.cast import Layer

        self.plans.clear()
        self.layers = layers + layers // 4 + 1024
        self.found, self.found_here = self._both(self.layers, Layer)

    def recorded(self, sizes: _Sizes, casting: Casting, given: _Given, owners: object) -> _Plan:
        """Return a plan of a turn."""
        import warp as wp

        from urbantwin.lidar.casting.device.poses import RayPose

        if sizes.rays > self.rays:
            self.plans.clear()
            self.rays = sizes.rays
            self.pose, self.range_m, self.face = (
                wp.empty(self.rays, dtype=kind, device=self.device)
                for kind in (RayPose, wp.float32, wp.int32)
            )
        if sizes.rays > self.layers:
            self.more_layers(sizes.rays)
        layout = _Layout.of(sizes)
        if self.sent is None or self.sent.size < layout.size:
            self.plans.clear()
            self.sent_there, self.sent = self._both(2 * layout.size, wp.uint8)
        if self.tally_here is None or self.tally_here.size < 1 + 2 * sizes.actors:
            self.plans.clear()
            _, self.tally_here = self._both(1 + 4 * sizes.actors, wp.int64)
        return _Plan(self, layout, sizes, casting, given, owners)

    def _both(self, size: int, dtype: Any) -> tuple[Any, Any]:  # noqa: ANN401
        """Return an array on the device, and a host array of the same size for copies."""
        import warp as wp

        there = wp.empty(size, dtype=dtype, device=self.device)
        if not self.device.is_cuda:
            return there, there
        return there, wp.empty(size, dtype=dtype, device="cpu", pinned=True)


class _Layout(NamedTuple):
    """Layout of a turn's arrays in the block that is sent: (name, type, shape, first byte)."""

    arrays: tuple[tuple[str, Any, tuple[int, ...], int], ...]
    size: int

    @classmethod
    def of(cls, sizes: _Sizes) -> _Layout:
        """Lay out the arrays one after the other; rays last, because only used ones are sent."""
        import warp as wp

        i4, i8, f8 = wp.int32, wp.int64, wp.float64
        a, t, b, p = sizes.actors, sizes.knots, sizes.blocks, sizes.poses
        arrays = (
            ("tally", i8, (1 + 2 * a,)),
            ("time", f8, (a, t)),
            ("rotation", wp.mat33d, (a, t)),
            ("place", wp.vec3d, (a, t)),
            ("turn", wp.vec3d, (a, t - 1)),
            ("column_time", f8, (sizes.columns,)),
            ("ring_time", f8, (sizes.rings,)),
            ("sensor_rotation", wp.mat33d, (p,)),
            ("sensor_place", wp.vec3d, (p,)),
            *((name, i4, (b,)) for name in ("actor", "rows", "wide", "start")),
            ("shape", i4, (a,)),
            ("ray", i4, (sizes.rays,)),
        )
        placed, first = [], 0
        for name, dtype, shape in arrays:
            placed.append((name, dtype, shape, first))
            size = int(np.prod(shape)) * wp.types.type_size_in_bytes(dtype)
            first += -(-size // _ALIGNED) * _ALIGNED
        return cls(tuple(placed), first)


class _Plan:
    """Recorded launches of a turn: arguments stay in place, values change."""

    def __init__(
        self,
        lane: _Lane,
        layout: _Layout,
        sizes: _Sizes,
        casting: Casting,
        given: _Given,
        owners: object,
    ) -> None:
        import warp as wp

        from urbantwin.lidar.casting.device import cast, poses

        self.actors, self.ticks_per_s = sizes.actors, cast.PICOSECONDS
        self._lane, self._owners = lane, owners  # keeps their ids in use
        self._expected = 1  # layers expected from the previous turn
        here: dict[str, NDArray[Any]] = {}
        there: dict[str, Any] = {}
        for name, dtype, shape, first in layout.arrays:
            there[name], block = (
                wp.array(
                    ptr=memory.ptr + first,
                    dtype=dtype,
                    shape=shape,
                    device=memory.device,
                    copy=False,
                )
                for memory in (lane.sent_there, lane.sent)
            )
            here[name] = block.numpy()
        self._here, self._tally_there = here, there["tally"]
        self._first_ray = layout.arrays[-1][-1]
        here["tally"][:], here["start"][:] = 0, _NEVER
        self._tally: NDArray[np.int64] = lane.tally_here.numpy()[: 1 + 2 * sizes.actors]
        self._found: NDArray[np.void] = lane.found_here.numpy()
        motion, turn, blocks = poses.Motion(), poses.Turn(), cast.Blocks()
        motion.time, motion.rotation = there["time"], there["rotation"]
        motion.place, motion.turn = there["place"], there["turn"]
        turn.column_time, turn.ring_time = there["column_time"], there["ring_time"]
        turn.rotation, turn.place = there["sensor_rotation"], there["sensor_place"]
        blocks.actor, blocks.rows, blocks.wide = there["actor"], there["rows"], there["wide"]
        blocks.start, blocks.ray = there["start"], there["ray"]
        axes = [lane.pose, lane.range_m, lane.face]
        self._commands = [
            wp.launch(
                kernel, dim=sizes.rays, inputs=inputs, device=lane.device, record_cmd=True
            )
            for kernel, inputs in (
                (
                    cast.cast_axes,
                    [given.meshes, there["shape"], motion, turn, blocks, given.beams, *axes,
                     there["tally"]],
                ),
                (
                    cast.find_layers,
                    [given.meshes, given.surfaces, there["shape"], blocks, given.beams,
                     given.footprint, casting.glass, casting.spread, casting.around, *axes,
                     there["tally"], lane.found],
                ),
            )
        ]  # fmt: skip

    def cast(self, firing: Firing, actors: PresentActors, blocks: Blocks) -> NDArray[np.int64]:
        """Cast the rays of a turn; return the tally: see ``device.cast.cast_axes``."""
        import warp as wp

        here, lane, rays = self._here, self._lane, len(blocks.ray)
        here["tally"][:] = 0
        for name, values in zip(("time", "rotation", "place", "turn"), actors.paths, strict=True):
            here[name][: len(values)] = values
        here["shape"][: len(actors.shape)] = actors.shape
        here["column_time"][:], here["ring_time"][:] = firing.column_time_s, firing.ring_time_s
        here["sensor_rotation"][:], here["sensor_place"][:] = firing.rotation, firing.translation
        for name, values in blocks._asdict().items():
            here[name][: len(values)] = values
        here["start"][len(blocks.start) :] = _NEVER
        if lane.stream is not None:
            used = self._first_ray + blocks.ray.nbytes
            wp.copy(lane.sent_there, lane.sent, count=used, stream=lane.stream)
        for command in self._commands:
            command.set_dim(rays)
            command.launch(lane.stream)
        if lane.stream is None:
            return self._here["tally"]
        # The count arrives together with the expected number of layers: one wait, unless there are
        # more.
        wp.copy(lane.tally_here, self._tally_there, count=self._tally.size, stream=lane.stream)
        wp.copy(lane.found_here, lane.found, count=self._expected, stream=lane.stream)
        wp.synchronize_stream(lane.stream)
        return self._tally

    def found(self, used: int) -> NDArray[np.void]:
        """Return the layers of the last turn, `device.cast.Layer`; valid until the next."""
        import warp as wp

        lane = self._lane
        if used > self._expected and lane.stream is not None:
            wp.copy(lane.found_here, lane.found, count=used, stream=lane.stream)
            wp.synchronize_stream(lane.stream)
        self._expected = min(used + used // 4 + 64, lane.layers)
        return self._found[:used]


def _room(count: int) -> int:
    """Return the next power of two."""
    return 1 << max(count - 1, 15).bit_length()
