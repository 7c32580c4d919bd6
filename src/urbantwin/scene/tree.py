"""Trees, rows of trees, woods and shrubs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.random import Generator, Philox
from numpy.typing import NDArray
from shapely import Geometry, LineString, MultiPolygon, Point, Polygon

from urbantwin.geometry import LabelledMesh
from urbantwin.scene.building import building_footprints
from urbantwin.scene.crown import broadleaved_crown, needleleaved_crown
from urbantwin.scene.placement import beside_carriageway, grounded
from urbantwin.scene.shrub import bushes
from urbantwin.scene.solids import Assembly, GroundHeight, Solid, columns
from urbantwin.scene.tag import length_m_of
from urbantwin.site.extract import OsmFeature

__all__ = ["tree_mesh"]

#: Trunks stand this far from carriageways; a mapped tree is moved no farther than this, metres.
KERB_M = 0.6
FARTHEST_M = 3.0
#: Trees of a row, of a wood; bushes of a scrub: spacing, metres.
ROW_M = 8.0
WOOD_M = 6.0
SCRUB_M = 1.6
#: At most so many trees of woods and bushes are drawn: those nearest to carriageways.
MOST_WOOD_TREES = 300
MOST_BUSHES = 1500
#: Crowns are cut back over carriageways to this height, metres.
CLEARANCE_M = 4.5
BURIED_M = 0.3


@dataclass(frozen=True)
class _Tree:
    x: float
    y: float
    tags: dict[str, str]
    seed: int


def tree_mesh(
    features: Sequence[OsmFeature],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
) -> tuple[LabelledMesh, dict[str, int]]:
    """Build mapped trees, rows of trees, the edges of woods, and shrubs.

    A tree is a tapered trunk (class ``trunk``) and a crown of leaf clumps (``vegetation``). Its
    height, crown and trunk follow ``height``, ``diameter_crown`` and ``circumference``; what is
    not mapped is derived from what is. The same map gives the same trees.

    Args:
        features: the map's features, site frame.
        region: trees outside it are left out.
        ground_height: heights of the ground.
        carriageway: where no trunk may stand; crowns leave 4.5 m clear above it.

    Returns:
        The mesh, ``part`` 1, 2, ... per tree or area of shrubs, and counts of what was built and
        left out.
    """
    notes: Counter[str] = Counter()
    blocked = shapely.union_all([p for p in building_footprints(features) if region.intersects(p)])
    taken = shapely.union_all([blocked, carriageway.buffer(KERB_M)])
    shapely.prepare(taken)
    trees = _mapped_trees(features, region, carriageway, notes)
    trees += _row_trees(features, region, taken, trees, notes)
    trees += _wood_trees(features, region, taken, carriageway, notes)
    assembly = Assembly()
    if trees:
        xy = np.array([(tree.x, tree.y) for tree in trees])
        feet = grounded(xy, ground_height(xy))
        crowns = []
        for tree, foot in zip(trees, feet, strict=True):
            crowns.append(_add_trunk(assembly, tree, foot))
        _add_crowns(assembly, crowns, feet[:, 2], carriageway)
        notes["trees"] = len(trees)
    _add_scrub(assembly, features, region, taken, carriageway, ground_height, notes)
    return assembly.mesh(), dict(sorted((k, n) for k, n in notes.items() if n))


def _mapped_trees(
    features: Iterable[OsmFeature], region: Polygon, carriageway: Geometry, notes: Counter[str]
) -> list[_Tree]:
    """Return the trees mapped one by one; trunks on a carriageway's border are moved beside it."""
    found = [
        f
        for f in features
        if f.tags.get("natural") == "tree"
        and isinstance(f.geometry, Point)
        and region.covers(f.geometry)
    ]
    mapped = np.array([[f.geometry.x, f.geometry.y] for f in found]).reshape(-1, 2)
    placed = beside_carriageway(mapped, carriageway, margin_m=KERB_M, farthest_m=FARTHEST_M)
    keep = np.isfinite(placed[:, 0])
    notes["trees moved off carriageways"] = int((keep & (placed != mapped).any(axis=1)).sum())
    notes["trees on carriageways, left out"] = int((~keep).sum())
    return [
        _Tree(float(x), float(y), f.tags, f.id)
        for f, (x, y), kept in zip(found, placed, keep, strict=True)
        if kept
    ]


