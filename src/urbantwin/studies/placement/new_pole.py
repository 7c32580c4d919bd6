"""Places where a pole may be set."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.lidar.sight.ground import pole_places
from urbantwin.twin import Twin

__all__ = ["new_pole_places"]


def new_pole_places(
    twin: Twin,
    middle: NDArray[np.float64],
    within_m: float,
    spacing_m: float,
    area: shapely.Polygon | None = None,
) -> list[NDArray[np.float64]]:
    """Return places (2,) for new poles, no two nearer than ``spacing_m``, the nearest first.

    Args:
        twin: the twin.
        middle: (2,) of the junction.
        within_m: of it.
        spacing_m: between places.
        area: where they may stand, whatever is there; beside the carriageways on firm ground
            (`lidar.sight.ground`) when not given.
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
    return kept


def _grid(area: shapely.Polygon, spacing_m: float) -> NDArray[np.float64]:
    """Return a grid of places in an area; its middle where the grid misses it."""
    area = shapely.make_valid(area)
    west, south, east, north = area.bounds
    x = np.arange(west + spacing_m / 2, east, spacing_m)
    y = np.arange(south + spacing_m / 2, north, spacing_m)
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    places = places[shapely.contains_xy(area, places[:, 0], places[:, 1])]
    if not len(places) and not area.is_empty:
        places = shapely.get_coordinates(area.representative_point())
    return np.asarray(places)
