"""Casting of beams on the device: the results of `compiled.cast`, by the same rule of a layer.

A ray is a thread. First all rays along the beams' axes are cast; then, where neighbours meet
something else, the rays of a beam's footprint. The caller sorts the layers.
"""

from collections.abc import Callable
from types import FunctionType
from typing import Any

import warp as wp

from urbantwin.lidar.casting import layer_rule
from urbantwin.lidar.casting.device.poses import Motion, RayPose, Turn, pose_for
from urbantwin.lidar.casting.device.triangles import Meshes, first_hit
from urbantwin.lidar.casting.layer_rule import BEHIND_M, MOST_PANES, MOST_SURFACES, ON_AXIS, STEP_M

__all__ = ["PICOSECONDS", "Blocks", "Layer", "Surfaces", "cast_axes", "find_layers", "on_device"]


def on_device(rule: Callable[..., Any], *kinds: object) -> wp.Function:
    """Return a plain function as one of Warp's.

    Args:
        rule: of numbers; the float constants that it names become double precision.
        kinds: Warp's type of each argument.
    """
    assert isinstance(rule, FunctionType)
    names = {
        name: wp.constant(wp.float64(value)) if isinstance(value, float) else value
        for name, value in rule.__globals__.items()
    }
    copy = FunctionType(rule.__code__, names, rule.__name__)
    copy.__module__, copy.__doc__ = rule.__module__, rule.__doc__
    arguments = rule.__code__.co_varnames[: rule.__code__.co_argcount]
    copy.__annotations__ = dict(zip(arguments, kinds, strict=True))
    return wp.func(copy)


#: Times are added up in these, so that the sum does not depend on the order.
PICOSECONDS = 1e12

wp.set_module_options({"enable_backward": False, "fast_math": False})

plane_range = on_device(layer_rule.plane_range, wp.float64, wp.float64)
is_predicted = on_device(layer_rule.is_predicted, wp.float64, wp.float64)
is_same_surface = on_device(layer_rule.is_same_surface, wp.float64, wp.float64)
layer_range = on_device(layer_rule.layer_range, wp.float64, wp.float64, wp.bool)

Masks = wp.types.vector(length=MOST_SURFACES, dtype=wp.int32)
Sums = wp.types.vector(length=MOST_SURFACES, dtype=wp.float64)


@wp.struct
class Blocks:
    """Blocks of rays (B,): actor, rows, columns, first ray; and all rays (R,), -1 for none."""

    actor: wp.array(dtype=wp.int32)
    rows: wp.array(dtype=wp.int32)
    wide: wp.array(dtype=wp.int32)
    start: wp.array(dtype=wp.int32)
    ray: wp.array(dtype=wp.int32)


@wp.struct
class Surfaces:
    """Bounds of each shape, planes and panes of all faces."""

    low: wp.array(dtype=wp.vec3d)
    high: wp.array(dtype=wp.vec3d)
    normal: wp.array(dtype=wp.vec3d)
    offset: wp.array(dtype=wp.float64)
    pane: wp.array(dtype=wp.uint8)


@wp.struct
class Layer:
    """One surface that a beam meets: ``at`` is where its ray stands among all rays."""

    at: wp.int32
    actor: wp.int32
    mask: wp.int32
    face: wp.int32
    range_m: wp.float32
    cosine: wp.float32


@wp.func
def on_plane(
    surfaces: Surfaces, face: wp.int32, origin: wp.vec3d, direction: wp.vec3d
) -> wp.float64:
    """Return where a ray meets a triangle's plane; ``nan`` where it grazes it."""
    normal = surfaces.normal[face]
    return plane_range(surfaces.offset[face] - wp.dot(normal, origin), wp.dot(normal, direction))


