"""A bounding volume hierarchy of triangles, and first hits of rays in it, compiled by numba.

`intersect1` and `intersect8` are C functions with the arguments of Embree's ``rtcIntersect1`` and
``rtcIntersect8``. Compiled code that casts rays calls either library through an address, and does
not know which of the two it is (see `geometry.rays`).

The tree is binary and is built by the surface area heuristic over 16 bins of centroids along each
axis (Wald, "On fast construction of SAH-based bounding volume hierarchies", 2007). Its nodes are in
depth-first order, so the first child of a node is the next one (Pharr, Jakob and Humphreys,
"Physically Based Rendering", 4.3.4). Rays of a packet descend together: a node is visited if any of
them enters its box. The test of a box is in single precision and conservative (Ize, "Robust BVH ray
traversal", 2013). The test of a triangle is in double precision and watertight. It uses the three
edge functions of Woop, Benthin and Wald ("Watertight ray/triangle intersection", 2013). Written as
triple products, they have the same magnitude and opposite signs in the two triangles of an edge.

A tree is one block of 32-bit words, which contains all data of a traversal::

    0        start of the triangles, words
    16       nodes, 8 words each: lower and upper corner, then for an inner node its second child
             and -1 - the axis of its split, for a leaf its first triangle and their number
    word 0   triangles, 10 words each: three corners, number of the face

If a ray hits several triangles at the same range in single precision, the one with the lowest
number is the hit: it does not depend on the tree or on the other rays of a packet.
"""

import numpy as np
from llvmlite import ir
from numba import carray, cfunc, njit, types  # type: ignore[attr-defined]
from numba.core import cgutils
from numba.extending import intrinsic

from urbantwin.geometry.compiled import per_block
from urbantwin.geometry.compiled.packet import LANES

__all__ = ["build_tree", "intersect1", "intersect8"]

_HEADER, _NODE, _TRIANGLE = 16, 8, 10
#: Larger than any block of words: arrays over external memory need a length.
_MANY = 1 << 40

_BINS = 16
#: A node with at most this many triangles is a leaf if no split is cheaper; larger nodes are split.
_LARGEST_LEAF = 8
#: The cost of visiting a node, in tests of a triangle.
_VISIT_COST = 1.0
#: From this depth on nodes are split into halves: a tree is at most 32 levels deeper.
_DEEPEST_SAH = 64
_STACK = 96

#: 1 + 2 gamma(3) for single precision, with which a box is entered if exact arithmetic enters it.
_ROBUST = np.float32(1.0 + 6.0 * 2.0**-24 + 2.0**-23)
#: Minimum magnitude of direction components, so that no product of 0 and infinity occurs.
_LEAST = np.float32(1e-18)

# Words of Embree's ray, in rays of a packet: `geometry.compiled.intersect` and `packet`.
_ORIGIN, _NEAR, _DIRECTION, _FAR = 0, 3, 4, 8
#: The unused normal of the hit: it temporarily holds the inverse of the direction.
_INVERSE = 12
_FACE, _GEOMETRY = 17, 18

# Division by zero gives infinity, as in C; a check would prevent vectorised loops over lanes.
_inlined = njit(error_model="numpy", nogil=True, forceinline=True)


@intrinsic
def _stack(typingctx):
    """Return the address of memory for `_STACK` words on the machine's stack."""

    def codegen(context, builder, signature, args):
        room = cgutils.alloca_once(builder, ir.ArrayType(ir.IntType(32), _STACK))
        return builder.bitcast(room, ir.IntType(8).as_pointer())

    return types.voidptr(), codegen


@_inlined
def _prepare(floats, words, lanes):
    """Write the inverse directions of rays, and mark them as without a hit."""
    for lane in range(lanes):
        for axis in range(3):
            d = floats[(_DIRECTION + axis) * lanes + lane]
            if abs(d) < _LEAST:
                d = -_LEAST if d < np.float32(0.0) else _LEAST
            floats[(_INVERSE + axis) * lanes + lane] = np.float32(1.0) / d
        words[_GEOMETRY * lanes + lane] = -1
        words[_FACE * lanes + lane] = -1


