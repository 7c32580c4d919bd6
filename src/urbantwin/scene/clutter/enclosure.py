"""Fences, walls and hedges around schools, works, railways and car parks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.random import Generator, Philox

from urbantwin.geometry import area_difference, area_union, grown
from urbantwin.scene.clutter.greenery import tree_clumps
from urbantwin.scene.clutter.practice import pairs_of, rows_of, tags_of
from urbantwin.scene.clutter.scatter import planted
from urbantwin.site.extract import OsmFeature

__all__ = ["Kept", "car_park_features", "enclosure_features", "tracks_of"]

#: Range of heights of screens between car parks and streets (zoning codes: Wauseon, Ohio: a wall,
#: fence or hedge of 30 inches; Carlisle, Ohio: 3 to 5 feet; Bellwood, Illinois: 3 feet).
HEDGE_M = (0.75, 1.5)
#: A tree every 40 feet of border (Bellwood; ecode360 33048200).
TREE_M = 12.0
#: Share of car parks with such a border: an estimate.
SHARE = 0.5
#: Distance of hedges outside of the paved ground, and their thickness, metres.
OUTSIDE_M, THICK_M = 0.6, 0.8
#: Width left open on each side of ways in and out, metres.
PARK_OPEN_M = 3.5
PARK_SEEN_M, PARK_SHORTEST_M = 40.0, 2.5
PARK_SEED = 6_007
PARK_FIRST_ID = 1 << 43


def car_park_features(
    features: Sequence[OsmFeature],
    carriageway: shapely.Geometry,
    taken: shapely.Geometry,
    region: shapely.Polygon,
) -> tuple[list[OsmFeature], Counter[str]]:
    """Return hedges and trees around car parks, tagged as in the map; and counts.

    Args:
        features: the map's features: its car parks and the ways that lead in.
        carriageway: carriageways from which they are visible.
        taken: area without plants.
        region: nothing is planted outside it.
    """
    parks = [
        f for f in features
        if f.tags.get("amenity") == "parking" and "building" not in f.tags
        and f.tags.get("parking", "surface") == "surface"
        and f.geometry.geom_type in ("Polygon", "MultiPolygon")
    ]  # fmt: skip
    if not parks:
        return [], Counter()
    ways = [
        f.geometry for f in features if "highway" in f.tags and f.geometry.geom_type == "LineString"
    ]
    blocked = area_union(
        [
            grown(area_union([p.geometry for p in parks]), 0.1),
            grown(taken, THICK_M / 2 + 0.1),
            shapely.union_all(shapely.buffer(ways, PARK_OPEN_M, cap_style="flat")),
        ]
    )
    near = shapely.intersection(region, shapely.buffer(carriageway, PARK_SEEN_M, quad_segs=2))
    found: list[OsmFeature] = []
    notes: Counter[str] = Counter()
    for park in parks:
        rng = Generator(Philox(key=[PARK_SEED, abs(park.id)]))
        if rng.random() >= SHARE:
            continue
        high = float(rng.uniform(*HEDGE_M))
        line = shapely.boundary(shapely.buffer(park.geometry, OUTSIDE_M, join_style="mitre"))
        line = shapely.difference(shapely.intersection(line, near), blocked)
        line = shapely.line_merge(line) if line.geom_type == "MultiLineString" else line
        for piece in shapely.get_parts(line):
            if piece.geom_type != "LineString" or piece.length < PARK_SHORTEST_M:
                continue
            tags = {"barrier": "hedge", "height": f"{high:.2f}", "triangles": "yes"}
            found.append(OsmFeature("way", PARK_FIRST_ID + len(found), tags, piece.simplify(0.1)))
            notes["hedge of car parks, m"] += round(piece.length)
            for along in np.arange(TREE_M / 2, piece.length, TREE_M).tolist():
                spot = shapely.get_coordinates(piece.interpolate(along))[0]
                height = float(rng.uniform(4.0, 8.0))
                across = 0.6 * height
                tree = {
                    "natural": "tree", "height": f"{height:.2f}",
                    "diameter_crown": f"{across:.2f}",
                    "triangles": str(tree_clumps(height, across)),
                }  # fmt: skip
                found.append(planted(tree, spot))
                notes["trees of car parks"] += 1
    return found, notes


#: Minimum distances to streets and to walls, metres; none within the last distance of a mapped
#: barrier.
SET_BACK_M, FROM_WALLS_M, MAPPED_M = 0.4, 0.3, 4.0
#: Half the width of openings for ways, metres.
OPEN_M = 2.5
SHORTEST_M = 3.0
#: Maximum distance of barriers from carriageways, metres.
SEEN_M = 30.0
SEED = 5_113
#: First id of assumed features around land.
FIRST_ID = 1 << 42


@dataclass(frozen=True, eq=False)
class Kept:
    """Areas from which barriers keep a distance, site frame.

    Attributes:
        seen_from: carriageways.
        street: areas for vehicles and pedestrians.
        walls: buildings.
        barriers: the mapped barriers.
        taken: crossings, corners where pedestrians wait, water.
    """

    seen_from: shapely.Geometry
    street: shapely.Geometry
    walls: shapely.Geometry
    barriers: shapely.Geometry
    taken: shapely.Geometry


def enclosure_features(
    kept: Kept, features: Sequence[OsmFeature], region: shapely.Polygon, group: str
) -> tuple[list[OsmFeature], Counter[str]]:
    """Return barriers, tagged as in the map; and counts, in metres.

    Args:
        kept: areas from which they keep a distance.
        features: the map's features: areas, tracks, ways that lead in.
        region: nothing is placed outside it.
        group: group of countries whose practice is used, see `practice.group_of`.
    """
    near = shapely.intersection(region, shapely.buffer(kept.seen_from, SEEN_M, quad_segs=2))
    ways = [
        f.geometry
        for f in features
        if "highway" in f.tags
        and f.geometry.geom_type == "LineString"
        and near.intersects(f.geometry)
    ]
    street, tracks = grown(kept.street, SET_BACK_M), shapely.union_all(tracks_of(features))
    taken = area_union(
        [
            street,
            grown(kept.walls, FROM_WALLS_M),
            shapely.union_all(shapely.buffer(ways, OPEN_M, cap_style="flat")),
            kept.taken,
        ]
    )
    if not kept.barriers.is_empty:
        taken = shapely.union(taken, shapely.buffer(kept.barriers, MAPPED_M, quad_segs=2))
    shapely.prepare(taken)
    rows = rows_of("enclosures.csv", group)
    found: list[OsmFeature] = []
    notes: Counter[str] = Counter()
    done: set[tuple[int, str]] = set()
    for row in rows:
        marks = pairs_of(row["tags_of_land"])
        for feature in features:
            mark = (feature.id, row["land"])
            if mark in done or not any(feature.tags.get(k) == v for k, v in marks):
                continue
            if "building" in feature.tags or feature.tags.get("tunnel", "no") != "no":
                continue
            if feature.tags.get("bridge", "no") != "no" or feature.tags.get("layer", "0") != "0":
                continue
            done.add(mark)
            rng = Generator(Philox(key=[SEED, abs(feature.id)]))
            if rng.random() >= float(row["share"]):
                continue
            for line in _borders(feature, float(row["aside_m"]), street, tracks):
                clear = shapely.difference(shapely.intersection(line, near), taken)
                for piece in _pieces(clear):
                    tags = tags_of(row["tags"])
                    found.append(OsmFeature("way", FIRST_ID + len(found), tags, piece))
                    notes[f"barriers of {row['land']}, m"] += round(piece.length)
    return found, notes


def tracks_of(features: Sequence[OsmFeature]) -> list[shapely.LineString]:
    """Return the tracks of trains and trams on the ground."""
    return [
        f.geometry for f in features
        if "railway" in f.tags and f.geometry.geom_type == "LineString"
        and f.tags.get("tunnel", "no") == "no"
    ]  # fmt: skip


def _borders(
    feature: OsmFeature, aside_m: float, street: shapely.Geometry, tracks: shapely.Geometry
) -> Iterator[shapely.Geometry]:
    """Yield possible lines of barriers: within an area's border, on both sides of a track."""
    shape = feature.geometry
    if shape.geom_type in ("Polygon", "MultiPolygon"):
        # Mapped land often extends to the middle of its streets.
        inside = area_difference(shape, street)
        yield shapely.boundary(grown(inside, -aside_m))
    elif "railway" in feature.tags and shape.geom_type == "LineString":
        for side in (aside_m, -aside_m):
            line = shapely.offset_curve(shape, side, join_style="mitre")
            # There is no fence between tracks.
            yield shapely.difference(line, shapely.buffer(tracks, aside_m - 0.3, quad_segs=2))


def _pieces(shape: shapely.Geometry) -> Iterator[shapely.LineString]:
    if shape.geom_type == "MultiLineString":
        shape = shapely.line_merge(shape)
    for part in shapely.get_parts(shape):
        if part.geom_type == "LineString" and part.length >= SHORTEST_M:
            yield part.simplify(0.1)
