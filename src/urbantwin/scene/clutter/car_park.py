"""Hedges and trees around car parks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.random import Generator, Philox

from urbantwin.geometry import area_union, grown
from urbantwin.scene.clutter.greenery import tree_clumps
from urbantwin.scene.clutter.scatter import planted
from urbantwin.site.extract import OsmFeature

__all__ = ["car_park_features"]

#: Car parks are screened toward streets by what is 0.75 to 1.5 m high (zoning codes: Wauseon, Ohio:
#: a wall, fence or hedge of 30 inches; Carlisle, Ohio: 3 to 5 feet; Bellwood, Illinois: 3 feet).
HEDGE_M = (0.75, 1.5)
#: A tree every 40 feet of border (Bellwood; ecode360 33048200).
TREE_M = 12.0
#: Share of car parks with such a border: an estimate.
SHARE = 0.5
#: Hedges stand so far outside of the paved ground, and are so thick, metres.
OUTSIDE_M, THICK_M = 0.6, 0.8
#: Ways in and out leave so much open on each side, metres.
OPEN_M = 3.5
SEEN_M, SHORTEST_M = 40.0, 2.5
SEED = 6_007
FIRST_ID = 1 << 43


def car_park_features(
    features: Sequence[OsmFeature],
    carriageway: shapely.Geometry,
    taken: shapely.Geometry,
    region: shapely.Polygon,
) -> tuple[list[OsmFeature], Counter[str]]:
    """Return hedges and trees around car parks as a mapper would have mapped them; and counts.

    Args:
        features: the map's features: its car parks and the ways that lead in.
        carriageway: what they are seen from.
        taken: where nothing is planted.
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
            shapely.union_all(shapely.buffer(ways, OPEN_M, cap_style="flat")),
        ]
    )
    near = shapely.intersection(region, shapely.buffer(carriageway, SEEN_M, quad_segs=2))
    found: list[OsmFeature] = []
    notes: Counter[str] = Counter()
    for park in parks:
        rng = Generator(Philox(key=[SEED, abs(park.id)]))
        if rng.random() >= SHARE:
            continue
        high = float(rng.uniform(*HEDGE_M))
        line = shapely.boundary(shapely.buffer(park.geometry, OUTSIDE_M, join_style="mitre"))
        line = shapely.difference(shapely.intersection(line, near), blocked)
        line = shapely.line_merge(line) if line.geom_type == "MultiLineString" else line
        for piece in shapely.get_parts(line):
            if piece.geom_type != "LineString" or piece.length < SHORTEST_M:
                continue
            tags = {"barrier": "hedge", "height": f"{high:.2f}", "triangles": "yes"}
            found.append(OsmFeature("way", FIRST_ID + len(found), tags, piece.simplify(0.1)))
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