def _row_trees(
    features: Iterable[OsmFeature],
    region: Polygon,
    taken: Geometry,
    mapped: Sequence[_Tree],
    notes: Counter[str],
) -> list[_Tree]:
    """Return a tree every 8 m of a row, except where one is mapped already."""
    near = shapely.STRtree([Point(tree.x, tree.y) for tree in mapped])
    trees = []
    for feature in features:
        if feature.tags.get("natural") != "tree_row" or not isinstance(
            feature.geometry, LineString
        ):
            continue
        count = max(round(feature.geometry.length / ROW_M), 1)
        spots = feature.geometry.interpolate(np.arange(count + 1) / count, normalized=True)
        for k, spot in enumerate(spots):
            if not region.covers(spot) or taken.intersects(spot):
                continue
            if len(near.query(spot, predicate="dwithin", distance=ROW_M / 2)):
                continue
            trees.append(_Tree(spot.x, spot.y, feature.tags, feature.id * 1000 + k))
    notes["trees of rows"] = len(trees)
    return trees


def _wood_trees(
    features: Iterable[OsmFeature],
    region: Polygon,
    taken: Geometry,
    carriageway: Geometry,
    notes: Counter[str],
) -> list[_Tree]:
    """Return trees of woods, those nearest to the carriageways first, up to a cap."""
    trees = []
    for feature in features:
        is_wood = feature.tags.get("natural") == "wood" or feature.tags.get("landuse") == "forest"
        if not is_wood or not isinstance(feature.geometry, Polygon | MultiPolygon):
            continue
        area = shapely.intersection(feature.geometry, region)
        for k, (x, y) in enumerate(_scattered(area, taken, WOOD_M, feature.id).tolist()):
            trees.append(_Tree(x, y, feature.tags, feature.id * 1000 + k))
    if len(trees) > MOST_WOOD_TREES:
        order = _nearest([(tree.x, tree.y) for tree in trees], carriageway)[:MOST_WOOD_TREES]
        notes["trees within woods, left out"] = len(trees) - MOST_WOOD_TREES
        trees = [trees[k] for k in sorted(order.tolist())]
    notes["trees of woods"] = len(trees)
    return trees


def _scattered(area: Geometry, taken: Geometry, spacing: float, seed: int) -> NDArray[np.float64]:
    """Return points (N, 2) over an area, one per square of a jittered grid, none where taken."""
    if area.is_empty or area.area < spacing:
        return np.zeros((0, 2))
    west, south, east, north = area.bounds
    x, y = np.meshgrid(np.arange(west, east, spacing), np.arange(south, north, spacing))
    points = np.column_stack([x.ravel(), y.ravel()])
    points += Generator(Philox(key=abs(seed))).uniform(0, spacing, points.shape)
    shapely.prepare(area)
    inside = shapely.contains_xy(area, points[:, 0], points[:, 1])
    points = points[inside]
    return np.asarray(points[~shapely.contains_xy(taken, points[:, 0], points[:, 1])])


def _nearest(xy: Sequence[tuple[float, float]], carriageway: Geometry) -> NDArray[np.int64]:
    """Return the order of points by distance to the carriageways, or to the anchor."""
    goal = Point(0, 0) if carriageway.is_empty else carriageway
    return np.argsort(shapely.distance(shapely.points(np.asarray(xy)), goal), kind="stable")


def _add_trunk(assembly: Assembly, tree: _Tree, foot: NDArray[np.float64]) -> _Crown:
    """Add a tree's trunk; return its crown."""
    rng = Generator(Philox(key=abs(tree.seed)))
    size = _size(tree.tags, rng)
    part = assembly.new_part()
    trunk_top = size.crown_low + (0.95 if size.needles else 0.55) * (size.height - size.crown_low)
    trunk = columns(foot - [0, 0, BURIED_M], trunk_top + BURIED_M, size.trunk, 0.35 * size.trunk, 8)
    assembly.add(trunk, "trunk", "bark", part)
    shape = needleleaved_crown if size.needles else broadleaved_crown
    clumps = shape(size.crown, size.crown_low, size.height, rng)
    return _Crown(clumps + foot, part)


@dataclass(frozen=True)
class _Crown:
    clumps: NDArray[np.float64]
    part: int


@dataclass(frozen=True)
class _Size:
    height: float
    crown: float
    crown_low: float
    trunk: float
    needles: bool


