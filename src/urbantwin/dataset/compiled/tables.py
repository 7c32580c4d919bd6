"""Labels, rays and attributes of a frame's points, in the layout of its files."""

import numpy as np

from urbantwin.geometry.compiled import per_ray

__all__ = ["write_tables"]


@per_ray
def write_tables(frame, told):
    """Write the tables of M points, and count and measure them, in one pass.

    Args:
        frame: points (M, 4) float32, then semantic, instance, sensor, ring, column, time_s and echo
            (M,), as `lidar.LabelledFrame` has them.
        told: `layout.FrameTables` to write: its counts are added to, its bounds widened.
    """
    labels, rays, points_of, bounds = told
    points, semantic, instance, sensor, ring, column, time_s, echo = frame
    x, y, z = bounds[0]
    far_x, far_y, far_z = bounds[1]
    last, run = np.uint16(0), 0
    for n in range(len(points)):
        one = semantic[n]
        labels[n] = np.uint32(instance[n]) << np.uint32(16) | np.uint32(one)
        ray = rays[n]
        ray.sensor, ray.ring, ray.column = sensor[n], ring[n], column[n]
        ray.time, ray.echo = time_s[n], echo[n]
        px, py, pz = points[n, 0], points[n, 1], points[n, 2]
        x, y, z = min(x, px), min(y, py), min(z, pz)
        far_x, far_y, far_z = max(far_x, px), max(far_y, py), max(far_z, pz)
        # Neighbours are mostly of one class: counting each by itself would wait for the last.
        if one != last:
            points_of[last] += run
            last, run = one, 0
        run += 1
    points_of[last] += run
    bounds[0, 0], bounds[0, 1], bounds[0, 2] = x, y, z
    bounds[1, 0], bounds[1, 1], bounds[1, 2] = far_x, far_y, far_z
