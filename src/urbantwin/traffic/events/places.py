"""Places of events: a lane, a street, a crossing, site coordinates, or degrees."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from pydantic import model_validator

from urbantwin.errors import InputError
from urbantwin.roads import Lane, RoadNetwork
from urbantwin.site.conditions import Strict
from urbantwin.site.yaml_document import nearest, wrong
from urbantwin.twin import Twin

__all__ = ["Place", "Spot", "find_spot", "lanes_for", "nearest_to_anchor", "spot_on"]

#: Maximum distance of a lane from given coordinates, metres.
_LANE_RANGE_M = 15.0
_VEHICLE_LANE_KINDS = ("driving", "bus", "bicycle", "connection")
_PEDESTRIAN_LANE_KINDS = ("sidewalk", "crossing", "walkingarea")


class Place(Strict):
    """The place of an event, given in one of several ways.

    Attributes:
        lane: id of a lane, as in ``roads.json`` and the plan; at ``offset_m`` from its start, else
            its middle.
        offset_m: metres.
        street: name of a street: its lane that leads to the junction nearest to the anchor, at
            ``before_junction_m`` metres before its end, or the one that leads away from it, at
            ``after_junction_m`` metres after its start.
        before_junction_m: metres; 30 if neither is given.
        after_junction_m: metres.
        crossing: id of a crossing, or the name of the street that it crosses (the one nearest to
            the anchor).
        x: east of the anchor, metres, with ``y``, north of it.
        y: metres.
        latitude: degrees, WGS84, with ``longitude``.
        longitude: degrees.
    """

    lane: str | None = None
    offset_m: float | None = None
    street: str | None = None
    before_junction_m: float | None = None
    after_junction_m: float | None = None
    crossing: str | None = None
    x: float | None = None
    y: float | None = None
    latitude: float | None = None
    longitude: float | None = None

    @model_validator(mode="after")
    def _is_said_once(self) -> Place:
        pairs = (self.x, self.y), (self.latitude, self.longitude)
        if any((first is None) != (second is None) for first, second in pairs):
            raise wrong("has one coordinate", "x and y, or latitude and longitude")
        alternatives = [self.lane, self.street, self.crossing, self.x, self.latitude]
        if sum(given is not None for given in alternatives) != 1:
            raise wrong(
                "does not say one place",
                "one of lane, street, crossing, x and y, latitude and longitude",
            )
        if self.offset_m is not None and self.lane is None:
            raise wrong("has offset_m without a lane", "lane: ID beside it")
        junction = self.before_junction_m is not None, self.after_junction_m is not None
        if any(junction) and (self.street is None or all(junction)):
            raise wrong(
                "says more than one distance, or names no street",
                "a street, and before_junction_m or after_junction_m",
            )
        return self


@dataclass(frozen=True, eq=False)
class Spot:
    """A position on a lane.

    Attributes:
        lane: the lane.
        along_m: metres from its start.
        xy: (2,) site frame, metres.
        yaw: heading of the lane there, rad.
    """

    lane: Lane
    along_m: float
    xy: NDArray[np.float64]
    yaw: float


def find_spot(place: Place, twin: Twin, actor_class: str) -> Spot:
    """Return the position of a place on a lane that a class of actors may use.

    Raises:
        InputError: there is no such lane, street or crossing, or no lane there.
    """
    roads = twin.roads
    if place.lane is not None:
        lane = roads.lane_by_id.get(place.lane)
        if lane is None:
            lane_ids = [
                known_lane.id
                for known_lane in roads.lanes
                if known_lane.kind in _VEHICLE_LANE_KINDS and known_lane.road
            ]
            raise InputError(
                f"there is no lane {place.lane!r:.60}",
                place="place.lane",
                expected=_suggestions(place.lane, lane_ids),
            )
        along = lane.length / 2 if place.offset_m is None else place.offset_m
        return spot_on(lane, along, "place.offset_m")
    if place.street is not None:
        return _on_street(place, twin, actor_class)
    if place.crossing is not None:
        return _on_crossing(place.crossing, twin)
    if place.x is not None and place.y is not None:
        xy = np.array([place.x, place.y])
    else:
        degrees = np.array([[place.longitude, place.latitude]], np.float64)
        xy = twin.frame.site_from_lonlat(degrees)[0]
    nearby = _lanes_near(twin, xy, actor_class)
    if not nearby or min(nearby)[0] > _LANE_RANGE_M:
        raise InputError(
            f"no lane for a {actor_class} within {_LANE_RANGE_M:g} m of {xy[0]:.1f}, {xy[1]:.1f}",
            place="place",
            expected="a place on the streets of the twin",
        )
    lane = roads.lane_by_id[min(nearby)[1]]
    along = shapely.line_locate_point(shapely.LineString(lane.centre[:, :2]), shapely.Point(xy))
    return spot_on(lane, float(along), "place")


def nearest_to_anchor(twin: Twin, actor_class: str) -> tuple[float, float]:
    """Return the point nearest to the anchor on a lane for a class of actors, metres.

    Raises:
        InputError: there is no such lane.
    """
    lanes = _lanes_near(twin, np.zeros(2), actor_class)
    if not lanes:
        raise InputError(f"no lane is for a {actor_class}", expected="a twin with one")
    lane = twin.roads.lane_by_id[min(lanes)[1]]
    line = shapely.LineString(lane.centre[:, :2])
    point = line.interpolate(line.project(shapely.Point(0.0, 0.0)))
    return round(point.x, 2), round(point.y, 2)


def _lanes_near(twin: Twin, xy: NDArray[np.float64], actor_class: str) -> list[tuple[float, str]]:
    """Return the lanes for a class of actors: distance from a place, metres, and id."""
    return [
        (float(shapely.LineString(lane.centre[:, :2]).distance(shapely.Point(xy))), lane.id)
        for lane in lanes_for(twin, actor_class)
    ]


def lanes_for(twin: Twin, actor_class: str) -> list[Lane]:
    """Return the lanes that a class of actors may use."""
    kinds = _PEDESTRIAN_LANE_KINDS if actor_class == "pedestrian" else _VEHICLE_LANE_KINDS
    return [
        lane
        for lane in twin.roads.lanes
        if lane.kind in kinds
        and (actor_class in lane.allowed or lane.kind in _PEDESTRIAN_LANE_KINDS)
    ]


def spot_on(lane: Lane, along_m: float, place: str = "place") -> Spot:
    """Return the position on a lane, metres from its start.

    Raises:
        InputError: the lane is shorter; ``place`` names the field.
    """
    if not 0 <= along_m <= lane.length + 1e-6:
        raise InputError(
            f"{along_m:g} m is not on the lane",
            place=place,
            expected=f"0 to {lane.length:.1f} m",
        )
    line = shapely.LineString(lane.centre[:, :2])
    ends = [
        shapely.get_coordinates(line.interpolate(min(max(along_m + offset_m, 0.0), line.length)))[0]
        for offset_m in (-0.5, 0.0, 0.5)
    ]
    yaw = float(np.arctan2(*(ends[2] - ends[0])[::-1]))
    return Spot(lane, along_m, ends[1], yaw)


def _on_street(place: Place, twin: Twin, actor_class: str) -> Spot:
    """Return a position on the street's lane that leads to, or from, the main junction."""
    roads = twin.roads
    street_roads = [road for road in roads.roads if road.name == place.street]
    if not street_roads:
        street_names = sorted({road.name for road in roads.roads if road.name})
        raise InputError(
            f"there is no street {place.street!r:.60}",
            place="place.street",
            expected=nearest(str(place.street), street_names)
            if street_names
            else "a twin with street names",
        )
    away = place.after_junction_m is not None
    from_m = place.after_junction_m if away else place.before_junction_m
    from_m = 30.0 if from_m is None else from_m
    candidates = []
    for road in street_roads:
        for name in road.lanes:
            lane = roads.lane_by_id[name]
            if actor_class not in lane.allowed or lane.kind not in _VEHICLE_LANE_KINDS:
                continue
            end, other = (0, -1) if away else (-1, 0)
            distance_m = float(np.linalg.norm(lane.centre[end, :2]))
            if distance_m < float(np.linalg.norm(lane.centre[other, :2])):
                candidates.append((distance_m > 60.0, lane.length < from_m, distance_m, lane.id))
    if not candidates or min(candidates)[1]:
        longest = max(
            (roads.lane_by_id[candidate[3]].length for candidate in candidates), default=0.0
        )
        raise InputError(
            f"no lane of {place.street} for a {actor_class} is {from_m:g} m long there",
            place="place.street",
            expected=f"at most {longest:.1f} m"
            if candidates
            else "a street that leads to the junction",
        )
    lane = roads.lane_by_id[min(candidates)[3]]
    return spot_on(lane, from_m if away else lane.length - from_m, "place.street")


