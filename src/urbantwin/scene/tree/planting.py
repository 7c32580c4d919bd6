"""Planting of trees, shrubs and woods: as mapped, or at random positions in mapped areas."""

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
from urbantwin.scene.placement import beside_carriageway, not_imported, on_ground
from urbantwin.scene.solids import Assembly, GroundHeight
from urbantwin.scene.tag_values import count_of, length_m_of
from urbantwin.scene.tree.growth import GrownTree, grow
from urbantwin.scene.tree.shrub import bushes, leafy_bush, loose
from urbantwin.scene.tree.size import mapped_size
from urbantwin.site.corrections import REMOVED
from urbantwin.site.extract import OsmFeature

__all__ = ["tree_mesh"]

#: Minimum distance of trunks from carriageways, and maximum shift of a mapped tree, metres.
KERB_M = 0.6
FARTHEST_M = 3.0
#: Trees of a row, of a wood, of an orchard; bushes of a scrub: spacing, metres.
ROW_M = 8.0
WOOD_M = 6.0
ORCHARD_M = 5.0
SCRUB_M = 1.6
#: Maximum number of wood trees and of bushes: those nearest to carriageways are kept.
MOST_WOOD_TREES = 400
MOST_BUSHES = 1500
#: Minimum distance of random trees from the middle of ways and tracks, metres.
WAY_M = 1.8
SCRUBS = {
    "natural": {"scrub", "shrubbery", "heath"},
    "landuse": {"shrubs", "vineyard"},
    "barrier": {"hedge"},
}
#: Heights of shrubs without a mapped height, metres.
LOW = {"heath": 0.6, "vineyard": 1.8}


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
    without: Geometry | None = None,
    decks: Geometry | None = None,
) -> tuple[LabelledMesh, dict[str, int]]:
    """Build mapped trees, rows of trees, woods, orchards, and shrubs.

    A tree's height, crown and trunk follow ``height``, ``diameter_crown`` and ``circumference``;
    values that are not mapped are derived from the mapped ones and from the genus. The same map
    gives the same trees.

    Args:
        features: the map's features, site frame.
        region: trees outside it are left out.
        ground_height: heights of the ground.
        carriageway: area without trunks; crowns leave 4.5 m clear above it.
        without: area in which imported geometry contains the trees.
        decks: decks over the ground in plan; no random trees are placed under them.

    Returns:
        The mesh, ``part`` 1, 2, ... per tree or area of shrubs, and counts of objects built and
        left out.
    """
    notes: Counter[str] = Counter()
    blocked = carriageway if decks is None else shapely.union(carriageway, decks)
    taken = _taken(features, region, blocked)
    green = [f for f in features if _is_green(f.tags)]
    mine = not_imported(green, without)
    trees = _mapped_trees(mine, region, carriageway, notes)
    trees += _row_trees(mine, region, taken, trees, notes)
    trees += _wood_trees(mine, region, taken, carriageway, notes)
    # A removed tree has kept its position free of other trees of its row.
    trees = [tree for tree in trees if REMOVED not in tree.tags]
    assembly = Assembly()
    grown = [
        GrownTree(
            t.x,
            t.y,
            mapped_size(t.tags, Generator(Philox(key=abs(t.seed)))),
            t.seed,
            _triangles(t.tags),
        )
        for t in trees
    ]
    grow(assembly, grown, ground_height=ground_height, carriageway=carriageway)
    notes["trees"] = len(trees)
    notes["trees without a mapped height"] = sum("height" not in t.tags for t in trees)
    _add_leafy(assembly, mine, region, ground_height, notes)
    _add_scrub(
        assembly,
        [f for f in mine if not _is_leafy(f)],
        region,
        taken,
        carriageway,
        ground_height,
        notes,
    )
    return assembly.mesh(), dict(sorted((k, n) for k, n in notes.items() if n))


def _is_green(tags: dict[str, str]) -> bool:
    return (
        tags.get("natural") in ("tree", "tree_row", "tree_group", "shrub", "wood")
        or tags.get("landuse") in ("forest", "orchard")
        or any(tags.get(key) in values for key, values in SCRUBS.items())
    )


def _taken(features: Sequence[OsmFeature], region: Polygon, carriageway: Geometry) -> Geometry:
    """Return the area without random plants."""
    shapes = [p for p in building_footprints(features) if region.intersects(p)]
    lines, areas = [], []
    for feature in features:
        tags, shape = feature.tags, feature.geometry
        if shape.geom_type == "LineString":
            if ("highway" in tags or "railway" in tags) and tags.get("tunnel", "no") == "no":
                lines.append(shape)
        elif tags.get("natural") == "water" or tags.get("waterway") == "riverbank":
            areas.append(shape)
    ways = shapely.intersection(np.array(lines, object), region.buffer(WAY_M))
    shapes += [carriageway.buffer(KERB_M), *areas, *shapely.buffer(ways, WAY_M, cap_style="flat")]
    taken = shapely.union_all(shapes)
    shapely.prepare(taken)
    return taken