@wp.func
def crosses(low: wp.vec3d, high: wp.vec3d, origin: wp.vec3d, direction: wp.vec3d) -> wp.bool:
    """Return whether a ray passes through a box."""
    enter, leave = wp.float64(0.0), wp.float64(wp.inf)
    for axis in range(3):
        if wp.abs(direction[axis]) < wp.float64(1e-12):
            if origin[axis] < low[axis] or origin[axis] > high[axis]:
                return False
        else:
            one = (low[axis] - origin[axis]) / direction[axis]
            other = (high[axis] - origin[axis]) / direction[axis]
            enter = wp.max(enter, wp.min(one, other))
            leave = wp.min(leave, wp.max(one, other))
    return enter <= leave


@wp.func
def block_of(blocks: Blocks, at: wp.int32) -> wp.int32:
    """Return the block that a ray stands in: the last that starts at or before it."""
    low, high = wp.int32(0), blocks.start.shape[0] - 1
    while low < high:
        middle = (low + high + 1) // 2
        if blocks.start[middle] <= at:
            low = middle
        else:
            high = middle - 1
    return low


@wp.kernel
def cast_axes(
    meshes: Meshes,
    shape: wp.array(dtype=wp.int32),
    motion: Motion,
    turn: Turn,
    blocks: Blocks,
    beams: wp.array(dtype=wp.vec3d),
    pose: wp.array(dtype=RayPose),
    range_m: wp.array(dtype=wp.float32),
    face: wp.array(dtype=wp.int32),
    tally: wp.array(dtype=wp.int64),
) -> None:
    """Cast the axes of beams: range and face (R,), -1 without a hit and -2 without a ray.

    ``tally`` is 0 (for the number of layers), then how many axes met each actor (A,), then the sums
    of the times (A,) at which they did, picoseconds.
    """
    at = wp.tid()
    ray = blocks.ray[at]
    face[at] = -2
    if ray < 0:
        return
    count = turn.column_time.shape[0]
    column, ring = ray % count, ray // count
    actor = blocks.actor[block_of(blocks, at)]
    own = pose_for(motion, turn, actor, column, ring)
    pose[at] = own
    hit = first_hit(meshes, shape[actor], own.origin, own.rotation @ beams[ray], wp.float64(0.0))
    range_m[at] = wp.float32(hit.range_m)
    face[at] = hit.face
    if hit.face >= 0:
        time = turn.column_time[column] + turn.ring_time[ring]
        wp.atomic_add(tally, 1 + actor, wp.int64(1))
        wp.atomic_add(
            tally,
            1 + shape.shape[0] + actor,
            wp.int64(wp.round(time * wp.float64(wp.static(PICOSECONDS)))),
        )


@wp.func
def is_edge(
    surfaces: Surfaces,
    base: wp.int32,
    blocks: Blocks,
    block: wp.int32,
    at: wp.int32,
    around: wp.bool,
    own: RayPose,
    beams: wp.array(dtype=wp.vec3d),
    range_m: wp.array(dtype=wp.float32),
    face: wp.array(dtype=wp.int32),
) -> wp.bool:
    """Return whether a neighbour of a ray meets another surface."""
    start, wide = blocks.start[block], blocks.wide[block]
    row, column = (at - start) // wide, (at - start) % wide
    for r in range(wp.max(row - 1, 0), wp.min(row + 2, blocks.rows[block])):
        for step in range(-1, 2):
            c = column + step
            if (c < 0 or c >= wide) and not around:
                continue
            other = start + r * wide + (c + wide) % wide
            if face[other] == -2:
                continue
            if (face[other] < 0) != (face[at] < 0):
                return True
            if face[at] >= 0 and wp.abs(range_m[other] - range_m[at]) > wp.static(STEP_M):
                aim = own.rotation @ beams[blocks.ray[other]]
                told = on_plane(surfaces, base + face[at], own.origin, aim)
                if not is_predicted(told, wp.float64(range_m[other])):
                    return True
    return False


