"""Votes of pieces of rings for the positions from which they may have been seen."""

import numpy as np
from numba import njit

__all__ = ["place_votes"]


@njit(cache=True, nogil=True)
def place_votes(middle, along, sigma, places, axis, coarse, seen_share, least_rise):
    """Return the log likelihood ratio of pieces as rings around positions, against chance.

    Args:
        middle: (P, 3) centres of the pieces, metres.
        along: (P, 3) their unit directions.
        sigma: (P,) standard deviation of their `standpoint.ring_residuals`, radians.
        places: (S, 3) sensor positions, metres.
        axis: (3,) unit vector of the rotation axis.
        coarse: standard deviation of the positions, metres: that of a coarse grid; 0 for exact
            ones.
        seen_share: prior share of the pieces that are the sensor's.
        least_rise: see `standpoint.RingResiduals`.

    Returns:
        (S,) sums over the pieces.
    """
    total = np.zeros(len(places))
    for i in range(len(places)):
        for k in range(len(middle)):
            x = middle[k, 0] - places[i, 0]
            y = middle[k, 1] - places[i, 1]
            z = middle[k, 2] - places[i, 2]
            flat = np.sqrt(x * x + y * y) + 1e-6
            away = np.sqrt(flat * flat + z * z)
            toward = (along[k, 0] * x + along[k, 1] * y + along[k, 2] * z) / away
            rise = (axis[0] * x + axis[1] * y + axis[2] * z) / away
            off = axis[0] * along[k, 0] + axis[1] * along[k, 1] + axis[2] * along[k, 2]
            off -= toward * rise
            steep = max(abs(z) / away, least_rise)
            spread = np.sqrt(sigma[k] ** 2 + (coarse / flat * steep) ** 2)
            odds = 1.2533 * steep / spread * np.exp(-0.5 * (off / spread) ** 2)
            total[i] += np.log(1 - seen_share + seen_share * odds)
    return total
