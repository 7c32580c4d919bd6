"""Where a sensor is, as the actor of a block of rays sees it, when each column fires."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry.compiled import per_block, per_ray
from urbantwin.lidar.compiled.pose import APART_S, LATER_S, actor_from_sensor, set_pose

__all__ = ["PoseRoom", "leaves", "pose_room", "set_poses", "turned"]

#: ``asset_SE3_sensor`` when a column fires: the rotation's rows, the place, and how fast the sensor
#: goes past the actor, m/s, for the channels that fire later.
_POSE = np.dtype([(name, np.float64) for name in "xx xy xz yx yy yz zx zy zz x y z u v w".split()])


class _Scratch(NamedTuple):
    """Room for the poses that `set_poses` computes with."""

    actor_rotation: NDArray[np.float64]
    actor_place: NDArray[np.float64]
    later_rotation: NDArray[np.float64]
    later_place: NDArray[np.float64]
    relative: NDArray[np.float64]
    place: NDArray[np.float64]


class PoseRoom(NamedTuple):
    """The poses of a block's K columns.

    Attributes:
        poses: (K,) `_POSE` of the sensor as the block's actor sees it.
        done: (K,) int64, the block that the pose of a column is of.
        scratch: for one pose.
    """

    poses: NDArray[np.void]
    done: NDArray[np.int64]
    scratch: _Scratch


@per_block
def pose_room(columns):
    """Return room for the poses of so many columns."""
    return PoseRoom(
        np.empty(columns, _POSE),
        np.full(columns, -1, np.int64),
        _Scratch(
            np.empty((3, 3)),
            np.empty(3),
            np.empty((3, 3)),
            np.empty(3),
            np.empty((3, 3)),
            np.empty(3),
        ),
    )


@per_ray
def set_poses(firing, paths, blocks, block, room):
    """Write the poses of the columns that a block has rays of into a `PoseRoom`."""
    actor_rotation, actor_place, later_rotation, later_place, relative, place = room.scratch
    poses, done = room.poses, room.done
    actor, start = blocks.actor[block], blocks.start[block]
    count, moving = len(firing.column_time_s), len(firing.translation) > 1
    first = np.int64(0)
    for at in range(start, start + blocks.rows[block] * blocks.wide[block]):
        ray = np.int64(blocks.ray[at])
        if ray < 0:
            continue
        # Rays of a row are of one channel: a division for each would take as long as its pose.
        if not first <= ray < first + count:
            first = ray // count * count
        column = ray - first
        if done[column] == block:
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
def leaves(pose, late):
    """Return where a ray leaves that fires ``late`` after its column, actor's frame."""
    return pose.x + pose.u * late, pose.y + pose.v * late, pose.z + pose.w * late


@per_ray
def turned(pose, x, y, z):
    """Return a direction of the sensor's frame in the actor's."""
    return (
        pose.xx * x + pose.xy * y + pose.xz * z,
        pose.yx * x + pose.yy * y + pose.yz * z,
        pose.zx * x + pose.zy * y + pose.zz * z,
    )
