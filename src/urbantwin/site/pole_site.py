"""Proposing where a roadside sensor's pole could stand at a junction, from the map alone."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import SiteFrame
from urbantwin.site.extract import Extract, OsmFeature
from urbantwin.site.junction_proposal import STREETS, meeting_nodes, way_lanes

__all__ = ["PolePosition", "features_around", "place_pole", "propose_pole"]

#: Width of a lane with its share of the kerb strip, metres (a usual urban lane is 3.0-3.5 m).
_LANE_M = 3.4
#: A pole stands this far from the carriageway and from buildings at least, metres.
_KERB_CLEARANCE_M = 2.0
_WALL_CLEARANCE_M = 1.0
#: Kerbs are rounded where streets meet: corners closer than this to both streets are paved, metres.
_CORNER_M = 6.0
#: Nodes this close to the middle belong to the junction; stop lines are this far beyond, metres.
_CORE_M, _STOP_M = 25.0, 10.0
#: Where poles are looked for, metres from the middle, and how far a sensor's view is judged.
_NEAREST_M, _WANTED_M, _FARTHEST_M, _VIEW_M = 10.0, 15.0, 60.0, 50.0

_RAILS = ("rail", "tram", "light_rail", "subway", "narrow_gauge")


@dataclass(frozen=True)
class PolePosition:
    """A place for a pole, site frame, and the heading from it to the middle of the junction."""

    east_m: float
    north_m: float
    yaw_deg: float


def propose_pole(extract: Extract, frame: SiteFrame) -> PolePosition:
    """Return the place of a pole at the junction around the anchor.

    It stands beside the carriageway and in no building, as close to 10-15 m from the anchor as
    the streets leave room, in sight of the anchor, where buildings hide the least. Carriageways are
    taken as wide as their lanes.
    """
    features = features_around(extract, frame)
    lines: list[shapely.Geometry] = []
    widths: list[float] = []
    for item in features:
        width = _half_width(item.tags, extract, item.id)
        if width and item.geometry.geom_type == "LineString":
            lines.append(item.geometry)
            widths.append(width)
    paved = shapely.union_all(shapely.buffer(np.array(lines, dtype=object), widths))
    paved = paved.buffer(_CORNER_M).buffer(-_CORNER_M)
    paved = shapely.union(paved, _crossing_area(extract, frame, paved))
    return place_pole(paved, features)


def features_around(extract: Extract, frame: SiteFrame) -> list[OsmFeature]:
    """Return the features within view of a sensor at the anchor's junction."""
    return extract.features(frame, shapely.Point(0.0, 0.0).buffer(_FARTHEST_M + _VIEW_M))


def place_pole(paved: shapely.Geometry, features: Iterable[OsmFeature]) -> PolePosition:
    """Return the place of a pole at the junction around the anchor.

    Args:
        paved: the carriageways, site frame.
        features: what is mapped around: buildings end the view, in water nothing stands.
    """
    areas = [item for item in features if "Polygon" in item.geometry.geom_type]
    buildings = shapely.union_all([x.geometry for x in areas if _is_building(x.tags)])
    water = shapely.union_all([x.geometry for x in areas if _is_water(x.tags)])
    distances = np.arange(_NEAREST_M, _FARTHEST_M + 0.5)
    angles = np.radians(np.arange(0.0, 360.0, 5.0))
    places = np.array(
        [(d * np.cos(a), d * np.sin(a)) for d in distances for a in angles], dtype=np.float64
    )
    points = shapely.points(places)
    shapely.prepare([paved, buildings])
    free = ~shapely.dwithin(paved, points, _KERB_CLEARANCE_M)
    free &= ~shapely.dwithin(buildings, points, _WALL_CLEARANCE_M)
    free &= ~shapely.intersects(buildings, _sight_lines(places))
    free &= ~shapely.intersects(water, points)
    # Where everything around is paved or built over: beside the middle.
    choice = places[free] if free.any() else places
    away = np.linalg.norm(choice, axis=1)
    cost = np.maximum(0.0, away - _WANTED_M)
    # Whole metres of distance first, then the view: no need to judge the view of them all.
    nearest = choice[cost <= cost.min() + 8.0]
    views = _views(nearest, buildings)
    cost = np.maximum(0.0, np.linalg.norm(nearest, axis=1) - _WANTED_M) - 25.0 * views
    east, north = nearest[int(np.argmin(np.round(cost, 6)))]
    yaw = float(np.degrees(np.arctan2(-north, -east)))
    return PolePosition(round(float(east), 2), round(float(north), 2), round(yaw, 1))


def _is_building(tags: dict[str, str]) -> bool:
    return "building" in tags or "building:part" in tags


def _is_water(tags: dict[str, str]) -> bool:
    return tags.get("natural") == "water" or "waterway" in tags


def _crossing_area(extract: Extract, frame: SiteFrame, paved: shapely.Geometry) -> shapely.Geometry:
    """Return the area between the stop lines: the hull of the pavement around the middle.

    Between wide streets traffic turns across corners that no street's own width covers.
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


def _sight_lines(places: NDArray[np.float64]) -> NDArray[np.object_]:
    ends = np.stack([places, np.zeros_like(places)], axis=1)
    return np.asarray(shapely.linestrings(ends))


def _views(places: NDArray[np.float64], buildings: shapely.Geometry) -> NDArray[np.float64]:
    """Return (N,) 0..1: how far one sees along the ground, on average over all directions."""
    reach = int(_FARTHEST_M + _VIEW_M) + 1
    east, north = np.meshgrid(np.arange(-reach, reach + 1.0), np.arange(-reach, reach + 1.0))
    built = shapely.contains_xy(buildings, east, north)
    angles = np.radians(np.arange(0.0, 360.0, 10.0))
    away = np.arange(1.0, _VIEW_M + 0.5)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    # (places, directions, steps, 2): the metre cells that each line of sight passes.
    steps = away[None, None, :, None] * directions[None, :, None, :]
    cells = np.rint(places[:, None, None, :] + steps).astype(int) + reach
    blocked = built[cells[..., 1], cells[..., 0]]
    return np.asarray(1.0 - np.maximum.accumulate(blocked, axis=2).mean(axis=(1, 2)))
