"""Where people walk along a sidewalk: in a band that buildings leave free."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.network import Lane

__all__ = ["Walls"]

#: People walk in a band at least this wide, metres: a stripe of SUMO's model of pedestrians.
BAND_M = 0.65
#: Nobody's middle is nearer to a wall, metres.
CLEAR_M = 0.4
#: How far a band is moved at most, metres, and how much from one metre to the next.
MOST_M, TAPER = 4.0, 0.5
#: Spacing of the places that are looked at, metres.
STEP_M = 0.5
#: Lines may be drawn with this much difference, so that fewer points say them, metres.
SIMPLER_M = 0.02


class Walls:
    """Buildings beside the sidewalks of a network.

    Args:
        buildings: where buildings stand on the ground, site frame.
        driving_side: ``right`` or ``left``.
    """

    def __init__(self, buildings: Sequence[shapely.Polygon], driving_side: str) -> None:
        self._tree = shapely.STRtree([one.buffer(CLEAR_M) for one in buildings])
        self._inwards = 1 if driving_side == "right" else -1

    def walked(self, lane: Lane) -> tuple[NDArray[np.float64], float | None]:
        """Return the middle (N, 2) of the band that people walk in along a sidewalk, and its width.

        Where a wall leaves less than a shoulder, the band is moved towards the carriageway, and
        on to it if need be. Its width is one for the whole lane: that of its narrowest place;
        ``None`` where no wall is near.

        Args:
            lane: the sidewalk.
        """
        line = lane.centre[:, :2]
        near = self._tree.query(shapely.LineString(line), predicate="intersects")
        if not len(near) or lane.level:
            return line, max(float(lane.widths.min()), BAND_M) if len(lane.widths) else None
        taken = shapely.union_all(self._tree.geometries[np.sort(near)])
        points = shapely.get_coordinates(shapely.segmentize(shapely.LineString(line), STEP_M))
        leg = np.diff(points, axis=0)
        leg = np.vstack([leg[:1], leg[:-1] + leg[1:], leg[-1:]])
        inwards = self._inwards * np.column_stack([-leg[:, 1], leg[:, 0]])
        inwards /= np.maximum(np.linalg.norm(inwards, axis=1, keepdims=True), 1e-9)
        across = shapely.linestrings(np.stack([points, points + MOST_M * inwards], axis=1))
        free = shapely.difference(across, taken)
        move = np.nan_to_num(shapely.distance(shapely.points(points), free), nan=0.0)
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        ramp = TAPER * along
        ahead = np.maximum.accumulate(move + ramp) - ramp
        back = (np.maximum.accumulate((move - ramp)[::-1]) + ramp[::-1])[::-1]
        moved = points + np.maximum(ahead, back)[:, None] * inwards
        band = shapely.simplify(shapely.LineString(moved), SIMPLER_M)
        return shapely.get_coordinates(band), BAND_M
