"""Statistics of a simulation, second by second."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = ["Observed"]


@dataclass(frozen=True, eq=False)
class Observed:
    """Statistics sampled each second, by minute (M, from SUMO's start) and class (C).

    Attributes:
        least: (M, C) least number of actors at a time.
        most: (M, C) largest number of actors at a time.
        samples: (M, C) number of samples of actors, one per actor and second.
        metres: (M, C) sum of their speeds: the distance travelled.
        entries: (M, C) number of entries from an outer road into the region.
        longest_halt_s: longest halt of any actor.
        vehicle_halt_s: longest halt of a vehicle.
        stuck: (trip, time, lane) of actors that halted for more than ``simulation.STUCK_S``.
        queued: lane -> total seconds that vehicles stood on it.
        seconds: (M,) number of sampled seconds in each minute.
    """

    least: NDArray[np.float64]
    most: NDArray[np.float64]
    samples: NDArray[np.float64]
    metres: NDArray[np.float64]
    entries: NDArray[np.float64]
    longest_halt_s: float
    stuck: tuple[tuple[int, float, str], ...]
    queued: Mapping[str, float] = field(default_factory=dict)
    vehicle_halt_s: float = 0.0
    seconds: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
