"""Rays that met an actor, carried along with it to where it stands in its box."""

import numpy as np

from urbantwin.geometry.compiled import per_block
from urbantwin.lidar.compiled.pose import actor_from_sensor, set_pose

__all__ = ["leaving"]


@per_block
def leaving(beam, actor, range_m, paths, firing, standing, margin):
    """Return the rays whose ends lie outside their actors' boxes: which, origins, unit vectors.

    Args:
        beam: (M,) int32.
        actor: (M,) int32, what each beam met.
        range_m: (M,) float32, where it ends.
        paths: `actor_path.Paths`.
        firing: `tracer.Firing`.
        standing: `standing.Standing`: where the actors stand then, and their boxes.
        margin: how far outside does not count, metres.

    Returns:
        Numbers (L,) int64 among the M rays; origins (3, L) and unit vectors (3, L) float64.
    """
    column_time, ring_time, beams = firing.column_time_s, firing.ring_time_s, firing.directions
    sensor_rotation, sensor_place = firing.rotation, firing.translation
    to_rotation, to_place, boxes = standing.rotation, standing.place, standing.boxes
    count = len(column_time)
    moving = len(sensor_place) > 1
    which = np.empty(len(beam), np.int64)
    origin, aim = np.empty((3, len(beam))), np.empty((3, len(beam)))
    actor_rotation, actor_place = np.empty((3, 3)), np.empty(3)
    relative, place = np.empty((3, 3)), np.empty(3)
    local, start, along = np.empty(3), np.empty(3), np.empty(3)
    cosine, sine = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
    found = 0
    for m in range(len(beam)):
        a, column = actor[m], beam[m] % count
        time = column_time[column] + ring_time[beam[m] // count]
        set_pose(time, a, paths, actor_rotation, actor_place)
        n = column if moving else 0
        actor_from_sensor(
            actor_rotation, actor_place, n, sensor_rotation, sensor_place, relative, place
        )
        for i in range(3):
            local[i] = (
                relative[i, 0] * beams[beam[m], 0]
                + relative[i, 1] * beams[beam[m], 1]
                + relative[i, 2] * beams[beam[m], 2]
            )
        for i in range(3):
            start[i], along[i] = to_place[a, i], 0.0
            for j in range(3):
                start[i] += to_rotation[a, i, j] * place[j]
                along[i] += to_rotation[a, i, j] * local[j]
        x = start[0] + along[0] * range_m[m] - boxes[a, 0]
        y = start[1] + along[1] * range_m[m] - boxes[a, 1]
        z = start[2] + along[2] * range_m[m] - boxes[a, 2]
        if (
            abs(x * cosine[a] + y * sine[a]) > boxes[a, 3] / 2 + margin
            or abs(y * cosine[a] - x * sine[a]) > boxes[a, 4] / 2 + margin
            or abs(z) > boxes[a, 5] / 2 + margin
        ):
            which[found] = m
            for i in range(3):
                origin[i, found], aim[i, found] = start[i], along[i]
            found += 1
    return which[:found], origin[:, :found], aim[:, :found]
