"""Objects assumed beside streets where none are mapped, as features of a map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import area_difference, area_intersection, area_union, areas_of, grown
from urbantwin.scene.building_outline import building_footprints
from urbantwin.scene.clutter.enclosure import Kept, car_park_features, enclosure_features, tracks_of
from urbantwin.scene.clutter.greenery import Land, greenery_features
from urbantwin.scene.clutter.kerbside import STREETS, Footway, kerbside_features
from urbantwin.scene.clutter.plot import Ground, plot_features
from urbantwin.scene.clutter.practice import group_of
from urbantwin.scene.clutter.street_tree import Kerbs, street_tree_features
from urbantwin.scene.land_use import AROUND_M, TOWN, mapped_cover, use_of_building
from urbantwin.scene.zones import Zone
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import material_id, semantic_id

__all__ = ["Assumed", "assumed_features"]

#: Minimum distance of objects from a sensor's pole, and from pedestrian crossings, metres.
SENSOR_M, CROSSING_M = 1.5, 0.5
#: Minimum distance of plants from a sensor, and of street trees from junctions, crossings and
#: waiting areas (Indianola, Iowa: 25 feet before corners), metres.
FROM_LEAVES_M, FROM_CORNERS_M = 8.0, 7.5
#: Clear width on each side of the middle of tracks and of ways, metres.
BESIDE_TRACKS_M, BESIDE_WAYS_M = 3.5, 2.0
#: Land that is mapped as green and has plants in addition to grass.
PARKS = (
    ("leisure", {"park", "garden"}),
    (
        "landuse",
        {"grass", "village_green", "cemetery", "recreation_ground", "greenery", "flowerbed"},
    ),
)
#: Minimum distance from the street of a forecourt, paving between buildings and streets, metres.
FORECOURT_M = 2.0
#: Distance of shrubs on medians from their kerbs (Texas, Landscape and Aesthetics Design Manual: 3
#: feet, and up to 30 inches high at their ends), metres.
FROM_MEDIANS_M = 0.8
#: Share of the places of cycle stands that are occupied: an estimate.
PARKED = 0.45


class Assumed(NamedTuple):
    """The map's features and the assumed features, and counts of the assumed ones."""

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
    """Return a map's features and typical objects beside such streets that are not mapped.

    All objects are placed outside lanes, crossings and the walking width of pedestrians. The same
    map gives the same objects. Without a map nothing is assumed.

    Args:
        features: the map's features, site frame.
        zones: zones of the ground.
        crossings: areas where pedestrians cross and wait, and the overhang of turning vehicles.
        region: nothing is placed outside it.
        country: ISO 3166-1 alpha-2; empty if unknown.
        sensors: east and north of sensors; nothing is placed near them, metres.
    """
    group = group_of(country)
    carriageway = area_union([z.area for z in zones if z.kind == "carriageway"])
    if not features or carriageway.is_empty:
        return Assumed(list(features), {})
    walked = area_union(
        [z.area for z in zones if z.kind == "footway" or z.semantic == semantic_id("sidewalk")]
    )
    paved = [z.area for z in zones if z.semantic in map(semantic_id, ("road", "parking"))]
    islands = [z.area for z in zones if z.kind == "island"]
    street = area_union([carriageway, walked, *paved, *islands])
    walls = area_union(building_footprints(features))
    water = area_union([z.area for z in zones if z.kind == "water"])
    barriers = shapely.union_all([f.geometry for f in features if "barrier" in f.tags])
    is_town = area_intersection(walls, region).area > TOWN * region.area
    poles = shapely.points(np.reshape(list(sensors), (-1, 2)))
    free = shapely.buffer(poles, SENSOR_M)
    plots, notes = plot_features(
        Ground(street, carriageway, area_union([*_public(features), water]), barriers, is_town),
        features,
        region,
        group,
    )
    waiting = shapely.buffer(areas_of(crossings), CROSSING_M, quad_segs=2)
    pieces, counts = kerbside_features(
        Footway(carriageway, walked, shapely.union_all([waiting, *free]), walls),
        features,
        region,
        group,
    )
    notes += counts
    # Leaves block a sensor's view from farther away than a bin does, and trees hide signals.
    open_ = [water, _tracks(features), *shapely.buffer(poles, FROM_LEAVES_M)]
    corners = shapely.buffer(areas_of(crossings), FROM_CORNERS_M, quad_segs=4)
    trees = street_tree_features(
        Kerbs(carriageway, walked, area_union([corners, *open_]), walls),
        features,
        [*pieces, *(one for one in plots if one.geometry.geom_type == "Point")],
        region,
        group,
    )
    notes["street trees"] += len(trees)
    taken = area_union([waiting, *open_, _ways(features)])
    parks, counts = car_park_features(
        features, carriageway, area_union([street, walls, taken]), region
    )
    notes += counts
    green, counts = greenery_features(
        Land(
            carriageway,
            area_union([carriageway, walked, *paved]),
            walls,
            area_union([taken, _decks(features)]),
            {**_land(features, zones, street, walls, group),
             "median": area_difference(grown(area_union(islands), -FROM_MEDIANS_M), corners)},
        ),
        features,
        region,
        group,
    )  # fmt: skip
    notes += counts
    fences, counts = enclosure_features(
        Kept(carriageway, street, walls, barriers, area_union([water, waiting])),
        features,
        region,
        group,
    )
    notes += counts
    beside = [*plots, *fences, *parks]
    if len(free):
        beside = [f for f in beside if not _is_near(f, poles)]
    every = [_with_bicycles(f) for f in (*features, *pieces)]
    found = [*every, *beside, *trees, *green]
    return Assumed(found, {name: n for name, n in sorted(notes.items()) if n})


