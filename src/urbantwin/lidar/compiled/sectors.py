"""Places between the lowest and the highest beam of their sector of azimuth."""

import numpy as np

from urbantwin.geometry.compiled import per_block

__all__ = ["in_sectors"]


@per_block
def in_sectors(directions, range_m, low, high, nearest, farthest):
    """Return which places (N,) lie in a field of view.

    Args:
        directions: (N, 3) unit vectors.
        range_m: (N,) distances.
        low: (S,) lowest elevation of each sector, from azimuth -pi on, radians.
        high: (S,) highest.
        nearest: distance that is seen.
        farthest: distance that is seen.
    """
    found = np.empty(len(directions), np.bool_)
    for n in range(len(directions)):
        elevation = np.arcsin(min(max(directions[n, 2], -1.0), 1.0))
        turn = np.arctan2(directions[n, 1], directions[n, 0]) / (2 * np.pi) + 0.5
        sector = min(int(turn * len(low)), len(low) - 1)
        level = low[sector] <= elevation <= high[sector]
        found[n] = level and nearest <= range_m[n] <= farthest
    return found
