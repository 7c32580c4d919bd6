"""Edges: beams with a neighbour that meets another surface."""

import numpy as np

from urbantwin.geometry.compiled import per_ray
from urbantwin.lidar.casting import layer_rule
from urbantwin.lidar.casting.layer_rule import STEP_M
from urbantwin.lidar.compiled.sensor_pose import leaves, turned

__all__ = ["NO_RAY", "find_edges", "on_plane", "plane_range", "slant"]

plane_range = per_ray(layer_rule.plane_range)
_is_predicted = per_ray(layer_rule.is_predicted)

#: In place of a face: no ray is cast here.
NO_RAY = -2
#: Range of what meets nothing, beside the ranges of its neighbours, metres.
_FAR = np.float32(1e9)
#: Ranges that differ by less are no edge in single precision either.
_NEARLY_STEP = np.float32(0.999 * STEP_M)


@per_ray
def find_edges(firing, planes, blocks, block, around, range_m, face, poses, depth, edge):
    """Write which beams of a block have a neighbour that meets another surface.

    Args:
        firing: `tracer.Firing`.
        planes: (F,) `shapes.PLANE` of the block's actor and those after it.
        blocks: `tracer.Blocks`.
        block: its number.
        around: whether the last ray of a row is the neighbour of its first.
        range_m: (R,) float32, what the axes of all blocks' beams meet.
        face: (R,) int32, of the actor; -1 for nothing, `NO_RAY` where none is cast.
        poses: `sensor_pose.PoseRoom.poses` of the block.
        depth: (R,) float32, room.
        edge: (R,) bool, to write.
    """
    start, rows, wide = blocks.start[block], blocks.rows[block], blocks.wide[block]
    _find_steps(start, rows, wide, around, range_m, face, depth, edge)
    count, ring_time, beams = len(firing.column_time_s), firing.ring_time_s, firing.directions
    rays = blocks.ray
    channel, first = np.int64(0), np.int64(0)
    for row in range(rows):
        for n in range(wide):
            at = start + row * wide + n
            if not edge[at]:
                continue
            own, ray = face[at], np.int64(rays[at])
            # Rays of a row are of one channel.
            if not first <= ray < first + count:
                channel = ray // count
                first = channel * count
            pose = poses[ray - first]
            ox, oy, oz = leaves(pose, ring_time[channel])
            found = False
            for r in range(max(row - 1, 0), min(row + 2, rows)):
                for c in range(n - 1, n + 2):
                    if found or (not around and not 0 <= c < wide):
                        continue
                    other = start + r * wide + _wrapped(c, wide)
                    if face[other] == NO_RAY:
                        continue
                    if (face[other] < 0) != (own < 0):
                        found = True
                    elif own >= 0 and abs(range_m[other] - range_m[at]) > STEP_M:
                        to = rays[other]
                        dx, dy, dz = turned(pose, beams[to, 0], beams[to, 1], beams[to, 2])
                        told = on_plane(planes[own], ox, oy, oz, dx, dy, dz)
                        found = not _is_predicted(told, np.float64(range_m[other]))
            edge[at] = found


@per_ray
def _find_steps(start, rows, wide, around, range_m, face, depth, edge):
    """Write which beams have a neighbour about `STEP_M` nearer or farther, or that alone hits.

    The rest are no edges. The inner loop has no branches, and numba sees that its indices are not
    negative: it becomes vector instructions for eight beams.
    """
    for at in range(start, start + rows * wide):
        depth[at] = range_m[at] if face[at] >= 0 else (_FAR if face[at] == -1 else np.nan)
        edge[at] = False
    for row in range(rows):
        own = start + row * wide
        here, found = depth[own : own + wide], edge[own : own + wide]
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            beside = depth[start + r * wide : start + (r + 1) * wide]
            for n in range(1, wide - 1):
                steps = abs(beside[n - 1] - here[n]) > _NEARLY_STEP
                steps |= abs(beside[n] - here[n]) > _NEARLY_STEP
                steps |= abs(beside[n + 1] - here[n]) > _NEARLY_STEP
                found[n] |= steps
            for n in (0, wide - 1):
                for c in range(n - 1, n + 2):
                    if around or 0 <= c < wide:
                        found[n] |= abs(beside[_wrapped(c, wide)] - here[n]) > _NEARLY_STEP


@per_ray
def _wrapped(column, wide):
    """Return a column of a row that goes around, from one beside it."""
    if column < 0:
        return column + wide
    return column - wide if column >= wide else column


@per_ray
def slant(plane, dx, dy, dz):
    """Return the cosine between a direction and a plane's normal."""
    return plane.x * dx + plane.y * dy + plane.z * dz


@per_ray
def on_plane(plane, ox, oy, oz, dx, dy, dz):
    """Return where a ray meets a plane; ``nan`` where it grazes it."""
    height = plane.offset - (plane.x * ox + plane.y * oy + plane.z * oz)
    return plane_range(height, slant(plane, dx, dy, dz))
