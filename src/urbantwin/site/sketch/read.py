"""Conversion of a sketch into a map extract: nodes, ways and tags."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site.extract import Extract, Way
from urbantwin.site.sketch.drawing import Feature, read_drawing
from urbantwin.site.sketch.kinds import Crossing, Junction, StopLine, Street, Turn
from urbantwin.site.sketch.turns import (
    FOLLOWED,
    Joined,
    Place,
    attached,
    check_turns,
    is_followed,
    joined,
    line_text,
    place_of,
)

__all__ = ["read_sketch"]

#: Largest distance of a stop line from the lanes of its street, metres.
BESIDE_M = 2.0


def read_sketch(path: Path, frame: SiteFrame) -> Extract:
    """Read a sketch as a map.

    Streets connect where their lines cross, or end on each other. Stop lines and crossings become
    nodes of their streets.

    Args:
        path: the sketch, GeoJSON.
        frame: the site frame.

    Raises:
        InputError: a feature is wrong; names the first.
    """
    features = read_drawing(path, frame)
    streets = [one for one in features if isinstance(one.drawn, Street)]
    if not streets:
        raise InputError("holds no streets", file=path, expected="lines of the kind 'street'")
    network = joined(
        attached(streets),
        [one.drawn.layer for one in streets if isinstance(one.drawn, Street)],
        [isinstance(one.drawn, Turn) for one in streets],
    )
    check_turns(streets, network, partial(_error, path))
    meeting = network.meeting()
    node_tags: dict[Place, dict[str, str]] = {}
    for one in features:
        if isinstance(one.drawn, Junction) and (tags := one.tags):
            inside = [at for at in meeting if one.geometry.contains(shapely.Point(at))]
            if not inside:
                raise _error(path, one, "holds no place where streets meet")
            node_tags |= dict.fromkeys(inside, tags)
    for one in features:
        if isinstance(one.drawn, StopLine):
            at, tags = _stop_line(path, one, streets, network, meeting)
            node_tags[at] = node_tags.get(at, {}) | tags
    crossed: dict[int, list[Place]] = {}
    for one in features:
        if isinstance(one.drawn, Crossing):
            crossed[one.number] = _crossed(one, streets, network)
            if not crossed[one.number]:
                raise _error(path, one, "crosses no street")
            for at in crossed[one.number]:
                node_tags[at] = node_tags.get(at, {}) | one.tags
    return _Map(path, frame, node_tags).of(features, network, crossed)


class _Map:
    """Nodes and ways with ids in the order of the sketch."""

    def __init__(
        self, path: Path, frame: SiteFrame, node_tags: Mapping[Place, Mapping[str, str]]
    ) -> None:
        self._path, self._frame = path, frame
        self._told = node_tags
        self._id: dict[Place, int] = {}
        self._places: list[Place] = []
        self._tags: dict[int, dict[str, str]] = {}
        self._ways: dict[int, Way] = {}

    def of(
        self, features: Sequence[Feature], network: Joined, crossed: Mapping[int, Sequence[Place]]
    ) -> Extract:
        """Return all features as a map; ``crossed``: positions of each crossing on streets."""
        lines = iter(network.lines)
        for one in features:
            if isinstance(one.drawn, Street):
                tags = one.tags | ({FOLLOWED: line_text(one)} if is_followed(one) else {})
                self._way([self._shared(point) for point in next(lines)], tags)
            elif isinstance(one.drawn, StopLine | Junction):
                continue
            elif isinstance(one.drawn, Crossing):
                self._crossing(one, crossed[one.number])
            elif one.geometry.geom_type == "Point":
                node = self._node(place_of(shapely.get_coordinates(one.geometry)[0]))
                self._tags[node] = one.tags
            else:
                points = shapely.get_coordinates(one.geometry)
                self._way([self._shared(point) for point in points], one.tags)
        places = np.array(self._places, dtype=np.float64).reshape(-1, 2)
        lonlat = self._frame.lonlat_from_site(places)
        return Extract(
            self._path,
            {k + 1: (float(lon), float(lat)) for k, (lon, lat) in enumerate(lonlat)},
            self._tags,
            self._ways,
            {},
            None,
        )

    def _crossing(self, one: Feature, streets: Sequence[Place]) -> None:
        """Add the walking path of a crossing, with a node on every street."""
        line = one.geometry
        drawn = [place_of(point) for point in shapely.get_coordinates(line)]
        order = {at: line.project(shapely.Point(at)) for at in dict.fromkeys([*drawn, *streets])}
        nodes = [self._shared(np.array(at)) for at in sorted(order, key=lambda at: order[at])]
        tags = {key: value for key, value in one.tags.items() if key != "highway"}
        self._way(nodes, {"highway": "footway", "footway": "crossing", **tags})

    def _shared(self, point: NDArray[np.float64]) -> int:
        """Return the node at a point, shared by all lines through it."""
        place = place_of(point)
        if place not in self._id:
            self._id[place] = self._node(place)
            if place in self._told:
                self._tags[self._id[place]] = dict(self._told[place])
        return self._id[place]

    def _node(self, place: Place) -> int:
        self._places.append(place)
        return len(self._places)

    def _way(self, nodes: list[int], tags: dict[str, str]) -> None:
        number = len(self._ways) + 1
        self._ways[number] = Way(number, tuple(nodes), tags)


def _stop_line(
    path: Path,
    one: Feature,
    streets: Sequence[Feature],
    network: Joined,
    meeting: Sequence[Place],
) -> tuple[Place, dict[str, str]]:
    """Insert a stop line into its street; return its position and tags."""
    middle = one.geometry.interpolate(0.5, normalized=True) if one.geometry.length else one.geometry
    gaps = [
        shapely.LineString(line).distance(middle) - street.drawn.half_width_m
        for line, street in zip(network.lines, streets, strict=True)
        if isinstance(street.drawn, Street)
    ]
    # Within the lanes of several streets, choose the most perpendicular one, then the nearest.
    on = [k for k, gap in enumerate(gaps) if gap <= BESIDE_M and not _is_turn(streets[k])]
    if not on:
        near = f"{max(min(gaps), 0.0):.1f} m from the lanes of the nearest street"
        raise _error(path, one, f"lies on no street: {near}")
    k = min(on, key=lambda k: (_along(network.lines[k], one.geometry), gaps[k]))
    at = network.put(k, shapely.get_coordinates(middle)[0])
    if at in meeting:
        raise _error(path, one, "lies where streets meet", "a place before it")
    tags = one.tags
    street = streets[k].drawn
    assert isinstance(street, Street)
    forward = not street.lanes_back or _leads_to(network.lines[k], at, meeting)
    way = "forward" if forward else "backward"
    key = "traffic_signals:direction" if tags.get("highway") == "traffic_signals" else "direction"
    return at, {**tags, key: way} if tags else {}


def _along(line: NDArray[np.float64], across: shapely.Geometry) -> float:
    """Return how parallel a line is to a street: 0 (perpendicular) to 1, rounded to tenths."""
    points = shapely.get_coordinates(across)
    if len(points) < 2:
        return 0.0
    whole = shapely.LineString(line)
    s = whole.project(across.interpolate(0.5, normalized=True))
    a, b = (
        shapely.get_coordinates(whole.interpolate(float(np.clip(s + d, 0, whole.length))))[0]
        for d in (-1.0, 1.0)
    )
    ahead, drawn = b - a, points[-1] - points[0]
    cosine = ahead @ drawn / max(float(np.linalg.norm(ahead) * np.linalg.norm(drawn)), 1e-9)
    return round(abs(float(cosine)), 1)


def _leads_to(line: NDArray[np.float64], at: Place, meeting: Sequence[Place]) -> bool:
    """Return whether the nearest junction along a street is ahead of a place on it."""
    corners = [place_of(point) for point in line]
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    here = along[corners.index(at)]
    ways = [
        along[k] - here for k, corner in enumerate(corners) if corner in meeting and corner != at
    ]
    return min(ways, key=abs, default=1.0) > 0.0


def _is_turn(one: Feature) -> bool:
    return isinstance(one.drawn, Turn)


def _crossed(one: Feature, streets: Sequence[Feature], network: Joined) -> list[Place]:
    """Insert a crossing into every street that it crosses; return the positions."""
    found = []
    for k, line in enumerate(network.lines):
        if _is_turn(streets[k]):
            continue
        across = shapely.intersection(shapely.LineString(line), one.geometry)
        points = [part for part in shapely.get_parts(across) if part.geom_type == "Point"]
        found += [network.put(k, shapely.get_coordinates(part)[0]) for part in points]
    return found


def _error(path: Path, one: Feature, problem: str, expected: str | None = None) -> InputError:
    x, y = shapely.get_coordinates(one.geometry)[0]
    where = f"{one.place} at {x:.1f}, {y:.1f} m"
    return InputError(problem, file=path, place=where, expected=expected)