@_inlined
def _enters(tree, at, rays, lanes):
    """Return whether any ray enters the box of a node before its nearest hit."""
    low_x, low_y, low_z = tree[at], tree[at + 1], tree[at + 2]
    high_x, high_y, high_z = tree[at + 3], tree[at + 4], tree[at + 5]
    entered = np.int32(0)
    for lane in range(lanes):
        x, y, z = rays[lane], rays[lanes + lane], rays[2 * lanes + lane]
        inverse_x = rays[_INVERSE * lanes + lane]
        inverse_y = rays[(_INVERSE + 1) * lanes + lane]
        inverse_z = rays[(_INVERSE + 2) * lanes + lane]
        a, b = (low_x - x) * inverse_x, (high_x - x) * inverse_x
        c, d = (low_y - y) * inverse_y, (high_y - y) * inverse_y
        e, f = (low_z - z) * inverse_z, (high_z - z) * inverse_z
        near, far = rays[_NEAR * lanes + lane], rays[_FAR * lanes + lane]
        near = max(near, a if a < b else b)
        far = min(far, b if a < b else a)
        near = max(near, c if c < d else d)
        far = min(far, d if c < d else c)
        near = max(near, e if e < f else f)
        far = min(far, f if e < f else e)
        entered |= np.int32(near <= far * _ROBUST)
    return entered != 0


@_inlined
def _meet(tree, at, face, rays, words, lanes):
    """Intersect rays with a triangle; write range and face if it is their first hit so far."""
    ax, ay, az = np.float64(tree[at]), np.float64(tree[at + 1]), np.float64(tree[at + 2])
    bx, by, bz = np.float64(tree[at + 3]), np.float64(tree[at + 4]), np.float64(tree[at + 5])
    cx, cy, cz = np.float64(tree[at + 6]), np.float64(tree[at + 7]), np.float64(tree[at + 8])
    ux, uy, uz = bx - ax, by - ay, bz - az
    vx, vy, vz = cx - ax, cy - ay, cz - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    for lane in range(lanes):
        x, y, z = rays[lane], rays[lanes + lane], rays[2 * lanes + lane]
        dx = np.float64(rays[_DIRECTION * lanes + lane])
        dy = np.float64(rays[(_DIRECTION + 1) * lanes + lane])
        dz = np.float64(rays[(_DIRECTION + 2) * lanes + lane])
        px, py, pz = ax - x, ay - y, az - z
        qx, qy, qz = bx - x, by - y, bz - z
        rx, ry, rz = cx - x, cy - y, cz - z
        # Side of each edge on which the ray passes.
        pq = dx * (py * qz - pz * qy) + dy * (pz * qx - px * qz) + dz * (px * qy - py * qx)
        qr = dx * (qy * rz - qz * ry) + dy * (qz * rx - qx * rz) + dz * (qx * ry - qy * rx)
        rp = dx * (ry * pz - rz * py) + dy * (rz * px - rx * pz) + dz * (rx * py - ry * px)
        slant = nx * dx + ny * dy + nz * dz
        range_m = np.float32((nx * px + ny * py + nz * pz) / slant)
        inside = ((pq >= 0.0) & (qr >= 0.0) & (rp >= 0.0)) | (
            (pq <= 0.0) & (qr <= 0.0) & (rp <= 0.0)
        )
        far, hit = rays[_FAR * lanes + lane], words[_FACE * lanes + lane]
        first = (range_m < far) | ((range_m == far) & (face < hit))
        met = inside & (slant != 0.0) & (range_m >= rays[_NEAR * lanes + lane]) & first
        rays[_FAR * lanes + lane] = range_m if met else far
        words[_FACE * lanes + lane] = face if met else hit


