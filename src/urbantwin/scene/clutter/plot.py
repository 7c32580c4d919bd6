"""Fronts of plots: walls, hedges and fences along streets, and objects behind them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from zlib import crc32

import numpy as np
import shapely
from numpy.random import Generator, Philox
from numpy.typing import NDArray
from shapely.ops import substring

from urbantwin.geometry import area_difference, area_union, grown
from urbantwin.scene.clutter.greenery import shrub_tags
from urbantwin.scene.clutter.practice import Boundary, boundaries, side_boundaries
from urbantwin.scene.land_use import use_of_building
from urbantwin.site.extract import OsmFeature

__all__ = ["Ground", "plot_features"]

#: Distance of boundaries from the paved street, so that pedestrians do not touch them, metres.
SET_BACK_M = 0.35
#: Distance of boundaries from carriageways: the overhang of long vehicles over a kerb, metres.
FROM_CARRIAGEWAY_M = 1.2
#: Strips between parts of a street that are narrower than this are verges, not plots, metres.
VERGE_M = 4.0
#: Range of the distance from the street of a building with a front garden, metres.
NEAREST_M, FARTHEST_M = 1.6, 16.0
#: Width of plots without a building, and their maximum distance from the next building, metres.
WIDE_M, FROM_HOUSES_M = 16.0, 120.0
#: Length of boundaries between neighbours behind the front of a building, metres.
BEHIND_M = 9.0
#: Larger buildings are blocks of flats, whose land is not divided, square metres.
LARGEST_HOUSE_M2 = 350.0
#: Land without a building enclosed by streets is a traffic island below this, square metres.
ISLAND_M2 = 1200.0
#: Plots are only along streets for vehicles, within this distance, metres.
ALONG_M = 12.0
#: Nothing is assumed within this distance of a mapped barrier, metres.
MAPPED_M = 4.0
#: Width of gates and of drives, and share of gardens with a drive: over 40 % of the front gardens
#: of Ealing (London, 2005: a survey of 7,675) are used for parking.
GATE_M, DRIVE_M, DRIVES = 1.2, 3.0, 0.4
SHORTEST_M, STEP_M = 2.5, 1.0
#: Shrubs per metre of garden front (fitted to odd-numbered frames of KITTI), and share of gardens
#: with wheeled bins (an estimate).
SHRUBS_PER_M, BINS = 0.2, 0.35
SEED = 9_101
#: First id of assumed features: above the ids of the map.
FIRST_ID = 1 << 40


@dataclass(frozen=True, eq=False)
class Ground:
    """Areas beside the streets, site frame.

    Attributes:
        street: all areas paved for vehicles and pedestrians.
        carriageway: the carriageways.
        public: open land that is not part of a plot: parks, squares, car parks, water.
        barriers: the mapped barriers.
        is_town: whether land without a mapped building is also assumed to be built-up.
    """

    street: shapely.Geometry
    carriageway: shapely.Geometry
    public: shapely.Geometry
    barriers: shapely.Geometry
    is_town: bool


@dataclass(frozen=True)
class _Front:
    """Part of a plot's front: its building (-1: none), line and depth."""

    house: int
    line: shapely.LineString
    depth_m: float
    inward: NDArray[np.float64]


