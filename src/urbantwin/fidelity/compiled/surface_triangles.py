"""Selection of the triangles of a triangulation by direction that can be a visible surface."""

import numpy as np
from numba import njit

__all__ = ["can_be_surface"]


@njit(cache=True, nogil=True)
def can_be_surface(angles, seen, corner, index, most_angle, most_edge, least_sine, least_level):
    """Return the mask (T,) of triangles that are small, not seen edge-on, and not duplicates.

    Args:
        angles: (A, 2) azimuth and elevation of the directions, radians.
        seen: (N, 3) points from the sensor, metres.
        corner: (T, 3) directions of each triangle.
        index: (A,) point of each direction.
        most_angle: largest difference of azimuth or elevation, radians.
        most_edge: longest edge, metres.
        least_sine: minimum sine of the angle between the triangle and the line of sight, ...
        least_level: ... or minimum vertical share of the normal.
    """
    found = np.zeros(len(corner), np.bool_)
    for t in range(len(corner)):
        i, j, k = corner[t]
        narrow = True
        for axis in range(2):
            u, v, w = angles[i, axis], angles[j, axis], angles[k, axis]
            narrow &= max(u, v, w) - min(u, v, w) <= most_angle
        # Strips are repeated beyond the seam: a triangle is kept where its centre is.
        middle = (angles[i, 0] + angles[j, 0] + angles[k, 0]) / 3
        if not narrow or middle < -np.pi or middle >= np.pi:
            continue
        a, b, c = seen[index[i]], seen[index[j]], seen[index[k]]
        px, py, pz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        qx, qy, qz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        third = (qx - px) ** 2 + (qy - py) ** 2 + (qz - pz) ** 2
        longest = max(px * px + py * py + pz * pz, qx * qx + qy * qy + qz * qz, third)
        nx, ny, nz = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
        size = np.sqrt(nx * nx + ny * ny + nz * nz)
        if longest > most_edge * most_edge or size == 0.0:
            continue
        sight = np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
        facing = abs(nx * a[0] + ny * a[1] + nz * a[2]) >= least_sine * size * sight
        found[t] = facing or abs(nz) >= least_level * size
    return found
