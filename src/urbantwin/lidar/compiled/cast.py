"""What beams meet: surfaces that fill the whole beam or, at edges, a part of it.

A beam is cast as one ray along its axis and, where its neighbours meet something else, as rays
spread over its footprint as well. A surface that several of a beam's rays meet is one layer: it
says which of the rays (bits of a mask), and the range at which the beam's axis meets its plane.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry.compiled import per_block, per_ray
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

_plane_range = per_ray(layer_rule.plane_range)
_is_predicted = per_ray(layer_rule.is_predicted)
_is_same_surface = per_ray(layer_rule.is_same_surface)
_layer_range = per_ray(layer_rule.layer_range)

#: In place of a face: no ray is cast here.
_NO_RAY = -2
#: Ways to spread beams over their footprint, see `tracer.Casting`.
_AT_EDGES, _EVERYWHERE = 1, 2


#: ``asset_SE3_sensor`` when a column fires: the rotation's rows, the place, and how fast the sensor
#: goes past the actor, m/s, for the channels that fire later.
_POSE = np.dtype([(name, np.float64) for name in "xx xy xz yx yy yz zx zy zz x y z u v w".split()])


class _Surfaces(NamedTuple):
    """The surfaces that one beam's rays meet: which (bits), face, sum of ranges, how many rays."""

    mask: NDArray[np.int64]
    face: NDArray[np.int64]
    total_m: NDArray[np.float64]
    rays: NDArray[np.float64]


class _Scratch(NamedTuple):
    """Room for the poses that `_set_poses` computes with."""

    actor_rotation: NDArray[np.float64]
    actor_place: NDArray[np.float64]
    later_rotation: NDArray[np.float64]
    later_place: NDArray[np.float64]
    relative: NDArray[np.float64]
    place: NDArray[np.float64]


class _Room(NamedTuple):
    """What the passes over a block's R rays, in K columns, hand on to each other.

    Attributes:
        poses: (K,) `_POSE` of the sensor as the block's actor sees it.
        done: (K,) int64, the block that the pose of a column is of.
        hits: of the beams' axes.
        edge: (R,) whether a neighbour meets another surface.
        surfaces: of one beam.
        ray: one ray for Embree, see `intersect.new_ray`.
        scratch: for one pose.
    """

    poses: NDArray[np.void]
    done: NDArray[np.int64]
    hits: Hits
    edge: NDArray[np.bool_]
    surfaces: _Surfaces
    ray: tuple[NDArray[np.float32], NDArray[np.uint32], np.uint64]
    scratch: _Scratch


@per_block
def _room(columns, rays):
    return _Room(
        np.empty(columns, _POSE),
        np.full(columns, -1, np.int64),
        Hits(np.empty(rays, np.float32), np.empty(rays, np.int32)),
        np.empty(rays, np.bool_),
        _Surfaces(
            np.empty(MOST_SURFACES, np.int64),
            np.empty(MOST_SURFACES, np.int64),
            np.empty(MOST_SURFACES),
            np.empty(MOST_SURFACES),
        ),
        new_ray(),
        _Scratch(
            np.empty((3, 3)),
            np.empty(3),
            np.empty((3, 3)),
            np.empty(3),
            np.empty((3, 3)),
            np.empty(3),
        ),
    )


@per_block
def cast_blocks(address, firing, targets, blocks, casting, layers):
    """Cast blocks of rays, each at its own actor, and write the layers that they meet.

    Args:
        address: of ``rtcIntersect1``.
        firing: `tracer.Firing`.
        targets: `embree.Targets`.
        blocks: `tracer.Blocks`.
        casting: `tracer.Casting`.
        layers: `tracer.Layers` to write, with the actors' ``seen`` and ``seen_s`` 0: the latter
            gets the sum of the times at which beams' axes met each actor.

    Returns:
        How many layers there are (written only while there is room).
    """
    room = _room(len(firing.column_time_s), len(blocks.ray))
    used = np.int64(0)  # a literal 0 would compile `_find_layers` once more
    for block in range(len(blocks.actor)):
        _set_poses(firing, targets.paths, blocks, block, room)
        _cast_axes(address, firing, targets, blocks, block, room)
        _find_edges(firing, targets, blocks, block, casting, room)
        used = _find_layers(address, firing, targets, blocks, block, casting, room, layers, used)
    return used


