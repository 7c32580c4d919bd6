"""Layers in the order of beams."""

import numpy as np

from urbantwin.geometry.compiled import per_block

__all__ = ["by_ray", "chained", "in_order"]


@per_block
def by_ray(ray, rays):
    """Return where each ray's entries begin (N + 1,) and the order (L,) that puts them together.

    Entries of a ray keep their order.

    Args:
        ray: (L,) int32, the ray of each entry.
        rays: N.
    """
    start = np.zeros(rays + 1, np.int64)
    for n in range(len(ray)):
        start[ray[n] + 1] += 1
    for n in range(rays):
        start[n + 1] += start[n]
    place = start[:-1].copy()
    order = np.empty(len(ray), np.int64)
    for n in range(len(ray)):
        order[place[ray[n]]] = n
        place[ray[n]] += 1
    return start, order


@per_block
def chained(ray, place, before):
    """Chain the entries of each ray.

    Args:
        ray: (L,) int32, the ray of each entry.
        place: (N,) int32, all -1; the number of each ray among those that have any, to write.
        before: (L,) int32, the entry before along the same ray or -1, to write.

    Returns:
        The M rays that have any, (M,) int32, ascending, and the last entry of each (M,) int32.
    """
    count = 0
    for n in range(len(ray)):
        if place[ray[n]] < 0:
            count += 1
        before[n] = place[ray[n]]
        place[ray[n]] = n
    touched, last = np.empty(count, np.int32), np.empty(count, np.int32)
    used = 0
    for n in range(len(place)):
        if place[n] >= 0:
            touched[used], last[used] = n, place[n]
            place[n] = used
            used += 1
    return touched, last


@per_block
def in_order(found, ray, layers):
    """Write layers that were found in any order in the order of the rays that met them.

    Args:
        found: (L,) records ``device.cast.Layer``; those of one ray are next to each other.
        ray: (R,) int32, the beam of each ray.
        layers: `tracer.Layers` with room for them, to write.
    """
    first, count = np.full(len(ray), -1, np.int32), len(found)
    for n in range(count):
        if n == 0 or found[n].at != found[n - 1].at:
            first[found[n].at] = n
    used = 0
    for at in range(len(ray)):
        n = first[at]
        while 0 <= n < count and found[n].at == at:
            layer = found[n]
            layers.ray[used], layers.actor[used] = ray[at], layer.actor
            layers.mask[used], layers.face[used] = layer.mask, layer.face
            layers.range_m[used], layers.cosine[used] = layer.range_m, layer.cosine
            used, n = used + 1, n + 1
