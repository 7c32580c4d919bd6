"""What beams meet: surfaces that fill the whole beam or, at edges, a part of it.

A beam is cast as one ray along its axis and, where its neighbours meet something else, as rays
spread over its footprint as well. A surface that several of a beam's rays meet is one layer: it
says which of the rays (bits of a mask), and the range at which the beam's axis meets its plane.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from urbantwin.geometry.compiled.intersect import intersect, new_ray
from urbantwin.geometry.compiled.planes import first_met
from urbantwin.geometry.embree import Hits
from urbantwin.lidar.casting import layer_rule
from urbantwin.lidar.casting.layer_rule import (
    BEHIND_M,
    GRAZING,
    MOST_PANES,
    MOST_SURFACES,
    ON_AXIS,
    STEP_M,
)
from urbantwin.lidar.compiled.pose import APART_S, LATER_S, actor_from_sensor, set_pose

__all__ = ["cast_blocks"]

_plane_range = njit(cache=True, nogil=True)(layer_rule.plane_range)
_is_predicted = njit(cache=True, nogil=True)(layer_rule.is_predicted)
_is_same_surface = njit(cache=True, nogil=True)(layer_rule.is_same_surface)
_layer_range = njit(cache=True, nogil=True)(layer_rule.layer_range)

#: In place of a face: no ray is cast here; the ray hits nothing.
_NO_RAY, _NO_HIT = -2, -1
#: Ways to spread beams over their footprint, see `tracer.Casting`.
_AT_EDGES, _EVERYWHERE = 1, 2


class _ColumnPoses(NamedTuple):
    """``asset_SE3_sensor`` when each of K columns fires, of the actor of one block.

    Attributes:
        rotation: (K, 3, 3).
        place: (K, 3).
        speed: (K, 3) m/s, how the sensor goes past the actor: for channels that fire later.
        block: (K,) the block that a column was last computed for.
    """

    rotation: NDArray[np.float64]
    place: NDArray[np.float64]
    speed: NDArray[np.float64]
    block: NDArray[np.int64]


class _Surfaces(NamedTuple):
    """The surfaces that one beam's rays meet: which (bits), face, sum of ranges, how many rays."""

    mask: NDArray[np.int64]
    face: NDArray[np.int64]
    total_m: NDArray[np.float64]
    rays: NDArray[np.float64]


@njit(cache=True, nogil=True)
def cast_blocks(address, firing, targets, blocks, casting, layers):
    """Cast blocks of rays, each at its own actor, and write the layers that they meet.

    Args:
        address: of ``rtcIntersect1``.
        firing: `tracer.Firing`.
        targets: `tracer.Targets`.
        blocks: `tracer.Blocks`.
        casting: `tracer.Casting`.
        layers: `tracer.Layers` to write, with the actors' ``seen`` and ``seen_s`` 0: the latter
            gets the sum of the times at which beams' axes met each actor.

    Returns:
        How many layers there are (written only while there is room).
    """
    rays, columns = len(blocks.ray), len(firing.column_time_s)
    hits = Hits(np.empty(rays, np.float32), np.empty(rays, np.int32))
    poses = _ColumnPoses(
        np.empty((columns, 3, 3)),
        np.empty((columns, 3)),
        np.empty((columns, 3)),
        np.full(columns, -1, np.int64),
    )
    surfaces = _Surfaces(
        np.empty(MOST_SURFACES, np.int64),
        np.empty(MOST_SURFACES, np.int64),
        np.empty(MOST_SURFACES),
        np.empty(MOST_SURFACES),
    )
    ray_hit = new_ray()
    used = 0
    for block in range(len(blocks.actor)):
        _cast_axes(address, firing, targets, blocks, block, poses, ray_hit, hits)
        used = _find_layers(
            address, firing, targets, blocks, block, casting, poses, ray_hit, hits, surfaces,
            layers, used,
        )  # fmt: skip
    return used


