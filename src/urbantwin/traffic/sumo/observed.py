"""What was seen of a simulation second by second, whoever it was."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = ["Observed"]


@dataclass(frozen=True, eq=False)
class Observed:
    """What was seen each second, by minute (M, from SUMO's start) and class (C).

    Attributes:
        least: (M, C) fewest actors at a time.
        most: (M, C) most actors at a time.
        samples: (M, C) actors seen, one each second.
        metres: (M, C) sum of their speeds: the distance that they travelled.
        entries: (M, C) how many came from an outer road into the region.
        longest_halt_s: the longest halt of anybody.
        vehicle_halt_s: the longest of a vehicle.
        stuck: (trip, time, lane) of who halted for more than ``simulation.STUCK_S``.
        queued: lane -> seconds that vehicles stood on it, all of them together.
        seconds: (M,) seconds of each minute that were seen.
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
