"""What beams meet: surfaces that fill the whole beam or, at edges, a part of it.

A beam is cast as one ray along its axis and, where its neighbours meet something else, as rays
spread over its footprint as well. A surface that several of a beam's rays meet is one layer: it
says which of the rays (bits of a mask), and the range at which the beam's axis meets its plane.
"""

import numpy as np
from numba import njit

from urbantwin.lidar.compiled.intersect import intersect, new_ray
from urbantwin.lidar.compiled.planes import first_met
from urbantwin.lidar.compiled.pose import actor_from_sensor, set_pose

__all__ = ["ON_AXIS", "cast_blocks"]

#: Bit of a layer's mask: the beam's axis passes through the bounds of the actor.
ON_AXIS = 1 << 7

#: Two rays meet the same surface where the plane of one's triangle predicts the other's range to
#: this, metres: what a curb, a bumper or a wheel stands out by.
_SAME_SURFACE_M = 0.1
#: A ray closer to a plane than this (sine of the angle) keeps the ray tracer's range.
_GRAZING = 1e-3
#: How much farther a ray starts behind a pane, metres.
_BEHIND_M = 2e-3
_MOST_PANES = 8
_MOST_GROUPS = 40


@njit(cache=True, nogil=True)
def _plane_range(n, normals, offsets, ox, oy, oz, dx, dy, dz):
    """Return where a ray meets a plane, ``nan`` where it grazes it, and the sine of the angle."""
    x, y, z = normals[n, 0], normals[n, 1], normals[n, 2]
    slant = x * dx + y * dy + z * dz
    if abs(slant) < _GRAZING:
        return np.nan, abs(slant)
    return (offsets[n] - (x * ox + y * oy + z * oz)) / slant, abs(slant)


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
def cast_blocks(
    address, blocks, rays, shapes, path, sensor_rotation, sensor_place, times, beams, footprint,
    options, room, layers,
):  # fmt: skip
    """Cast blocks of rays, each at its own actor, and write the layers that they meet.

    Args:
        address: of ``rtcIntersect1``.
        blocks: (B, 4) int64: actor, rows, columns, number of the first ray.
        rays: (R,) int32, rays of the blocks in rows of neighbours; -1 for none.
        shapes: what the A actors are made of: Embree's scenes (A,) uint64, first face of each in
            the next arrays (A,) int64, unit normals (F, 3) and offsets (F,) float64 of the planes,
            whether a triangle lets light through (F,) bool, vertices (V, 3) float64 and the
            triangles' corners among them (F, 3) int32, lower and upper corners (A, 3) of the
            bounds; all in the actors' frames.
        path: knots of all actors, see ``blocks.find_blocks``.
        sensor_rotation: (K, 3, 3) of ``site_SE3_sensor`` by column, or (1, 3, 3).
        sensor_place: (K, 3) or (1, 3).
        times: of columns (K,) and of channels within them (C,), seconds from the frame's time.
        beams: (N, 3) float64 unit vectors, sensor frame; N is C times K.
        footprint: (S, 2) float64, radians across and up from the axis; the first is the axis.
        options: whether rays pass through glass; how beams are spread over their footprint: 0 not
            at all, 1 where neighbours differ, 2 everywhere; whether a block goes around.
        room: pose scratch (K, 15) float64, stamps (K,) int64, ranges (R,) float32, faces (R,)
            int32; the stamps below ``room[4][0]`` are stale.
        layers: ray (L,) int32, actor (L,) int32, mask (L,) uint8 (with `ON_AXIS` where the beam's
            axis passes through the actor's bounds), range (L,) float32, cosine (L,) float32, face
            (L,) int32 (of the actor) to write.

    Returns:
        How many layers there are (written only while there is room), and for each actor the sum
        of the times (A,) at which beams' axes met it, and how many did (A,).
    """
    scenes, first_face, normals, offsets, panes, vertices, corners, lows, highs = shapes
    knot_time, rotation, translation, turns = path
    column_time, ring_time = times
    glass, spread, around = options
    pose, stamp, range_m, face, clock = room
    out_ray, out_actor, out_mask, out_range, out_cosine, out_face = layers
    count = len(column_time)
    moving = len(sensor_place) > 1
    samples = len(footprint)
    whole = np.uint8((1 << samples) - 1)
    ray_hit = new_ray()
    actors = len(scenes)
    seen_time, seen = np.zeros(actors), np.zeros(actors, np.int64)
    actor_rotation, actor_place = np.empty((3, 3)), np.empty(3)
    relative, place = np.empty((3, 3)), np.empty(3)
    later_rotation, later_place = np.empty((3, 3)), np.empty(3)
    group_mask = np.empty(_MOST_GROUPS, np.int64)
    group_face = np.empty(_MOST_GROUPS, np.int64)
    group_sum, group_count = np.empty(_MOST_GROUPS), np.empty(_MOST_GROUPS)
    used = 0
    for block in range(len(blocks)):
        actor, rows, wide, start = blocks[block]
        clock[0] += 1
        scene, base = scenes[actor], first_face[actor]
        for at in range(start, start + rows * wide):
            ray = rays[at]
            if ray < 0:
                face[at] = -2
                continue
            column, ring = ray % count, ray // count
            if stamp[column] != clock[0]:
                stamp[column] = clock[0]
                time = column_time[column]
                n = column if moving else 0
                set_pose(
                    time, actor, knot_time, rotation, translation, turns,
                    actor_rotation, actor_place,
                )  # fmt: skip
                actor_from_sensor(
                    actor_rotation, actor_place, n, sensor_rotation, sensor_place, relative,
                    place,
                )  # fmt: skip
                # How fast the sensor goes past the actor, for the channels that fire later.
                later = time + 1e-3
                set_pose(
                    later, actor, knot_time, rotation, translation, turns,
                    later_rotation, later_place,
                )  # fmt: skip
                m, over = n, 0.0
                if moving:
                    m = (column + 1) % count
                    over = column_time[m] - time
                    if not 0.0 < over < 0.05:
                        m, over = n, 0.0
                for i in range(3):
                    for j in range(3):
                        pose[column, 3 * i + j] = relative[i, j]
                    pose[column, 9 + i] = place[i]
                for i in range(3):
                    v = 0.0
                    for j in range(3):
                        own = 0.0
                        if over > 0.0:
                            own = (sensor_place[m, j] - sensor_place[n, j]) / over
                        gone = (later_place[j] - actor_place[j]) / 1e-3
                        v += actor_rotation[j, i] * (own - gone)
                    pose[column, 12 + i] = v
            late = ring_time[ring]
            x, y, z = beams[ray, 0], beams[ray, 1], beams[ray, 2]
            ox = pose[column, 9] + pose[column, 12] * late
            oy = pose[column, 10] + pose[column, 13] * late
            oz = pose[column, 11] + pose[column, 14] * late
            dx = pose[column, 0] * x + pose[column, 1] * y + pose[column, 2] * z
            dy = pose[column, 3] * x + pose[column, 4] * y + pose[column, 5] * z
            dz = pose[column, 6] * x + pose[column, 7] * y + pose[column, 8] * z
            met, hit = intersect(address, scene, ray_hit, np.float32(0.0), ox, oy, oz, dx, dy, dz)
            if hit >= 0:
                n = base + hit
                slant = normals[n, 0] * dx + normals[n, 1] * dy + normals[n, 2] * dz
                if abs(slant) < _GRAZING:
                    # Along a triangle single precision knows but rounding: see ``planes``.
                    met, hit = first_met(
                        address, scene, ray_hit, vertices, corners[base:], np.float32(0.0),
                        ox, oy, oz, dx, dy, dz,
                    )  # fmt: skip
            range_m[at], face[at] = met, hit
        for row in range(rows):
            for n in range(wide):
                at = start + row * wide + n
                if face[at] == -2:
                    continue
                ray = rays[at]
                column = ray % count
                late = ring_time[ray // count]
                ox, oy, oz = (
                    pose[column, 9] + pose[column, 12] * late,
                    pose[column, 10] + pose[column, 13] * late,
                    pose[column, 11] + pose[column, 14] * late,
                )
                own = face[at]
                edge = spread == 2
                if spread == 1:
                    for r in range(max(row - 1, 0), min(row + 2, rows)):
                        for c in range(n - 1, n + 2):
                            if edge or (not around and not 0 <= c < wide):
                                continue
                            other = start + r * wide + c % wide
                            if face[other] == -2:
                                continue
                            if (face[other] < 0) != (own < 0):
                                edge = True
                            elif own >= 0 and abs(range_m[other] - range_m[at]) > 0.3:
                                x = beams[rays[other], 0]
                                y = beams[rays[other], 1]
                                z = beams[rays[other], 2]
                                told, _ = _plane_range(
                                    base + own, normals, offsets, ox, oy, oz,
                                    pose[column, 0] * x + pose[column, 1] * y + pose[column, 2] * z,
                                    pose[column, 3] * x + pose[column, 4] * y + pose[column, 5] * z,
                                    pose[column, 6] * x + pose[column, 7] * y + pose[column, 8] * z,
                                )  # fmt: skip
                                edge = not abs(told - range_m[other]) < 3 * _SAME_SURFACE_M
                if own >= 0:
                    seen[actor] += 1
                    seen_time[actor] += column_time[column] + late
                elif not edge:
                    continue
                bx, by, bz = beams[ray, 0], beams[ray, 1], beams[ray, 2]
                if not edge and not (glass and panes[base + own]):
                    # Most beams: one opaque surface meets all of their light.
                    told, cosine = _plane_range(
                        base + own, normals, offsets, ox, oy, oz,
                        pose[column, 0] * bx + pose[column, 1] * by + pose[column, 2] * bz,
                        pose[column, 3] * bx + pose[column, 4] * by + pose[column, 5] * bz,
                        pose[column, 6] * bx + pose[column, 7] * by + pose[column, 8] * bz,
                    )  # fmt: skip
                    if not abs(told - range_m[at]) < 10 * _SAME_SURFACE_M:
                        told = np.float64(range_m[at])
                    if used < len(out_ray):
                        out_ray[used], out_actor[used] = ray, actor
                        out_mask[used] = whole | np.uint8(ON_AXIS)
                        out_range[used], out_cosine[used] = told, cosine
                        out_face[used] = own
                    used += 1
                    continue
                groups = 0
                flat = np.sqrt(bx * bx + by * by)
                ex, ey = 0.0, 1.0
                if flat > 1e-9:
                    ex, ey = -by / flat, bx / flat
                for sample in range(samples if edge else 1):
                    across, up = footprint[sample, 0], footprint[sample, 1]
                    # Across lies level; up is the beam's axis turned by a quarter.
                    x = bx + across * ex - up * bz * ey
                    y = by + across * ey + up * bz * ex
                    z = bz + up * flat
                    size = np.sqrt(x * x + y * y + z * z)
                    x, y, z = x / size, y / size, z / size
                    dx = pose[column, 0] * x + pose[column, 1] * y + pose[column, 2] * z
                    dy = pose[column, 3] * x + pose[column, 4] * y + pose[column, 5] * z
                    dz = pose[column, 6] * x + pose[column, 7] * y + pose[column, 8] * z
                    bit = 1 << sample if edge else int(whole)
                    near = np.float32(0.0)
                    for pane in range(_MOST_PANES):
                        if sample == 0 and pane == 0:
                            met, hit = range_m[at], own
                        else:
                            met, hit = intersect(
                                address, scene, ray_hit, near, ox, oy, oz, dx, dy, dz
                            )
                            if hit >= 0:
                                m = base + hit
                                slant = normals[m, 0] * dx + normals[m, 1] * dy + normals[m, 2] * dz
                                if abs(slant) < _GRAZING:
                                    met, hit = first_met(
                                        address, scene, ray_hit, vertices, corners[base:], near,
                                        ox, oy, oz, dx, dy, dz,
                                    )  # fmt: skip
                        if hit < 0:
                            break
                        joined = False
                        for g in range(groups):
                            if group_mask[g] & bit or not edge:
                                continue
                            told, _ = _plane_range(
                                base + group_face[g], normals, offsets,
                                ox, oy, oz, dx, dy, dz,
                            )  # fmt: skip
                            if abs(told - met) < _SAME_SURFACE_M and (
                                panes[base + hit] == panes[base + group_face[g]]
                            ):
                                group_mask[g] |= bit
                                group_sum[g] += met
                                group_count[g] += 1
                                joined = True
                                break
                        if not joined and groups < _MOST_GROUPS:
                            group_mask[groups], group_face[groups] = bit, hit
                            group_sum[groups], group_count[groups] = met, 1
                            groups += 1
                        if not (glass and panes[base + hit]):
                            break
                        near = met + np.float32(_BEHIND_M)
                dx = pose[column, 0] * bx + pose[column, 1] * by + pose[column, 2] * bz
                dy = pose[column, 3] * bx + pose[column, 4] * by + pose[column, 5] * bz
                dz = pose[column, 6] * bx + pose[column, 7] * by + pose[column, 8] * bz
                on_axis = 0
                if own >= 0 or _crosses(actor, lows, highs, ox, oy, oz, dx, dy, dz):
                    on_axis = ON_AXIS
                for g in range(groups):
                    hit = group_face[g]
                    told, cosine = _plane_range(
                        base + hit, normals, offsets, ox, oy, oz, dx, dy, dz
                    )
                    mean = group_sum[g] / group_count[g]
                    if not group_mask[g] & 1 or not abs(told - mean) < 10 * _SAME_SURFACE_M:
                        told = mean
                    if used < len(out_ray):
                        out_ray[used], out_actor[used] = ray, actor
                        out_mask[used] = group_mask[g] | on_axis
                        out_range[used] = told
                        out_cosine[used] = cosine
                        out_face[used] = hit
                    used += 1
    return used, seen_time, seen
