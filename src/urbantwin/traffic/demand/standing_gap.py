"""The gap of each driver to the vehicle ahead at standstill."""

from __future__ import annotations

from hashlib import blake2b
from statistics import NormalDist

from urbantwin.traffic.demand.demand import Trip

__all__ = ["standing_gap_of"]

#: Maximum deviation from the mean, standard deviations, and least gap, metres.
_MAX_DEVIATION_SIGMAS, _MIN_GAP_M = 2.5, 0.5
_OF_64_BITS = 2.0**64


def standing_gap_of(trip: Trip, mean_m: float, spread_m: float) -> float:
    """Return a driver's gap to the vehicle ahead at standstill, metres.

    It depends on the trip alone, not on other traffic.

    Args:
        trip: the driver's trip.
        mean_m: mean of all drivers, metres.
        spread_m: standard deviation, metres.
    """
    identity = f"{trip.asset} {trip.depart_s:.2f} {' '.join(trip.edges)}"
    drawn = int.from_bytes(blake2b(identity.encode(), digest_size=8).digest(), "little")
    off = NormalDist().inv_cdf((drawn + 0.5) / _OF_64_BITS)
    return max(
        mean_m + spread_m * min(max(off, -_MAX_DEVIATION_SIGMAS), _MAX_DEVIATION_SIGMAS),
        min(_MIN_GAP_M, mean_m),
    )
