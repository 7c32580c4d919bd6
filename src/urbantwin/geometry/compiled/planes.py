"""First hits on triangles found by a ray tracer, confirmed in double precision.

Embree, and the built-in tracer's tree, hold triangles in single precision.

If a ray grazes a surface, rounding of the surface's position by some micrometres moves the hit by
millimetres to metres; on the triangle's plane in double precision it does not move. If a ray is
parallel to a triangle's plane, the single-precision result is only rounding, and Embree may report
the triangle where it is not. Such a hit is skipped.
"""

import numpy as np

from urbantwin.geometry.compiled import per_block, per_ray
from urbantwin.geometry.compiled.intersect import intersect, new_ray

__all__ = ["cast_rays", "first_met", "range_on"]

#: Rounding error of a position in single precision, as a share of its distance from the ray's
#: origin.
_ROUNDING = 2.0**-20
#: Sine of the angle between ray and plane below which a triangle is seen from its edge.
_PARALLEL = 1e-12
#: A narrower triangle is a line, which no ray hits.
_THINNEST_M = 1e-9
#: Two surfaces closer to each other than this along a ray are not distinguished, metres.
_CLOSE_M = 1e-4
#: Maximum number of skipped triangles of a ray before it counts as without a hit.
_MOST_ALONG = 1000


@per_ray
def range_on(vertices, faces, face, ox, oy, oz, dx, dy, dz, found):
    """Return the range at which a ray hits a triangle; -1 if it misses.

    It is the range of the triangle's plane, limited to the part of the ray over the triangle,
    within rounding of its border. So a ray along an edge gets no hit far out on the plane.

    ``vertices`` (V, 3) float64 and ``faces`` (F, 3) int32 are triangles; ``face`` is the one that
    the ray tracer found. ``found`` is the range at which it was found; it is used if the ray is
    within the plane. The ray starts at o and has the direction d, a unit vector, float64.
    """
    a, b, c = vertices[faces[face, 0]], vertices[faces[face, 1]], vertices[faces[face, 2]]
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    area = np.sqrt(nx * nx + ny * ny + nz * nz)
    if area <= _THINNEST_M * np.sqrt(ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz):
        return -1.0
    slant = nx * dx + ny * dy + nz * dz
    height = nx * (a[0] - ox) + ny * (a[1] - oy) + nz * (a[2] - oz)
    at = found
    if abs(slant) > _PARALLEL * area:
        at = height / slant
    low, high, farthest = 0.0, np.inf, 0.0
    first, last = np.inf, -np.inf
    for corner in range(3):
        p = vertices[faces[face, corner]]
        q = vertices[faces[face, (corner + 1) % 3]]
        ex, ey, ez = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        # Across the edge, within the plane, inwards.
        mx, my, mz = ny * ez - nz * ey, nz * ex - nx * ez, nx * ey - ny * ex
        sx, sy, sz = ox - p[0], oy - p[1], oz - p[2]
        away = np.sqrt(sx * sx + sy * sy + sz * sz)
        farthest = max(farthest, away)
        along = -(sx * dx + sy * dy + sz * dz)
        first, last = min(first, along), max(last, along)
        wider = _ROUNDING * away * np.sqrt(mx * mx + my * my + mz * mz)
        start = mx * sx + my * sy + mz * sz + wider
        step = mx * dx + my * dy + mz * dz
        if step > 0.0:
            low = max(low, -start / step)
        elif step < 0.0:
            high = min(high, -start / step)
        elif start < 0.0:
            return -1.0
    # Borders extend beyond a sharp corner: limited to the range of the corners along the ray.
    border = _ROUNDING * farthest
    low, high = max(low, first - border), min(high, last + border)
    if low > high:
        return -1.0
    at = min(max(at, low), high)
    if abs(height - slant * at) > border * area:
        return -1.0
    return at


@per_ray
def first_met(address, scene, ray, vertices, faces, near, ox, oy, oz, dx, dy, dz):
    """Return range and face of the first hit beyond ``near``; ``inf`` and -1 without one.

    Like `intersect.intersect`, with ``vertices`` (V, 3) float64 and ``faces`` (F, 3) int32 of the
    scene.
    """
    x, y, z = np.float32(ox), np.float32(oy), np.float32(oz)
    best, owner = np.inf, np.int32(-1)
    for _ in range(_MOST_ALONG):
        found, face = intersect(
            address, scene, ray, near, x, y, z, np.float32(dx), np.float32(dy), np.float32(dz)
        )
        if face < 0 or found >= best:
            break
        at = range_on(vertices, faces, face, ox, oy, oz, dx, dy, dz, np.float64(found))
        if 0.0 <= at < best:
            best, owner = at, face
        if best - found <= _CLOSE_M:
            break
        # The hit is farther than reported: another triangle may be in front of it.
        near = np.nextafter(found, np.float32(np.inf))
    return np.float32(best), owner


@per_block
def cast_rays(address, scene, vertices, faces, origins, directions, hits):
    """Write the first `rays.Hits` of rays from origins (N, 3) float64."""
    ray = new_ray()
    for n in range(len(directions)):
        hits.range_m[n], hits.face[n] = first_met(
            address,
            scene,
            ray,
            vertices,
            faces,
            np.float32(0.0),
            origins[n, 0],
            origins[n, 1],
            origins[n, 2],
            np.float64(directions[n, 0]),
            np.float64(directions[n, 1]),
            np.float64(directions[n, 2]),
        )
