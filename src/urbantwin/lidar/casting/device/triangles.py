"""Rays against triangles in double precision, on the device.

NVIDIA Warp compiles these functions for CUDA or for the processor. A bounding volume hierarchy in
single precision, its boxes grown by more than any rounding, gives the triangles that a ray may
meet; whether and where it does is decided in double precision. A ray that passes within
`EDGE_M` of a triangle's border meets it, so none slips through the edge of two triangles.
"""

import warp as wp

__all__ = ["EDGE_M", "FirstHit", "Meshes", "first_hit"]

#: A triangle is wider by this on all sides than its vertices say, metres: far more than double
#: precision loses within kilometres, far less than anybody sees. One that is less wide is a line,
#: which no ray meets.
EDGE_M = 1e-9
#: Sine of the angle between ray and plane below which a triangle is seen from its edge: not hit.
_PARALLEL = 1e-12
#: What boxes are grown by: single precision rounds a place to 2^-24 of it, a few times.
_GROWN = 2.0**-20
_LEAST_GROWN_M = 1e-6

wp.set_module_options({"enable_backward": False, "fast_math": False})


@wp.struct
class Meshes:
    """Meshes end to end.

    Attributes:
        tree: of each mesh, the hierarchy of its triangles' boxes.
        first_face: of each mesh.
        extent: of each mesh, the farthest that a vertex is from the frame's origin, metres.
        vertices: of all meshes.
        faces: of all meshes, by numbers of all vertices.
    """

    tree: wp.array(dtype=wp.uint64)
    first_face: wp.array(dtype=wp.int32)
    extent: wp.array(dtype=wp.float64)
    vertices: wp.array(dtype=wp.vec3d)
    faces: wp.array(dtype=wp.vec3i)


@wp.struct
class FirstHit:
    """The first triangle along a ray: its range, ``inf`` without one, and its number or -1."""

    range_m: wp.float64
    face: wp.int32


@wp.func
def is_within(place: wp.vec3d, p: wp.vec3d, q: wp.vec3d, normal: wp.vec3d) -> wp.bool:
    """Return whether a place on a triangle's plane is inside its edge from p to q."""
    inward = wp.cross(normal, q - p)
    aside = wp.dot(inward, place - p)
    edge = wp.float64(wp.static(EDGE_M))
    return aside >= wp.float64(0.0) or aside * aside <= edge * edge * wp.dot(inward, inward)


@wp.func
def triangle_range(
    origin: wp.vec3d, direction: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d
) -> wp.float64:
    """Return the distance along a ray to a triangle; -1 where they do not meet."""
    none = wp.float64(-1.0)
    u, v = b - a, c - a
    normal = wp.cross(u, v)
    slant = wp.dot(normal, direction)
    area = wp.dot(normal, normal)
    if slant * slant <= wp.float64(wp.static(_PARALLEL**2)) * area:
        return none
    if area <= wp.float64(wp.static(EDGE_M**2)) * (wp.dot(u, u) + wp.dot(v, v)):
        return none
    at = wp.dot(normal, a - origin) / slant
    if at < wp.float64(0.0):
        return none
    place = origin + at * direction
    # Beyond a sharp corner the widened borders run on.
    edge = wp.float64(wp.static(EDGE_M))
    low, high = wp.min(wp.min(a, b), c), wp.max(wp.max(a, b), c)
    for axis in range(3):
        if place[axis] < low[axis] - edge or place[axis] > high[axis] + edge:
            return none
    if (
        is_within(place, a, b, normal)
        and is_within(place, b, c, normal)
        and is_within(place, c, a, normal)
    ):
        return at
    return none


@wp.func
def first_hit(
    meshes: Meshes, mesh: wp.int32, origin: wp.vec3d, direction: wp.vec3d, near: wp.float64
) -> FirstHit:
    """Return the first triangle of a mesh along a ray; of several at one range, the first in order.

    Args:
        meshes: all meshes.
        mesh: which one.
        origin: where the ray leaves, in the mesh's frame.
        direction: a unit vector.
        near: triangles before it are left out.
    """
    best = FirstHit()
    best.range_m = wp.float64(wp.inf)
    best.face = wp.int32(-1)
    base = meshes.first_face[mesh]
    radius = wp.float32(
        wp.float64(wp.static(_LEAST_GROWN_M))
        + wp.float64(wp.static(_GROWN)) * (meshes.extent[mesh] + wp.length(origin))
    )
    reach = wp.float32(wp.inf)
    query = wp.bvh_query_capsule(meshes.tree[mesh], wp.vec3(origin), wp.vec3(direction), radius)
    number = wp.int32(0)
    while wp.bvh_query_next(query, number, reach):
        corner = meshes.faces[base + number]
        at = triangle_range(
            origin,
            direction,
            meshes.vertices[corner[0]],
            meshes.vertices[corner[1]],
            meshes.vertices[corner[2]],
        )
        if at < near:
            continue
        if at < best.range_m or (at == best.range_m and number < best.face):
            best.range_m = at
            best.face = number
            # Single precision measures where the ray enters a box to 1e-6 of the distance.
            reach = wp.float32(at) * 1.00001 + radius
    return best
