"""Growing arrays for rows that are found one by one."""

import numpy as np

from urbantwin.geometry.compiled import per_block

__all__ = ["with_more_room"]


@per_block
def with_more_room(rows):
    """Return rows (N, K) with the same number of unset rows appended.

    Values are copied one at a time: the assignment of a slice takes numba seconds to compile, most
    of them for the text of an error.
    """
    count, wide = rows.shape
    more = np.empty((2 * count, wide), rows.dtype)
    for n in range(count):
        for k in range(wide):
            more[n, k] = rows[n, k]
    return more