def _is_near(feature: OsmFeature, poles: NDArray[np.object_]) -> bool:
    """Return whether a feature is too close to a sensor."""
    apart = FROM_LEAVES_M if "natural" in feature.tags else SENSOR_M
    return bool(shapely.dwithin(poles, feature.geometry, apart).any())


def _is_area(feature: OsmFeature) -> bool:
    return feature.geometry.geom_type in ("Polygon", "MultiPolygon")


def _public(features: Sequence[OsmFeature]) -> list[shapely.Geometry]:
    """Return open land that is not part of a plot."""
    return [
        f.geometry for f in features
        if _is_area(f)
        and (mapped_cover(f.tags) is not None or f.tags.get("place") == "square"
             or f.tags.get("amenity") in ("parking", "fuel") or "railway" in f.tags
             or f.tags.get("natural") == "water" or f.tags.get("area:highway"))
        and "building" not in f.tags
    ]  # fmt: skip


def _tracks(features: Sequence[OsmFeature]) -> shapely.Geometry:
    """Return tracks of trains and trams on the ground, with their clearance at the sides."""
    lines = tracks_of(features)
    return shapely.union_all(shapely.buffer(lines, BESIDE_TRACKS_M, cap_style="flat"))


def _ways(features: Sequence[OsmFeature]) -> shapely.Geometry:
    """Return the areas of ways beside the streets: paths, steps, bridges, drives."""
    lines = [
        f.geometry for f in features
        if f.tags.get("highway", "street") not in ("street", *STREETS)
        and f.geometry.geom_type == "LineString"
        and f.tags.get("tunnel", "no") == "no"
    ]  # fmt: skip
    return shapely.union_all(shapely.buffer(lines, BESIDE_WAYS_M, cap_style="flat"))


def _decks(features: Sequence[OsmFeature]) -> shapely.Geometry:
    """Return bridges as areas; plants are not placed in them."""
    return shapely.union_all([f.geometry for f in features if _is_area(f) and "man_made" in f.tags])


def _land(
    features: Sequence[OsmFeature],
    zones: Sequence[Zone],
    street: shapely.Geometry,
    walls: shapely.Geometry,
    group: str,
) -> dict[str, shapely.Geometry]:
    """Return land by the kind of its usual plants, see ``plants.csv``."""
    grass = area_union([z.area for z in zones if z.material == material_id("grass")])
    dwellings = [f.geometry for f in features if "building" in f.tags and _is_area(f)
                 and use_of_building(f) == "dwellings"]  # fmt: skip
    covered = [f for f in features if _is_area(f) and mapped_cover(f.tags) is not None]
    parks = area_union([f.geometry for f in covered if any(f.tags.get(k) in v for k, v in PARKS)])
    cover = area_union([f.geometry for f in covered])
    land = area_difference(grass, cover)
    gardens = area_intersection(land, grown(area_union(dwellings), AROUND_M))
    paving = [
        z.area
        for z in zones
        if z.material == material_id("paving")
        and z.kind == "paved"
        and z.semantic != semantic_id("sidewalk")
    ]
    kinds = {
        "forecourt": area_difference(area_union(paving), grown(street, FORECOURT_M)),
        "garden": gardens,
        "green": area_difference(land, gardens),
        "mapped": area_intersection(grass, parks),
    }
    if group in ("japan", "asia"):
        bare = [
            z.area for z in zones if z.kind == "paved" and z.material == material_id("concrete")
        ]
        kinds["yard"] = area_difference(area_union(bare), area_union([cover, walls]))
    return kinds


def _with_bicycles(feature: OsmFeature) -> OsmFeature:
    """Return a feature; cycle stands get the share of their occupied places."""
    if feature.tags.get("amenity") != "bicycle_parking":
        return feature
    tags = {"parked": f"{PARKED:g}", **feature.tags}
    return OsmFeature(feature.kind, feature.id, tags, feature.geometry)
