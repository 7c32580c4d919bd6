"""The histograms of a cloud that the Jensen-Shannon divergence compares.

Bins are fixed, so values of different pairs are comparable. The first and last bins of range and
height are open-ended: no point is lost.

| name | count | bins |
|---|---|---|
| ``occupancy`` | points per cubic voxel | edges at whole metres |
| ``range`` | points by distance from the sensor | 1 m, 0 to 250 m |
| ``height`` | points by z | 0.25 m, -20 to 60 m |
| ``intensity`` | points by intensity as a share of its full scale | 50, 0 to 1 |
| ``density`` | mean points per occupied 1 m voxel, by distance of its centre | 5 m, 0 to 250 m |
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.fidelity.clouds import Cloud
from urbantwin.geometry import row_keys

__all__ = [
    "DENSITY_EDGES_M",
    "HEIGHT_EDGES_M",
    "HISTOGRAMS",
    "INTENSITY_EDGES",
    "RANGE_EDGES_M",
    "VOXEL_M",
    "Histograms",
    "divergences",
    "full_scale",
    "histograms_of",
    "jensen_shannon",
]


def jensen_shannon(first: ArrayLike, second: ArrayLike) -> float | None:
    """Return the Jensen-Shannon divergence, base 2: 0 for equal, 1 for disjoint histograms.

    JSD(P, Q) = KL(P | M) / 2 + KL(Q | M) / 2 with M = (P + Q) / 2 and KL(P | M) = sum of
    P log2(P / M) where P > 0 (Lin 1991, "Divergence measures based on the Shannon entropy",
    IEEE Trans. Inf. Theory 37(1)). Histograms are divided by their sums first. It is the
    divergence itself and not its square root (the Jensen-Shannon distance).

    Args:
        first: (K,) counts or weights, not negative.
        second: (K,) the same bins.

    Returns:
        0..1, or None where either histogram is empty: there is then no distribution to compare.
    """
    p, q = np.asarray(first, np.float64), np.asarray(second, np.float64)
    if p.shape != q.shape or p.ndim != 1:
        raise ValueError(f"histograms must be of one shape (K,), not {p.shape} and {q.shape}")
    if (p < 0).any() or (q < 0).any():
        raise ValueError("a histogram has a negative bin")
    if not p.sum() or not q.sum():
        return None
    p, q = p / p.sum(), q / q.sum()
    middle = (p + q) / 2
    return float(np.clip((_relative_entropy(p, middle) + _relative_entropy(q, middle)) / 2, 0, 1))


def _relative_entropy(p: NDArray[np.float64], m: NDArray[np.float64]) -> float:
    some = p > 0
    return float((p[some] * np.log2(p[some] / m[some])).sum())


VOXEL_M = 1.0
RANGE_EDGES_M = np.arange(0.0, 250.5, 1.0)
HEIGHT_EDGES_M = np.arange(-20.0, 60.1, 0.25)
INTENSITY_EDGES = np.linspace(0.0, 1.0, 51)
DENSITY_EDGES_M = np.arange(0.0, 250.5, 5.0)

HISTOGRAMS = ("occupancy", "range", "height", "intensity", "density")


@dataclass(frozen=True, eq=False)
class Histograms:
    """Histograms of one cloud, and its occupied voxels (whole metres and points in each)."""

    voxels: NDArray[np.int64]
    voxel_points: NDArray[np.int64]
    binned: dict[str, NDArray[np.float64]]


def full_scale(largest: float) -> float:
    """Return the full scale of an intensity from its largest value: 1, 255 or 65535.

    Datasets write intensity as a share, as a byte or as 16 bits, and no cloud format states which.
    """
    for scale in (1.0, 255.0, 65535.0):
        if largest <= scale:
            return scale
    return largest


def histograms_of(
    cloud: Cloud, *, intensity_scale: float | None = None, origin: ArrayLike = (0.0, 0.0, 0.0)
) -> Histograms:
    """Return the histograms of a cloud.

    Args:
        cloud: the points.
        intensity_scale: full scale of its intensity; None leaves intensity out.
        origin: (3,) position of the sensor in the cloud's frame, metres.
    """
    place = np.asarray(origin, np.float64)
    distance = np.linalg.norm(cloud.points - place, axis=1)
    binned = {
        "range": _open_ended(distance, RANGE_EDGES_M),
        "height": _open_ended(cloud.points[:, 2], HEIGHT_EDGES_M),
    }
    if intensity_scale is not None and cloud.intensity is not None:
        binned["intensity"] = _open_ended(cloud.intensity / intensity_scale, INTENSITY_EDGES)

    voxels, points = _occupied(np.floor(cloud.points / VOXEL_M).astype(np.int64))
    centre = (voxels + 0.5) * VOXEL_M
    voxel_range = np.linalg.norm(centre - place, axis=1)
    per_bin = _open_ended(voxel_range, DENSITY_EDGES_M)
    in_bin = _open_ended(voxel_range, DENSITY_EDGES_M, points.astype(np.float64))
    binned["density"] = np.divide(in_bin, per_bin, out=np.zeros_like(in_bin), where=per_bin > 0)
    return Histograms(voxels, points, binned)


def divergences(first: Histograms, second: Histograms) -> dict[str, float | None]:
    """Return the Jensen-Shannon divergence of each histogram, and their ``mean``.

    A histogram that either cloud lacks is None and excluded from the mean.
    """
    found: dict[str, float | None] = {}
    for name in HISTOGRAMS:
        if name == "occupancy":
            found[name] = jensen_shannon(*_on_the_same_voxels(first, second))
        elif name in first.binned and name in second.binned:
            found[name] = jensen_shannon(first.binned[name], second.binned[name])
        else:
            found[name] = None
    given = [value for value in found.values() if value is not None]
    found["mean"] = float(np.mean(given)) if given else None
    return found


def _open_ended(
    values: NDArray[np.float64],
    edges: NDArray[np.float64],
    weights: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Count values by equal bins; values beyond the ends go into the end bins."""
    step = (edges[-1] - edges[0]) / (len(edges) - 1)
    bins = np.clip(np.floor((values - edges[0]) / step), 0, len(edges) - 2).astype(np.int64)
    return np.bincount(bins, weights, minlength=len(edges) - 1).astype(np.float64)


def _occupied(voxels: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the unique voxels (V, 3), sorted, and how often each occurs in (N, 3)."""
    _, first, count = np.unique(row_keys(voxels), axis=0, return_index=True, return_counts=True)
    return voxels[first], count


def _on_the_same_voxels(
    first: Histograms, second: Histograms
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the number of points of both clouds in each voxel that either occupies."""
    key = row_keys(np.concatenate([first.voxels, second.voxels]))
    _, place = np.unique(key, axis=0, return_inverse=True)
    place = place.ravel()
    size = int(place.max()) + 1
    split = len(first.voxels)
    return (
        np.bincount(place[:split], first.voxel_points, size).astype(np.float64),
        np.bincount(place[split:], second.voxel_points, size).astype(np.float64),
    )