@_inlined
def _cast(tree_place, ray_place, lanes):
    """Find the first hits of rays; a lane with a negative maximum range is not cast."""
    tree, links = carray(tree_place, _MANY, np.float32), carray(tree_place, _MANY, np.int32)
    rays, words = carray(ray_place, _MANY, np.float32), carray(ray_place, _MANY, np.int32)
    stack = carray(_stack(), _STACK, np.int32)
    _prepare(rays, words, lanes)
    triangles = np.int64(links[0])
    depth, node = 0, np.int64(0)
    while True:
        at = _HEADER + _NODE * node
        if _enters(tree, at, rays, lanes):
            link, count = np.int64(links[at + 6]), links[at + 7]
            if count < 0:
                # The child that the first ray enters first.
                first, second = node + 1, link
                if rays[(_INVERSE - 1 - count) * lanes] < np.float32(0.0):
                    first, second = second, first
                stack[depth] = second
                depth += 1
                node = first
                continue
            for number in range(link, link + count):
                place = triangles + _TRIANGLE * number
                _meet(tree, place, links[place + 9], rays, words, lanes)
        if depth == 0:
            break
        depth -= 1
        node = np.int64(stack[depth])
    for lane in range(lanes):
        words[_GEOMETRY * lanes + lane] = -1 if words[_FACE * lanes + lane] < 0 else 0


@cfunc(types.void(*[types.voidptr] * 3), cache=True, error_model="numpy")
def intersect1(tree, ray, _arguments):
    """Find the first hit of a ray: as ``rtcIntersect1``, with a tree instead of a scene."""
    _cast(tree, ray, 1)


@cfunc(types.void(*[types.voidptr] * 4), cache=True, error_model="numpy")
def intersect8(valid, tree, rays, _arguments):
    """Find the first hits of eight rays: as ``rtcIntersect8``, with a tree instead of a scene."""
    cast, floats = carray(valid, LANES, np.int32), carray(rays, _MANY, np.float32)
    for lane in range(LANES):
        if cast[lane] == 0:
            floats[_FAR * LANES + lane] = np.float32(-1.0)
    _cast(tree, rays, LANES)


@per_block
def _area(box):
    """Return half of the surface of a box, (6,) lower and upper corner."""
    x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return x * y + y * z + z * x


@per_block
def _grow(box, other):
    """Extend a box (6,) to contain another."""
    for axis in range(3):
        box[axis] = min(box[axis], other[axis])
        box[3 + axis] = max(box[3 + axis], other[3 + axis])


@per_block
def _emptied(boxes):
    """Make boxes (..., 6) empty."""
    boxes[..., :3] = np.inf
    boxes[..., 3:] = -np.inf


@per_block
def _bin_of(boxes, triangle, axis, low, scale):
    """Return the bin of the centroid of a triangle's box."""
    centre = boxes[triangle, axis] + boxes[triangle, 3 + axis]
    return min(np.int64((centre - low) * scale), _BINS - 1)


@per_block
def _best_split(boxes, order, begin, end, bounds, bins, counts, right):
    """Return the axis, lower end and scale of the cheapest split, its bin, and its cost.

    The cost is the sum over both sides of surface times number of triangles; ``inf`` if all
    centroids coincide. ``bins`` (16, 6), ``counts`` (16,) and ``right`` (16,) are work arrays.
    """
    best = (0, 0.0, 0.0, 0)
    least = np.inf
    for axis in range(3):
        low, high = np.inf, -np.inf
        for n in range(begin, end):
            centre = boxes[order[n], axis] + boxes[order[n], 3 + axis]
            low, high = min(low, centre), max(high, centre)
        if not high > low:
            continue
        scale = _BINS / (high - low)
        if not np.isfinite(scale):
            continue
        _emptied(bins)
        counts[:] = 0
        for n in range(begin, end):
            number = _bin_of(boxes, order[n], axis, low, scale)
            counts[number] += 1
            _grow(bins[number], boxes[order[n]])
        _emptied(bounds)
        count = 0
        for number in range(_BINS - 1, 0, -1):
            _grow(bounds, bins[number])
            count += counts[number]
            right[number] = count * _area(bounds) if count else np.inf
        _emptied(bounds)
        count = 0
        for number in range(1, _BINS):
            _grow(bounds, bins[number - 1])
            count += counts[number - 1]
            if count:
                cost = count * _area(bounds) + right[number]
                if cost < least:
                    least = cost
                    best = (axis, low, scale, number)
    return best, least