def plot_features(
    ground: Ground, features: Sequence[OsmFeature], region: shapely.Polygon, group: str
) -> tuple[list[OsmFeature], Counter[str]]:
    """Return boundaries, shrubs and bins of plots, tagged as in the map; and counts.

    Args:
        ground: the streets and the areas beside them.
        features: the map's features, with the buildings.
        region: nothing is placed outside it.
        group: group of countries whose practice is used, see `practice.group_of`.
    """
    houses = [
        f for f in features
        if f.tags.get("building", "no") not in ("no", "roof", "carport")
        and f.geometry.geom_type in ("Polygon", "MultiPolygon")
    ]  # fmt: skip
    found: list[OsmFeature] = []
    notes: Counter[str] = Counter()
    blocked = area_union(
        [grown(area_union([h.geometry for h in houses]), 0.15), grown(ground.street, SET_BACK_M),
         ground.public]
    )  # fmt: skip
    if not ground.barriers.is_empty:
        blocked = shapely.union(blocked, shapely.buffer(ground.barriers, 1.0, quad_segs=2))
    blocked = shapely.union(blocked, shapely.difference(shapely.buffer(region, 50), region))
    for front in _fronts(ground, houses, region):
        house = houses[front.house] if front.house >= 0 else None
        use = "dwellings" if house is None else use_of_building(house)
        middle = front.line.interpolate(0.5, normalized=True)
        # The draw depends on the building, for all its sides, or on the plot's position.
        key = abs(house.id) if house else crc32(f"{middle.x:.0f} {middle.y:.0f}".encode())
        rng = Generator(Philox(key=[SEED, key]))
        tags = _drawn(boundaries(group, use), rng)
        if tags:
            for piece in _with_gates(front.line, rng):
                found.append(OsmFeature("way", FIRST_ID + len(found), dict(tags), piece))
                notes[f"{tags['barrier']} of plots, m"] += round(piece.length)
        if house is not None and use == "dwellings":
            small = house.geometry.area <= LARGEST_HOUSE_M2
            side = _side(front, blocked) if small else None
            tags = _drawn(side_boundaries(group), rng) if side is not None else None
            if side is not None and tags:
                found.append(OsmFeature("way", FIRST_ID + len(found), dict(tags), side))
                notes[f"{tags['barrier']} between plots, m"] += round(side.length)
            for what, spot in _garden(front, group, rng):
                found.append(OsmFeature("node", FIRST_ID + len(found), what, spot))
                notes["shrubs" if "natural" in what else "wheeled bins"] += 1
    return found, notes


def _drawn(kinds: Sequence[Boundary], rng: Generator) -> Mapping[str, str] | None:
    """Return the tags of a boundary, ``None`` for an open front."""
    draw, vary = float(rng.random()), float(rng.uniform(0.85, 1.15))
    for kind in kinds:
        draw -= kind.share
        if draw < 0:
            tags = {"barrier": kind.barrier, "height": f"{kind.height_m * vary:.2f}"}
            leaves = {"triangles": "yes"} if kind.barrier == "hedge" else {}
            return {**tags, **leaves, **dict(kind.more)}
    return None


def _fronts(
    ground: Ground, houses: Sequence[OsmFeature], region: shapely.Polygon
) -> Iterator[_Front]:
    """Yield the fronts of plots along the streets."""
    # Strips between parts of a street are filled, so that only its outside is left.
    whole = grown(grown(ground.street, VERGE_M / 2), -VERGE_M / 2)
    tree = shapely.STRtree([house.geometry for house in houses])
    street = area_union([ground.street, whole])
    street = area_union([street, *_islands(street, tree)])
    kept_free = area_union(
        [grown(street, SET_BACK_M), grown(ground.carriageway, FROM_CARRIAGEWAY_M)]
    )
    border = shapely.boundary(kept_free)
    near = grown(ground.carriageway, ALONG_M)
    kept = area_difference(region, grown(ground.public, SET_BACK_M))
    line = shapely.intersection(shapely.intersection(border, near), kept)
    if not ground.barriers.is_empty:
        line = shapely.difference(line, shapely.buffer(ground.barriers, MAPPED_M, quad_segs=2))
    line = shapely.line_merge(line) if line.geom_type == "MultiLineString" else line
    parts = [p for p in shapely.get_parts(line) if p.length >= SHORTEST_M]
    shapely.prepare(street)
    for part in parts:
        yield from _of_line(part, tree, street, ground.is_town)


def _islands(street: shapely.Geometry, houses: shapely.STRtree) -> Iterator[shapely.Polygon]:
    """Yield areas enclosed by streets that are too small for a plot and without a building."""
    for part in shapely.get_parts(street):
        for ring in part.interiors:
            land = shapely.Polygon(ring)
            if land.area < ISLAND_M2 and not len(houses.query(land, "intersects")):
                yield land


