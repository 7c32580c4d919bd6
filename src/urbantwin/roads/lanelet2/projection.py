"""Projection of the nodes of a Lanelet2 map: from degrees, or ``local_x`` and ``local_y``."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import SiteFrame
from urbantwin.number_text import finite_number
from urbantwin.roads.lanelet2.document import Document, read_document

__all__ = ["Places", "anchor_of", "places_of"]

#: Maximum distance of a map from the site's anchor, metres.
FAR_M = 50_000.0
#: Maximum absolute coordinate or height, metres.
LARGEST_M = 1e7

#: Node -> x, y, z in the site frame, metres.
Places = dict[int, NDArray[np.float64]]


def anchor_of(path: Path) -> tuple[float, float]:
    """Return latitude and longitude of the centre of a map, degrees.

    Raises:
        InputError: it is not a Lanelet2 map, or has no latitudes and longitudes.
    """
    document = read_document(path)
    degrees = np.array([(node.latitude, node.longitude) for node in document.nodes.values()])
    placed = degrees[~_unplaced(degrees)]
    if not len(placed):
        raise document.error("has no latitudes and longitudes")
    middle = (placed.min(axis=0) + placed.max(axis=0)) / 2
    return float(middle[0]), float(middle[1])


def places_of(
    document: Document, frame: SiteFrame, used: Mapping[int, int], notes: dict[str, object]
) -> Places:
    """Return the positions of nodes; nodes without one are left out.

    Latitude and longitude are used if given. Nodes with only ``local_x`` and ``local_y`` are placed
    by a fit to nodes that have both. Without any such node the map is not georeferenced: local axes
    are east and north of the anchor. Heights (``ele``) are relative to the node nearest to the
    anchor.

    Args:
        document: the map.
        frame: the site frame.
        used: node -> a relation that needs it.
        notes: receives the assumptions.

    Raises:
        InputError: no node has a position, or the map is far from the anchor.
    """
    ids = list(used)
    nodes = [document.nodes[i] for i in ids]
    degrees = np.array([(node.latitude, node.longitude) for node in nodes])
    local = _numbers(((n.tags.get("local_x"), n.tags.get("local_y")) for n in nodes), math.nan)
    unplaced = _unplaced(degrees)
    xy = np.full((len(ids), 2), math.nan)
    if not unplaced.all():
        xy[~unplaced] = frame.site_from_lonlat(degrees[~unplaced][:, ::-1])
    if unplaced.any():
        _fill(xy, local, notes)
    placed = np.isfinite(xy).all(axis=1)
    if not placed.any():
        raise document.error(f"node {ids[0]} has no finite latitude and longitude", used[ids[0]])
    # The reference is on the ground, not on a traffic light.
    ground = [document.relations[used[i]].tags.get("type") == "lanelet" for i in ids]
    away_m = np.where(placed, np.linalg.norm(xy, axis=1), np.inf)
    reference = int(np.argmin(np.where(ground, away_m, np.maximum(away_m, 1e9))))
    distance_m = float(np.linalg.norm(xy[reference]))
    if distance_m > FAR_M and not unplaced.all():
        raise document.error(f"lies {distance_m / 1000:.0f} km from the site's anchor")
    z = _numbers(((n.tags.get("ele", "0"), "0") for n in nodes), 0.0)[:, 0]
    if z[reference]:
        notes["heights_count_from_metres"] = round(float(z[reference]), 3)
    z = z - z[reference]
    return {
        i: np.array([*point, h]) for i, point, h, ok in zip(ids, xy, z, placed, strict=True) if ok
    }


def _unplaced(degrees: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the mask of nodes without degrees; unplaced maps have 0, 0."""
    return np.asarray(~np.isfinite(degrees).all(axis=1) | (degrees == 0).all(axis=1))


def _numbers(rows: Iterable[tuple[str | None, str | None]], missing: float) -> NDArray[np.float64]:
    def number(text: str | None) -> float:
        value = finite_number(text)
        return missing if value is None or abs(value) > LARGEST_M else value

    return np.array([[number(a), number(b)] for a, b in rows]).reshape(-1, 2)


def _fill(xy: NDArray[np.float64], local: NDArray[np.float64], notes: dict[str, object]) -> None:
    """Set the positions of nodes with local coordinates only."""
    has = np.isfinite(local).all(axis=1)
    has_xy = np.isfinite(xy).all(axis=1)
    both, missing = has & has_xy, has & ~has_xy
    if both.sum() >= 2:
        # Rotation, scale and translation as one complex factor and summand.
        a = np.column_stack([local[both] @ [1, 1j], np.ones(both.sum())])
        factor, shift = np.linalg.lstsq(a, xy[both] @ np.array([1, 1j]), rcond=None)[0]
        fitted = local[missing] @ np.array([1, 1j]) * factor + shift
        xy[missing] = np.column_stack([fitted.real, fitted.imag])
        notes["nodes_placed_by_local_coordinates"] = int(missing.sum())
    elif missing.any() and not has_xy.any():
        xy[missing] = local[missing]
        notes["map_without_a_place_on_earth"] = "its origin lies at the anchor"