@per_block
def build_tree(vertices, faces):
    """Return the words (W,) int32 of a tree, see above.

    A triangle with a corner that is infinite or ``nan`` is left out: no ray hits it.

    Args:
        vertices: (V, 3) float32, metres.
        faces: (F, 3) int32, indices of vertices.
    """
    boxes, order, count = np.empty((len(faces), 6)), np.empty(len(faces), np.int64), 0
    _emptied(boxes)
    for n in range(len(faces)):
        finite = True
        for corner in range(3):
            for axis in range(3):
                value = np.float64(vertices[faces[n, corner], axis])
                finite &= np.isfinite(value)
                boxes[n, axis] = min(boxes[n, axis], value)
                boxes[n, 3 + axis] = max(boxes[n, 3 + axis], value)
        if finite:
            order[count] = n
            count += 1
    nodes = np.empty((max(2 * count, 1), 6), np.float32)
    links = np.empty((max(2 * count, 1), 2), np.int32)
    used = 0
    bins, counts, right, bounds = (
        np.empty((_BINS, 6)),
        np.empty(_BINS, np.int64),
        np.empty(_BINS),
        np.empty(6),
    )
    # Nodes to create: their triangles, their depth, and the node whose second child they are.
    waiting = np.empty((_STACK, 4), np.int64)
    waiting[0] = 0, count, 0, -1
    depth = 1
    while depth:
        depth -= 1
        begin, end, level, parent = waiting[depth]
        node = used
        used += 1
        if parent >= 0:
            links[parent, 0] = node
        _emptied(bounds)
        for n in range(begin, end):
            _grow(bounds, boxes[order[n]])
        surface = _area(bounds)
        for k in range(6):
            nodes[node, k] = bounds[k]
        (axis, low, scale, number), cost = _best_split(
            boxes, order, begin, end, bounds, bins, counts, right
        )
        size = end - begin
        if size <= 1 or (
            size <= _LARGEST_LEAF and not cost + _VISIT_COST * surface < size * surface
        ):
            links[node] = begin, size
            continue
        middle = (begin + end) // 2
        if np.isfinite(cost) and level < _DEEPEST_SAH:
            middle, last = begin, end - 1
            while middle <= last:
                if _bin_of(boxes, order[middle], axis, low, scale) < number:
                    middle += 1
                else:
                    order[middle], order[last] = order[last], order[middle]
                    last -= 1
        links[node, 1] = -1 - axis
        waiting[depth] = middle, end, level + 1, node
        waiting[depth + 1] = begin, middle, level + 1, -1
        depth += 2
    return _words(vertices, faces, order[:count], nodes[:used], links[:used])


@per_block
def _words(vertices, faces, order, nodes, links):
    """Return the words of a tree from its nodes."""
    first = _HEADER + _NODE * len(nodes)
    words = np.zeros(first + _TRIANGLE * len(order), np.int32)
    floats = words.view(np.float32)
    words[0] = first
    for node in range(len(nodes)):
        at = _HEADER + _NODE * node
        for k in range(6):
            floats[at + k] = nodes[node, k]
        words[at + 6], words[at + 7] = links[node]
    for n in range(len(order)):
        at = first + _TRIANGLE * n
        for corner in range(3):
            for axis in range(3):
                floats[at + 3 * corner + axis] = vertices[faces[order[n], corner], axis]
        words[at + 9] = order[n]
    return words
