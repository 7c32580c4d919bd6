"""Poses of actors and of sensors at the moments at which rays fire."""

import numpy as np

from urbantwin.geometry.compiled import per_block, per_ray

__all__ = ["APART_S", "LATER_S", "actor_from_sensor", "poses_at", "set_pose"]

#: Time step of the finite difference that gives an actor's speed relative to the sensor, seconds.
LATER_S = 1e-3
#: Columns that fire farther apart than this do not follow each other, seconds.
APART_S = 0.05


@per_ray
def set_pose(time, actor, paths, out_rotation, out_translation):
    """Write where an actor is at a time: rotation (3, 3) and translation (3,), site frame.

    Between two of its T knots it goes straight and turns about one axis at one speed; before the
    first and after the last it goes on so.

    Args:
        time: seconds from the frame's time.
        actor: which of the A actors; here and below arrays come whole, with a number: a part of
            an array that is handed on counts its owners, which costs as much as the work.
        paths: `actor_path.Paths`.
        out_rotation: (3, 3) to write.
        out_translation: (3,) to write.
    """
    knot_time, rotation, translation, turn = paths
    k = 0
    while k < knot_time.shape[1] - 2 and time >= knot_time[actor, k + 1]:
        k += 1
    start = knot_time[actor, k]
    share = (time - start) / (knot_time[actor, k + 1] - start)
    for i in range(3):
        step = translation[actor, k + 1, i] - translation[actor, k, i]
        out_translation[i] = translation[actor, k, i] + share * step
    x, y, z = share * turn[actor, k, 0], share * turn[actor, k, 1], share * turn[actor, k, 2]
    angle = np.sqrt(x * x + y * y + z * z)
    if angle < 1e-12:
        for i in range(3):
            for j in range(3):
                out_rotation[i, j] = rotation[actor, k, i, j]
        return
    x, y, z = x / angle, y / angle, z / angle
    c, s = np.cos(angle), np.sin(angle)
    v = 1.0 - c
    r00, r01, r02 = c + x * x * v, x * y * v - z * s, x * z * v + y * s
    r10, r11, r12 = y * x * v + z * s, c + y * y * v, y * z * v - x * s
    r20, r21, r22 = z * x * v - y * s, z * y * v + x * s, c + z * z * v
    for i in range(3):
        a = rotation[actor, k, i, 0]
        b = rotation[actor, k, i, 1]
        d = rotation[actor, k, i, 2]
        out_rotation[i, 0] = a * r00 + b * r10 + d * r20
        out_rotation[i, 1] = a * r01 + b * r11 + d * r21
        out_rotation[i, 2] = a * r02 + b * r12 + d * r22


@per_ray
def actor_from_sensor(
    actor_rotation, actor_place, n, sensor_rotation, sensor_place, out_rotation, out_place
):
    """Write ``asset_SE3_sensor`` of ``site_SE3_asset`` and the n-th ``site_SE3_sensor``."""
    for i in range(3):
        for j in range(3):
            out_rotation[i, j] = (
                actor_rotation[0, i] * sensor_rotation[n, 0, j]
                + actor_rotation[1, i] * sensor_rotation[n, 1, j]
                + actor_rotation[2, i] * sensor_rotation[n, 2, j]
            )
        out_place[i] = (
            actor_rotation[0, i] * (sensor_place[n, 0] - actor_place[0])
            + actor_rotation[1, i] * (sensor_place[n, 1] - actor_place[1])
            + actor_rotation[2, i] * (sensor_place[n, 2] - actor_place[2])
        )


@per_block
def poses_at(time, paths):
    """Return rotations (A, 3, 3) and translations (A, 3) of actors, each at a time (A,) of its own.

    ``paths`` are `actor_path.Paths`.
    """
    turned, moved = np.empty((len(time), 3, 3)), np.empty((len(time), 3))
    for a in range(len(time)):
        set_pose(time[a], a, paths, turned[a], moved[a])
    return turned, moved
