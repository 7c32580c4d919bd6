"""Completeness of a twin relative to the map: streets, crossings, signals, and extent."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.roads import RoadNetwork
from urbantwin.roads.build import NETWORK_CLASSES
from urbantwin.roads.network import CARRIAGEWAY_KINDS
from urbantwin.site import Extract
from urbantwin.site.extract import Way
from urbantwin.site.extract_coverage import mapped_area, small_features

__all__ = ["FoundOfMapped", "found_of_mapped", "share_known"]

#: Margin along the region's border in which mapped objects may lie beyond the ends of roads,
#: metres.
BORDER_M = 10.0
#: Maximum distance of a crossing from its mapped place along its street, metres.
CROSSING_M = 8.0
#: Crossings of one street nearer to each other than this are one, metres.
ONE_CROSSING_M = 4.0
#: Maximum distance of a stop line from its mapped signal, metres: before a junction, and within
#: one.
SIGNAL_M, JUNCTION_M = 15.0, 30.0
#: Least length of a way to count as a street of the region, metres; least share of it along which
#: lanes lie, and maximum distance from them, metres.
LONG_M, ALONG, BESIDE_M = 20.0, 0.8, 3.0
#: Number of small features below which a map is taken as drawn by hand; share of the region below
#: which an extract hardly covers it.
MANY, HARDLY = 100, 1 / 3
_PATH_KEYS = ("footway", "path", "cycleway")


@dataclass(frozen=True)
class FoundOfMapped:
    """Number of mapped objects of a kind in the region, and of those in the roads.

    Attributes:
        found: number in the roads.
        mapped: number in the map.
        missing: (x, y) of the others, site frame, metres.
    """

    found: int
    mapped: int
    missing: tuple[tuple[float, float], ...]

    def as_note(self) -> dict[str, object]:
        """Return the entry of a twin's notes."""
        places = [[round(x, 1), round(y, 1)] for x, y in self.missing]
        return {"found": self.found, "mapped": self.mapped, "missing": places}


def found_of_mapped(
    extract: Extract | None, frame: SiteFrame, region: shapely.Polygon, network: RoadNetwork
) -> dict[str, FoundOfMapped]:
    """Return the completeness of the mapped ``streets``, ``crossings`` and ``signals``.

    A street counts if at least 20 m of a way are in the region; it is found if lanes or junctions
    lie along four fifths of them. Tunnels do not count. A mapped crossing is found if a crossing
    lies over the same street within 8 m; each carriageway of a dual one has its own.

    A mapped signal is found if vehicles are stopped within 15 m, or within 30 m where streets meet;
    that of a crossing also if a crossing with signals is within 8 m.

    Args:
        extract: the map; ``None`` gives an empty result.
        frame: the site frame.
        region: the region, site frame.
        network: the roads.
    """
    if extract is None:
        return {}
    streets = _streets(extract)
    lines = {street.id: shapely.LineString(extract.way_line(street, frame)) for street in streets}
    inside = region.buffer(-BORDER_M)
    over = [lane.polygon.buffer(0.5) for lane in network.lanes if lane.kind == "crossing"]
    crossed = shapely.STRtree(over)
    crossings = [
        (point, len(crossed.query(_around(lines[street_id], point), predicate="intersects")) > 0)
        for street_id, point in _crossings(extract, frame, streets, lines)
        if inside.contains(point)
    ]
    signalised = [(head, network.lane_by_id[head.lane]) for head in network.signals]
    stops = shapely.STRtree(
        [shapely.Point(head.x, head.y) for head, lane in signalised if lane.kind != "crossing"]
    )
    walks = shapely.STRtree([lane.polygon for _, lane in signalised if lane.kind == "crossing"])
    signals = [
        (
            point,
            _is_near(stops, point, reach) or (of_crossing and _is_near(walks, point, CROSSING_M)),
        )
        for point, reach, of_crossing in _signals(extract, frame, streets)
        if inside.contains(point)
    ]
    return {
        "streets": _presence_counts(_street_presence(lines.values(), inside, network)),
        "crossings": _presence_counts(crossings),
        "signals": _presence_counts(signals),
    }


def share_known(extract: Extract | None, frame: SiteFrame, region: shapely.Polygon) -> float:
    """Return the share of a region that an extract covers.

    It is the part within its declared bounds. Without bounds it is the area around its small
    features, if that is less than a third of the region, else 1: parks and water would look like
    areas without data.
    """
    if extract is None:
        return 1.0
    share = float(mapped_area(extract, frame).intersection(region).area / region.area)
    if extract.bounds is not None:
        return share
    return share if share < HARDLY and len(small_features(extract, frame)) >= MANY else 1.0