def _on_crossing(name: str, twin: Twin) -> Spot:
    """Return the middle of a crossing, by its id or by the street that it crosses."""
    roads = twin.roads
    crossings = {lane.id: lane for lane in roads.lanes if lane.kind == "crossing"}
    lane = crossings.get(name)
    if lane is None:
        crossed = _crossed_streets(crossings, roads)
        over = [
            (float(np.linalg.norm(crossing.centre[:, :2].mean(axis=0))), crossing.id)
            for crossing in crossings.values()
            if name in crossed[crossing.id]
        ]
        if not over:
            names: set[str] = set().union(*crossed.values())
            raise InputError(
                f"there is no crossing {name!r:.60}",
                place="place.crossing",
                expected=_suggestions(name, [*crossings, *sorted(names - {""})])
                if crossings
                else "another place: this twin has no crossings",
            )
        lane = crossings[min(over)[1]]
    return spot_on(lane, lane.length / 2, "place.crossing")


def _crossed_streets(crossings: Mapping[str, Lane], roads: RoadNetwork) -> dict[str, set[str]]:
    """Return the names of the streets that each crossing crosses."""
    strips = [
        (road.name, shapely.LineString(roads.lane_by_id[lane_id].centre[[0, -1], :2]).buffer(12.0))
        for road in roads.roads
        for lane_id in road.lanes
    ]
    return {
        crossing_id: {name for name, strip in strips if strip.intersects(crossing.polygon)}
        for crossing_id, crossing in crossings.items()
    }


def _suggestions(name: str, known: list[str]) -> str:
    """Return the most similar name, or a few of the existing ones."""
    suggestion = nearest(name, known)
    if not suggestion.startswith("one of"):
        return suggestion
    few = ", ".join(known[:5])
    return f"one of {few}, ..." if len(known) > 5 else f"one of {few}"
