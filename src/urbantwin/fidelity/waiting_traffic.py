"""Detection of waiting traffic on a twin's lanes, which must not become static background."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.geometry import DownwardProbe, Pose
from urbantwin.traffic.observed.lanes_beneath import LanesBeneath
from urbantwin.twin import Twin

__all__ = ["WaitingTraffic"]

#: Heights of vehicles above the road, metres.
_LOW_M, _HIGH_M = 0.2, 3.2
#: The road is searched downward from this height above a point, metres: another road may lie above.
_FROM_M = 0.5
#: A point this near to a surface of the twin is static, such as boughs over a lane, metres.
_STANDS_M = 0.2


class WaitingTraffic:
    """Classifies positions over lanes at the height of vehicles, away from the twin's objects.

    Args:
        twin: the twin, with its lanes.
        site_SE3_places: transform of the positions to the site frame.
    """

    def __init__(self, twin: Twin, site_SE3_places: Pose) -> None:
        self._pose = site_SE3_places
        self._lanes = LanesBeneath(twin.roads)
        self._ground = DownwardProbe(twin.ground_mesh)
        stands = ~twin.mesh.is_ground
        # Measured objects consist of patches of about `_STANDS_M`.
        corners = twin.mesh.vertices[twin.mesh.faces[stands]]
        self._things = cKDTree(corners.mean(axis=1))

    def __call__(self, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return the mask (N,) of the positions (N, 3) that belong to waiting traffic."""
        at = self._pose.apply(places)
        over = np.flatnonzero(self._lanes.cover(at))
        found = np.zeros(len(at), bool)
        above = at[over, 2] - self._ground.height_below(at[over] + [0.0, 0.0, _FROM_M])
        found[over] = (above > _LOW_M) & (above < _HIGH_M)
        over = np.flatnonzero(found)
        found[over] = self._things.query(at[over], distance_upper_bound=_STANDS_M)[0] > _STANDS_M
        return found