def _size(tags: dict[str, str], rng: Generator) -> _Size:
    """Return a tree's size in metres; ``trunk`` is a radius."""
    needles = tags.get("leaf_type") == "needleleaved"
    slender = 0.4 if needles else 0.65
    height = length_m_of(tags.get("height"))
    crown = length_m_of(tags.get("diameter_crown"))
    girth = length_m_of(tags.get("circumference"))
    if girth is not None and girth > 12:  # mapped in centimetres
        girth /= 100
    if height is None:
        if crown is not None:
            height = crown / slender
        elif girth is not None:
            # About 10 m at 0.8 m of girth and 18 m at 2 m: street trees of temperate cities.
            height = 11.5 * girth**0.65
        else:
            height = (11.0 if needles else 9.0) * rng.uniform(0.8, 1.2)
        height = min(max(height, 3.0), 28.0)
    height = min(max(height, 1.5), 80.0)
    if crown is None:
        crown = min(max(slender * height, 1.5), 14.0) * rng.uniform(0.9, 1.1)
    crown = min(crown, 35.0)
    clear = (0.12 if needles else 0.3) * height
    if not needles and height > 5:
        clear = min(max(clear, 2.3), 0.45 * height)
    trunk = girth / (2 * np.pi) if girth is not None else 0.04 + 0.014 * height
    return _Size(height, crown, clear, min(trunk, 2.0, crown / 4), needles)


def _add_crowns(
    assembly: Assembly,
    crowns: Sequence[_Crown],
    ground: NDArray[np.float64],
    carriageway: Geometry,
) -> None:
    """Add crowns, cut back over carriageways."""
    clumps = np.concatenate([crown.clumps for crown in crowns])
    part = np.repeat([crown.part for crown in crowns], [len(crown.clumps) for crown in crowns])
    foot = np.repeat(ground, [len(crown.clumps) for crown in crowns])
    lowest = clumps[..., 2].min(axis=1)
    low = np.flatnonzero(lowest < foot + CLEARANCE_M)
    if not carriageway.is_empty and len(low):
        shapely.prepare(carriageway)
        x, y = clumps[low, :, 0], clumps[low, :, 1]
        over = shapely.contains_xy(carriageway, x.ravel(), y.ravel()).reshape(x.shape).any(axis=1)
        keep = np.ones(len(clumps), bool)
        keep[low[over]] = False
        clumps, part = clumps[keep], part[keep]
    vertices = clumps.reshape(-1, 3)
    leaves = Solid(vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3))
    assembly.add(leaves, "vegetation", "foliage", part)


def _add_scrub(
    assembly: Assembly,
    features: Iterable[OsmFeature],
    region: Polygon,
    taken: Geometry,
    carriageway: Geometry,
    ground_height: GroundHeight,
    notes: Counter[str],
) -> None:
    """Add single shrubs and the bushes of areas of shrubs, up to a cap."""
    spots: list[tuple[float, float]] = []
    owners: list[OsmFeature] = []
    for feature in features:
        shape, tags = feature.geometry, feature.tags
        if tags.get("natural") == "shrub" and isinstance(shape, Point):
            found = [(shape.x, shape.y)] if region.covers(shape) else []
        elif (
            tags.get("natural") in ("scrub", "shrubbery")
            or tags.get("barrier") == "hedge"
            or tags.get("landuse") == "shrubs"
        ) and isinstance(shape, Polygon | MultiPolygon):
            area = shapely.intersection(shape, region)
            found = [tuple(p) for p in _scattered(area, taken, SCRUB_M, feature.id).tolist()]
        else:
            continue
        spots += found
        owners += [feature] * len(found)
    if not spots:
        return
    chosen = np.sort(_nearest(spots, carriageway)[:MOST_BUSHES])
    notes["bushes"] = len(chosen)
    notes["bushes within scrub, left out"] = len(spots) - len(chosen)
    xy = np.array(spots)[chosen]
    feet = grounded(xy, ground_height(xy))
    mine = [owners[k] for k in chosen.tolist()]
    rng = Generator(Philox(key=abs(mine[0].id)))
    tall = np.array([length_m_of(f.tags.get("height")) or 1.5 for f in mine])
    heights = np.minimum(tall, 4.0) * rng.uniform(0.75, 1.0, len(feet))
    solid, faces = bushes(feet, rng.uniform(0.8, 1.2, len(feet)), heights, mine[0].id)
    numbers: dict[int, int] = {}
    for feature in mine:
        if feature.id not in numbers:
            numbers[feature.id] = assembly.new_part()
    part = np.repeat([numbers[feature.id] for feature in mine], faces)
    assembly.add(solid, "vegetation", "foliage", part)
