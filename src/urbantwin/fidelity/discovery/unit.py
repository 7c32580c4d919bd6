"""The channels of one unit: offsets from its model, and the channel that sees a point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.discovery.standpoint import Standpoint
from urbantwin.lidar import Sensor

__all__ = ["OnChannel", "Unit"]

#: Maximum interval of a channel: at the edge of a table, or far from other channels, degrees.
_MOST_ROOM_DEG = 1.0
#: Channels on each side of the nearest elevation that are tested with beam origin offsets.
_BESIDE = 3


@dataclass(frozen=True, eq=False)
class OnChannel:
    """The channels that see points.

    Attributes:
        channel: (N,) nearest channel, in the manufacturer's order.
        off_deg: (N,) elevation of the point above that channel's beam.
        room_deg: (N,) interval of elevations that are nearest to that channel.
        far: (N,) distance, metres.
    """

    channel: NDArray[np.int64]
    off_deg: NDArray[np.float64]
    room_deg: NDArray[np.float64]
    far: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Unit:
    """The channels of one sensor as built.

    Attributes:
        model: model of the catalogue; None: the table was found from the points.
        table_deg: (C,) elevations of the model, or as found.
        offset_deg: (C,) this unit's elevations minus those of the table.
        origin_offset_m: (C,) beam origin offset: height of each beam's line above the sensor's
            position. An HDL-64E has two lenses, one 0.1 m above the other.
    """

    model: Sensor | None
    table_deg: NDArray[np.float64]
    offset_deg: NDArray[np.float64]
    origin_offset_m: NDArray[np.float64]

    @classmethod
    def of_table(cls, table_deg: NDArray[np.float64], model: Sensor | None) -> Unit:
        """Return a unit that equals its table."""
        return cls(model, table_deg, np.zeros(len(table_deg)), np.zeros(len(table_deg)))

    @property
    def elevation_deg(self) -> NDArray[np.float64]:
        """Elevations (C,) of its channels."""
        return self.table_deg + self.offset_deg

    def sees(self, points: NDArray[np.float64], seen_from: Standpoint) -> OnChannel:
        """Return the channels that see (N, 3) points from a standpoint."""
        far = np.sqrt(((points - seen_from.place) ** 2).sum(axis=1))
        seen = seen_from.elevation_deg(points)
        rising = np.argsort(self.elevation_deg, kind="stable")
        table = self.elevation_deg[rising]
        row = np.searchsorted((table[1:] + table[:-1]) / 2, seen)
        gaps = np.diff(table)
        sides = np.stack([np.append(gaps[:1], gaps), np.append(gaps, gaps[-1:])])
        room = np.full(len(table), _MOST_ROOM_DEG)
        if len(gaps):
            room = np.minimum(sides, _MOST_ROOM_DEG).mean(axis=0)
        off = seen - table[row]
        if self.origin_offset_m.any():
            above = np.degrees(self.origin_offset_m[rising])
            least = np.full(len(points), np.inf)
            best = row
            for step in range(-_BESIDE, _BESIDE + 1):
                other = np.clip(row + step, 0, len(table) - 1)
                here = seen - table[other] - above[other] / np.maximum(far, 0.1)
                nearer = np.abs(here) < np.abs(least)
                least, best = np.where(nearer, here, least), np.where(nearer, other, best)
            row, off = best, least
        return OnChannel(rising[row], off, room[row], far)
