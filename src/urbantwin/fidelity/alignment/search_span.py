"""The span of a pose search."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import wrapped

__all__ = ["SearchSpan"]


@dataclass(frozen=True, eq=False)
class SearchSpan:
    """Possible poses of the sensor.

    Attributes:
        middle: (2,) east and north, metres.
        reach_m: half extent, east and north.
        yaw: central heading of the frame's x axis, radians counter-clockwise from east.
        reach_rad: maximum deviation from it; pi: any heading.
    """

    middle: NDArray[np.float64]
    reach_m: float
    yaw: float
    reach_rad: float

    def holds(self, place: NDArray[np.float64], yaw: float) -> bool:
        """Return whether a position (2,) and a heading, radians, are in the span."""
        apart = np.abs(place - self.middle).max()
        turned = abs(wrapped(yaw - self.yaw))
        return bool(apart <= self.reach_m + 1e-6 and turned <= self.reach_rad + 1e-6)

    def clipped(
        self, xy: NDArray[np.float64], yaws: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the nearest positions (P, 2) and headings (Y,) in the span."""
        xy = np.clip(xy, self.middle - self.reach_m, self.middle + self.reach_m)
        if self.reach_rad >= np.pi:
            return xy, yaws
        turned = wrapped(yaws - self.yaw)
        return xy, self.yaw + np.clip(turned, -self.reach_rad, self.reach_rad)
