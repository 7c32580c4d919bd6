"""From every beam of a turn to what the sensor reports: one pass.

The same in numpy takes a dozen passes over arrays of a quarter of a million beams; it is what a
frame mostly costs where few actors are near.
"""

import numpy as np
from numba import njit

from urbantwin.lidar.compiled.echoes import BESIDE
from urbantwin.taxonomy import semantic_id

__all__ = ["gather", "write_points"]

#: Class of a point between an actor and what is behind it, which belongs to neither.
OUTLIER = np.uint16(semantic_id("outlier"))


@njit(cache=True, nogil=True)
def gather(static, second, moving, dead, draws, second_draws, quantiles, step_m, both, out):
    """Return how many returns there are, in the order of beams, and write them.

    Args:
        static: what each of N beams would report of the static world: level int32, range, sigma
            and intensity float32, semantic uint16.
        second: for each beam the number of its other echo (N,) int32 or -1, and these: the same
            five.
        moving: for each beam the number (N,) int32 of the place where its echoes stand, or -1
            where it touches no actor; first and second echo of each place (M,) int32; level,
            range, sigma, intensity, owner of echoes (E,); semantic of the static world's layers.
        dead: (N,) bool, beams that report nothing; or none at all.
        draws: detection and noise (N,) uint16.
        second_draws: the same for the other echo, where both are reported.
        quantiles: (65536,) float32, standard normal number of each draw of noise.
        step_m: float32, step that ranges are rounded to; 0 for none.
        both: whether the other echo is reported too, or only where the first is missed.
        out: beam int32, which echo uint8, source int32 (-1 the static world, else the number of
            the echo), semantic uint16, range float32 with noise (but not of echoes of actors),
            intensity float32; all (2 N,) or (N,).
    """
    level, range_m, sigma, intensity, semantic = static
    other, level_2, range_2, sigma_2, intensity_2, semantic_2 = second
    front, first_of, second_of, level_e, range_e, sigma_e, intensity_e, owner, layer_class = moving
    detection, noise = draws
    detection_2, noise_2 = second_draws
    out_beam, out_echo, out_source, out_class, out_range, out_intensity = out
    count = 0
    for beam in range(len(level)):
        if len(dead) and dead[beam]:
            continue
        place = front[beam]
        reported = 0
        for turn in range(2):
            if turn == 1 and reported == 1 and not both:
                break
            if turn == 1 and both:
                drawn, jitter = detection_2[beam], noise_2[beam]
            else:
                drawn, jitter = detection[beam], noise[beam]
            if place < 0:
                if turn == 0:
                    if drawn >= level[beam]:
                        continue
                    at, wide, bright = range_m[beam], sigma[beam], intensity[beam]
                    kind = semantic[beam]
                else:
                    n = other[beam]
                    if n < 0 or drawn >= level_2[n]:
                        break
                    at, wide, bright = range_2[n], sigma_2[n], intensity_2[n]
                    kind = semantic_2[n]
                source = -1
            else:
                source = first_of[place] if turn == 0 else second_of[place]
                if source < 0 or drawn >= level_e[source]:
                    continue
                at, wide, bright = range_e[source], sigma_e[source], intensity_e[source]
                kind = np.uint16(0)
                if owner[source] < 0:
                    kind = layer_class[-1 - owner[source]]
                elif owner[source] >= BESIDE:
                    kind = OUTLIER
            out_beam[count], out_echo[count], out_source[count] = beam, reported, source
            out_class[count], out_intensity[count] = kind, bright
            if source < 0 or owner[source] < 0 or owner[source] >= BESIDE:
                at = at + wide * quantiles[jitter]
                if step_m > 0:
                    at = np.float32(np.rint(at / step_m)) * step_m
            out_range[count] = at
            reported += 1
            count += 1
    return count


@njit(cache=True, nogil=True)
def write_points(beam, range_m, intensity, directions, origin, column_s, ring_s, out):
    """Write where beams end, which they are, and when they fired.

    Args:
        beam: (M,) int32, best in ascending order.
        range_m: (M,) float32.
        intensity: (M,) float32.
        directions: (3, N) float32, frame of the points.
        origin: (3, K) float32, where each column's beams leave, or (3, 1).
        column_s: (K,) float64, when columns fire, seconds.
        ring_s: (C,) float64, how much later each channel does.
        out: points (M, 4) float32, rings (M,) and columns (M,) uint16, times (M,) float32 to write.
    """
    points, rings, columns, times = out
    count = len(column_s)
    moving = origin.shape[1] > 1
    ring, first = 0, 0
    for m in range(len(beam)):
        n = beam[m]
        if not first <= n < first + count:
            ring = n // count
            first = ring * count
        column = n - first
        k = column if moving else 0
        for axis in range(3):
            points[m, axis] = directions[axis, n] * range_m[m] + origin[axis, k]
        points[m, 3] = intensity[m]
        rings[m], columns[m] = ring, column
        times[m] = column_s[column] + ring_s[ring]
