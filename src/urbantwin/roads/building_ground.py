"""The ground that buildings stand on: no sidewalk, no parking and no pole is there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import shapely

from urbantwin.geometry import area_difference, area_union
from urbantwin.roads.cross_section.lane_tags import metres
from urbantwin.roads.passage import passages_of
from urbantwin.site.extract import OsmFeature

__all__ = ["BuildingGround", "building_ground", "building_grounds"]

#: Values of ``building`` that are roofs without walls: one walks under them.
ROOFS = ("roof", "carport", "canopy")
#: A building or part whose underside is higher than this stands over the ground, metres.
HEADROOM_M = 2.0


@dataclass(frozen=True)
class BuildingGround:
    """The ground under buildings in plan, apart from passages and arcades.

    Attributes:
        everywhere: of all of them.
        within: of those that touch the region.
    """

    everywhere: list[shapely.Polygon]
    within: list[shapely.Polygon]


def building_ground(features: Iterable[OsmFeature]) -> list[shapely.Polygon]:
    """Return the ground under buildings in plan, apart from passages and arcades.

    Roofs on posts, what is underground and what hangs over the ground are left out.

    Args:
        features: the map's features, site frame.
    """
    return building_grounds(features, shapely.MultiPolygon()).everywhere


def building_grounds(features: Iterable[OsmFeature], region: shapely.Geometry) -> BuildingGround:
    """Return the same, also of those buildings alone that touch a region."""
    features = list(features)
    standing = [
        feature.geometry
        for feature in features
        if feature.geometry.geom_type in ("Polygon", "MultiPolygon") and _stands(feature.tags)
    ]
    passages = area_union([passage.corridor for passage in passages_of(features)])
    shapely.prepare(region)
    within = [shape for shape in standing if region.intersects(shape)]
    return BuildingGround(*(_without(shapes, passages) for shapes in (standing, within)))


def _without(shapes: list[shapely.Geometry], passages: shapely.Geometry) -> list[shapely.Polygon]:
    ground = area_difference(area_union(shapes), passages)
    return [part for part in shapely.get_parts(ground) if not part.is_empty]


def _stands(tags: Mapping[str, str]) -> bool:
    """Return whether a feature is a building whose walls stand on the ground."""
    kind = tags.get("building", "no")
    if kind == "no" or kind in (*ROOFS, "underground") or tags.get("location") == "underground":
        return False
    if tags.get("layer", "0").strip().startswith("-"):
        return False
    lowest = metres(tags.get("min_height")) or 0.0
    storeys = tags.get("building:min_level", "0").strip()
    return lowest < HEADROOM_M and storeys in ("0", "")
