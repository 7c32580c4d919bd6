"""Possible positions of a roadside sensor's pole at a junction, from the map alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import SiteFrame, area_union
from urbantwin.site.extract import Extract, OsmFeature
from urbantwin.site.junction_proposal import STREETS, meeting_nodes, way_lanes

__all__ = [
    "JUNCTION_M",
    "PoleChoice",
    "PoleGround",
    "PolePosition",
    "features_around",
    "ground_around",
    "nearest_place",
]

#: Radius around the anchor of the ground that a junction's sensor should see, metres.
JUNCTION_M = 50.0
#: Default height of a sensor, metres, and its downward pitch, degrees.
_HEIGHT_M, _PITCH_DEG = 5.5, 5.0

#: Width of a lane with its share of the kerb strip, metres (a usual urban lane is 3.0-3.5 m).
_LANE_M = 3.4
#: Clearances of a pole from the carriageway, in order of preference (the carriageway's width is a
#: guess), and from buildings, metres.
_KERB_CLEARANCES_M = (2.0, 1.0, 0.3)
_WALL_CLEARANCE_M = 1.0
#: Clearance from the centre line of a footway, metres.
_FOOTWAY_M = 1.2
#: Kerbs are rounded where streets meet: corners closer than this to both streets are paved, metres.
_CORNER_M = 6.0
#: Nodes this close to the centre belong to the junction; stop lines are this far beyond, metres.
_CORE_M, _STOP_M = 25.0, 10.0
#: Search for poles: range of distances from the centre, grid step, and largest distance from a
#: carriageway, metres.
_NEAREST_M, _FARTHEST_M, _GRID_M, _BESIDE_M = 10.0, 45.0, 1.5, 8.0
#: Features farther than this from the anchor are ignored, metres.
_AROUND_M = 110.0

_RAILS = ("rail", "tram", "light_rail", "subway", "narrow_gauge")
_WALKED = ("footway", "pedestrian", "path", "cycleway", "steps")


@dataclass(frozen=True)
class PolePosition:
    """Position of a sensor on a pole, site frame.

    Attributes:
        east_m: metres east of the anchor.
        north_m: metres north of the anchor.
        yaw_deg: heading to the centre of the junction, degrees counter-clockwise from east.
        height_m: height above the local ground, metres.
        pitch_deg: downward pitch, degrees.
        seen: visible fraction (0..1) of the junction; ``None`` if unknown.
    """

    east_m: float
    north_m: float
    yaw_deg: float
    height_m: float = _HEIGHT_M
    pitch_deg: float = _PITCH_DEG
    seen: float | None = None


@dataclass(frozen=True)
class PoleGround:
    """Ground around a junction in plan, as mapped: site frame, metres.

    Attributes:
        streets: carriageways that should be visible.
        paved: areas without poles: these and other carriageways, service roads, tracks.
        region: the region of the twin; no pole is placed outside.
        features: mapped features around.
        quarter: signs of east and north of the only quadrant for poles, if it has a possible
            position; ``None`` for all quadrants.
    """

    streets: shapely.Geometry
    paved: shapely.Geometry
    region: shapely.Polygon
    features: Sequence[OsmFeature]
    quarter: tuple[int, int] | None = None

    @cached_property
    def junction(self) -> shapely.Geometry:
        """The carriageways within `JUNCTION_M` of the anchor."""
        disc = shapely.Point(0.0, 0.0).buffer(JUNCTION_M)
        return shapely.intersection(shapely.intersection(self.streets, disc), self.region)

    def places(self) -> NDArray[np.float64]:
        """Return the possible positions (N, 2) of a pole, at least one.

        They are beside a carriageway, not in a building or water, and not on a footway.
        """
        steps = np.arange(-_FARTHEST_M, _FARTHEST_M + _GRID_M / 2, _GRID_M)
        places = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        away = np.linalg.norm(places, axis=1)
        places = places[(away >= _NEAREST_M) & (away <= _FARTHEST_M)]
        if self.quarter is not None:
            places = places[(places * self.quarter >= 0.0).all(axis=1)]
        areas = [item for item in self.features if "Polygon" in item.geometry.geom_type]
        taken = shapely.union_all(
            [
                *(x.geometry.buffer(_WALL_CLEARANCE_M) for x in areas if _is_building(x.tags)),
                *(x.geometry for x in areas if _is_water(x.tags)),
                *(x.geometry.buffer(_FOOTWAY_M) for x in self.features if _is_walked(x)),
            ]
        )
        region = shapely.buffer(self.region, -1.0)
        shapely.prepare([self.paved, taken, region])
        points = shapely.points(places)
        near = shapely.dwithin(self.paved, points, _BESIDE_M + _KERB_CLEARANCES_M[0])
        free = near & shapely.contains(region, points) & ~shapely.intersects(taken, points)
        places, points = places[free], points[free]
        for clearance in _KERB_CLEARANCES_M:
            beside = ~shapely.dwithin(self.paved, points, clearance)
            if beside.any():
                return np.asarray(places[beside])
        if self.quarter is not None:
            return replace(self, quarter=None).places()
        # If everything around is paved or built over, use a place beside the centre.
        return np.array([[_NEAREST_M, 0.0]])


#: Function that chooses a pole's position on the ground of a junction.
PoleChoice = Callable[[PoleGround], PolePosition]


def nearest_place(ground: PoleGround) -> PolePosition:
    """Return the position nearest to the anchor, regardless of the view."""
    places = ground.places()
    east, north = places[int(np.argmin(np.round(np.linalg.norm(places, axis=1), 6)))]
    yaw = float(np.degrees(np.arctan2(-north, -east)))
    return PolePosition(round(float(east), 2), round(float(north), 2), round(yaw, 1))


def ground_around(extract: Extract, frame: SiteFrame, region: shapely.Polygon) -> PoleGround:
    """Return the ground around the anchor; carriageways get the width of their lanes."""
    features = features_around(extract, frame)
    level = _level(features)
    streets: list[shapely.Geometry] = []
    others: list[shapely.Geometry] = []
    for item in features:
        width = _half_width(item.tags, extract, item.id)
        if width and item.geometry.geom_type == "LineString":
            strip = item.geometry.buffer(width)
            seen = item.tags.get("highway") in STREETS and _layer(item.tags) == level
            (streets if seen else others).append(strip)
    driven = _rounded(area_union(streets))
    driven = shapely.union(driven, _crossing_area(extract, frame, driven))
    paved = shapely.union(_rounded(area_union([*streets, *others])), driven)
    return PoleGround(driven, paved, region, features)


def features_around(extract: Extract, frame: SiteFrame) -> list[OsmFeature]:
    """Return the features within view of a sensor at the anchor's junction."""
    return extract.features(frame, shapely.Point(0.0, 0.0).buffer(_AROUND_M))


