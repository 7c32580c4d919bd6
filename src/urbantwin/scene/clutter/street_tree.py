"""Rows of trees along streets where none are mapped."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from zlib import crc32

import numpy as np
import shapely
from numpy.random import Generator, Philox
from numpy.typing import NDArray

from urbantwin.scene.clutter.greenery import tree_clumps
from urbantwin.scene.clutter.kerbside import BESIDE_M, CLEAR_M, is_business, streets_of
from urbantwin.scene.clutter.practice import rows_of
from urbantwin.scene.clutter.scatter import planted
from urbantwin.scene.tree.genus import genus_of
from urbantwin.site.extract import OsmFeature

__all__ = ["Kerbs", "street_tree_features"]

#: Distance of trunks from kerbs (Syracuse: 2 feet; Los Angeles similar), metres, and distance
#: behind footways.
FROM_KERB_M, BEHIND_M = 0.75, 0.9
#: Half the size of a tree pit on a footway, which pedestrians pass, metres.
PIT_M = 0.35
#: No trees are assumed within this distance of a mapped tree, metres.
MAPPED_M = 40.0
#: Distance from buildings; from bins, signs and lamps (Los Angeles: hydrants 10 feet, lamps 15 to
#: 20).
FROM_WALLS_M, FROM_PIECES_M, FROM_LAMPS_M = 1.8, 2.0, 4.5
#: Minimum width of strips between carriageways with trees, metres.
MEDIAN_M = 4.0
#: Maximum distance of a kerb from a street's line, and step of the search, metres.
WIDEST_M, STEP_M = 22.0, 0.25
#: Trees of streets are 0.3 to 0.75 of the full height of their genus: an estimate.
GROWN = (0.3, 0.75)
#: Minimum height of trees and of their crowns' base: pedestrians pass below (RASt 06), metres.
LOWEST_M, CLEAR_BELOW_M = 4.5, 2.5
#: Maximum width of crowns, metres.
WIDEST_CROWN_M = 9.0
SEED = 7_331


@dataclass(frozen=True, eq=False)
class Kerbs:
    """Areas relevant to trees along streets, site frame.

    Attributes:
        carriageway: area for vehicles.
        footway: area for pedestrians.
        taken: crossings, junctions with their clear area, sensors, tracks, water.
        walls: buildings.
    """

    carriageway: shapely.Geometry
    footway: shapely.Geometry
    taken: shapely.Geometry
    walls: shapely.Geometry


@dataclass(frozen=True)
class _Practice:
    spacing_m: float
    business: float
    dwellings: float
    genera: tuple[tuple[str, float], ...]


def street_tree_features(
    kerbs: Kerbs,
    features: Sequence[OsmFeature],
    pieces: Sequence[OsmFeature],
    region: shapely.Polygon,
    group: str,
) -> list[OsmFeature]:
    """Return street trees, tagged as in the map.

    Args:
        kerbs: areas along the streets.
        features: the map's features: streets, shops, trees.
        pieces: other objects assumed at the kerbs; trees keep a distance from them.
        region: nothing is planted outside it.
        group: group of countries whose practice is used, see `practice.group_of`.
    """
    for shape in (kerbs.carriageway, kerbs.footway, kerbs.taken, kerbs.walls):
        shapely.prepare(shape)
    practice = _practice(group)
    shops = shapely.STRtree([f.geometry for f in features if is_business(f)])
    mapped = shapely.STRtree(
        [f.geometry for f in features if f.tags.get("natural") in ("tree", "tree_row", "wood")]
    )
    every = [*features, *pieces]
    small = shapely.STRtree([f.geometry for f in every if f.geometry.geom_type == "Point"])
    lamps = shapely.STRtree([f.geometry for f in every if _is_lit(f)])
    found: list[OsmFeature] = []
    standing = np.zeros((0, 2))
    for street in streets_of(features, region):
        for side in (1, -1):
            rng = Generator(Philox(key=[SEED + side, abs(street.id)]))
            drawn, start, kind = float(rng.random()), float(rng.random()), float(rng.random())
            genus = _genus(practice, kind)
            if drawn >= max(practice.business, practice.dwellings):
                continue
            for spot in _spots(street.geometry, side, start, practice.spacing_m, kerbs):
                at = shapely.Point(spot)
                busy = len(shops) and len(shops.query(at, "dwithin", BESIDE_M))
                if drawn >= (practice.business if busy else practice.dwellings):
                    continue
                if not region.contains(at) or shapely.intersects(kerbs.taken, at):
                    continue
                if shapely.dwithin(kerbs.walls, at, FROM_WALLS_M):
                    continue
                if len(mapped) and len(mapped.query(at, "dwithin", MAPPED_M)):
                    continue
                if len(lamps) and len(lamps.query(at, "dwithin", FROM_LAMPS_M)):
                    continue
                if len(small) and len(small.query(at, "dwithin", FROM_PIECES_M)):
                    continue
                apart = 0.6 * practice.spacing_m
                if len(standing) and np.hypot(*(standing - spot).T).min() < apart:
                    continue
                standing = np.vstack([standing, spot])
                room = (
                    2 * float(shapely.distance(kerbs.walls, at)) if not kerbs.walls.is_empty else 99
                )
                found.append(_tree(spot, genus, room - 0.6))
    return found


def _is_lit(feature: OsmFeature) -> bool:
    return feature.tags.get("highway") in ("street_lamp", "traffic_signals") and (
        feature.geometry.geom_type == "Point"
    )


@cache
def _practice(group: str) -> _Practice:
    row = rows_of("street_trees.csv", group)[0]
    pairs = (pair.split(":") for pair in row["genera"].split())
    return _Practice(
        float(row["spacing_m"]),
        float(row["business"]),
        float(row["dwellings"]),
        tuple((name, float(share) / 100) for name, share in pairs),
    )


def _genus(practice: _Practice, draw: float) -> str:
    """Return the genus of a row, empty for a genus not in the list."""
    for name, share in practice.genera:
        draw -= share
        if draw < 0:
            return name
    return ""


def _tree(spot: NDArray[np.float64], genus: str, room: float) -> OsmFeature:
    seed = crc32(f"{spot[0]:.2f} {spot[1]:.2f}".encode())
    rng = Generator(Philox(key=[SEED, seed]))
    kind = genus_of({"genus": genus})
    height = min(max(kind.height_m * float(rng.uniform(*GROWN)), LOWEST_M), 14.0)
    across = min(
        kind.crown * height * float(rng.uniform(0.85, 1.1)), WIDEST_CROWN_M, max(room, 1.5)
    )
    tags = {
        "natural": "tree",
        "height": f"{height:.2f}",
        "diameter_crown": f"{across:.2f}",
        "crown_base": f"{max(CLEAR_BELOW_M, kind.clear * height):.2f}",
        "triangles": str(tree_clumps(height, across)),
    }
    return planted({**tags, "genus": genus} if genus else tags, spot)


def _spots(
    line: shapely.LineString, side: int, start: float, spacing: float, kerbs: Kerbs
) -> Iterator[NDArray[np.float64]]:
    """Yield positions of trunks along a side of a street."""
    along = np.arange(start * spacing, line.length, spacing)
    if not len(along):
        return
    here = shapely.get_coordinates(shapely.line_interpolate_point(line, along))
    before, after = (
        shapely.get_coordinates(
            shapely.line_interpolate_point(line, np.clip(along + d, 0, line.length))
        )
        for d in (-0.5, 0.5)
    )
    ahead = after - before
    ahead /= np.maximum(np.hypot(*ahead.T), 1e-9)[:, None]
    normal = side * np.column_stack([-ahead[:, 1], ahead[:, 0]])
    steps = np.arange(0.0, WIDEST_M, STEP_M)
    rays = here[:, None] + steps[None, :, None] * normal[:, None]
    flat = rays.reshape(-1, 2)
    driven = shapely.contains_xy(kerbs.carriageway, flat).reshape(rays.shape[:2])
    walked = shapely.contains_xy(kerbs.footway, flat).reshape(rays.shape[:2])
    for k in range(len(along)):
        out = _out(driven[k], walked[k])
        if out is not None:
            spot = here[k] + out * normal[k]
            if not shapely.dwithin(kerbs.carriageway, shapely.Point(spot), FROM_KERB_M - 0.2):
                yield spot


def _out(driven: NDArray[np.bool_], walked: NDArray[np.bool_]) -> float | None:
    """Return a trunk's distance from the street's line along a ray; ``None`` if impossible."""
    kerb = int(np.argmin(driven))
    if not driven[0] or driven[kerb]:
        return None
    at = kerb * STEP_M
    beyond = driven[kerb:]
    gap = float(np.argmax(beyond)) * STEP_M if beyond.any() else np.inf
    if gap < 12.0:  # another carriageway: a median
        open_ = not walked[kerb : kerb + int(gap / STEP_M)].any()
        return at + gap / 2 if gap >= MEDIAN_M and open_ else None
    own = walked[kerb:]
    first = float(np.argmax(own)) * STEP_M if own.any() else np.inf
    if first >= FROM_KERB_M + 0.35:  # a verge before the footway, or no footway
        return at + (min(max(first / 2, FROM_KERB_M), 1.5) if np.isfinite(first) else 1.5)
    begin = round(first / STEP_M)
    rest = own[begin:]
    wide = float(np.argmin(rest)) * STEP_M if not rest.all() else len(rest) * STEP_M
    if wide >= FROM_KERB_M + PIT_M + CLEAR_M:
        return at + first + FROM_KERB_M
    return at + first + wide + BEHIND_M if wide >= CLEAR_M - STEP_M else None