@per_ray
def _set_poses(firing, paths, blocks, block, room):
    """Write where the sensor is, as a block's actor sees it, when each of its columns fires."""
    actor_rotation, actor_place, later_rotation, later_place, relative, place = room.scratch
    poses, done = room.poses, room.done
    actor, start = blocks.actor[block], blocks.start[block]
    count, moving = len(firing.column_time_s), len(firing.translation) > 1
    for at in range(start, start + blocks.rows[block] * blocks.wide[block]):
        ray = blocks.ray[at]
        column = ray % count
        if ray < 0 or done[column] == block:
            continue
        done[column] = block
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
            m = (column + 1) % count
            over = firing.column_time_s[m] - time
            if not 0.0 < over < APART_S:
                m, over = n, 0.0
        u = v = w = 0.0
        for j in range(3):
            own = 0.0
            if over > 0.0:
                own = (firing.translation[m, j] - firing.translation[n, j]) / over
            past = own - (later_place[j] - actor_place[j]) / LATER_S
            u += actor_rotation[j, 0] * past
            v += actor_rotation[j, 1] * past
            w += actor_rotation[j, 2] * past
        pose = poses[column]
        pose.xx, pose.xy, pose.xz = relative[0, 0], relative[0, 1], relative[0, 2]
        pose.yx, pose.yy, pose.yz = relative[1, 0], relative[1, 1], relative[1, 2]
        pose.zx, pose.zy, pose.zz = relative[2, 0], relative[2, 1], relative[2, 2]
        pose.x, pose.y, pose.z = place[0], place[1], place[2]
        pose.u, pose.v, pose.w = u, v, w