def _of_line(
    part: shapely.LineString, tree: shapely.STRtree, street: shapely.Geometry, is_town: bool
) -> Iterator[_Front]:
    count = max(int(part.length / STEP_M), 1)
    at = (np.arange(count) + 0.5) * part.length / count
    points = shapely.line_interpolate_point(part, at)
    owner = np.full(count, -2)
    depth = np.full(count, np.inf)
    way = np.zeros((count, 2))
    if len(tree):
        row, house = tree.query_nearest(points, max_distance=FROM_HOUSES_M, all_matches=False)
        own = tree.geometries[house]
        line = shapely.shortest_line(points[row], own)
        depth[row] = shapely.length(line)
        ends = shapely.get_coordinates(line).reshape(-1, 2, 2)
        way[row] = ends[:, 1] - ends[:, 0]
        # Buildings across the street are not neighbours.
        free = shapely.length(shapely.intersection(line, street)) < 0.5
        ours = free & (depth[row] >= NEAREST_M) & (depth[row] <= FARTHEST_M)
        owner[row[ours]] = house[ours]
        lonely = (depth[row] > FARTHEST_M) | (~free & (depth[row] > NEAREST_M))
        if is_town:
            plot = -3 - (at / WIDE_M).astype(int)
            owner[row[lonely]] = plot[row[lonely]]
    cuts = np.flatnonzero(np.diff(owner)) + 1
    for mine in np.split(np.arange(count), cuts):
        whose = int(owner[mine[0]])
        half = part.length / count / 2
        low, high = at[mine[0]] - half, at[mine[-1]] + half
        if whose == -2 or high - low < SHORTEST_M:
            continue
        piece = substring(part, low, high).simplify(0.1)
        inward = way[mine].mean(axis=0)
        length = float(np.hypot(*inward))
        if piece.geom_type == "LineString" and length > 0:
            yield _Front(max(whose, -1), piece, float(depth[mine].min()), inward / length)


def _side(front: _Front, blocked: shapely.Geometry) -> shapely.LineString | None:
    """Return the boundary to the next plot, from a front's end inward to the first obstacle."""
    start = shapely.get_coordinates(front.line)[-1]
    end = start + (front.depth_m + BEHIND_M) * front.inward
    line = shapely.LineString([start + 0.1 * front.inward, end])
    parts = shapely.get_parts(shapely.difference(line, blocked))
    first = [p for p in parts if p.distance(shapely.Point(line.coords[0])) < 0.5]
    if not first or first[0].length < SHORTEST_M:
        return None
    return first[0]


def _with_gates(line: shapely.LineString, rng: Generator) -> Iterator[shapely.LineString]:
    """Yield the parts of a boundary beside gates and drives, one gate per building width."""
    houses = max(1, round(line.length / WIDE_M))
    cuts = []
    for k in range(houses):
        wide = DRIVE_M if rng.random() < DRIVES else GATE_M
        middle = (k + rng.uniform(0.2, 0.8)) * line.length / houses
        cuts.append((middle - wide / 2, middle + wide / 2))
    start = 0.0
    for low, high in [*cuts, (line.length, line.length)]:
        if low - start >= 1.0:
            piece = substring(line, start, low)
            if piece.geom_type == "LineString":
                yield piece
        start = max(high, start)


def _garden(
    front: _Front, group: str, rng: Generator
) -> Iterator[tuple[dict[str, str], shapely.Point]]:
    """Yield shrubs and bins between the front and the house."""
    room = min(front.depth_m - 0.7, 5.0)
    if room < 1.0:
        return

    def behind(along: float, by: float) -> shapely.Point:
        on = shapely.get_coordinates(front.line.interpolate(along))[0]
        return shapely.Point(on + by * front.inward)

    length = front.line.length
    for _ in range(int(rng.poisson(SHRUBS_PER_M * length))):
        tags = shrub_tags(float(rng.uniform(0.5, 1.7)), float(rng.uniform(0.6, 1.4)))
        yield tags, behind(rng.random() * length, rng.uniform(0.9, max(room, 0.95)))
    if group in ("britain", "europe", "america", "australia") and rng.random() < BINS:
        along = rng.uniform(0.1, 0.9) * length
        for k in range(int(rng.integers(1, 4))):
            yield {"amenity": "wheelie_bin"}, behind(min(along + 0.7 * k, length), 0.75)
