"""Pieces beside kerbs: bins, bollards, cabinets, cycle stands, signs, poles."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from zlib import crc32

import numpy as np
import shapely
from numpy.random import Generator, Philox
from numpy.typing import NDArray

from urbantwin.scene.clutter.practice import Kerbside, kerbside_kinds
from urbantwin.scene.land_use import use_of_building
from urbantwin.site.extract import OsmFeature

__all__ = [
    "BESIDE_M",
    "CLEAR_M",
    "STREETS",
    "Footway",
    "is_business",
    "kerbside_features",
    "streets_of",
]

#: Minimum distance of objects from the kerb (Inclusive Mobility, DfT 2021: 0.45 to 0.6 m).
FROM_KERB_M = 0.45
#: Clear width for pedestrians (the same source: 1.5 m where 2 m is not possible).
CLEAR_M = 1.5
#: Maximum distance of footways from a street's line, metres.
WIDEST_M = 22.0
#: If the map has an object of a kind within this distance, none are assumed, metres.
MAPPED_M = 75.0
#: Minimum distance between objects, metres.
APART_M = 1.5
#: Distance of shops and offices that make a street's side a business one, metres.
BESIDE_M = 20.0
STREETS = (
    "trunk", "primary", "secondary", "tertiary", "unclassified", "residential", "living_street",
    "pedestrian",
)  # fmt: skip
#: Bollards are in rows: number, and distance (Manual for Streets: 1.2 to 1.5 m).
ROW, ROW_STEP_M = 6, 1.5


@dataclass(frozen=True, eq=False)
class Footway:
    """Areas for objects, site frame.

    Attributes:
        carriageway: area for vehicles.
        footway: raised footways and paved ground for pedestrians.
        taken: crossings, corners where pedestrians wait, and areas kept free around sensors.
        walls: buildings.
    """

    carriageway: shapely.Geometry
    footway: shapely.Geometry
    taken: shapely.Geometry
    walls: shapely.Geometry


def kerbside_features(
    ground: Footway, features: Sequence[OsmFeature], region: shapely.Polygon, group: str
) -> tuple[list[OsmFeature], Counter[str]]:
    """Return objects beside kerbs, tagged as in the map; and counts.

    Args:
        ground: the areas along the streets.
        features: the map's features: streets, shops, and the mapped objects.
        region: nothing is placed outside it.
        group: group of countries whose practice is used, see `practice.group_of`.
    """
    for shape in (ground.carriageway, ground.taken, ground.footway):
        shapely.prepare(shape)
    walls = shapely.buffer(ground.walls, 0.25)
    shapely.prepare(walls)
    shops = shapely.STRtree([f.geometry for f in features if is_business(f)])
    streets = streets_of(features, region)
    found: list[OsmFeature] = []
    notes: Counter[str] = Counter()
    standing = np.zeros((0, 2))
    for kind in kerbside_kinds(group):
        known = [f.geometry for f in features if _is_of(f, kind)]
        mapped = shapely.STRtree(known)
        for street in streets:
            rng = Generator(Philox(key=[crc32(kind.kind.encode()), abs(street.id)]))
            for spot in _spots(street.geometry, kind, ground, shops, rng):
                at = shapely.Point(spot)
                if not region.contains(at) or shapely.intersects(walls, at):
                    continue
                if known and len(mapped.query(at, "dwithin", MAPPED_M)):
                    continue
                if len(standing) and np.hypot(*(standing - spot).T).min() < APART_M - 0.05:
                    continue
                standing = np.vstack([standing, spot])
                number = crc32(f"{kind.kind} {street.id} {len(found)}".encode())
                found.append(OsmFeature("node", number, dict(kind.tags), at))
                notes[kind.kind] += 1
    return found, notes


def streets_of(features: Sequence[OsmFeature], region: shapely.Polygon) -> list[OsmFeature]:
    """Return the streets of a map on the ground, within a region."""
    return [
        f for f in features
        if f.tags.get("highway") in STREETS
        and f.geometry.geom_type == "LineString"
        and f.tags.get("tunnel", "no") == "no"
        and f.tags.get("bridge", "no") == "no"
        and region.intersects(f.geometry)
    ]  # fmt: skip


def is_business(feature: OsmFeature) -> bool:
    """Return whether a feature makes the adjacent side of a street a business one."""
    tags = feature.tags
    if tags.get("building", "no") != "no":
        return use_of_building(feature) == "business"
    return "shop" in tags or tags.get("amenity") in ("restaurant", "cafe", "bar", "bank", "pub")


def _is_of(feature: OsmFeature, kind: Kerbside) -> bool:
    key, value = next(iter(kind.tags.items()))
    said = feature.tags.get(key, "no")
    return said == value or (key == "traffic_sign" and said != "no")


def _spots(
    line: shapely.LineString,
    kind: Kerbside,
    ground: Footway,
    shops: shapely.STRtree,
    rng: Generator,
) -> Iterator[NDArray[np.float64]]:
    """Yield positions of objects of a kind along a street."""
    rate = max(kind.business, kind.dwellings)
    group = ROW if kind.kind == "bollards" else 1
    count = int(rng.poisson(rate * line.length / 1000 / group))
    draws = rng.random((count, 3))
    for share, side, keep in draws.tolist():
        at = share * line.length
        row = at + ROW_STEP_M * (np.arange(group) - (group - 1) / 2)
        row = row[(row >= 0) & (row <= line.length)]
        for step, along in enumerate(row.tolist()):
            here, ahead = _station(line, along)
            normal = np.array([-ahead[1], ahead[0]]) * (1 if side < 0.5 else -1)
            if step == 0:
                middle = shapely.Point(here + 8.0 * normal)
                busy = len(shops) and len(shops.query(middle, "dwithin", BESIDE_M))
                own = kind.business if busy else kind.dwellings
                if keep * rate >= own:
                    break
            spot = _beside(here, normal, kind, ground)
            if spot is not None:
                yield spot


def _station(
    line: shapely.LineString, along: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    ends = [max(along - 0.5, 0.0), min(along + 0.5, line.length)]
    a, b = (shapely.get_coordinates(line.interpolate(s))[0] for s in ends)
    return (a + b) / 2, (b - a) / np.hypot(*(b - a))


def _beside(
    here: NDArray[np.float64], normal: NDArray[np.float64], kind: Kerbside, ground: Footway
) -> NDArray[np.float64] | None:
    """Return a position beside the kerb or behind the footway, or ``None``."""
    steps = np.arange(0.0, WIDEST_M, 0.1)
    ray = here + steps[:, None] * normal
    driven = shapely.contains_xy(ground.carriageway, ray[:, 0], ray[:, 1])
    if not driven[0]:
        return None
    kerb = int(np.argmin(driven))
    if driven[kerb] or driven[kerb : kerb + 30].any():
        return None  # no kerb, or another carriageway behind it
    walked = shapely.contains_xy(ground.footway, ray[:, 0], ray[:, 1])[kerb:]
    first = int(np.argmax(walked)) if walked.any() else len(walked)
    if first > 30:
        return None
    wide = int(np.argmin(walked[first:])) if not walked[first:].all() else len(walked) - first
    room = 0.1 * wide
    out = FROM_KERB_M + kind.across_m / 2
    if 0.1 * first >= out + kind.across_m / 2:
        spot = ray[kerb] + (out - 0.1) * normal  # on a verge before the footway
    elif room >= out + kind.across_m / 2 + CLEAR_M:
        spot = ray[kerb] + (0.1 * first + out) * normal
    elif kind.may_stand_back and room >= CLEAR_M:
        spot = ray[kerb] + (0.1 * (first + wide) + 0.15 + kind.across_m / 2) * normal
    else:
        return None
    if shapely.dwithin(ground.carriageway, shapely.Point(spot), FROM_KERB_M):
        return None
    return None if shapely.intersects_xy(ground.taken, *spot) else spot
