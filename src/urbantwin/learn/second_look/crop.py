"""Input of the second stage: crops of points around detections."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.learn.decoding import Found

__all__ = ["CROP_POINTS", "LOOKED_AT", "TOLD", "Crops", "crops_of"]

#: Classes that are rescored: small enough for a crop to hold the object and its surroundings.
LOOKED_AT = ("motorcycle", "bicycle", "pedestrian")
#: Radius in plan and range of heights of a crop, metres: the ground in front shows where the object
#: stands, and a crown above tells a trunk from a leg.
_REACH_M, _LOW_M, _HIGH_M = 1.6, -0.6, 4.0
#: Number of points in a crop, evenly chosen in their order, or repeated where there are fewer.
CROP_POINTS = 128
#: Number of further features: number of points, range, score, box (length, width, height, z).
TOLD = 7
#: Scales of these features: logarithm of the number of points, range (m), log-odds of the score.
_MANY, _FAR_M, _SURE = 6.0, 40.0, 3.0


@dataclass(frozen=True, eq=False)
class Crops:
    """Crops of boxes.

    Attributes:
        points: (K, `CROP_POINTS`, 3) float32, metres: along the ray of the nearest sensor and to
            its left, both from the centre of the box, and height above the ground.
        told: (K, `TOLD`) float32: further features.
        number: (K,) int64: class indices.
    """

    points: NDArray[np.float32]
    told: NDArray[np.float32]
    number: NDArray[np.int64]

    @staticmethod
    def joined(parts: list[Crops]) -> Crops:
        """Concatenate crops."""
        names = [one.name for one in fields(Crops)]
        return Crops(*(np.concatenate([getattr(one, name) for one in parts]) for name in names))

    def only(self, chosen: NDArray[np.int64]) -> Crops:
        """Return a selection of crops."""
        return Crops(self.points[chosen], self.told[chosen], self.number[chosen])


def crops_of(points: NDArray[np.float32], sensors: NDArray[np.float64], found: Found) -> Crops:
    """Return the crops of detected boxes.

    Args:
        points: (N, 3+) float32: x, y, height above the ground, metres.
        sensors: (S, 2+) positions of the sensors, S >= 1.
        found: detected boxes in the same frame.
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
