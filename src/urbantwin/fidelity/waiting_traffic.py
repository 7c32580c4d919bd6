"""Where traffic waits on a twin's lanes: what was measured there is no static world."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.geometry import DownwardProbe, Pose
from urbantwin.traffic.observed.lanes_beneath import LanesBeneath
from urbantwin.twin import Twin

__all__ = ["WaitingTraffic"]

#: Heights above the road between which vehicles are, metres.
_LOW_M, _HIGH_M = 0.2, 3.2
#: The road is looked for from so far above, metres: under bridges there is another.
_FROM_M = 0.5
#: What the twin has within this is a thing of the place, as boughs over a lane are, metres.
_STANDS_M = 0.2


class WaitingTraffic:
    """Tells which places are over lanes, as low as vehicles are, and nothing that the twin has.

    Args:
        twin: with the lanes.
        site_SE3_places: takes the places to the site frame.
    """

    def __init__(self, twin: Twin, site_SE3_places: Pose) -> None:
        self._pose = site_SE3_places
        self._lanes = LanesBeneath(twin.roads)
        self._ground = DownwardProbe(twin.ground_mesh)
        stands = ~twin.mesh.is_ground
        # Measured things are made of patches about as large as this.
        corners = twin.mesh.vertices[twin.mesh.faces[stands]]
        self._things = cKDTree(corners.mean(axis=1))

    def __call__(self, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which places (N, 3) are of traffic that waits."""
        at = self._pose.apply(places)
        over = np.flatnonzero(self._lanes.cover(at))
        found = np.zeros(len(at), bool)
        above = at[over, 2] - self._ground.height_below(at[over] + [0.0, 0.0, _FROM_M])
        found[over] = (above > _LOW_M) & (above < _HIGH_M)
        over = np.flatnonzero(found)
        found[over] = self._things.query(at[over], distance_upper_bound=_STANDS_M)[0] > _STANDS_M
        return found
