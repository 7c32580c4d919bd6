"""Bridge decks: their position in plan and their heights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Polygon

from urbantwin.scene.solids import GroundHeight

__all__ = ["Deck", "Decks"]


@dataclass(frozen=True, eq=False)
class Deck:
    """A bridge, or a ramp to one, along a way.

    Attributes:
        id: id of the way in the map.
        kind: foot, road or rail.
        line: its centre line, site frame.
        width: metres.
        stations: (N,) along the line, metres.
        heights: (N,) heights of its top at the stations.
        thickness: metres; a ramp is solid down to the ground instead.
        is_ramp: whether it is a ramp.
        plan: its area.
    """

    id: int
    kind: str
    line: LineString
    width: float
    stations: NDArray[np.float64]
    heights: NDArray[np.float64]
    thickness: float
    is_ramp: bool
    plan: Polygon

    def height(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the top's height (N,) at (N, 2) points: that of the nearest point on the line."""
        along = shapely.line_locate_point(self.line, shapely.points(xy))
        return np.asarray(np.interp(along, self.stations, self.heights))


@dataclass(frozen=True, eq=False)
class Decks:
    """All decks that are not in the lane model."""

    decks: Sequence[Deck] = field(default_factory=tuple)

    def over(self, ground_height: GroundHeight, kinds: Sequence[str]) -> GroundHeight:
        """Return heights of the ground, or of a deck of one of these kinds above it."""
        mine = [deck for deck in self.decks if deck.kind in kinds]
        if not mine:
            return ground_height

        def height(xy: NDArray[np.float64]) -> NDArray[np.float64]:
            z = np.array(ground_height(xy), np.float64)
            for deck in mine:
                on = shapely.contains_xy(deck.plan, xy[:, 0], xy[:, 1])
                if on.any():
                    z[on] = np.fmax(z[on], deck.height(xy[on]))
            return z

        return height
