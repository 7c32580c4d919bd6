"""Levelling of a model, and the fit of its ground to the site's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.ground import Elevation
from urbantwin.reconstruct.georeference.ground_level import Samples
from urbantwin.reconstruct.georeference.similarity import Similarity

__all__ = ["GroundFit", "fit_ground", "upright"]

_NEIGHBOURS = 12
_MOST_POINTS = 30_000


def upright(samples: Samples) -> tuple[Similarity, float, bool]:
    """Return the rotation that levels a model's level surfaces, its angle, and whether it flips.

    The direction that most of the surface faces, ground and flat roofs, is found iteratively from z
    as the mean of the normals around it. A model that is upside down is flipped.

    Args:
        samples: points of the whole model, roughly z-up.

    Returns:
        The rotation, its angle in degrees, and whether the model was flipped.
    """
    points, normals = samples.points, samples.normals
    if normals is None:
        step = max(1, len(points) // _MOST_POINTS)
        points = points[::step]
        normals = _normals(points)
    up = np.array([0.0, 0.0, 1.0])
    for widest in (45.0, 30.0, 20.0, 12.0, 8.0, 6.0, 6.0, 6.0):
        along = normals @ up
        near = np.abs(along) > np.cos(np.radians(widest))
        if near.sum() < 50:
            break
        mean = (normals[near] * np.sign(along[near])[:, None]).mean(axis=0)
        up = mean / np.linalg.norm(mean)
    over = False
    if samples.normals is not None:
        level = np.abs(samples.normals @ up) > 0.95
        over = bool(level.any() and (samples.normals[level] @ up).mean() < -0.3)
    else:
        height = points @ up
        low, middle, high = np.quantile(height, [0.02, 0.5, 0.98])
        # most points of a street are low
        over = bool(middle - low > 1.5 * (high - middle))
    if over:
        up = -up
    return _turn_to_z(up), float(np.degrees(np.arccos(np.clip(up[2], -1, 1)))), over


@dataclass(frozen=True, eq=False)
class GroundFit:
    """Fit of a model's ground to the site's.

    Attributes:
        transform: a vertical shift and a slight tilt.
        median_m, p95_m: absolute residuals.
        tilt_deg: angle of the tilt.
        points: number of ground points compared.
    """

    transform: Similarity
    median_m: float
    p95_m: float
    tilt_deg: float
    points: int


def fit_ground(
    ground: NDArray[np.float64], elevation: Elevation, *, tilt: bool
) -> GroundFit | None:
    """Fit ground points (G, 3), placed in plan, to the site's ground.

    Robust least squares (Tukey's biweight).

    Args:
        ground: points of the model's ground, site frame in plan.
        elevation: the site's ground.
        tilt: whether a tilt is fitted, too.
    """
    rows, columns = elevation.raw.shape
    low = np.array([elevation.west, elevation.south])
    high = low + np.array([columns - 1, rows - 1]) * elevation.step
    inside = ((ground[:, :2] >= low) & (ground[:, :2] <= high)).all(axis=1)
    points = ground[inside]
    if len(points) < 30:
        return None
    middle = points[:, :2].mean(axis=0)
    terms = np.ones((len(points), 3))
    terms[:, 1:] = points[:, :2] - middle
    if not tilt:
        terms = terms[:, :1]
    error = elevation.raw_at(points[:, :2]) - points[:, 2]
    plane: NDArray[np.float64] = np.zeros(terms.shape[1])
    plane[0] = np.median(error)
    for _ in range(30):
        rest = error - terms @ plane
        spread = max(0.02, 1.4826 * float(np.median(np.abs(rest))))
        weight = np.clip(1 - (rest / (4.685 * spread)) ** 2, 0, None) ** 2
        weighted = terms * weight[:, None]
        plane = np.asarray(np.linalg.lstsq(weighted.T @ terms, weighted.T @ error, rcond=None)[0])
    east, north = (float(plane[1]), float(plane[2])) if tilt else (0.0, 0.0)
    normal = np.array([-east, -north, 1.0])
    turn = _turn_to_z(normal / np.linalg.norm(normal)).rotation.T
    pivot = np.array([*middle, float(np.median(points[:, 2]))])
    shift = pivot - turn @ pivot + [0.0, 0.0, float(plane[0])]
    transform = Similarity(1.0, turn, shift)
    after = transform.apply(points)
    left = elevation.raw_at(after[:, :2]) - after[:, 2]
    transform = Similarity(1.0, turn, shift + [0, 0, float(np.median(left))])
    left = np.abs(left - np.median(left))
    angle = float(np.degrees(np.arctan(np.hypot(east, north))))
    return GroundFit(
        transform, float(np.median(left)), float(np.quantile(left, 0.95)), angle, len(points)
    )


def _turn_to_z(up: NDArray[np.float64]) -> Similarity:
    """Return the shortest rotation of a direction to z (Rodrigues)."""
    axis = np.cross(up, [0.0, 0.0, 1.0])
    sine, cosine = float(np.linalg.norm(axis)), float(up[2])
    if sine < 1e-12:
        turn = np.eye(3) if cosine > 0 else np.diag([1.0, -1.0, -1.0])
        return Similarity(1.0, turn, np.zeros(3))
    x, y, z = axis / sine
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return Similarity(1.0, np.eye(3) + sine * k + (1 - cosine) * k @ k, np.zeros(3))


def _normals(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return unit normals (N, 3) of the planes through each point's neighbours."""
    count = min(_NEIGHBOURS, len(points))
    _, near = cKDTree(points).query(points, k=count)
    around = points[np.reshape(near, (len(points), -1))]
    around = around - around.mean(axis=1, keepdims=True)
    _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))
    return np.asarray(vectors[:, :, 0])
