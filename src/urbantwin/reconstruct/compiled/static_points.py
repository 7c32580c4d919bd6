"""Classification of points as static, by direction and range."""

import numpy as np
from numba import njit

__all__ = ["stand_still"]


@njit(cache=True, nogil=True)
def stand_still(name, range_m, known, stands, static_m, reach_m, side, turns, rows):
    """Return the mask of points (N,) at a static range of their cell or a neighbouring one.

    Points beyond all static ranges of their own cell are static, too.

    Args:
        name: (N,) cell of each point: row times ``side``, plus column.
        range_m: (N,) range of each point.
        known: (C,) sorted cells.
        stands: (C, M) mask of their valid ranges.
        static_m: (C, M) the ranges.
        reach_m: (C, M) tolerance of the ranges.
        side: index stride of a row.
        turns: columns of a whole rotation.
        rows: number of neighbouring rows above and below.
    """
    found = np.zeros(len(name), np.bool_)
    for i in range(len(name)):
        row, column = name[i] // side, name[i] % side
        for step in range(2 * rows + 1):
            up = (step + 1) // 2 * (1 if step % 2 else -1)  # 0, 1, -1, ...: its own row first
            for beside in range(3):
                aside = (beside + 1) // 2 * (1 if beside % 2 else -1)
                wanted = (row + up) * side + (column + aside) % turns
                at = np.searchsorted(known, wanted)
                if at == len(known) or known[at] != wanted:
                    continue
                beyond, some = True, False
                for k in range(stands.shape[1]):
                    if stands[at, k]:
                        behind = range_m[i] - static_m[at, k]
                        found[i] |= abs(behind) <= reach_m[at, k]
                        beyond &= behind > 0
                        some = True
                if up == 0 and aside == 0:
                    found[i] |= some and beyond
                if found[i]:
                    break
            if found[i]:
                break
    return found