@wp.kernel
def find_layers(
    meshes: Meshes,
    surfaces: Surfaces,
    shapes: wp.array(dtype=wp.int32),
    blocks: Blocks,
    beams: wp.array(dtype=wp.vec3d),
    footprint: wp.array(dtype=wp.vec2d),
    glass: wp.bool,
    spread: wp.int32,
    around: wp.bool,
    pose: wp.array(dtype=RayPose),
    range_m: wp.array(dtype=wp.float32),
    face: wp.array(dtype=wp.int32),
    tally: wp.array(dtype=wp.int64),
    found: wp.array(dtype=Layer),
) -> None:
    """Write the layers of each beam next to each other in ``found``, as far as there is room.

    How many there are is added to the first of ``tally``.
    """
    at = wp.tid()
    own_face = wp.int32(face[at])
    if own_face == -2:
        return
    ray = blocks.ray[at]
    block = block_of(blocks, at)
    actor = blocks.actor[block]
    shape = shapes[actor]
    base = meshes.first_face[shape]
    own = pose[at]
    edge = spread == 2
    if spread == 1:
        edge = is_edge(surfaces, base, blocks, block, at, around, own, beams, range_m, face)
    if own_face < 0 and not edge:
        return

    samples = footprint.shape[0]
    cast = wp.int32(1)
    if edge:
        cast = samples
    masks, faces, counts = Masks(), Masks(), Masks()
    sums = Sums()
    groups = wp.int32(0)
    beam = beams[ray]
    flat = wp.sqrt(beam[0] * beam[0] + beam[1] * beam[1])
    ex, ey = wp.float64(0.0), wp.float64(1.0)
    if flat > wp.float64(1e-9):
        ex, ey = -beam[1] / flat, beam[0] / flat
    for sample in range(cast):
        across, up = footprint[sample][0], footprint[sample][1]
        aim = own.rotation @ wp.normalize(
            wp.vec3d(
                beam[0] + across * ex - up * beam[2] * ey,
                beam[1] + across * ey + up * beam[2] * ex,
                beam[2] + up * flat,
            )
        )
        bit = wp.int32(1) << sample
        if not edge:
            bit = (wp.int32(1) << samples) - 1
        near = wp.float64(0.0)
        pane = wp.int32(0)
        while pane < wp.static(MOST_PANES):
            met, hit = wp.float32(range_m[at]), wp.int32(own_face)
            if sample > 0 or pane > 0:
                further = first_hit(meshes, shape, own.origin, aim, near)
                met, hit = wp.float32(further.range_m), wp.int32(further.face)
            pane += 1
            if hit < 0:
                break
            clear = surfaces.pane[base + hit]
            joined = wp.bool(False)
            for g in range(groups):
                if edge and not joined and (masks[g] & bit) == 0:
                    told = on_plane(surfaces, base + faces[g], own.origin, aim)
                    if (
                        is_same_surface(told, wp.float64(met))
                        and clear == surfaces.pane[base + faces[g]]
                    ):
                        masks[g] = masks[g] | bit
                        sums[g] = sums[g] + wp.float64(met)
                        counts[g] = counts[g] + 1
                        joined = True
            if not joined and groups < wp.static(MOST_SURFACES):
                masks[groups] = bit
                faces[groups] = hit
                sums[groups] = wp.float64(met)
                counts[groups] = 1
                groups += 1
            if not glass or clear == wp.uint8(0):
                break
            near = wp.float64(met) + wp.float64(wp.static(BEHIND_M))

    axis = own.rotation @ beam
    on_axis = wp.int32(0)
    if own_face >= 0 or crosses(surfaces.low[shape], surfaces.high[shape], own.origin, axis):
        on_axis = wp.int32(wp.static(ON_AXIS))
    place = wp.int32(wp.atomic_add(tally, 0, wp.int64(groups)))
    for g in range(groups):
        told = on_plane(surfaces, base + faces[g], own.origin, axis)
        told = layer_range(told, sums[g] / wp.float64(counts[g]), (masks[g] & 1) == 1)
        if place + g < found.shape[0]:
            layer = Layer()
            layer.at = at
            layer.actor = actor
            layer.mask = masks[g] | on_axis
            layer.face = faces[g]
            layer.range_m = wp.float32(told)
            layer.cosine = wp.float32(wp.abs(wp.dot(surfaces.normal[base + faces[g]], axis)))
            found[place + g] = layer
