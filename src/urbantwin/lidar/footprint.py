"""The footprint of a beam: a few rays that stand for all of its light.

A laser's beam is Gaussian: at an angle r from its axis it is ``exp(-r^2 / (2 s^2))`` as bright as
there, with s its full width at half maximum over ``2 sqrt(2 ln 2)``; its light is spread with a
mean square of ``2 s^2`` from the axis. Seven rays of equal share, one on the axis and six around it
at ``sqrt(7 / 3) s``, have the same mean square (and, by symmetry, the same first and third
moments), so a surface's mean range over them is right to second order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.sensor import Sensor

__all__ = ["Footprint"]


@dataclass(frozen=True, eq=False)
class Footprint:
    """Rays that a beam is made of.

    Attributes:
        offset: (S, 2) float64, radians across (level, to the left) and up from the beam's axis;
            the first is the axis itself.
        share: (S,) float64, of the beam's light; they add up to 1.
    """

    offset: NDArray[np.float64]
    share: NDArray[np.float64]

    @property
    def reach(self) -> float:
        """How far the rays go from the axis, radians."""
        return float(np.abs(self.offset).max())

    @classmethod
    def thin(cls) -> Footprint:
        """Return a beam that is a single ray."""
        return cls(np.zeros((1, 2)), np.ones(1))

    @classmethod
    def of(cls, sensor: Sensor) -> Footprint:
        """Return the beam of a sensor."""
        across, up = np.radians(sensor.assumed_divergence_deg) / np.sqrt(8 * np.log(2))
        turn = np.radians(60.0 * np.arange(6) + 30.0)
        ring = np.sqrt(7 / 3) * np.column_stack([across * np.cos(turn), up * np.sin(turn)])
        return cls(np.vstack([np.zeros((1, 2)), ring]), np.full(7, 1 / 7))
