"""How far each driver stands behind who is ahead."""

from __future__ import annotations

from hashlib import blake2b
from statistics import NormalDist

from urbantwin.traffic.demand.demand import Trip

__all__ = ["standing_gap_of"]

#: Nobody is farther from the mean, standard deviations; nor nearer to who is ahead, metres.
_CUT, _LEAST_M = 2.5, 0.5
_OF_64_BITS = 2.0**64


def standing_gap_of(trip: Trip, mean_m: float, spread_m: float) -> float:
    """Return the gap that a driver keeps who stands, metres.

    It follows from the trip alone: whoever else comes or stays away changes nothing of it.

    Args:
        trip: of the driver.
        mean_m: of all drivers.
        spread_m: its standard deviation.
    """
    told = f"{trip.asset} {trip.depart_s:.2f} {' '.join(trip.edges)}"
    drawn = int.from_bytes(blake2b(told.encode(), digest_size=8).digest(), "little")
    off = NormalDist().inv_cdf((drawn + 0.5) / _OF_64_BITS)
    return max(mean_m + spread_m * min(max(off, -_CUT), _CUT), min(_LEAST_M, mean_m))
