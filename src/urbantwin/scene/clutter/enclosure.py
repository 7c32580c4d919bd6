"""Fences, walls and hedges around schools, playgrounds, building sites and along railways."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import shapely
from numpy.random import Generator, Philox

from urbantwin.geometry import area_difference, area_union, grown
from urbantwin.scene.clutter.table import pairs_of, rows_of, tags_of
from urbantwin.site.extract import OsmFeature

__all__ = ["Kept", "enclosure_features", "tracks_of"]

#: Nearest to where one drives or walks, and to walls, metres; mapped barriers this near go before.
SET_BACK_M, FROM_WALLS_M, MAPPED_M = 0.4, 0.3, 4.0
#: Half of what ways leave open in what they lead through, metres.
OPEN_M = 2.5
SHORTEST_M = 3.0
#: What is farther from carriageways than this is left out, metres.
SEEN_M = 30.0
SEED = 5_113
#: Ids of what is assumed around land begin here.
FIRST_ID = 1 << 42


@dataclass(frozen=True, eq=False)
class Kept:
    """What barriers keep clear of, site frame.

    Attributes:
        seen_from: carriageways.
        street: where one drives or walks.
        walls: buildings.
        barriers: what is mapped.
        taken: crossings, corners where walkers wait, water.
    """

    seen_from: shapely.Geometry
    street: shapely.Geometry
    walls: shapely.Geometry
    barriers: shapely.Geometry
    taken: shapely.Geometry


def enclosure_features(
    kept: Kept, features: Sequence[OsmFeature], region: shapely.Polygon, group: str
) -> tuple[list[OsmFeature], Counter[str]]:
    """Return barriers as a mapper would have mapped them; and counts, in metres.

    Args:
        kept: what they keep clear of.
        features: the map's features: areas, tracks, ways that lead in.
        region: nothing is placed outside it.
        group: whose practice is followed, see `practice.group_of`.
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
    """Return the tracks of trains and trams on the ground, of a map's features."""
    return [
        f.geometry for f in features
        if "railway" in f.tags and f.geometry.geom_type == "LineString"
        and f.tags.get("tunnel", "no") == "no"
    ]  # fmt: skip


def _borders(
    feature: OsmFeature, aside_m: float, street: shapely.Geometry, tracks: shapely.Geometry
) -> Iterator[shapely.Geometry]:
    """Yield where a barrier would stand: within an area's border, on both sides of a track."""
    shape = feature.geometry
    if shape.geom_type in ("Polygon", "MultiPolygon"):
        # Mappers draw land to the middle of its streets.
        inside = area_difference(shape, street)
        yield shapely.boundary(grown(inside, -aside_m))
    elif "railway" in feature.tags and shape.geom_type == "LineString":
        for side in (aside_m, -aside_m):
            line = shapely.offset_curve(shape, side, join_style="mitre")
            # Between tracks there is no fence.
            yield shapely.difference(line, shapely.buffer(tracks, aside_m - 0.3, quad_segs=2))


def _pieces(shape: shapely.Geometry) -> Iterator[shapely.LineString]:
    if shape.geom_type == "MultiLineString":
        shape = shapely.line_merge(shape)
    for part in shapely.get_parts(shape):
        if part.geom_type == "LineString" and part.length >= SHORTEST_M:
            yield part.simplify(0.1)
