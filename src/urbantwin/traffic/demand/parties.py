"""Parties: who walks together, and how many."""

from __future__ import annotations

import numpy as np

__all__ = ["LARGEST", "party_places"]

#: No party is larger.
LARGEST = 4
_STREAM = 7_100_000  # apart from those of actors and classes


def party_places(count: int, in_groups: float, seed: int) -> list[int]:
    """Return for each of ``count`` people which of its party it is: 0 leads, 1, 2, 3 follow it.

    Sizes of parties are those of a Poisson distribution without zero, as Moussaid et al. (PLOS ONE
    5, 2010, e10047, figure 1) found them; larger ones than `LARGEST` are cut. Who is in which party
    depends on nobody who comes later.

    Args:
        count: of people.
        in_groups: share of people who are not alone, 0..1; of that distribution 1 - exp(-rate).
        seed: of the random choice.
    """
    if in_groups <= 0:
        return [0] * count
    random = np.random.Generator(np.random.Philox(key=[seed, _STREAM]))
    rate = -np.log1p(-min(in_groups, 0.95))
    places: list[int] = []
    while len(places) < count:
        size = 0
        while size == 0:
            size = min(int(random.poisson(rate)), LARGEST)
        places += range(size)
    return places[:count]
