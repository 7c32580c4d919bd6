"""Road restraint systems: steel W-beam guard rails on posts, concrete barriers."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry

from urbantwin.scene.solids import Solid, box, sweep

__all__ = ["concrete_barrier", "w_beam"]

#: A W-beam is 310 mm high and 81 mm deep (EN 1317 profile A, AASHTO M 180).
BEAM_M, DEPTH_M = 0.31, 0.081
POST_M = (0.06, 0.12)
BURIED_M = 0.3


def w_beam(
    path: NDArray[np.float64], height: float, carriageway: Geometry, *, closed: bool
) -> list[Solid]:
    """Return a guard rail along (N, 3) points of the ground: the beam's two waves and its posts.

    The beam is on the side of the nearest carriageway.

    Args:
        path: its posts' feet.
        height: of the beam's upper edge, metres.
        carriageway: where traffic is.
        closed: whether the path is a ring.
    """
    side = _traffic_side(path, carriageway)
    face = POST_M[0] / 2
    low = height - BEAM_M
    half = BEAM_M / 2
    waves = []
    for foot in (low, low + half):
        out = np.array([(face, 0.0), (face + DEPTH_M, 0.3), (face + DEPTH_M, 0.7), (face, 1.0)])
        profile = np.column_stack([-out[:, 0], foot + half * out[:, 1]])
        if side > 0:  # the mirror image, counter-clockwise again
            profile = (profile * [-1, 1])[::-1]
        waves.append(sweep(path, profile, closed=closed))
    tall = height - 0.02 + BURIED_M
    way = np.roll(path, -1, axis=0) - path
    if not closed:
        way[-1] = path[-1] - path[-2]
    yaw = np.arctan2(way[:, 1], way[:, 0])
    centre = path + [0, 0, tall / 2 - BURIED_M]
    posts = box(centre, np.full((len(path), 3), [POST_M[1], POST_M[0], tall]), yaw)
    return [*waves, posts]


def _traffic_side(path: NDArray[np.float64], carriageway: Geometry) -> float:
    """Return 1 if traffic is to the left of a path, else -1."""
    if carriageway.is_empty:
        return -1.0
    middle = path[:-1, :2] + np.diff(path[:, :2], axis=0) / 2
    way = np.diff(path[:, :2], axis=0)
    left = np.column_stack([-way[:, 1], way[:, 0]])
    left /= np.maximum(np.linalg.norm(left, axis=1, keepdims=True), 1e-9)
    far = [
        shapely.distance(carriageway, shapely.points(middle + sign * 0.5 * left)).sum()
        for sign in (1, -1)
    ]
    return 1.0 if far[0] < far[1] else -1.0


def concrete_barrier(
    path: NDArray[np.float64], thickness: float, height: float, *, closed: bool
) -> Solid:
    """Return a New Jersey profile: a foot, a steep slope above it, and an upright stem."""
    steps = [(0.5, -0.1), (0.5, 0.1), (0.22, 0.35), (0.13, 1.0)]
    right = np.array([(-share * thickness, up * height) for share, up in steps])
    return sweep(path, np.concatenate([right, right[::-1] * [-1, 1]]), closed=closed)
