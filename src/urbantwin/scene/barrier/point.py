"""Barriers mapped as points: blocks, boulders, staggered railings, height restrictors."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, Point

from urbantwin.scene.placement import along_nearest, on_ground
from urbantwin.scene.solids import Assembly, GroundHeight, Solid, box, rods
from urbantwin.scene.tag_values import length_m_of
from urbantwin.scene.tree.shrub import bushes
from urbantwin.site.extract import OsmFeature

__all__ = ["add_point_barriers"]

BURIED_M = 0.3
#: Kind -> what notes call it.
KINDS = {
    "block": "blocks",
    "jersey_barrier": "blocks",
    "planter": "planters",
    "log": "logs",
    "debris": "boulders",
    "rock": "boulders",
    "stone": "boulders",
    "cycle_barrier": "staggered railings",
    "motorcycle_barrier": "staggered railings",
    "height_restrictor": "height restrictors",
}


def add_point_barriers(
    assembly: Assembly,
    features: Sequence[OsmFeature],
    ways: Sequence[Geometry],
    kept: Geometry,
    ground_height: GroundHeight,
    notes: Counter[str],
) -> None:
    """Add barriers that are mapped as points, across the way that they bar."""
    found = []
    for feature in features:
        kind = feature.tags.get("barrier") or feature.tags.get("natural", "")
        shape = feature.geometry
        if kind not in KINDS or not isinstance(shape, Point):
            continue
        if kind == "height_restrictor" or kept.covers(shape):
            found.append((kind, feature))
    if not found:
        return
    xy = np.array([[f.geometry.x, f.geometry.y] for _, f in found])
    feet = on_ground(xy, ground_height(xy))
    yaw = np.nan_to_num(along_nearest(xy, ways, farthest_m=1.0)) + np.pi / 2
    for (kind, feature), foot, turn in zip(found, feet, yaw.tolist(), strict=True):
        if kind == "height_restrictor":
            if not _add_portal(assembly, feature, foot, turn, kept, ground_height):
                continue
        elif kind in ("rock", "stone", "debris"):
            _add_boulder(assembly, feature, foot)
        elif kind in ("cycle_barrier", "motorcycle_barrier"):
            _add_railings(assembly, foot, turn)
        else:
            _add_block(assembly, kind, feature, foot, turn)
        notes[KINDS[kind]] += 1


def _height(feature: OsmFeature, usual: float, most: float) -> float:
    return min(length_m_of(feature.tags.get("height")) or usual, most)


def _add_block(
    assembly: Assembly, kind: str, feature: OsmFeature, foot: NDArray[np.float64], yaw: float
) -> None:
    height = _height(feature, {"log": 0.4, "jersey_barrier": 0.85}.get(kind, 0.6), 2.0)
    long = {"jersey_barrier": 2.0, "log": 2.0, "planter": 1.2}.get(kind, 1.0)
    material = {"log": "wood"}.get(kind, "concrete")
    part = assembly.new_part()
    low = box(foot + [0, 0, (height - BURIED_M) / 2], [long, 0.5, height + BURIED_M], yaw)
    assembly.add(low, "other-object", material, part)
    if kind == "planter":
        plants, _ = bushes((foot + [0, 0, height - 0.1])[None], np.array([0.4]), np.array([0.6]),
                           feature.id)  # fmt: skip
        assembly.add(plants, "vegetation", "foliage", part)


def _add_boulder(assembly: Assembly, feature: OsmFeature, foot: NDArray[np.float64]) -> None:
    height = _height(feature, 0.7, 4.0)
    body, _ = bushes(foot[None], np.array([0.8 * height]), np.array([height]), feature.id)
    assembly.add(body, "other-object", "stone", assembly.new_part())


def _add_railings(assembly: Assembly, foot: NDArray[np.float64], yaw: float) -> None:
    """Add two railings that overlap across a path, 1.5 m apart."""
    across = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    along = np.array([-across[1], across[0], 0.0])
    part = assembly.new_part()
    for side in (1.0, -1.0):
        near = foot + 0.75 * side * along - 0.1 * side * across
        far = near + 1.2 * side * across
        assembly.add(_frame(near, far, 1.0), "fence", "metal-painted", part)


def _frame(a: NDArray[np.float64], b: NDArray[np.float64], height: float) -> Solid:
    """Return two posts with a rail between their tops."""
    up, down = np.array([0, 0, height]), np.array([0, 0, BURIED_M])
    return rods([a - down, b - down, a + up], [a + up, b + up, b + up], 0.025, 0.025, 6)


def _add_portal(
    assembly: Assembly,
    feature: OsmFeature,
    foot: NDArray[np.float64],
    yaw: float,
    kept: Geometry,
    ground_height: GroundHeight,
) -> bool:
    """Add a beam over a way, its posts at the first free place to both sides."""
    high = min(length_m_of(feature.tags.get("maxheight")) or 2.2, 6.0)
    way = np.array([np.cos(yaw), np.sin(yaw)])
    steps = np.arange(1.8, 8.0, 0.2)[:, None]
    spots = []
    for side in (1, -1):
        line = foot[:2] + side * steps * way
        free = shapely.contains_xy(kept, line[:, 0], line[:, 1])
        if not free.any():
            return False
        spots.append(line[int(np.argmax(free))])
    ends = on_ground(np.array(spots), ground_height(np.array(spots)))
    top = max(foot[2], *ends[:, 2]) + high + 0.1
    tops = np.column_stack([ends[:, :2], [top, top]])
    part = assembly.new_part()
    down = [0, 0, BURIED_M]
    portal = rods([*(ends - down), tops[0]], [*(tops + [0, 0, 0.08]), tops[1]], 0.06, 0.06, 8)
    assembly.add(portal, "other-structure", "metal-painted", part)
    return True