@per_ray
def _cast_axes(address, firing, targets, blocks, block, room):
    """Cast the axes of a block's beams."""
    actor = blocks.actor[block]
    scene, base = targets.scene[actor], targets.first_face[actor]
    planes, vertices, corners = targets.triangles
    count = len(firing.column_time_s)
    ring_time, beams = firing.ring_time_s, firing.directions
    rays, range_m, face = blocks.ray, room.hits.range_m, room.hits.face
    poses, ray_hit = room.poses, room.ray
    start = blocks.start[block]
    for at in range(start, start + blocks.rows[block] * blocks.wide[block]):
        ray = rays[at]
        if ray < 0:
            face[at] = _NO_RAY
            continue
        pose = poses[ray % count]
        ox, oy, oz = _origin(pose, ring_time[ray // count])
        dx, dy, dz = _turned(pose, beams[ray, 0], beams[ray, 1], beams[ray, 2])
        met, hit = intersect(address, scene, ray_hit, np.float32(0.0), ox, oy, oz, dx, dy, dz)
        if hit >= 0 and abs(_slant(planes[base + hit], dx, dy, dz)) < GRAZING:
            # Along a triangle single precision knows but rounding: see ``planes``.
            met, hit = first_met(
                address, scene, ray_hit, vertices, corners[base:], np.float32(0.0),
                ox, oy, oz, dx, dy, dz,
            )  # fmt: skip
        range_m[at], face[at] = met, hit


@per_ray
def _find_edges(firing, targets, blocks, block, casting, room):
    """Write which beams of a block have a neighbour that meets another surface."""
    base = targets.first_face[blocks.actor[block]]
    start, rows, wide = blocks.start[block], blocks.rows[block], blocks.wide[block]
    planes = targets.triangles.planes
    count, ring_time, beams = len(firing.column_time_s), firing.ring_time_s, firing.directions
    rays, range_m, face = blocks.ray, room.hits.range_m, room.hits.face
    poses, edge = room.poses, room.edge
    edge[start : start + rows * wide] = casting.spread == _EVERYWHERE
    if casting.spread != _AT_EDGES:
        return
    for at in range(start, start + rows * wide):
        own, ray = face[at], rays[at]
        if own == _NO_RAY:
            continue
        row, n, column = (at - start) // wide, (at - start) % wide, ray % count
        pose = poses[column]
        ox, oy, oz = _origin(pose, ring_time[ray // count])
        found = False
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(n - 1, n + 2):
                if found or (not casting.around and not 0 <= c < wide):
                    continue
                other = start + r * wide + c % wide
                if face[other] == _NO_RAY:
                    continue
                if (face[other] < 0) != (own < 0):
                    found = True
                elif own >= 0 and abs(range_m[other] - range_m[at]) > STEP_M:
                    x, y, z = beams[rays[other], 0], beams[rays[other], 1], beams[rays[other], 2]
                    dx, dy, dz = _turned(pose, x, y, z)
                    told = _on_plane(planes[base + own], ox, oy, oz, dx, dy, dz)
                    found = not _is_predicted(told, np.float64(range_m[other]))
        edge[at] = found


@per_ray
def _find_layers(address, firing, targets, blocks, block, casting, room, layers, used):
    """Write the layers of a block's beams from number ``used`` on; return how many there are."""
    actor = blocks.actor[block]
    scene, base = targets.scene[actor], targets.first_face[actor]
    low, high = targets.low, targets.high
    planes, vertices, corners = targets.triangles
    count, column_time, ring_time = (
        len(firing.column_time_s),
        firing.column_time_s,
        firing.ring_time_s,
    )
    beams, footprint = firing.directions, firing.footprint
    range_m, face, rays = room.hits.range_m, room.hits.face, blocks.ray
    poses, edges, surfaces, ray_hit = room.poses, room.edge, room.surfaces, room.ray
    whole = (1 << len(footprint)) - 1
    start = blocks.start[block]
    for at in range(start, start + blocks.rows[block] * blocks.wide[block]):
        own, ray, edge = face[at], rays[at], edges[at]
        if own == _NO_RAY:
            continue
        column, late = ray % count, ring_time[ray // count]
        if own >= 0:
            layers.seen[actor] += 1
            layers.seen_s[actor] += column_time[column] + late
        elif not edge:
            continue
        pose = poses[column]
        ox, oy, oz = _origin(pose, late)
        bx, by, bz = beams[ray, 0], beams[ray, 1], beams[ray, 2]
        ax, ay, az = _turned(pose, bx, by, bz)

        # Which surfaces the beam meets, and which of its rays meet each.
        met = 0
        if not edge and not (casting.glass and planes[base + own].pane):
            # Most beams: one opaque surface meets all of their light.
            surfaces.mask[0], surfaces.face[0] = whole, own
            surfaces.total_m[0], surfaces.rays[0] = range_m[at], 1
            met = 1
        for sample in range(0 if met else (len(footprint) if edge else 1)):
            x, y, z = _spread(bx, by, bz, footprint[sample, 0], footprint[sample, 1])
            dx, dy, dz = _turned(pose, x, y, z)
            bit = 1 << sample if edge else whole
            near = np.float32(0.0)
            for pane in range(MOST_PANES):
                if sample == 0 and pane == 0:
                    far, hit = range_m[at], own
                else:
                    far, hit = intersect(address, scene, ray_hit, near, ox, oy, oz, dx, dy, dz)
                    if hit >= 0 and abs(_slant(planes[base + hit], dx, dy, dz)) < GRAZING:
                        far, hit = first_met(
                            address, scene, ray_hit, vertices, corners[base:], near,
                            ox, oy, oz, dx, dy, dz,
                        )  # fmt: skip
                if hit < 0:
                    break
                joined = False
                for g in range(met):
                    if joined or surfaces.mask[g] & bit or not edge:
                        continue
                    other = planes[base + surfaces.face[g]]
                    told = _on_plane(other, ox, oy, oz, dx, dy, dz)
                    alike = planes[base + hit].pane == other.pane
                    if alike and _is_same_surface(told, np.float64(far)):
                        surfaces.mask[g] |= bit
                        surfaces.total_m[g] += far
                        surfaces.rays[g] += 1
                        joined = True
                if not joined and met < MOST_SURFACES:
                    surfaces.mask[met], surfaces.face[met] = bit, hit
                    surfaces.total_m[met], surfaces.rays[met] = far, 1
                    met += 1
                if not (casting.glass and planes[base + hit].pane):
                    break
                near = far + np.float32(BEHIND_M)

        # Each is a layer, at the range of its plane along the beam's axis.
        on_axis = 0
        if own >= 0 or _crosses(actor, low, high, ox, oy, oz, ax, ay, az):
            on_axis = ON_AXIS
        for g in range(met):
            mask, plane = surfaces.mask[g], planes[base + surfaces.face[g]]
            told = _on_plane(plane, ox, oy, oz, ax, ay, az)
            mean = surfaces.total_m[g] / surfaces.rays[g]
            if used < len(layers.ray):
                layers.ray[used], layers.actor[used] = ray, actor
                layers.mask[used] = mask | on_axis
                layers.range_m[used] = _layer_range(told, mean, mask & 1 == 1)
                layers.cosine[used] = abs(_slant(plane, ax, ay, az))
                layers.face[used] = surfaces.face[g]
            used += 1
    return used


@per_ray
def _origin(pose, late):
    """Return where a ray leaves that fires ``late`` after its column, actor's frame."""
    return pose.x + pose.u * late, pose.y + pose.v * late, pose.z + pose.w * late


@per_ray
def _turned(pose, x, y, z):
    """Return a direction of the sensor's frame in the actor's."""
    return (
        pose.xx * x + pose.xy * y + pose.xz * z,
        pose.yx * x + pose.yy * y + pose.yz * z,
        pose.zx * x + pose.zy * y + pose.zz * z,
    )


@per_ray
def _spread(x, y, z, across, up):
    """Return the direction of a ray beside a beam's axis, by angles across and up from it."""
    flat = np.sqrt(x * x + y * y)
    ex, ey = 0.0, 1.0
    if flat > 1e-9:
        ex, ey = -y / flat, x / flat
    # Across lies level; up is the beam's axis turned by a quarter.
    u = x + across * ex - up * z * ey
    v = y + across * ey + up * z * ex
    w = z + up * flat
    size = np.sqrt(u * u + v * v + w * w)
    return u / size, v / size, w / size


@per_ray
def _slant(plane, dx, dy, dz):
    """Return the cosine between a direction and a plane's normal."""
    return plane.x * dx + plane.y * dy + plane.z * dz


@per_ray
def _on_plane(plane, ox, oy, oz, dx, dy, dz):
    """Return where a ray meets a plane; ``nan`` where it grazes it."""
    height = plane.offset - (plane.x * ox + plane.y * oy + plane.z * oz)
    return _plane_range(height, _slant(plane, dx, dy, dz))


@per_ray
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
