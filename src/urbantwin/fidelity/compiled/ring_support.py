"""Support of points by their neighbours on rings of one sensor."""

import numpy as np
from numba import njit

__all__ = ["ring_support"]


@njit(cache=True, nogil=True)
def ring_support(channel, azimuth, range_m, off, weight, wide, range_share, off_most):
    """Return for each point the weight of its neighbours on the ring.

    Args:
        channel: (N,) sorted.
        azimuth: (N,) radians, sorted within a channel.
        range_m: (N,) ranges, metres.
        off: (N,) elevation residuals of the channel, degrees.
        weight: (N,) probability that a point is the sensor's.
        wide: largest difference of azimuths, radians.
        range_share: largest difference of ranges, as a share of the range, beside 0.1 m.
        off_most: largest difference of elevation residuals, degrees.

    Returns:
        (N,) sums of weights without the point itself.
    """
    count = len(channel)
    total = np.zeros(count)
    first = 0
    for i in range(count):
        while channel[first] != channel[i] or azimuth[first] < azimuth[i] - wide:
            first += 1
        j = first
        reach = 0.1 + range_share * range_m[i]
        while j < count and channel[j] == channel[i] and azimuth[j] <= azimuth[i] + wide:
            if j != i and abs(range_m[j] - range_m[i]) < reach and abs(off[j] - off[i]) < off_most:
                total[i] += weight[j]
            j += 1
    return total
