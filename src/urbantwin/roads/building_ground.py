"""The ground under buildings, which is free of sidewalks, parking and poles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import LineString, Polygon

from urbantwin.geometry import area_difference, area_union
from urbantwin.roads.cross_section.lane_tags import metres
from urbantwin.site.extract import OsmFeature

__all__ = [
    "ROAD_CLEARANCE_M",
    "BuildingGround",
    "Passage",
    "building_ground",
    "building_grounds",
    "passages_of",
]

#: Values of ``building`` for roofs without walls, with passage underneath.
ROOFS = ("roof", "carport", "canopy")
#: A building or part with a higher underside does not stand on the ground, metres.
HEADROOM_M = 2.0
#: Clear height over carriageways and passages for vehicles; over those for pedestrians and
#: cyclists, metres.
ROAD_CLEARANCE_M = 4.5
PATH_CLEARANCE_M = 3.0
#: Extension of a passage's line at both ends, so that it cuts through the walls, metres.
REACH_M = 1.0
WIDTH_M = {
    **dict.fromkeys(("footway", "path", "cycleway", "steps", "corridor"), 2.5),
    **dict.fromkeys(("pedestrian", "service", "track"), 4.0),
    **dict.fromkeys(("residential", "living_street", "unclassified", "tertiary"), 6.0),
}
WIDER_M = 7.0
#: Values of ``covered`` for passages with columns along their open side, and for all passages under
#: buildings.
ARCADES = ("arcade", "colonnade")
COVERED = ("yes", *ARCADES)
PATHS = ("footway", "path", "cycleway", "steps", "corridor", "pedestrian")


@dataclass(frozen=True)
class BuildingGround:
    """The ground under buildings in plan, except passages and arcades.

    Attributes:
        everywhere: of all buildings.
        within: of buildings that touch the region.
    """

    everywhere: list[shapely.Polygon]
    within: list[shapely.Polygon]


@dataclass(frozen=True)
class Passage:
    """A mapped way through buildings.

    Attributes:
        line: its centre line.
        corridor: its area in plan.
        clearance_m: its clear height, metres.
        has_columns: whether it has columns along its open side: an arcade or a colonnade.
    """

    line: LineString
    corridor: Polygon
    clearance_m: float
    has_columns: bool = False


def building_ground(features: Iterable[OsmFeature]) -> list[shapely.Polygon]:
    """Return the ground under buildings in plan, except passages and arcades.

    Roofs on posts, underground parts and parts above the ground are excluded.

    Args:
        features: the map's features, site frame.
    """
    return building_grounds(features, shapely.MultiPolygon()).everywhere


def building_grounds(features: Iterable[OsmFeature], region: shapely.Geometry) -> BuildingGround:
    """Return the ground under all buildings, and under those that touch a region."""
    features = list(features)
    standing = [
        feature.geometry
        for feature in features
        if feature.geometry.geom_type in ("Polygon", "MultiPolygon")
        and _has_walls_on_ground(feature.tags)
    ]
    passages = area_union([passage.corridor for passage in passages_of(features)])
    shapely.prepare(region)
    within = [shape for shape in standing if region.intersects(shape)]
    return BuildingGround(*(_without_passages(shapes, passages) for shapes in (standing, within)))


def _without_passages(
    shapes: list[shapely.Geometry], passages: shapely.Geometry
) -> list[shapely.Polygon]:
    ground = area_difference(area_union(shapes), passages)
    return [part for part in shapely.get_parts(ground) if not part.is_empty]


def _has_walls_on_ground(tags: Mapping[str, str]) -> bool:
    """Return whether a feature is a building with walls on the ground."""
    kind = tags.get("building", "no")
    if kind == "no" or kind in (*ROOFS, "underground") or tags.get("location") == "underground":
        return False
    if tags.get("layer", "0").strip().startswith("-"):
        return False
    lowest = metres(tags.get("min_height")) or 0.0
    storeys = tags.get("building:min_level", "0").strip()
    return lowest < HEADROOM_M and storeys in ("0", "")


def passages_of(features: Iterable[OsmFeature]) -> list[Passage]:
    """Return the mapped ways through or under buildings."""
    passages = []
    for feature in features:
        tags = feature.tags
        covered = tags.get("tunnel") == "building_passage" or tags.get("covered") in COVERED
        if not covered or "highway" not in tags or not isinstance(feature.geometry, LineString):
            continue
        kind = tags["highway"]
        width = metres(tags.get("width")) or WIDTH_M.get(kind, WIDER_M)
        corridor = _longer(feature.geometry).buffer(width / 2, cap_style="flat")
        if corridor.is_empty:
            continue
        clearance = PATH_CLEARANCE_M if kind in PATHS else ROAD_CLEARANCE_M
        has_columns = tags.get("covered") in ARCADES or tags.get("arcade:type") is not None
        passages.append(Passage(feature.geometry, corridor, clearance, has_columns))
    return passages


def _longer(line: LineString) -> LineString:
    """Return a line extended at both ends."""
    xy = shapely.get_coordinates(shapely.remove_repeated_points(line, 0.001))
    if len(xy) < 2:
        return line
    first, last = xy[0] - xy[1], xy[-1] - xy[-2]
    start = xy[0] + first / np.hypot(*first) * REACH_M
    end = xy[-1] + last / np.hypot(*last) * REACH_M
    return LineString([start, *xy[1:-1], end])
