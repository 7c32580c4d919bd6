"""One turn of one sensor: when every ray fires, and what its clock says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Sweep"]


@dataclass(frozen=True, eq=False)
class Sweep:
    """One turn of a sensor, in seconds from the frame's time.

    The ray of channel c in column k fires at ``column_time_s[k] + ring_time_s[c]``, true time.
    Column k is the one that fires at encoder angle ``2 pi k / K``, whichever fires first.

    Attributes:
        column_time_s: (K,) float64, when each column begins.
        ring_time_s: (C,) float64, when each channel fires within its column.
        clock_offset_s: what the sensor's clock is ahead of true time at the frame's time.
        clock_rate: seconds that its clock counts in a true second.
        turn: the number of the turn since the start of the motion.
    """

    column_time_s: NDArray[np.float64]
    ring_time_s: NDArray[np.float64]
    clock_offset_s: float = 0.0
    clock_rate: float = 1.0
    turn: int = 0

    @property
    def first_column(self) -> int:
        """The column that fires first; those after it follow in time, around the turn."""
        return int(self.column_time_s.argmin())

    @classmethod
    def snapshot(cls, columns: int, channels: int) -> Sweep:
        """Return a turn in which every ray fires at the frame's time."""
        return cls(np.zeros(columns), np.zeros(channels))

    def reported(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what the sensor's clock says, from the frame's time, at true times."""
        return self.clock_offset_s + self.clock_rate * time_s
