"""Grouping of layers by beam."""

import numpy as np

from urbantwin.geometry.compiled import per_block

__all__ = ["by_ray", "chained"]


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
def chained(ray, head, before):
    """Chain the entries of each ray, and return the rays that have any (M,) int32, ascending.

    Args:
        ray: (L,) int32, the ray of each entry.
        head: (N,) int32, all -1; the last entry of each ray, to write.
        before: (L,) int32, the entry before along the same ray or -1, to write.
    """
    count = 0
    for n in range(len(ray)):
        if head[ray[n]] < 0:
            count += 1
        before[n] = head[ray[n]]
        head[ray[n]] = n
    touched = np.empty(count, np.int32)
    used = 0
    for n in range(len(head)):
        if head[n] >= 0:
            touched[used] = n
            used += 1
    return touched
