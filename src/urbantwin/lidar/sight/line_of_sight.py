"""Straight lines of sight through the static world or past boxes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.geometry.rays import Hits, RayScene

__all__ = ["LineOfSight"]

#: Triangles beyond this distance of a junction's centre are ignored, metres.
_REACH_M = 130.0
#: Steps of azimuth and elevation of the directions in which the nearest object is searched,
#: degrees: rings that miss no pole, and fans that miss no edge of a wall or roof.
_RINGS, _FANS = (2.0, 25.0), (10.0, 5.0)
#: Largest elevation of these directions, up and down, degrees.
_STEEPEST_DEG = 75.0
#: A line of sight may end this far before its target, metres.
_SLACK_M = 0.3
#: Corners of a unit cube about the origin, and its triangles.
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
_TRIANGLES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)  # fmt: skip


class LineOfSight:
    """Lines of sight around a place.

    Args:
        mesh: obstacles.
        middle: (2,) the place, in the frame of the mesh, metres.
        reach_m: triangles farther from the place along x or y are left out.

    Attributes:
        mesh: the part of it near the place; hits number its faces.
    """

    def __init__(
        self, mesh: LabelledMesh, middle: NDArray[np.float64], reach_m: float = _REACH_M
    ) -> None:
        corners = mesh.triangles()[:, :, :2] - middle
        apart = (corners.min(axis=1) > reach_m) | (corners.max(axis=1) < -reach_m)
        self.mesh = mesh.select(np.asarray(~apart.any(axis=1)))
        # The last element is for rays without a hit.
        self._is_thing = np.append(~self.mesh.is_ground, False)
        # Relative to the place, because rays are float32.
        self._shift = np.array([*middle, 0.0])
        self._scene = RayScene(self.mesh.vertices - self._shift, self.mesh.faces)

    @classmethod
    def past_boxes(cls, boxes: NDArray[np.float64], middle: NDArray[np.float64]) -> LineOfSight:
        """Return lines of sight past boxes (B, 7); the part of a face is its box's number."""
        cos, sin = np.cos(boxes[:, 6, None]), np.sin(boxes[:, 6, None])
        x, y, z = np.moveaxis(_CORNERS * boxes[:, None, 3:6], -1, 0)
        corners = np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=-1) + boxes[:, None, :3]
        number = np.arange(len(boxes))
        faces = (_TRIANGLES + len(_CORNERS) * number[:, None, None]).reshape(-1, 3)
        part = np.repeat(number, len(_TRIANGLES))
        return cls(LabelledMesh.build(corners.reshape(-1, 3), faces, 0, 0, part), middle, np.inf)

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> Hits:
        """Return the first hits of rays from origins (..., 3) along unit vectors (..., 3)."""
        starts, aims = np.broadcast_arrays(origins - self._shift, directions)
        shape = aims.shape[:-1]
        found = self._scene.cast_single(starts.reshape(-1, 3), aims.reshape(-1, 3))
        return Hits(found.range_m.reshape(shape), found.face.reshape(shape))

    def towards(
        self, place: NDArray[np.float64], targets: NDArray[np.float64]
    ) -> tuple[Hits, NDArray[np.float64]]:
        """Return the hits of rays from a place (3,) to targets (N, 3), and the distances (N,)."""
        offset = targets - place
        away = np.linalg.norm(offset, axis=1)
        return self.cast(place[None, :], offset / np.maximum(away, 1e-6)[:, None]), away

    def sees(self, place: NDArray[np.float64], targets: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which targets (N, 3) are in sight from a place (3,)."""
        hits, away = self.towards(place, targets)
        return np.asarray(hits.range_m >= away - _SLACK_M)

    def is_thing(self, hits: Hits) -> NDArray[np.bool_]:
        """Return which rays (...) hit an object that is not ground."""
        return np.asarray(self._is_thing[hits.face])

    def nearest_thing(self, place: NDArray[np.float64]) -> tuple[float, int]:
        """Return distance and face of the nearest object around a place (3,) that is not ground.

        The face is -1 without one.
        """
        hits = self.cast(place[None, :], np.vstack([_all_around(*_RINGS), _all_around(*_FANS)]))
        away = np.where(self.is_thing(hits), hits.range_m, np.inf)
        first = int(np.argmin(away))
        return float(away[first]), int(hits.face[first]) if np.isfinite(away[first]) else -1


def _all_around(azimuth_step_deg: float, elevation_step_deg: float) -> NDArray[np.float64]:
    """Return unit vectors (N, 3)."""
    turn = np.radians(np.arange(0.0, 360.0, azimuth_step_deg))
    most = _STEEPEST_DEG + elevation_step_deg / 2
    tilt = np.radians(np.arange(-_STEEPEST_DEG, most, elevation_step_deg))[:, None]
    flat, up = np.cos(tilt), np.broadcast_to(np.sin(tilt), (len(tilt), len(turn)))
    rays = np.stack([flat * np.cos(turn), flat * np.sin(turn), up], axis=-1)
    return np.asarray(rays.reshape(-1, 3))
