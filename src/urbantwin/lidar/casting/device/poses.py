"""Poses of actors and sensors at the moments at which rays fire, on the device.

The same as ``compiled.pose``, which says what they mean.
"""

import warp as wp

from urbantwin.lidar.compiled.pose import APART_S, LATER_S

__all__ = ["Motion", "RayPose", "Turn", "pose_for"]

wp.set_module_options({"enable_backward": False, "fast_math": False})


@wp.struct
class Motion:
    """Knots of A actors' paths: times and poses (A, T), rotation vectors between (A, T - 1)."""

    time: wp.array2d(dtype=wp.float64)
    rotation: wp.array2d(dtype=wp.mat33d)
    place: wp.array2d(dtype=wp.vec3d)
    turn: wp.array2d(dtype=wp.vec3d)


@wp.struct
class Turn:
    """When rays fire, by column (K,) and channel (C,), and where the sensor is: (K,) or (1,)."""

    column_time: wp.array(dtype=wp.float64)
    ring_time: wp.array(dtype=wp.float64)
    rotation: wp.array(dtype=wp.mat33d)
    place: wp.array(dtype=wp.vec3d)


@wp.struct
class RayPose:
    """Where a ray leaves, and the rotation from the sensor's frame, in an actor's frame."""

    rotation: wp.mat33d
    origin: wp.vec3d


@wp.func
def actor_pose(motion: Motion, actor: wp.int32, time: wp.float64) -> RayPose:
    """Return where an actor is at a time, site frame."""
    last = motion.time.shape[1] - 2
    k = wp.int32(0)
    while k < last and time >= motion.time[actor, k + 1]:
        k += 1
    start = motion.time[actor, k]
    share = (time - start) / (motion.time[actor, k + 1] - start)
    pose = RayPose()
    place = motion.place[actor, k]
    pose.origin = place + share * (motion.place[actor, k + 1] - place)
    pose.rotation = motion.rotation[actor, k]
    turn = share * motion.turn[actor, k]
    angle = wp.length(turn)
    if angle >= wp.float64(1e-12):
        x, y, z = turn[0] / angle, turn[1] / angle, turn[2] / angle
        c, s = wp.cos(angle), wp.sin(angle)
        v = wp.float64(1.0) - c
        pose.rotation = pose.rotation @ wp.mat33d(
            c + x * x * v, x * y * v - z * s, x * z * v + y * s,
            y * x * v + z * s, c + y * y * v, y * z * v - x * s,
            z * x * v - y * s, z * y * v + x * s, c + z * z * v,
        )  # fmt: skip
    return pose


@wp.func
def pose_for(
    motion: Motion, turn: Turn, actor: wp.int32, column: wp.int32, ring: wp.int32
) -> RayPose:
    """Return the pose of a ray in the frame of an actor when it fires."""
    time = turn.column_time[column]
    moving = turn.place.shape[0] > 1
    n = wp.int32(0)
    if moving:
        n = column
    here = actor_pose(motion, actor, time)
    later = actor_pose(motion, actor, time + wp.float64(wp.static(LATER_S)))
    speed = -(later.origin - here.origin) / wp.float64(wp.static(LATER_S))
    if moving:
        m = (column + 1) % turn.column_time.shape[0]
        over = turn.column_time[m] - time
        if over > wp.float64(0.0) and over < wp.float64(wp.static(APART_S)):
            speed += (turn.place[m] - turn.place[n]) / over
    back = wp.transpose(here.rotation)
    pose = RayPose()
    pose.rotation = back @ turn.rotation[n]
    pose.origin = back @ (turn.place[n] - here.origin + turn.ring_time[ring] * speed)
    return pose
