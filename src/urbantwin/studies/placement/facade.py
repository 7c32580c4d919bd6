"""Places on the facades of buildings that look at a junction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.lidar.sight import LineOfSight
from urbantwin.taxonomy import semantic_id

__all__ = ["FacadePlace", "facade_places"]

#: Walls are upright to this (sine of the angle), and face the middle to this (cosine).
_UPRIGHT, _FACES = 0.1, 0.3
#: Narrower pieces of a wall, and lower ones, bear no bracket, metres.
_NARROWEST_M, _LOWEST_M = 0.6, 3.0
#: Along a wall it is looked every so many metres.
_STEP_M = 2.0
#: In front of it nothing stands for so far, metres, from so far off the wall.
_FREE_M, _OFF_WALL_M = 2.0, 0.02


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
    mesh: LabelledMesh,
    middle: NDArray[np.float64],
    within_m: float,
    spacing_m: float,
    around: LineOfSight,
) -> list[FacadePlace]:
    """Return places on walls that face a point, the nearest to it first.

    Args:
        mesh: the static world, site frame.
        middle: (2,) of the junction.
        within_m: of it.
        spacing_m: between places at least.
        around: lines of sight there.
    """
    face = np.flatnonzero(mesh.semantic == semantic_id("building"))
    normals = mesh.normals(face)
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
    found: list[tuple[FacadePlace, float]] = []
    for one in np.flatnonzero(near & wide).tolist():
        count = max(1, int((high[one] - low[one]) / _STEP_M))
        at = low[one] + (np.arange(count) + 0.5) * (high[one] - low[one]) / count
        feet = offset[one] * normals[one] + at[:, None] * along[one]
        away = middle - feet
        distance = np.linalg.norm(away, axis=1)
        fits = (distance <= within_m) & (away @ normals[one] >= _FACES * distance)
        # The wall here: triangles of the same plane around each station.
        same = (np.abs(offset - offset[one]) < 0.05) & (normals @ normals[one] > 0.999)
        for k in np.flatnonzero(fits).tolist():
            here = same & (low <= at[k]) & (high >= at[k])
            base, top = float(corners[here, :, 2].min()), float(corners[here, :, 2].max())
            if top - base >= _LOWEST_M:
                found.append((FacadePlace(feet[k], normals[one], top - 0.5), base))
    found.sort(key=lambda one: round(float(np.linalg.norm(one[0].foot - middle)), 6))
    kept: list[FacadePlace] = []
    for place, base in found:
        apart = all(np.linalg.norm(place.foot - one.foot) >= spacing_m for one in kept)
        if apart and _is_free(place, base, around):
            kept.append(place)
    return kept


def _is_free(place: FacadePlace, base_m: float, around: LineOfSight) -> bool:
    """Return whether nothing stands right in front of a place, from its base to its top."""
    out = np.array([*place.normal, 0.0])
    heights = np.linspace(base_m + _LOWEST_M, max(place.top_m, base_m + _LOWEST_M), 3)
    starts = np.column_stack([np.tile(place.foot, (3, 1)), heights]) + _OFF_WALL_M * out
    return bool((around.cast(starts, out[None, :]).range_m >= _FREE_M).all())
