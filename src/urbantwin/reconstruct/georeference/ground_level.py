"""Ground level of a model, and its offset from another surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.io.model import ImportedModel
from urbantwin.reconstruct.georeference.similarity import Similarity

__all__ = ["Samples", "above", "height_at_anchor", "samples_of"]

#: ASPRS LAS 1.4, table 17.
_GROUND, _NOISE = 2, (7, 18)
#: Maximum number of sample points of a model.
MOST_SAMPLES = 400_000
#: Size of the blocks in which some ground is visible, metres.
_BLOCK_M = 25.0
#: Quantile of heights that represents the ground, above outliers below it; only walls reach below.
_LOW = 0.02
#: Tolerance of ground points from the plane of the lowest ones, metres.
_NEAR_M = 0.2


@dataclass(frozen=True, eq=False)
class Samples:
    """Sample points of a model's surface.

    Attributes:
        points: (N, 3).
        normals: (N, 3) unit normals of their triangles; ``None`` for a cloud.
        ground: whether the points are classified ground only.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64] | None
    ground: bool = False

    def moved(self, transform: Similarity) -> Samples:
        """Return the samples of the transformed model."""
        normals = None if self.normals is None else self.normals @ transform.rotation.T
        return Samples(transform.apply(self.points), normals, self.ground)


def samples_of(model: ImportedModel, *, ground: bool = False) -> Samples:
    """Return sample points of a model, evenly by area and reproducible.

    Args:
        model: with a mesh or a cloud; the mesh is used if it has both.
        ground: only the points classified as ground, if there are enough.
    """
    if model.mesh is not None and len(model.mesh.faces):
        a, b, c = np.moveaxis(model.mesh.triangles(), 1, 0)
        cross = np.cross(b - a, c - a)
        area = np.linalg.norm(cross, axis=1)
        total = np.cumsum(area)
        if total[-1] > 0:
            random = np.random.Generator(np.random.Philox(key=len(area)))
            count = min(MOST_SAMPLES, max(MOST_SAMPLES // 2, 4 * len(area)))
            face = np.searchsorted(total, (np.arange(count) + 0.5) / count * total[-1])
            u, v = random.random((2, count))
            fold = u + v > 1
            u[fold], v[fold] = 1 - u[fold], 1 - v[fold]
            points = a[face] + u[:, None] * (b - a)[face] + v[:, None] * (c - a)[face]
            return Samples(points, cross[face] / area[face, None])
    if model.cloud is None or not len(model.cloud.points):
        return Samples(np.zeros((0, 3)), None)
    cloud, is_ground = model.cloud, False
    points = cloud.points
    if cloud.classification is not None:
        is_ground = ground and bool((cloud.classification == _GROUND).sum() >= 50)
        keep = cloud.classification == _GROUND
        points = points[keep if is_ground else ~np.isin(cloud.classification, _NOISE)]
    return Samples(points[:: max(1, len(points) // MOST_SAMPLES)], None, is_ground)


def above(
    samples: Samples, surface: Callable[[NDArray[np.float64]], NDArray[np.float64]]
) -> tuple[float, float] | None:
    """Return the median height of a model's ground above a surface, and half the spread.

    The lowest points of every 25 m block are ground, which excludes objects and a few outliers
    below. ``None`` if no points remain.

    Args:
        samples: points of the model, in metres.
        surface: returns heights (N,) at (N, 2) positions, nan if unknown.
    """
    height = samples.points[:, 2] - surface(samples.points[:, :2])
    known = np.isfinite(height)
    if known.sum() < 10:
        return None
    height = height[known]
    cell = np.floor(samples.points[known, :2] / _BLOCK_M).astype(np.int64)
    low = height if samples.ground else height[_lowest_of_groups(cell, height, least=5)]
    if not len(low):
        return None
    q = np.quantile(low, [0.25, 0.5, 0.75])
    return float(q[1]) + _middle(height - q[1]), float(q[2] - q[0]) / 2


def height_at_anchor(samples: Samples, farthest_m: float = np.inf) -> float | None:
    """Return the height of a model's ground at the origin of the plan, or the nearest available.

    A robust plane is fitted to the lowest points of small cells around the anchor. ``None`` if
    there is no ground within ``farthest_m``.
    """
    distance = np.hypot(samples.points[:, 0], samples.points[:, 1])
    if not len(distance) or distance.min() > farthest_m:
        return None
    radius = max(15.0, 1.3 * float(distance.min()))
    while (distance < radius).sum() < 200 and radius < distance.max():
        radius *= 1.5
    near = samples.points[distance < radius]
    size = radius / 10.0
    cell = np.floor(near[:, :2] / size).astype(np.int64)
    low = near if samples.ground else near[_lowest_of_groups(cell, near[:, 2])]
    kept = low
    for _ in range(15):
        if len(kept) < 4:
            break
        terms = np.column_stack([kept[:, :2], np.ones(len(kept))])
        plane, *_ = np.linalg.lstsq(terms, kept[:, 2], rcond=None)
        height = low[:, 2] - (low[:, :2] @ plane[:2] + plane[2])
        spread = float(np.quantile(np.abs(height), 0.5))
        left = low[(height < max(0.1, spread)) & (height > -max(0.5, 4 * spread))]
        if len(left) == len(kept):
            break
        kept = left
    if len(kept) < 4 or distance.min() > radius / 1.2:
        return float(np.quantile(low[:, 2], 0.2))
    return float(plane[2]) + _middle(near[:, 2] - (near[:, :2] @ plane[:2] + plane[2]))


def _middle(height: NDArray[np.float64]) -> float:
    """Return the ground's offset from its lowest points, which lie in its noise."""
    near = height[np.abs(height) < _NEAR_M]
    return float(np.median(near)) if len(near) else 0.0


def _lowest_of_groups(
    cell: NDArray[np.int64], value: NDArray[np.float64], least: int = 1
) -> NDArray[np.int64]:
    """Return the index of a low value in each cell with enough values."""
    _, group = np.unique(cell, axis=0, return_inverse=True)
    order = np.lexsort([value, group.ravel()])
    start = np.flatnonzero(np.diff(group.ravel()[order], prepend=-1))
    count = np.diff(start, append=len(order))
    place = order[start + (_LOW * (count - 1)).astype(np.int64)]
    return np.asarray(place[count >= least])
