"""The points about what was found, as the second look is told of them."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.learn.decoding import Found

__all__ = ["CROP_POINTS", "LOOKED_AT", "TOLD", "Crops", "crops_of"]

#: Classes whose crops hold all of them and what stands beside them.
LOOKED_AT = ("motorcycle", "bicycle", "pedestrian")
#: Points within so much of the middle of a box in plan, at any height between these, metres: the
#: ground in front shows what stands on it, and a crown above tells a trunk from a leg.
_REACH_M, _LOW_M, _HIGH_M = 1.6, -0.6, 4.0
#: So many points are kept of a crop, evenly spread over the order in which they lie; where there
#: are fewer, some are told again.
CROP_POINTS = 128
#: What is told beside the points: how many there are, how far it is, how sure the detector is, its
#: box.
TOLD = 7
#: In units of about 1: logarithm of points, metres, log-odds.
_MANY, _FAR_M, _SURE = 6.0, 40.0, 3.0


@dataclass(frozen=True, eq=False)
class Crops:
    """What is told of some boxes.

    Attributes:
        points: (K, `CROP_POINTS`, 3) float32 metres: along the ray from the nearest sensor, across
            it to the left, both from the middle of the box, and height above the ground.
        told: (K, `TOLD`) float32.
        number: (K,) int64 class.
    """

    points: NDArray[np.float32]
    told: NDArray[np.float32]
    number: NDArray[np.int64]

    @staticmethod
    def joined(parts: list[Crops]) -> Crops:
        """Return several as one."""
        names = [one.name for one in fields(Crops)]
        return Crops(*(np.concatenate([getattr(one, name) for one in parts]) for name in names))

    def only(self, chosen: NDArray[np.int64]) -> Crops:
        """Return some of them."""
        return Crops(self.points[chosen], self.told[chosen], self.number[chosen])


def crops_of(points: NDArray[np.float32], sensors: NDArray[np.float64], found: Found) -> Crops:
    """Return what is told of each box.

    Args:
        points: (N, 3+) float32, x, y, height above the ground, metres.
        sensors: (S, 2+) where the sensors are, S >= 1.
        found: boxes in the same frame, by the detector.
    """
    count = len(found.box)
    crops = np.zeros((count, CROP_POINTS, 3), np.float32)
    many = np.zeros(count)
    middle = found.box[:, :2]
    away = middle[:, None] - sensors[None, :, :2]
    far = np.linalg.norm(away, axis=2)
    nearest = far.argmin(axis=1)
    ray = np.take_along_axis(away, nearest[:, None, None], axis=1)[:, 0]
    range_m = far.min(axis=1)
    ray = ray / np.maximum(range_m, 1e-6)[:, None]
    seen = points[(points[:, 2] > _LOW_M) & (points[:, 2] < _HIGH_M), :3]
    if count and len(seen):
        for k, near in enumerate(cKDTree(seen[:, :2]).query_ball_point(middle, _REACH_M)):
            many[k] = len(near)
            if not near:
                continue
            rows = np.sort(np.asarray(near))
            if len(rows) > CROP_POINTS:
                rows = rows[np.arange(CROP_POINTS) * len(rows) // CROP_POINTS]
            rows = rows[np.arange(CROP_POINTS) % len(rows)]
            off = seen[rows, :2] - middle[k]
            crops[k, :, 0] = off @ ray[k]
            crops[k, :, 1] = off @ (-ray[k, 1], ray[k, 0])
            crops[k, :, 2] = seen[rows, 2]
    score = np.clip(found.score, 1e-3, 1 - 1e-3)
    told = np.column_stack([
        np.log1p(many) / _MANY, range_m / _FAR_M, np.log(score / (1 - score)) / _SURE,
        found.box[:, 3:6], found.box[:, 2],
    ])  # fmt: skip
    return Crops(crops, told.astype(np.float32), found.number)
