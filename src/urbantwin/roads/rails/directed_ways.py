"""Which way trams run on each track of the map."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import SiteFrame
from urbantwin.roads.grade_separation import way_layer
from urbantwin.site.extract import Extract, Relation, Way

__all__ = ["tram_ways", "ways_run"]

RAILWAYS, ROUTES = ("tram", "light_rail"), ("tram", "light_rail")
#: A track that is so far from another one, and runs with it, is one of a pair, metres.
PAIR_M = (2.0, 7.0)
PARALLEL_COS = np.cos(np.radians(20.0))
_YES = {"yes": {1}, "forward": {1}, "1": {1}, "-1": {-1}, "reverse": {-1}, "backward": {-1}}
_BOTH = {"no": {1, -1}, "both": {1, -1}, "bidirectional": {1, -1}}


def tram_ways(extract: Extract, frame: SiteFrame, region: shapely.Polygon) -> list[Way]:
    """Return the tracks in the open that lines run on; where no line is mapped, all but sidings."""
    tracks = [
        way
        for _, way in sorted(extract.ways.items())
        if way.tags.get("railway") in RAILWAYS
        and way.tags.get("tunnel", "no") == "no"
        and way_layer(way.tags) >= 0
        and len(line := extract.way_line(way, frame)) > 1
        and region.intersects(shapely.LineString(line))
    ]
    used = {way for route in _routes(extract) for kind, way, _ in route.members if kind == "w"}
    on_lines = [way for way in tracks if way.id in used]
    return on_lines or [way for way in tracks if "service" not in way.tags]


def ways_run(
    extract: Extract, frame: SiteFrame, ways: Sequence[Way], driving_side: str
) -> dict[int, frozenset[int]]:
    """Return for each way whether trams run along it (1), against it (-1), or both.

    What the way's tags say counts first (``railway:preferred_direction``, ``oneway``), then the
    order of the ways in mapped lines, then on which side the other track of a pair lies. A track
    by itself is used in both directions.
    """
    lines = {way.id: extract.way_line(way, frame) for way in ways}
    by_route = _directions_of_routes(extract, {way.id: way for way in ways})
    found = {}
    for way in ways:
        said = way.tags.get("railway:preferred_direction") or way.tags.get("oneway", "")
        tagged = _YES.get(said) or _BOTH.get(said)
        beside = _of_pair(way.id, lines, driving_side)
        found[way.id] = frozenset(tagged or by_route.get(way.id) or beside or {1, -1})
    return found


def _routes(extract: Extract) -> list[Relation]:
    return [
        relation
        for _, relation in sorted(extract.relations.items())
        if relation.tags.get("type") == "route" and relation.tags.get("route") in ROUTES
    ]


def _directions_of_routes(extract: Extract, ways: Mapping[int, Way]) -> dict[int, set[int]]:
    """Return the directions in which lines run on ways, by the order of a line's members."""
    found: defaultdict[int, set[int]] = defaultdict(set)
    for route in _routes(extract):
        rows = [member for kind, member, role in route.members if kind == "w" and role == ""]
        for first, second in pairwise(rows):
            a, b = extract.ways.get(first), extract.ways.get(second)
            if a is None or b is None or len(a.nodes) < 2 or len(b.nodes) < 2:
                continue
            for k, sign in ((-1, 1), (0, -1)):
                if a.nodes[k] in (b.nodes[0], b.nodes[-1]):
                    if first in ways:
                        found[first].add(sign)
                    if second in ways:
                        found[second].add(1 if a.nodes[k] == b.nodes[0] else -1)
                    break
    return found


def _of_pair(
    own: int, lines: Mapping[int, NDArray[np.float64]], driving_side: str
) -> set[int] | None:
    """Return the direction of a track by the side on which the other one of the pair lies."""
    line = lines[own]
    middle = shapely.LineString(line).interpolate(0.5, normalized=True)
    ahead = _heading(line, middle)
    here = shapely.get_coordinates(middle)[0]
    for other, points in lines.items():
        whole = shapely.LineString(points)
        if other == own or not PAIR_M[0] <= whole.distance(middle) <= PAIR_M[1]:
            continue
        if abs(float(ahead @ _heading(points, middle))) < PARALLEL_COS:
            continue
        gap = shapely.get_coordinates(whole.interpolate(whole.project(middle)))[0] - here
        left = float(ahead[0] * gap[1] - ahead[1] * gap[0]) > 0
        # Where one drives on the right, the other direction is on the left.
        return {1} if left == (driving_side == "right") else {-1}
    return None


def _heading(line: NDArray[np.float64], near: shapely.Point) -> NDArray[np.float64]:
    """Return the unit vector (2,) along a line where it is nearest to a place."""
    whole = shapely.LineString(line)
    at = whole.project(near)
    ends = shapely.line_interpolate_point(whole, [max(at - 1.0, 0.0), min(at + 1.0, whole.length)])
    leg = np.diff(shapely.get_coordinates(ends), axis=0)[0]
    return np.asarray(leg / max(float(np.linalg.norm(leg)), 1e-9))
