"""What is assumed beside streets where the map is silent, as features of a map."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely

from urbantwin.geometry import area_intersection, area_union, areas_of
from urbantwin.scene.building_outline import building_footprints
from urbantwin.scene.clutter.kerbside import Footway, kerbside_features
from urbantwin.scene.clutter.plot import Ground, plot_features
from urbantwin.scene.clutter.practice import group_of
from urbantwin.scene.land_use import TOWN, mapped_cover
from urbantwin.scene.zones import Zone
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import semantic_id

__all__ = ["Assumed", "assumed_features"]

#: Nothing stands nearer than this to a sensor's pole, nor to where walkers cross, metres.
SENSOR_M, CROSSING_M = 1.5, 0.5
#: Share of cycle stands' places that are taken: an estimate.
PARKED = 0.45


class Assumed(NamedTuple):
    """The map's features and those that are assumed, and counts of the assumed ones."""

    features: list[OsmFeature]
    notes: dict[str, int]


def assumed_features(
    features: Sequence[OsmFeature],
    zones: Sequence[Zone],
    crossings: shapely.Geometry,
    region: shapely.Polygon,
    country: str,
    sensors: Sequence[tuple[float, float]] = (),
) -> Assumed:
    """Return a map's features with what usually stands beside such streets and is not mapped.

    Everything is placed where it leaves lanes, crossings and walkers free; the same map gives the
    same. Where there is no map nothing is assumed.

    Args:
        features: the map's features, site frame.
        zones: what lies where on the ground.
        crossings: where walkers cross and wait, and what turning vehicles swing out over.
        region: nothing is placed outside it.
        country: ISO 3166-1 alpha-2; empty if unknown.
        sensors: east and north of sensors, around which nothing is placed, metres.
    """
    group = group_of(country)
    carriageway = area_union([z.area for z in zones if z.kind == "carriageway"])
    if not features or carriageway.is_empty:
        return Assumed(list(features), {})
    walked = [z.area for z in zones if z.kind == "footway" or z.semantic == semantic_id("sidewalk")]
    paved = [z.area for z in zones if z.semantic in map(semantic_id, ("road", "parking"))]
    islands = [z.area for z in zones if z.kind == "island"]
    walls = area_union(building_footprints(features))
    open_land = [
        f.geometry for f in features
        if f.geometry.geom_type in ("Polygon", "MultiPolygon")
        and (mapped_cover(f.tags) is not None or f.tags.get("place") == "square"
             or f.tags.get("amenity") in ("parking", "fuel") or "railway" in f.tags
             or f.tags.get("natural") == "water" or f.tags.get("area:highway"))
        and "building" not in f.tags
    ]  # fmt: skip
    water = [z.area for z in zones if z.kind == "water"]
    plots, notes = plot_features(
        Ground(
            area_union([carriageway, *walked, *paved, *islands]),
            carriageway,
            area_union([*open_land, *water]),
            shapely.union_all([f.geometry for f in features if "barrier" in f.tags]),
            area_intersection(walls, region).area > TOWN * region.area,
        ),
        features,
        region,
        group,
    )
    waiting = shapely.buffer(areas_of(crossings), CROSSING_M, quad_segs=2)
    free = shapely.buffer(shapely.points(np.reshape(list(sensors), (-1, 2))), SENSOR_M)
    pieces, counts = kerbside_features(
        Footway(carriageway, area_union(walked), shapely.union_all([waiting, *free]), walls),
        features,
        region,
        group,
    )
    if len(free):
        poles = shapely.union_all(free)
        plots = [f for f in plots if not f.geometry.intersects(poles)]
    every = [_with_bicycles(f) for f in (*features, *pieces)]
    return Assumed([*every, *plots], dict(sorted((Counter(notes) + counts).items())))


def _with_bicycles(feature: OsmFeature) -> OsmFeature:
    """Return cycle stands with the share of their places that is taken."""
    if feature.tags.get("amenity") != "bicycle_parking":
        return feature
    tags = {"parked": f"{PARKED:g}", **feature.tags}
    return OsmFeature(feature.kind, feature.id, tags, feature.geometry)