@njit(cache=True, nogil=True)
def _cast_axes(address, firing, targets, blocks, block, poses, ray_hit, hits):
    """Cast the axes of a block's beams."""
    actor = blocks.actor[block]
    count = len(firing.column_time_s)
    ring_time, beams = firing.ring_time_s, firing.directions
    rays, range_m, face = blocks.ray, hits.range_m, hits.face
    rotation, place, speed, done = poses.rotation, poses.place, poses.speed, poses.block
    start = blocks.start[block]
    for at in range(start, start + blocks.rows[block] * blocks.wide[block]):
        ray = rays[at]
        if ray < 0:
            face[at] = _NO_RAY
            continue
        column = ray % count
        if done[column] != block:
            done[column] = block
            _set_column_pose(firing, targets.paths, actor, column, poses)
        ox, oy, oz = _origin(place, speed, column, ring_time[ray // count])
        dx, dy, dz = _turned(rotation, column, beams[ray, 0], beams[ray, 1], beams[ray, 2])
        range_m[at], face[at] = _first_hit(
            address, targets, actor, ray_hit, np.float32(0.0), ox, oy, oz, dx, dy, dz
        )


@njit(cache=True, nogil=True)
def _find_layers(
    address, firing, targets, blocks, block, casting, poses, ray_hit, hits, surfaces, layers, used
):
    """Write the layers of a block's beams from number ``used`` on; return how many there are."""
    actor = blocks.actor[block]
    base = targets.first_face[actor]
    start, rows, wide = blocks.start[block], blocks.rows[block], blocks.wide[block]
    count = len(firing.column_time_s)
    column_time, ring_time, beams = firing.column_time_s, firing.ring_time_s, firing.directions
    normals, offsets = targets.triangles.normals, targets.triangles.offsets
    panes = targets.triangles.panes
    rotation, place, speed = poses.rotation, poses.place, poses.speed
    range_m, face, rays = hits.range_m, hits.face, blocks.ray
    seen, seen_s = layers.seen, layers.seen_s
    whole = np.uint8((1 << len(firing.footprint)) - 1)
    for at in range(start, start + rows * wide):
        own = face[at]
        if own == _NO_RAY:
            continue
        ray = rays[at]
        column = ray % count
        late = ring_time[ray // count]
        ox, oy, oz = _origin(place, speed, column, late)
        edge = casting.spread == _EVERYWHERE
        if casting.spread == _AT_EDGES:
            edge = _is_edge(
                at, start, rows, wide, casting.around, base, beams, rays, rotation, column,
                normals, offsets, range_m, face, ox, oy, oz,
            )  # fmt: skip
        if own >= 0:
            seen[actor] += 1
            seen_s[actor] += column_time[column] + late
        elif not edge:
            continue
        dx, dy, dz = _turned(rotation, column, beams[ray, 0], beams[ray, 1], beams[ray, 2])
        if not edge and not (casting.glass and panes[base + own]):
            # Most beams: one opaque surface meets all of their light.
            told, slant = _on_plane(base + own, normals, offsets, ox, oy, oz, dx, dy, dz)
            told = _layer_range(told, np.float64(range_m[at]), True)
            _write(layers, used, ray, actor, whole | np.uint8(ON_AXIS), told, abs(slant), own)
            used += 1
            continue
        met = _find_surfaces(
            address, firing, targets, actor, ray, column, edge, casting.glass, rotation, ray_hit,
            range_m[at], own, ox, oy, oz, surfaces,
        )  # fmt: skip
        on_axis = 0
        if own >= 0 or _crosses(actor, targets.low, targets.high, ox, oy, oz, dx, dy, dz):
            on_axis = ON_AXIS
        for g in range(met):
            hit, mask = surfaces.face[g], surfaces.mask[g]
            told, slant = _on_plane(base + hit, normals, offsets, ox, oy, oz, dx, dy, dz)
            mean = surfaces.total_m[g] / surfaces.rays[g]
            told = _layer_range(told, mean, mask & 1 == 1)
            _write(layers, used, ray, actor, mask | on_axis, told, abs(slant), hit)
            used += 1
    return used


@njit(cache=True, nogil=True)
def _is_edge(
    at, start, rows, wide, around, base, beams, rays, rotation, column, normals, offsets, range_m,
    face, ox, oy, oz,
):  # fmt: skip
    """Return whether a neighbour of a beam in its block meets another surface."""
    row, n, own = (at - start) // wide, (at - start) % wide, face[at]
    for r in range(max(row - 1, 0), min(row + 2, rows)):
        for c in range(n - 1, n + 2):
            if not around and not 0 <= c < wide:
                continue
            other = start + r * wide + c % wide
            if face[other] == _NO_RAY:
                continue
            if (face[other] < 0) != (own < 0):
                return True
            if own >= 0 and abs(range_m[other] - range_m[at]) > STEP_M:
                x, y, z = beams[rays[other], 0], beams[rays[other], 1], beams[rays[other], 2]
                dx, dy, dz = _turned(rotation, column, x, y, z)
                told, _ = _on_plane(base + own, normals, offsets, ox, oy, oz, dx, dy, dz)
                if not _is_predicted(told, np.float64(range_m[other])):
                    return True
    return False


@njit(cache=True, nogil=True)
def _find_surfaces(
    address, firing, targets, actor, ray, column, edge, glass, rotation, ray_hit, axis_range,
    axis_face, ox, oy, oz, surfaces,
):  # fmt: skip
    """Write the surfaces that a beam's rays meet and return how many.

    At an edge all rays of its footprint are cast, elsewhere the axis stands for all of them.
    """
    beams, footprint = firing.directions, firing.footprint
    normals, offsets = targets.triangles.normals, targets.triangles.offsets
    panes, base = targets.triangles.panes, targets.first_face[actor]
    bx, by, bz = beams[ray, 0], beams[ray, 1], beams[ray, 2]
    flat = np.sqrt(bx * bx + by * by)
    ex, ey = 0.0, 1.0
    if flat > 1e-9:
        ex, ey = -by / flat, bx / flat
    used = 0
    for sample in range(len(footprint) if edge else 1):
        across, up = footprint[sample, 0], footprint[sample, 1]
        # Across lies level; up is the beam's axis turned by a quarter.
        x = bx + across * ex - up * bz * ey
        y = by + across * ey + up * bz * ex
        z = bz + up * flat
        size = np.sqrt(x * x + y * y + z * z)
        dx, dy, dz = _turned(rotation, column, x / size, y / size, z / size)
        bit = 1 << sample if edge else (1 << len(footprint)) - 1
        near = np.float32(0.0)
        for pane in range(MOST_PANES):
            if sample == 0 and pane == 0:
                met, hit = axis_range, axis_face
            else:
                met, hit = _first_hit(
                    address, targets, actor, ray_hit, near, ox, oy, oz, dx, dy, dz
                )
            if hit < 0:
                break
            joined = False
            for g in range(used):
                if surfaces.mask[g] & bit or not edge:
                    continue
                other = base + surfaces.face[g]
                told, _ = _on_plane(other, normals, offsets, ox, oy, oz, dx, dy, dz)
                if _is_same_surface(told, np.float64(met)) and panes[base + hit] == panes[other]:
                    surfaces.mask[g] |= bit
                    surfaces.total_m[g] += met
                    surfaces.rays[g] += 1
                    joined = True
                    break
            if not joined and used < MOST_SURFACES:
                surfaces.mask[used], surfaces.face[used] = bit, hit
                surfaces.total_m[used], surfaces.rays[used] = met, 1
                used += 1
            if not (glass and panes[base + hit]):
                break
            near = met + np.float32(BEHIND_M)
    return used


@njit(cache=True, nogil=True)
def _set_column_pose(firing, paths, actor, column, poses):
    """Write where the sensor is, as an actor sees it, when a column fires."""
    actor_rotation, actor_place = np.empty((3, 3)), np.empty(3)
    later_rotation, later_place = np.empty((3, 3)), np.empty(3)
    relative, place = np.empty((3, 3)), np.empty(3)
    moving = len(firing.translation) > 1
    time = firing.column_time_s[column]
    n = column if moving else 0
    set_pose(time, actor, paths, actor_rotation, actor_place)
    actor_from_sensor(
        actor_rotation, actor_place, n, firing.rotation, firing.translation, relative, place
    )
    # How fast the sensor goes past the actor, for the channels that fire later.
    set_pose(time + LATER_S, actor, paths, later_rotation, later_place)
    m, over = n, 0.0
    if moving:
        m = (column + 1) % len(firing.column_time_s)
        over = firing.column_time_s[m] - time
        if not 0.0 < over < APART_S:
            m, over = n, 0.0
    for i in range(3):
        for j in range(3):
            poses.rotation[column, i, j] = relative[i, j]
        poses.place[column, i] = place[i]
        v = 0.0
        for j in range(3):
            own = 0.0
            if over > 0.0:
                own = (firing.translation[m, j] - firing.translation[n, j]) / over
            gone = (later_place[j] - actor_place[j]) / LATER_S
            v += actor_rotation[j, i] * (own - gone)
        poses.speed[column, i] = v


@njit(cache=True, nogil=True)
def _origin(place, speed, column, late):
    """Return where a ray leaves that fires ``late`` after its column, actor's frame."""
    return (
        place[column, 0] + speed[column, 0] * late,
        place[column, 1] + speed[column, 1] * late,
        place[column, 2] + speed[column, 2] * late,
    )


@njit(cache=True, nogil=True)
def _turned(rotation, column, x, y, z):
    """Return a direction of the sensor's frame in the actor's, when a column fires."""
    return (
        rotation[column, 0, 0] * x + rotation[column, 0, 1] * y + rotation[column, 0, 2] * z,
        rotation[column, 1, 0] * x + rotation[column, 1, 1] * y + rotation[column, 1, 2] * z,
        rotation[column, 2, 0] * x + rotation[column, 2, 1] * y + rotation[column, 2, 2] * z,
    )


@njit(cache=True, nogil=True)
def _first_hit(address, targets, actor, ray_hit, near, ox, oy, oz, dx, dy, dz):
    """Return range and face of the first hit of an actor beyond ``near``."""
    normals, base = targets.triangles.normals, targets.first_face[actor]
    scene = targets.scene[actor]
    met, hit = intersect(address, scene, ray_hit, near, ox, oy, oz, dx, dy, dz)
    if hit >= 0:
        n = base + hit
        slant = normals[n, 0] * dx + normals[n, 1] * dy + normals[n, 2] * dz
        if abs(slant) < GRAZING:
            # Along a triangle single precision knows but rounding: see ``planes``.
            met, hit = first_met(
                address, scene, ray_hit, targets.triangles.vertices,
                targets.triangles.corners[base:], near, ox, oy, oz, dx, dy, dz,
            )  # fmt: skip
    return met, hit


@njit(cache=True, nogil=True)
def _on_plane(n, normals, offsets, ox, oy, oz, dx, dy, dz):
    """Return where a ray meets a triangle's plane, and the cosine to its normal."""
    x, y, z = normals[n, 0], normals[n, 1], normals[n, 2]
    slant = x * dx + y * dy + z * dz
    return _plane_range(offsets[n] - (x * ox + y * oy + z * oz), slant), slant


@njit(cache=True, nogil=True)
def _crosses(n, low, high, ox, oy, oz, dx, dy, dz):
    """Return whether a ray passes through a box."""
    enter, leave = 0.0, np.inf
    for axis in range(3):
        o = ox if axis == 0 else (oy if axis == 1 else oz)
        d = dx if axis == 0 else (dy if axis == 1 else dz)
        if abs(d) < 1e-12:
            if o < low[n, axis] or o > high[n, axis]:
                return False
            continue
        one, other = (low[n, axis] - o) / d, (high[n, axis] - o) / d
        enter, leave = max(enter, min(one, other)), min(leave, max(one, other))
    return enter <= leave


@njit(cache=True, nogil=True)
def _write(layers, used, ray, actor, mask, range_m, cosine, face):
    """Write a layer, if there is room for it."""
    if used < len(layers.ray):
        layers.ray[used], layers.actor[used], layers.mask[used] = ray, actor, mask
        layers.range_m[used], layers.cosine[used], layers.face[used] = range_m, cosine, face
