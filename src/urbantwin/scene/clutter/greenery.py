"""Trees and shrubs of gardens, verges and other green land where none are mapped."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from urbantwin.geometry import area_difference, area_intersection, area_union, grown
from urbantwin.scene.clutter.practice import rows_of
from urbantwin.scene.clutter.scatter import cell_draws, planted, scattered
from urbantwin.site.extract import OsmFeature

__all__ = ["Land", "greenery_features", "shrub_tags", "tree_clumps"]

#: Maximum distance of plants from carriageways: farther ones are hardly visible, metres.
SEEN_M = 32.0
#: No trees are assumed this close to a mapped one, metres; in gardens few trees are mapped.
MAPPED_M, MAPPED_IN_GARDENS_M = 30.0, 10.0
#: Minimum distance of trunks from buildings and from streets and footways, of crowns from streets,
#: m.
FROM_WALLS_M, NEAREST_M, FROM_STREET_M = 2.5, 1.0, 0.3
#: Maximum factor on the density of trees if little of the land is far enough from walls.
MOST_DENSE = 2.0
#: Beds: edge of the cells of beds, edge of the cells of shrubs within, share of these with a shrub.
BED_M, SHRUB_M, FULL = 4.0, 1.5, 0.8
#: Edge of the cells with at most one single shrub, metres.
SINGLE_M = 5.0
#: Distance from carriageways without tall plants: drivers see over 0.8 m (RASt 06), metres.
SIGHT_M, LOW_M = 3.0, 0.8
#: Beds by height: share, minimum and maximum, metres. Estimates.
BEDS = ((0.35, 0.4, 0.9), (0.40, 0.8, 1.6), (0.25, 1.4, 2.8))
#: Garden trees: minimum and maximum height, and share of conifers. Estimates.
TREE_M, CONIFERS = (3.0, 9.0), 0.25
#: Groups of hot countries, with palms instead of conifers.
HOT = ("asia",)
#: Triangles of a shrub of a metre, of the crown of a 6 m tree, and its outline; number ~ root of
#: outline.
SHRUB_CLUMPS, TREE_CLUMPS, OUTLINE_M2 = 22, 85, 25.0
FEWEST_CLUMPS, MOST_CLUMPS = 55, 130
#: Maximum numbers of assumed trees and shrubs of a scene, to limit file sizes, and square metres of
#: the region per shrub. Plants with the lowest products of draw and distance from carriageways plus
#: the last value, metres, are kept.
MOST_TREES, MOST_SHRUBS, SHRUB_M2, NEAR_M = 150, 500, 110.0, 5.0


@dataclass(frozen=True, eq=False)
class Land:
    """Areas beside the streets, site frame.

    Attributes:
        seen_from: carriageways.
        street: areas for vehicles and pedestrians.
        walls: buildings.
        taken: areas without plants: ways, tracks, water, and around sensors and crossings.
        kinds: land by kind, see ``plants.csv``.
    """

    seen_from: shapely.Geometry
    street: shapely.Geometry
    walls: shapely.Geometry
    taken: shapely.Geometry
    kinds: Mapping[str, shapely.Geometry]


def greenery_features(
    land: Land, features: Sequence[OsmFeature], region: shapely.Polygon, group: str
) -> tuple[list[OsmFeature], Counter[str]]:
    """Return trees and shrubs, tagged as in the map; and counts.

    Args:
        land: the areas beside the streets.
        features: the map's features, with its trees.
        region: nothing is planted outside it.
        group: group of countries whose practice is used, see `practice.group_of`.
    """
    near = area_intersection(region, grown(land.seen_from, SEEN_M))
    free = area_difference(near, area_union([land.street, land.walls, land.taken]))
    rows = {row["land"]: row for row in reversed(rows_of("plants.csv", group))}
    trees: list[tuple[float, OsmFeature]] = []
    shrubs: list[tuple[float, OsmFeature]] = []
    for number, (kind, area) in enumerate(sorted(land.kinds.items())):
        if kind not in rows or area.is_empty:
            continue
        mine = area_intersection(area, free)
        row = rows[kind]
        apart = MAPPED_IN_GARDENS_M if kind == "garden" else MAPPED_M
        open_ = _far_from_mapped(mine, features, apart)
        other = "palm" if group in HOT else "needleleaved"
        trees += _trees(open_, land, float(row["trees"]), other, 100 + number)
        shrubs += _shrubs(mine, land, float(row["beds"]), float(row["singles"]), 200 + 10 * number)
    most = min(MOST_SHRUBS, round(region.area / SHRUB_M2))
    kept = [*_first(trees, MOST_TREES, land), *_first(shrubs, most, land)]
    notes = Counter(
        "trees beside streets" if one.tags["natural"] == "tree" else "shrubs" for one in kept
    )
    return kept, notes


def _first(found: list[tuple[float, OsmFeature]], most: int, land: Land) -> list[OsmFeature]:
    """Return the plants with the lowest draws; those near carriageways are preferred."""
    away = shapely.distance(land.seen_from, [one.geometry for _, one in found])
    order = (np.array([draw for draw, _ in found]) * (NEAR_M + away)).argsort(kind="stable")
    return [found[k][1] for k in order[:most].tolist()]


def shrub_tags(height: float, across: float) -> dict[str, str]:
    """Return the tags of a deciduous shrub: its size, and its number of triangles."""
    count = round(SHRUB_CLUMPS * min(max(np.sqrt(across * height), 0.6), 2.0))
    return {
        "natural": "shrub",
        "height": f"{height:.2f}",
        "diameter_crown": f"{across:.2f}",
        "triangles": str(count),
    }


def tree_clumps(height: float, across: float) -> int:
    """Return the number of triangles of the crown of an assumed tree."""
    count = TREE_CLUMPS * math.sqrt(height * across / OUTLINE_M2)
    return round(min(max(count, FEWEST_CLUMPS), MOST_CLUMPS))


def _trees(
    area: shapely.Geometry,
    land: Land,
    rate: float,
    other: str,
    seed: int,
) -> list[tuple[float, OsmFeature]]:
    """Return trees of an area by number per hectare, with draws to select some of them.

    ``other`` is the leaf type of trees that are not broadleaved.
    """
    kept_from = area_union([grown(land.walls, FROM_WALLS_M), grown(land.street, NEAREST_M)])
    free = area_difference(area, kept_from)
    if rate <= 0 or free.is_empty:
        return []
    # Trees excluded near walls are added to the remaining land, up to a limit.
    dense = min(area.area / free.area, MOST_DENSE)
    xy, draws = scattered(free, 100 / math.sqrt(rate * MOST_DENSE), seed, 6)
    taken = draws[:, 5] < dense / MOST_DENSE
    xy, draws = xy[taken], draws[taken]
    if not len(xy):
        return []
    points = shapely.points(xy)
    to_walls = (
        shapely.distance(land.walls, points) if not land.walls.is_empty else np.full(len(xy), 99.0)
    )
    to_street = shapely.distance(land.street, points)
    height = TREE_M[0] + (TREE_M[1] - TREE_M[0]) * draws[:, 0]
    conifer = draws[:, 1] < CONIFERS
    across = np.where(conifer, 0.45, 0.7) * height * (0.85 + 0.3 * draws[:, 2])
    across = np.minimum(across, 2 * to_walls - 1.0)
    # Leaves begin near the ground; over footways there are none below 2.5 m.
    base = np.where(conifer, 0.3, 0.5 + 1.3 * draws[:, 3])
    if other == "palm":
        base = np.where(conifer, 0.6 * height, base)
    over = to_street < across / 2 + FROM_STREET_M
    base = np.where(over, 2.5, base)
    good = (across >= 1.2) & (~over | (~conifer & (height > 4.5)))
    return [
        (
            float(draw),
            planted(
                {
                    "natural": "tree",
                    "height": f"{high:.2f}",
                    "diameter_crown": f"{wide:.2f}",
                    "crown_base": f"{low:.2f}",
                    "leaf_type": other if needles else "broadleaved",
                    "triangles": str(tree_clumps(high, wide)),
                },
                spot,
            ),
        )
        for spot, high, wide, low, needles, draw, kept in zip(
            xy, height, across, base, conifer, draws[:, 4], good, strict=True
        )
        if kept
    ]


def _far_from_mapped(
    area: shapely.Geometry, features: Sequence[OsmFeature], apart: float
) -> shapely.Geometry:
    """Return the part of an area that is not near mapped trees."""
    mapped = [
        f.geometry for f in features
        if f.tags.get("natural") in ("tree", "tree_row", "wood", "tree_group")
        or f.tags.get("landuse") in ("forest", "orchard")
    ]  # fmt: skip
    near = [shape for shape in mapped if shapely.dwithin(shape, area, apart)]
    return area_difference(area, shapely.union_all(shapely.buffer(near, apart, quad_segs=3)))


def _shrubs(
    area: shapely.Geometry, land: Land, beds: float, singles: float, seed: int
) -> list[tuple[float, OsmFeature]]:
    """Return shrubs of an area, in beds and single, with draws to select some of them."""
    xy, draws = scattered(area, SHRUB_M, seed, 4)
    bed = np.floor(xy / BED_M).astype(np.int64)
    of_bed = cell_draws(bed, seed + 1, 3)
    in_bed = (of_bed[:, 0] < beds) & (draws[:, 0] < FULL)
    alone, own = scattered(area, SINGLE_M, seed + 2, 6)
    taken = own[:, 0] < singles * SINGLE_M**2 / 100
    kind = np.searchsorted(np.cumsum([share for share, _, _ in BEDS])[:-1], of_bed[:, 1])
    low, high = (np.array([row[k] for row in BEDS])[kind] for k in (1, 2))
    xy = np.concatenate([xy[in_bed], alone[taken]])
    height = np.concatenate(
        [(low + (high - low) * (0.7 * of_bed[:, 2] + 0.3 * draws[:, 1]))[in_bed],
         0.6 + 1.6 * own[taken, 1]]
    )  # fmt: skip
    wide = np.concatenate([draws[in_bed, 2], own[taken, 2]])
    # A bed is kept or removed as a whole.
    order = np.concatenate([of_bed[in_bed, 0] / max(beds, 1e-9), own[taken, 3]])
    if not len(xy):
        return []
    points = shapely.points(xy)
    shapely.prepare(land.seen_from)
    height = np.where(
        shapely.dwithin(land.seen_from, points, SIGHT_M), np.minimum(height, LOW_M), height
    )
    across = np.clip((0.7 + 0.6 * wide) * (0.5 + 0.6 * height), 0.5, 2.2)
    across = np.minimum(across, 2 * (shapely.distance(land.street, points) - FROM_STREET_M))
    return [
        (float(draw), planted(shrub_tags(high, broad), spot))
        for spot, high, broad, draw in zip(xy, height, across, order, strict=True)
        if broad >= 0.4
    ]
