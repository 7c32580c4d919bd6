"""Places on the facades of buildings that look at a junction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import semantic_id

__all__ = ["FacadePlace", "facade_places"]

#: Walls are upright to this (sine of the angle), and face the middle to this (cosine).
_UPRIGHT, _FACES = 0.1, 0.3
#: Narrower pieces of a wall, and lower ones, bear no bracket, metres.
_NARROWEST_M, _LOWEST_M = 0.6, 3.0
#: Along a wall it is looked every so many metres.
_STEP_M = 2.0
#: In front of it nothing of its building stands for so far, metres.
_FREE_M = 2.0


@dataclass(frozen=True, eq=False)
class FacadePlace:
    """A place on a wall.

    Attributes:
        foot: (2,) on the wall, site frame, metres.
        normal: (2,) unit vector out of the wall.
        top_m: z of the wall's top there, site frame, less half a metre.
    """

    foot: NDArray[np.float64]
    normal: NDArray[np.float64]
    top_m: float


def facade_places(
    mesh: LabelledMesh, middle: NDArray[np.float64], within_m: float, spacing_m: float
) -> list[FacadePlace]:
    """Return places on walls that face a point, the nearest to it first.

    Args:
        mesh: the static world, site frame.
        middle: (2,) of the junction.
        within_m: of it.
        spacing_m: between places at least.
    """
    face = np.flatnonzero(mesh.semantic == semantic_id("building"))
    normals = mesh.normals()[face]
    upright = np.abs(normals[:, 2]) < _UPRIGHT
    face, normals = face[upright], normals[upright][:, :2]
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-9)[:, None]
    corners = mesh.triangles()[face]
    along = np.column_stack([-normals[:, 1], normals[:, 0]])
    station = np.einsum("fki,fi->fk", corners[:, :, :2], along)
    offset = (corners[:, 0, :2] * normals).sum(axis=1)
    low, high = station.min(axis=1), station.max(axis=1)
    near = np.linalg.norm(corners[:, :, :2] - middle, axis=2).min(axis=1) <= within_m + 20.0
    wide = high - low >= _NARROWEST_M
    found: list[FacadePlace] = []
    for one in np.flatnonzero(near & wide).tolist():
        count = max(1, int((high[one] - low[one]) / _STEP_M))
        for k in range(count):
            at = low[one] + (k + 0.5) * (high[one] - low[one]) / count
            foot = offset[one] * normals[one] + at * along[one]
            away = middle - foot
            distance = float(np.linalg.norm(away))
            if distance > within_m or distance < 1.0:
                continue
            if float(away @ normals[one]) < _FACES * distance:
                continue
            # The wall here: triangles of the same plane around this station.
            same = (np.abs(offset - offset[one]) < 0.05) & (normals @ normals[one] > 0.999)
            here = same & (low <= at) & (high >= at)
            base, top = corners[here, :, 2].min(), corners[here, :, 2].max()
            if top - base < _LOWEST_M or not _is_free(foot, normals[one], corners, base, top):
                continue
            found.append(FacadePlace(foot, normals[one], float(top) - 0.5))
    found.sort(key=lambda one: round(float(np.linalg.norm(one.foot - middle)), 6))
    kept: list[FacadePlace] = []
    for place in found:
        if all(np.linalg.norm(place.foot - one.foot) >= spacing_m for one in kept):
            kept.append(place)
    return kept


def _is_free(
    foot: NDArray[np.float64],
    normal: NDArray[np.float64],
    corners: NDArray[np.float64],
    base_m: float,
    top_m: float,
) -> bool:
    """Return whether no other wall of a building stands right in front of a place."""
    across = np.array([-normal[1], normal[0]])
    ahead = (corners[:, :, :2] - foot) @ normal
    aside = (corners[:, :, :2] - foot) @ across
    before = (ahead.max(axis=1) > 0.05) & (ahead.min(axis=1) < _FREE_M)
    beside = (aside.max(axis=1) > -0.5) & (aside.min(axis=1) < 0.5)
    level = (corners[:, :, 2].max(axis=1) > base_m + _LOWEST_M) & (
        corners[:, :, 2].min(axis=1) < top_m
    )
    return not bool((before & beside & level).any())