def _mapped_trees(
    features: Iterable[OsmFeature], region: Polygon, carriageway: Geometry, notes: Counter[str]
) -> list[_Tree]:
    """Return individually mapped trees; trunks on a carriageway's border are moved beside it."""
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
    """Return a tree every 8 m of a row, except near individually mapped trees."""
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
    """Return trees of woods, nearest to the carriageways first, up to a maximum number."""
    trees = []
    for feature in features:
        tags, shape = feature.tags, feature.geometry
        orchard = tags.get("landuse") == "orchard"
        is_wood = tags.get("natural") in ("wood", "tree_group") or tags.get("landuse") == "forest"
        if not (is_wood or orchard) or not isinstance(shape, Polygon | MultiPolygon):
            continue
        area = shapely.intersection(shape, region)
        spots = _scattered(area, taken, ORCHARD_M if orchard else WOOD_M, feature.id)
        own = _wood_tags(tags, orchard, len(spots), feature.id)
        for k, (x, y) in enumerate(spots.tolist()):
            trees.append(_Tree(x, y, own[k], feature.id * 1000 + k))
    if len(trees) > MOST_WOOD_TREES:
        order = _nearest([(tree.x, tree.y) for tree in trees], carriageway)[:MOST_WOOD_TREES]
        notes["trees within woods, left out"] = len(trees) - MOST_WOOD_TREES
        trees = [trees[k] for k in sorted(order.tolist())]
    notes["trees of woods"] = len(trees)
    return trees


def _wood_tags(tags: dict[str, str], orchard: bool, count: int, seed: int) -> list[dict[str, str]]:
    """Return the tags of each tree of a wood; a ``mixed`` wood has trees of both kinds."""
    if orchard:
        return [{"genus": "Malus", **tags}] * count
    if tags.get("leaf_type") != "mixed":
        return [tags] * count
    needles = Generator(Philox(key=abs(seed) + 1)).random(count) < 0.5
    kinds = ("broadleaved", "needleleaved")
    return [{**tags, "leaf_type": kinds[int(k)]} for k in needles]


def _scattered(area: Geometry, taken: Geometry, spacing: float, seed: int) -> NDArray[np.float64]:
    """Return points (N, 2) in an area, one per square of a jittered grid, not where occupied."""
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


def _triangles(tags: dict[str, str]) -> int | None:
    """Return the number of triangles of an assumed tree; ``None`` for mapped trees."""
    count = count_of(tags.get("triangles"))
    return None if count is None else int(np.clip(count, 12, 900))


def _is_leafy(feature: OsmFeature) -> bool:
    return feature.tags.get("natural") == "shrub" and "triangles" in feature.tags


def _add_leafy(
    assembly: Assembly,
    features: Iterable[OsmFeature],
    region: Polygon,
    ground_height: GroundHeight,
    notes: Counter[str],
) -> None:
    """Add the shrubs that are assumed, each of loose leaves."""
    mine = [f for f in features if _is_leafy(f) and region.covers(f.geometry)]
    if not mine:
        return
    xy = shapely.get_coordinates([f.geometry for f in mine])
    feet = on_ground(xy, ground_height(xy))
    solids = [
        leafy_bush(
            foot,
            length_m_of(f.tags.get("diameter_crown")) or 1.0,
            length_m_of(f.tags.get("height")) or 1.0,
            f.id,
            _triangles(f.tags) or 40,
        )
        for f, foot in zip(mine, feet, strict=True)
    ]
    many = [len(solid.faces) for solid in solids]
    leaves = loose(np.concatenate([solid.vertices for solid in solids]))
    parts = np.array([assembly.new_part() for _ in mine])
    assembly.add(leaves, "vegetation", "foliage", np.repeat(parts, many))
    notes["leafy shrubs"] = len(mine)


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
        elif any(tags.get(key) in values for key, values in SCRUBS.items()) and isinstance(
            shape, Polygon | MultiPolygon
        ):
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
    feet = on_ground(xy, ground_height(xy))
    mine = [owners[k] for k in chosen.tolist()]
    rng = Generator(Philox(key=abs(mine[0].id)))
    tall = np.array([length_m_of(f.tags.get("height")) or _low(f.tags) for f in mine])
    heights = np.minimum(tall, 4.0) * rng.uniform(0.75, 1.0, len(feet))
    solid, faces = bushes(feet, rng.uniform(0.8, 1.2, len(feet)), heights, mine[0].id)
    numbers: dict[int, int] = {}
    for feature in mine:
        if feature.id not in numbers:
            numbers[feature.id] = assembly.new_part()
    part = np.repeat([numbers[feature.id] for feature in mine], faces)
    assembly.add(solid, "vegetation", "foliage", part)


def _low(tags: dict[str, str]) -> float:
    return LOW.get(tags.get("natural", ""), LOW.get(tags.get("landuse", ""), 1.5))
