"""From every ray of a sensor to the points that it reports: one pass, compiled.

The same in numpy takes a dozen passes over arrays of a quarter of a million rays; it is what a
frame mostly costs where few actors are near.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from urbantwin.lidar.returns import Draws

__all__ = ["Reported", "StaticReturns", "gather"]


class StaticReturns(NamedTuple):
    """What each of N rays would report of the static world; nothing here changes between frames.

    Attributes:
        directions: (3, N) float32, dataset frame.
        origin: (3,) float32, where the rays leave, dataset frame, metres.
        range_m: (N,) float32.
        sigma: (N,) float32, standard deviation of the range, metres.
        intensity: (N,) float32.
        semantic: (N,) uint16.
        step_m: float32, step that ranges are rounded to; 0 for none.
        columns: rays per ring.
    """

    directions: NDArray[np.float32]
    origin: NDArray[np.float32]
    range_m: NDArray[np.float32]
    sigma: NDArray[np.float32]
    intensity: NDArray[np.float32]
    semantic: NDArray[np.uint16]
    step_m: np.float32
    columns: int


class Reported(NamedTuple):
    """M returns in the order of their rays.

    Attributes:
        points: (M, 4) float32; a row is unset where an actor was hit.
        ray: (M,) int32.
        front: (M,) int32, what ``gather`` was told of the ray: -1 for the static world.
        semantic: (M,) uint16; unset where an actor was hit.
        ring: (M,) uint16.
        column: (M,) uint16.
    """

    points: NDArray[np.float32]
    ray: NDArray[np.int32]
    front: NDArray[np.int32]
    semantic: NDArray[np.uint16]
    ring: NDArray[np.uint16]
    column: NDArray[np.uint16]


def gather(
    static: StaticReturns,
    level: NDArray[np.int32],
    front: NDArray[np.int32],
    draws: Draws,
    quantiles: NDArray[np.float32],
) -> Reported:
    """Return what comes back.

    Args:
        static: the static world along the rays.
        level: (N,) the level below which a ray's draw means a return.
        front: (N,) -1 where a ray hits the static world first, else the number of an actor's hit.
        draws: the random numbers of the frame.
        quantiles: (65536,) standard normal number of each draw of noise.
    """
    rays = len(level)
    reported = Reported(
        np.empty((rays, 4), np.float32),
        np.empty(rays, np.int32),
        np.empty(rays, np.int32),
        np.empty(rays, np.uint16),
        np.empty(rays, np.uint16),
        np.empty(rays, np.uint16),
    )
    count = _gather(*static, level, front, draws.detection, draws.noise, quantiles, *reported)
    return Reported(
        reported.points[:count],
        reported.ray[:count],
        reported.front[:count],
        reported.semantic[:count],
        reported.ring[:count],
        reported.column[:count],
    )


@njit(cache=True, nogil=True)
def _gather(  # type: ignore[no-untyped-def]  # noqa: ANN202, PLR0913, PLR0917
    directions, origin, range_m, sigma, intensity, semantic, step_m, columns,  # noqa: ANN001
    level, front, detection, noise, quantiles,  # noqa: ANN001
    points, ray_out, front_out, semantic_out, ring_out, column_out,  # noqa: ANN001
):  # fmt: skip
    count = 0
    for ray in range(len(level)):
        if detection[ray] < level[ray]:
            ray_out[count] = ray
            front_out[count] = front[ray]
            ring = ray // columns
            ring_out[count] = ring
            column_out[count] = ray - ring * columns
            if front[ray] < 0:
                measured = range_m[ray] + sigma[ray] * quantiles[noise[ray]]
                if step_m > 0:
                    measured = np.float32(np.rint(measured / step_m)) * step_m
                for axis in range(3):
                    points[count, axis] = directions[axis, ray] * measured + origin[axis]
                points[count, 3] = intensity[ray]
                semantic_out[count] = semantic[ray]
            count += 1
    return count