def _is_near(tree: shapely.STRtree, point: shapely.Point, reach_m: float) -> bool:
    return len(tree.query(point, predicate="dwithin", distance=reach_m)) > 0


def _presence_counts(places: list[tuple[shapely.Point, bool]]) -> FoundOfMapped:
    missing = tuple((point.x, point.y) for point, is_present in places if not is_present)
    return FoundOfMapped(len(places) - len(missing), len(places), missing)


def _street_presence(
    lines: Iterable[shapely.LineString], inside: shapely.Geometry, network: RoadNetwork
) -> list[tuple[shapely.Point, bool]]:
    """Return a point on each street in the region, and whether lanes lie along it."""
    driven = [
        lane.polygon for lane in network.lanes if lane.kind in (*CARRIAGEWAY_KINDS, "connection")
    ]
    junctions = [junction.polygon for junction in network.junctions]
    paved = shapely.union_all([*driven, *junctions]).buffer(BESIDE_M)
    parts = [
        part for part in (line.intersection(inside) for line in lines) if part.length >= LONG_M
    ]
    return [
        (
            part.interpolate(0.5, normalized=True)
            if part.geom_type == "LineString"
            else part.centroid,
            part.intersection(paved).length >= ALONG * part.length,
        )
        for part in parts
    ]


def _around(line: shapely.LineString, point: shapely.Point) -> shapely.Geometry:
    return shapely.intersection(line, point.buffer(CROSSING_M))


def _streets(extract: Extract) -> list[Way]:
    """Return the ways that become roads and are not underground."""
    return [
        osm_way
        for osm_way in extract.highways()
        if osm_way.tags["highway"] in NETWORK_CLASSES
        and osm_way.tags.get("area") != "yes"
        and osm_way.tags.get("tunnel", "no") in ("no", "building_passage")
        and sum(node in extract.nodes for node in osm_way.nodes) > 1
    ]


def _crossings(
    extract: Extract,
    frame: SiteFrame,
    streets: list[Way],
    lines: Mapping[int, shapely.LineString],
) -> Iterator[tuple[int, shapely.Point]]:
    """Yield the street and position of every mapped crossing, each once."""
    points_of: dict[int, list[shapely.Point]] = defaultdict(list)
    for osm_way in streets:
        nodes = [node for node in osm_way.nodes if node in extract.nodes]
        for node in nodes:
            tags = extract.node_tags.get(node, {})
            if tags.get("highway") == "crossing" and tags.get("crossing") != "no":
                xy = frame.site_from_lonlat([extract.nodes[node]])[0]
                points_of[osm_way.id].append(shapely.Point(xy))
    tree = shapely.STRtree([lines[osm_way.id] for osm_way in streets])
    for path in extract.highways():
        if "crossing" not in [path.tags.get(key) for key in _PATH_KEYS]:
            continue
        points = extract.way_line(path, frame)
        if len(points) < 2 or path.tags.get("crossing") == "no":
            continue
        line = shapely.LineString(points)
        for number in sorted(tree.query(line, predicate="intersects")):
            street = streets[number]
            if street.tags.get("layer", "0") == path.tags.get("layer", "0"):
                points_of[street.id].append(line.intersection(lines[street.id]).centroid)
    for street_id, places in sorted(points_of.items()):
        separate: list[shapely.Point] = []
        for point in places:
            if all(point.distance(other) >= ONE_CROSSING_M for other in separate):
                separate.append(point)
                yield street_id, point


def _signals(
    extract: Extract, frame: SiteFrame, streets: list[Way]
) -> Iterator[tuple[shapely.Point, float, bool]]:
    """Yield each mapped signal's position, search radius, and whether it is a crossing's."""
    legs: dict[int, int] = defaultdict(int)
    for street in streets:
        for index, node in enumerate(street.nodes):
            legs[node] += (index > 0) + (index < len(street.nodes) - 1)
    for node in sorted(legs.keys() & extract.node_tags.keys() & extract.nodes.keys()):
        tags = extract.node_tags[node]
        if "traffic_signals" in (tags.get("highway"), tags.get("crossing")):
            xy = np.asarray(frame.site_from_lonlat([extract.nodes[node]]))[0]
            reach_m = JUNCTION_M if legs[node] > 2 else SIGNAL_M
            yield shapely.Point(xy), reach_m, tags.get("highway") != "traffic_signals"
