"""Possible mounting places of sensors on a twin: mapped poles, facades, and new poles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.lidar.sight import LineOfSight
from urbantwin.lidar.sight.ground import pole_places
from urbantwin.taxonomy import semantic_id
from urbantwin.twin import Twin

__all__ = ["MountPlace", "facade_places", "mapped_poles", "new_pole_places"]

#: Height above a pole's lowest point within which its foot is measured, metres.
_FOOT_M = 0.3
#: Poles closer than this are one place, metres.
_SAME_M = 1.0
#: Class of the lights of a signal.
_LIGHTS = "other-object"
#: Largest deviation of walls from vertical (sine), and smallest alignment with the centre (cosine).
_UPRIGHT, _FACES = 0.1, 0.3
#: Smallest width of a wall piece, and lowest height, for a bracket, metres.
_NARROWEST_M, _LOWEST_M = 0.6, 3.0
#: Spacing of tested places along a wall, metres.
_STEP_M = 2.0
#: Free space in front of a wall, and the distance from it at which that begins, metres.
_FREE_M, _OFF_WALL_M = 2.0, 0.02


@dataclass(frozen=True, eq=False)
class MountPlace:
    """A possible place of a sensor, which is mounted at a bracket's length from it.

    Attributes:
        foot: (2,) site frame, metres.
        outward: (2,) unit vector of the bracket.
        top_m: z of the highest point, site frame, metres.
    """

    foot: NDArray[np.float64]
    outward: NDArray[np.float64]
    top_m: float


def mapped_poles(
    mesh: LabelledMesh, middle: NDArray[np.float64], within_m: float, *, signals: bool
) -> list[MountPlace]:
    """Return the mapped poles, lamps and masts around a point, each a part of the scene.

    Args:
        mesh: the static scene, site frame.
        middle: (2,) centre of the junction.
        within_m: largest distance from it, metres.
        signals: return poles with signals, otherwise all others.
    """
    steel = np.flatnonzero(mesh.semantic == semantic_id("pole"))
    with_lights = set(mesh.part[mesh.semantic == semantic_id(_LIGHTS)].tolist())
    found: list[MountPlace] = []
    for part in np.unique(mesh.part[steel]).tolist():
        corners = mesh.vertices[np.unique(mesh.faces[steel[mesh.part[steel] == part]])]
        low = corners[corners[:, 2] <= corners[:, 2].min() + _FOOT_M]
        foot = (low[:, :2].min(axis=0) + low[:, :2].max(axis=0)) / 2
        signal = part in with_lights
        if signal != signals or np.linalg.norm(foot - middle) > within_m:
            continue
        if any(np.linalg.norm(foot - one.foot) < _SAME_M for one in found):
            continue
        toward = (middle - foot) / max(float(np.linalg.norm(middle - foot)), 1e-6)
        found.append(MountPlace(foot, toward, float(corners[:, 2].max())))
    return found


def facade_places(
    mesh: LabelledMesh,
    middle: NDArray[np.float64],
    within_m: float,
    spacing_m: float,
    around: LineOfSight,
) -> list[MountPlace]:
    """Return places on walls that face a point, the nearest first.

    Args:
        mesh: the static scene, site frame.
        middle: (2,) centre of the junction.
        within_m: largest distance from it, metres.
        spacing_m: smallest distance between places, metres.
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
    found: list[tuple[MountPlace, float]] = []
    for one in np.flatnonzero(near & wide).tolist():
        count = max(1, int((high[one] - low[one]) / _STEP_M))
        at = low[one] + (np.arange(count) + 0.5) * (high[one] - low[one]) / count
        feet = offset[one] * normals[one] + at[:, None] * along[one]
        away = middle - feet
        distance = np.linalg.norm(away, axis=1)
        fits = (distance <= within_m) & (away @ normals[one] >= _FACES * distance)
        # Triangles in the plane of the wall around each station.
        same = (np.abs(offset - offset[one]) < 0.05) & (normals @ normals[one] > 0.999)
        for k in np.flatnonzero(fits).tolist():
            here = same & (low <= at[k]) & (high >= at[k])
            base, top = float(corners[here, :, 2].min()), float(corners[here, :, 2].max())
            if top - base >= _LOWEST_M:
                found.append((MountPlace(feet[k], normals[one], top - 0.5), base))
    found.sort(key=lambda one: round(float(np.linalg.norm(one[0].foot - middle)), 6))
    kept: list[MountPlace] = []
    for place, base in found:
        apart = all(np.linalg.norm(place.foot - one.foot) >= spacing_m for one in kept)
        if apart and _is_free(place, base, around):
            kept.append(place)
    return kept


def _is_free(place: MountPlace, base_m: float, around: LineOfSight) -> bool:
    """Return whether the space in front of a place is free, from its base to its top."""
    out = np.array([*place.outward, 0.0])
    heights = np.linspace(base_m + _LOWEST_M, max(place.top_m, base_m + _LOWEST_M), 3)
    starts = np.column_stack([np.tile(place.foot, (3, 1)), heights]) + _OFF_WALL_M * out
    return bool((around.cast(starts, out[None, :]).range_m >= _FREE_M).all())


def new_pole_places(
    twin: Twin,
    middle: NDArray[np.float64],
    within_m: float,
    spacing_m: float,
    area: shapely.Polygon | None = None,
) -> list[MountPlace]:
    """Return places for new poles, at least ``spacing_m`` apart, the nearest first.

    Args:
        twin: the twin.
        middle: (2,) centre of the junction.
        within_m: largest distance from it, metres.
        spacing_m: distance between places, metres.
        area: area of the places, whatever is there; beside the carriageways on firm ground
            (`lidar.sight.ground`) if not given.
    """
    if area is None:
        feet, _ = pole_places(twin.roads, twin.region, twin.mesh, middle)
        places = feet[:, :2]
    else:
        places = _grid(area, spacing_m)
    away = np.round(np.linalg.norm(places - middle, axis=1), 6)
    order = np.argsort(away, kind="stable")
    kept: list[NDArray[np.float64]] = []
    for place in places[order[away[order] <= within_m]]:
        if all(np.linalg.norm(place - one) >= spacing_m - 1e-9 for one in kept):
            kept.append(place)
    return [MountPlace(place, np.zeros(2), np.inf) for place in kept]


def _grid(area: shapely.Polygon, spacing_m: float) -> NDArray[np.float64]:
    """Return a grid of places in an area, or a point inside if the grid misses it."""
    area = shapely.make_valid(area)
    west, south, east, north = area.bounds
    x = np.arange(west + spacing_m / 2, east, spacing_m)
    y = np.arange(south + spacing_m / 2, north, spacing_m)
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    places = places[shapely.contains_xy(area, places[:, 0], places[:, 1])]
    if not len(places) and not area.is_empty:
        places = shapely.get_coordinates(area.representative_point())
    return np.asarray(places)
