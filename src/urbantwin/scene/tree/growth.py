"""Trunks and crowns of trees as triangles."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.random import Generator, Philox
from numpy.typing import NDArray
from shapely import Geometry, Polygon

from urbantwin.geometry import LabelledMesh
from urbantwin.reconstruct import SurveyedTree
from urbantwin.scene.placement import beside_carriageway, on_ground
from urbantwin.scene.solids import Assembly, GroundHeight, Solid, columns
from urbantwin.scene.tree.crown import crown_clumps, rounded
from urbantwin.scene.tree.size import TreeSize, surveyed_size
from urbantwin.taxonomy import material_id

__all__ = ["GrownTree", "grow", "surveyed_tree_mesh"]

#: Approximate number of triangles of all crowns of a scene; minimum and maximum per crown.
MOST_TRIANGLES, FEWEST_CLUMPS, MOST_CLUMPS = 300_000, 60, 900
#: Crowns are cut back over carriageways to this height (RASt 06, AASHTO: 4.5 m), metres.
CLEARANCE_M = 4.5
BURIED_M = 0.3


@dataclass(frozen=True)
class GrownTree:
    """A tree to draw: its position, its size, and the seed of its shape.

    ``clumps`` is the number of triangles of its crown; ``None``: an equal share of the scene's
    triangles.
    """

    x: float
    y: float
    size: TreeSize
    seed: int
    clumps: int | None = None


def grow(
    assembly: Assembly,
    trees: Sequence[GrownTree],
    *,
    ground_height: GroundHeight,
    carriageway: Geometry,
) -> None:
    """Add trees: a tapered trunk (class ``trunk``) and a crown of leaf clumps (``vegetation``)."""
    if not trees:
        return
    xy = np.array([(tree.x, tree.y) for tree in trees])
    feet = on_ground(xy, ground_height(xy))
    sizes = [tree.size for tree in trees]
    parts = np.array([assembly.new_part() for _ in trees])
    height, clear, radius = (
        np.array([getattr(size, name) for size in sizes]) for name in ("height", "clear", "trunk")
    )
    reach = np.array([{"cone": 0.95, "palm": 0.9}.get(size.form, 0.55) for size in sizes])
    top = clear + reach * (height - clear)
    trunks = columns(feet - [0, 0, BURIED_M], top + BURIED_M, radius, 0.35 * radius)
    assembly.add(trunks, "trunk", "bark", np.repeat(parts, len(trunks.faces) // len(trees)))
    free = sum(tree.clumps is None for tree in trees)
    count = int(np.clip(MOST_TRIANGLES / max(free, 1), FEWEST_CLUMPS, MOST_CLUMPS))
    crowns = [_crown(tree, foot, count) for tree, foot in zip(trees, feet, strict=True)]
    many = [len(crown) for crown in crowns]
    clumps, part, foot = np.concatenate(crowns), np.repeat(parts, many), np.repeat(feet[:, 2], many)
    keep = _clear_of_traffic(clumps, foot, carriageway)
    vertices = clumps[keep].reshape(-1, 3)
    leaves = Solid(vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3))
    needles = np.repeat([size.needles for size in sizes], many)[keep]
    leaf = np.where(needles, material_id("foliage-needle"), material_id("foliage"))
    assembly.add(leaves, "vegetation", leaf, part[keep])


def _crown(tree: GrownTree, foot: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return the clumps (N, 3, 3) of a tree's crown at its position."""
    size, rng = tree.size, Generator(Philox(key=abs(tree.seed)))
    drawn = count if tree.clumps is None else tree.clumps
    crown = crown_clumps(size.form, size.crown, size.clear, size.height, rng, drawn) + foot
    return crown if tree.clumps is None else rounded(crown)


def _clear_of_traffic(
    clumps: NDArray[np.float64], foot: NDArray[np.float64], carriageway: Geometry
) -> NDArray[np.bool_]:
    """Return which clumps (N,) are not low over a carriageway."""
    keep = np.ones(len(clumps), bool)
    low = np.flatnonzero(clumps[..., 2].min(axis=1) < foot + CLEARANCE_M)
    if not carriageway.is_empty and len(low):
        shapely.prepare(carriageway)
        x, y = clumps[low, :, 0], clumps[low, :, 1]
        over = shapely.contains_xy(carriageway, x.ravel(), y.ravel()).reshape(x.shape).any(axis=1)
        keep[low[over]] = False
    return keep


def surveyed_tree_mesh(
    trees: Sequence[SurveyedTree],
    ground_height: GroundHeight,
    *,
    region: Polygon | None = None,
    carriageway: Geometry | None = None,
) -> tuple[LabelledMesh, dict[str, int]]:
    """Create trees that were found in a survey.

    Args:
        trees: the trees; those with values that are not finite are left out.
        ground_height: heights of the ground.
        region: trees outside it are left out; ``None``: no limit.
        carriageway: trunks on it are moved beside it, up to 3 m, and crowns leave it clear.

    Returns:
        The mesh, ``part`` 1, 2, ... per tree, and counts of trees built and left out.
    """
    notes: Counter[str] = Counter()
    numbers = np.array(
        [(t.x, t.y, t.height_m, t.crown_m, t.crown_base_m) for t in trees], np.float64
    ).reshape(-1, 5)
    good = np.isfinite(numbers).all(axis=1) & (numbers[:, 2] > 0)
    notes["surveyed trees without a size, left out"] = int((~good).sum())
    if region is not None:
        outside = good & ~shapely.intersects_xy(region, numbers[:, 0], numbers[:, 1])
        notes["surveyed trees outside the region, left out"] = int(outside.sum())
        good &= ~outside
    road = carriageway if carriageway is not None else Polygon()
    placed = beside_carriageway(numbers[good, :2], road, margin_m=0.6, farthest_m=3.0)
    free = np.isfinite(placed[:, 0])
    notes["surveyed trees on carriageways, left out"] = int((~free).sum())
    grown = [
        GrownTree(x, y, surveyed_size(*size), int(number))
        for (x, y), size, number in zip(
            placed[free].tolist(),
            numbers[good, 2:][free].tolist(),
            np.flatnonzero(good)[free],
            strict=True,
        )
    ]
    notes["surveyed trees"] = len(grown)
    assembly = Assembly()
    grow(assembly, grown, ground_height=ground_height, carriageway=road)
    return assembly.mesh(), dict(sorted((k, n) for k, n in notes.items() if n))
