"""Lines of sight through the static world, and what ends them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.geometry.rays import Hits, RayScene
from urbantwin.taxonomy import GROUND_CLASSES, semantic_id

__all__ = ["Surroundings"]

#: What is farther from the middle than this in plan stands in nobody's way, metres.
_REACH_M = 130.0
#: Directions in which it is looked for what is near, as steps of azimuth and of elevation, degrees:
#: rings, so close that no pole is missed, and fans, so close that no edge of a wall or roof is.
_RINGS, _FANS = (2.0, 25.0), (10.0, 5.0)
#: Above and below it is not looked, degrees from the horizontal.
_STEEPEST_DEG = 75.0


class Surroundings:
    """What stands around a junction.

    Args:
        mesh: the static world, site frame.
        middle: (2,) of the junction.

    Attributes:
        mesh: the part of it that can stand in the way.
    """

    def __init__(self, mesh: LabelledMesh, middle: NDArray[np.float64]) -> None:
        corners = mesh.triangles()[:, :, :2] - middle
        apart = (corners.min(axis=1) > _REACH_M) | (corners.max(axis=1) < -_REACH_M)
        self.mesh = mesh.select(np.asarray(~apart.any(axis=1)))
        ground = np.isin(self.mesh.semantic, [semantic_id(x) for x in GROUND_CLASSES])
        # With a last one for rays that hit nothing.
        self._is_thing = np.append(~ground, False)
        # Moved to the junction before it becomes float32.
        self._shift = np.array([*middle, 0.0])
        self._scene = RayScene(self.mesh.vertices - self._shift, self.mesh.faces)

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> Hits:
        """Return what rays from origins (..., 3) along unit vectors (..., 3) hit first."""
        starts, aims = np.broadcast_arrays(origins - self._shift, directions)
        shape = aims.shape[:-1]
        found = self._scene.cast_single(starts.reshape(-1, 3), aims.reshape(-1, 3))
        return Hits(found.range_m.reshape(shape), found.face.reshape(shape))

    def is_thing(self, hits: Hits) -> NDArray[np.bool_]:
        """Return which rays (...) hit something that is not ground."""
        return np.asarray(self._is_thing[hits.face])

    def nearest_thing(self, places: NDArray[np.float64]) -> Hits:
        """Return how far (N,) from places (N, 3) the nearest thing is that is not ground."""
        rays = np.vstack([_all_around(*_RINGS), _all_around(*_FANS)])[None]
        hits = self.cast(places[:, None, :], rays)
        away = np.where(self.is_thing(hits), hits.range_m, np.inf).astype(np.float32)
        first = np.argmin(away, axis=1)
        rows = np.arange(len(places))
        face = np.where(np.isfinite(away[rows, first]), hits.face[rows, first], -1)
        return Hits(away[rows, first], face.astype(np.int32))


def _all_around(azimuth_step_deg: float, elevation_step_deg: float) -> NDArray[np.float64]:
    """Return unit vectors (N, 3)."""
    turn = np.radians(np.arange(0.0, 360.0, azimuth_step_deg))
    most = _STEEPEST_DEG + elevation_step_deg / 2
    tilt = np.radians(np.arange(-_STEEPEST_DEG, most, elevation_step_deg))[:, None]
    flat, up = np.cos(tilt), np.broadcast_to(np.sin(tilt), (len(tilt), len(turn)))
    rays = np.stack([flat * np.cos(turn), flat * np.sin(turn), up], axis=-1)
    return np.asarray(rays.reshape(-1, 3))