def _rounded(paved: shapely.Geometry) -> shapely.Geometry:
    return paved.buffer(_CORNER_M).buffer(-_CORNER_M)


def _layer(tags: dict[str, str]) -> str:
    if tags.get("tunnel", "no") not in ("no", "building_passage"):
        return tags.get("layer", "-1")
    return tags.get("layer", "1" if tags.get("bridge", "no") != "no" else "0")


def _level(features: Sequence[OsmFeature]) -> str:
    """Return the layer of the street nearest to the anchor."""
    middle = shapely.Point(0.0, 0.0)
    streets = [
        (round(shapely.distance(x.geometry, middle), 3), _layer(x.tags))
        for x in features
        if x.tags.get("highway") in STREETS
    ]
    return min(streets, default=(0.0, "0"))[1]


def _is_building(tags: dict[str, str]) -> bool:
    return "building" in tags or "building:part" in tags


def _is_water(tags: dict[str, str]) -> bool:
    return tags.get("natural") == "water" or "waterway" in tags


def _is_walked(item: OsmFeature) -> bool:
    return item.tags.get("highway") in _WALKED and item.geometry.geom_type == "LineString"


def _crossing_area(extract: Extract, frame: SiteFrame, paved: shapely.Geometry) -> shapely.Geometry:
    """Return the area between the stop lines: the hull of the pavement around the centre.

    Between wide streets, traffic turns across corners outside of the streets' own widths.
    """
    streets = [way for way in extract.highways() if way.tags["highway"] in STREETS]
    nodes = [extract.nodes[node] for node in meeting_nodes(extract, streets)]
    away = np.linalg.norm(frame.site_from_lonlat(nodes), axis=1)
    reach = float(away[away < _CORE_M].max(initial=0.0)) + _STOP_M
    disc = shapely.Point(0.0, 0.0).buffer(reach)
    return shapely.convex_hull(shapely.intersection(paved, disc))


def _half_width(tags: dict[str, str], extract: Extract, way: int) -> float:
    """Return half the width of a carriageway, metres; 0 for other features."""
    kind = tags.get("highway")
    if kind in STREETS:
        return way_lanes(extract.ways[way]) * _LANE_M / 2 + 0.5
    if kind == "service":
        return 2.5
    return 1.7 if tags.get("railway") in _RAILS and tags.get("tunnel") != "yes" else 0.0
