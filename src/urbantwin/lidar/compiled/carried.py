"""Rays that met an actor, carried along with it to where it stands in its box."""

import numpy as np

from urbantwin.geometry.compiled import per_block, per_ray
from urbantwin.lidar.compiled.pose import actor_from_sensor, set_pose
from urbantwin.lidar.compiled.report import quantised

__all__ = ["keep_inside", "span_in_box"]


@per_block
def keep_inside(detections, touching, draws, step_m, paths, firing, standing, margin):
    """Give detections of actors their noise where that leaves them inside their actors' boxes.

    Args:
        detections: `detections.Detections`; the ranges of those are written, in the sensor's steps.
        touching: `detections.Touching`, K of them.
        draws: `returns.draws.TurnDraws`.
        step_m: float32, step that ranges are rounded to; 0 for none.
        paths: `actor_path.Paths`.
        firing: `tracer.Firing`.
        standing: `standing.Standing`: where the actors stand then, and their boxes.
        margin: how far outside does not count, metres.

    Returns:
        The others' numbers (L,) int64 among the K, and where their rays enter and leave the boxes,
        (L,) float64 each, metres.
    """
    column_time, ring_time, beams = firing.column_time_s, firing.ring_time_s, firing.directions
    sensor_rotation, sensor_place = firing.rotation, firing.translation
    to_rotation, to_place, boxes = standing.rotation, standing.place, standing.boxes
    count, rows = len(column_time), len(touching.row)
    moving = len(sensor_place) > 1
    which = np.empty(rows, np.int64)
    enters, leaves = np.empty(rows), np.empty(rows)
    actor_rotation, actor_place = np.empty((3, 3)), np.empty(3)
    # Channels that fire together see the actor of a column alike: its pose is kept for them.
    relative, place = np.empty((count, 3, 3)), np.empty((count, 3))
    whose, when = np.full(count, -1, np.int32), np.empty(count)
    local, start, along = np.empty(3), np.empty(3), np.empty(3)
    cosine, sine = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
    found = 0
    for k in range(rows):
        row = touching.row[k]
        a, beam = detections.actor[row], detections.beam[row]
        if a < 0:
            continue
        noise = draws.first.noise if detections.echo[row] == 0 else draws.second.noise
        range_m = detections.range_m[row] + touching.sigma[k] * draws.quantiles[noise[beam]]
        column = beam % count
        time = column_time[column] + ring_time[beam // count]
        if whose[column] != a or when[column] != time:
            whose[column], when[column] = a, time
            set_pose(time, a, paths, actor_rotation, actor_place)
            n = column if moving else 0
            actor_from_sensor(
                actor_rotation, actor_place, n, sensor_rotation, sensor_place,
                relative[column], place[column],
            )  # fmt: skip
        for i in range(3):
            local[i] = (
                relative[column, i, 0] * beams[beam, 0]
                + relative[column, i, 1] * beams[beam, 1]
                + relative[column, i, 2] * beams[beam, 2]
            )
        for i in range(3):
            start[i], along[i] = to_place[a, i], 0.0
            for j in range(3):
                start[i] += to_rotation[a, i, j] * place[column, j]
                along[i] += to_rotation[a, i, j] * local[j]
        x = start[0] + along[0] * range_m - boxes[a, 0]
        y = start[1] + along[1] * range_m - boxes[a, 1]
        z = start[2] + along[2] * range_m - boxes[a, 2]
        if (
            abs(x * cosine[a] + y * sine[a]) > boxes[a, 3] / 2 + margin
            or abs(y * cosine[a] - x * sine[a]) > boxes[a, 4] / 2 + margin
            or abs(z) > boxes[a, 5] / 2 + margin
        ):
            which[found] = k
            enters[found], leaves[found] = span_in_box(start, along, boxes, a, cosine, sine, margin)
            found += 1
        else:
            detections.range_m[row] = quantised(range_m, step_m)
    return which[:found], enters[:found], leaves[:found]


@per_ray
def span_in_box(origin, aim, boxes, a, cosine, sine, margin):
    """Return where a ray enters and leaves one of the boxes, grown; beside it, first leaves it.

    Args:
        origin: (3,) where the ray leaves.
        aim: (3,) unit vector.
        boxes: (A, 7).
        a: number of the box.
        cosine: (A,) of the yaws of the boxes.
        sine: (A,) of the yaws of the boxes.
        margin: how much the box grows on every side, metres.
    """
    x, y, c, s = origin[0] - boxes[a, 0], origin[1] - boxes[a, 1], cosine[a], sine[a]
    enters, leaves = -np.inf, np.inf
    for start, along, size in (
        (x * c + y * s, aim[0] * c + aim[1] * s, boxes[a, 3]),
        (y * c - x * s, aim[1] * c - aim[0] * s, boxes[a, 4]),
        (origin[2] - boxes[a, 2], aim[2], boxes[a, 5]),
    ):
        half = size / 2 + margin
        # A ray along a face never meets the other two of its kind: infinitely far is right there.
        way = along if along != 0.0 else 1e-300
        one, other = (-half - start) / way, (half - start) / way
        enters, leaves = max(enters, min(one, other)), min(leaves, max(one, other))
    return enters, leaves
