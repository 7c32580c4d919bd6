"""Lane corrections by a user: the ways, their stretches, and the resulting tags."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.ops import substring

from urbantwin.geometry import SiteFrame
from urbantwin.roads.build import NETWORK_CLASSES
from urbantwin.roads.cross_section.lane_correction import (
    OTHER,
    ImpossibleLaneError,
    Street,
    with_lane,
    without_lane,
)
from urbantwin.roads.sidewalk import sidewalk_sides
from urbantwin.site.corrections import (
    AddLane,
    Correction,
    Outcome,
    RemoveLane,
    known_element,
)
from urbantwin.site.extract import Extract, Relation, Way

__all__ = ["with_lanes_corrected"]

#: Maximum distance of a drawn line from its way, metres, and minimum cosine of the angle between
#: them.
BESIDE_M, ALONG = 12.0, 0.8
#: A stretch that ends within the first distance of an end of its way ends there; stretches below
#: the second are dropped, metres.
END_M, SHORTEST_M = 4.0, 5.0
STEP_M = 1.0


@dataclass(frozen=True)
class _Stretch:
    """A part of a way, by distance along it; ``aligned``: whether drawn in its direction."""

    way: int
    first: float
    last: float
    aligned: bool = True


class _Map:
    """The map during its correction."""

    def __init__(self, extract: Extract, frame: SiteFrame) -> None:
        self.frame = frame
        self.nodes = dict(extract.nodes)
        self.ways = dict(extract.ways)
        self.relations = dict(extract.relations)
        #: Parts of ways that were cut.
        self.parts: dict[int, list[int]] = {}
        self.next_node = max(extract.highest[0], max(extract.nodes, default=0)) + 1
        self.next_way = max(extract.highest[1], max(extract.ways, default=0)) + 1

    def known(self, way: Way) -> list[int]:
        """Return the nodes of a way that are in the map."""
        return [node for node in way.nodes if node in self.nodes]

    def line(self, way: Way) -> NDArray[np.float64]:
        """Return the points of a way (N, 2), site frame."""
        return self.frame.site_from_lonlat([self.nodes[node] for node in self.known(way)])

    def cut(self, way: Way, first: float, last: float) -> int:
        """Cut a stretch out of a way, which keeps its other parts; return the id of the stretch."""
        points, nodes = self.line(way), self.known(way)
        along = _stations(points)
        cuts = [station_m for station_m in (first, last) if END_M < station_m < along[-1] - END_M]
        if not cuts:
            return way.id
        for station_m in cuts:
            nodes, points, along = self._with_node(nodes, points, along, station_m)
        ends = [0, *(int(np.abs(along - station_m).argmin()) for station_m in cuts), len(nodes) - 1]
        parts = [tuple(nodes[a : b + 1]) for a, b in pairwise(ends)]
        ids = [way.id, *range(self.next_way, self.next_way + len(parts) - 1)]
        self.next_way += len(parts) - 1
        for identity, part in zip(ids, parts, strict=True):
            self.ways[identity] = Way(identity, part, way.tags)
        self._replace(way.id, ids)
        return int(ids[1 if first == cuts[0] else 0])

    def _with_node(
        self,
        nodes: list[int],
        points: NDArray[np.float64],
        along: NDArray[np.float64],
        at: float,
    ) -> tuple[list[int], NDArray[np.float64], NDArray[np.float64]]:
        """Return a way with a node at a distance along it; an existing node is used."""
        if np.abs(along - at).min() < SHORTEST_M / 10:
            return nodes, points, along
        k = int(np.searchsorted(along, at))
        share = (at - along[k - 1]) / (along[k] - along[k - 1])
        place = points[k - 1] + share * (points[k] - points[k - 1])
        lon, lat = self.frame.lonlat_from_site(place[None])[0]
        self.nodes[self.next_node] = (float(lon), float(lat))
        self.next_node += 1
        grown = [*nodes[:k], self.next_node - 1, *nodes[k:]]
        return grown, np.insert(points, k, place, axis=0), np.insert(along, k, at)

    def _replace(self, way: int, ids: Sequence[int]) -> None:
        """Replace a cut way in relations by all its parts, in their order."""
        for part_ids in self.parts.values():
            if way in part_ids:
                part_ids[part_ids.index(way) : part_ids.index(way) + 1] = ids
        self.parts.setdefault(way, list(ids))
        for identity, relation in self.relations.items():
            if any(kind == "w" and ref == way for kind, ref, _ in relation.members):
                members = tuple(
                    (kind, part, role)
                    for kind, ref, role in relation.members
                    for part in (ids if kind == "w" and ref == way else (ref,))
                )
                self.relations[identity] = Relation(identity, members, relation.tags)


def with_lanes_corrected(
    extract: Extract,
    corrections: Iterable[Correction],
    frame: SiteFrame,
    region: shapely.Polygon,
    *,
    driving_side: str,
    country: str = "",
) -> tuple[Extract, list[Outcome]]:
    """Return the map with lanes added and removed, and the outcome of each correction.

    A correction of a stretch cuts its way there.

    Args:
        extract: the map.
        corrections: the corrections; other kinds are ignored.
        frame: the site frame.
        region: the region, site frame.
        driving_side: ``right`` or ``left``.
        country: ISO 3166-1 alpha-2; empty if unknown.

    Raises:
        InputError: a way is not in the map.
    """
    edited = _Map(extract, frame)
    outcomes = []
    for correction in corrections:
        if isinstance(correction.asked, AddLane | RemoveLane):
            if correction.asked.element is not None:
                known_element(extract, correction.asked.element, correction)
            outcomes.append(
                _corrected(edited, correction, correction.asked, region, driving_side, country)
            )
    if not outcomes:
        return extract, []
    changed = replace(extract, nodes=edited.nodes, ways=edited.ways, relations=edited.relations)
    return changed, outcomes


def _corrected(
    edited: _Map,
    one: Correction,
    asked: AddLane | RemoveLane,
    region: shapely.Polygon,
    driving_side: str,
    country: str,
) -> Outcome:
    """Apply one correction in place."""
    among = None if asked.element is None else edited.parts.get(asked.element.id)
    if asked.element is not None and among is None:
        among = [asked.element.id]
    candidates = [
        osm_way
        for identity in (sorted(edited.ways) if among is None else among)
        if _is_street(osm_way := edited.ways[identity]) and len(edited.known(osm_way)) > 1
    ]
    if not candidates:
        return Outcome(one, False, f"{asked.element} is no street with lanes")
    if one.shapes:
        stretches = _stretches(edited, candidates, one.shapes)
    else:
        stretches = [
            _Stretch(osm_way.id, 0.0, float(_stations(edited.line(osm_way))[-1]))
            for osm_way in candidates
        ]
    if not stretches:
        return Outcome(
            one, False, f"runs along no street: {_nearest(edited, candidates, one.shapes)}"
        )
    one_way_lines = [
        shapely.LineString(edited.line(osm_way))
        for osm_way in edited.ways.values()
        if _is_street(osm_way)
        and osm_way.tags.get("oneway") in ("yes", "1", "true")
        and len(edited.known(osm_way)) > 1
    ]
    changes, reasons, places = [], [], []
    for stretch in stretches:
        osm_way = edited.ways[stretch.way]
        line = edited.line(osm_way)
        stretch_line = substring(shapely.LineString(line), stretch.first, stretch.last)
        if shapely.distance(stretch_line, region) > 0:
            reasons.append(f"way/{osm_way.id} lies outside the region")
            continue
        side = asked.side if stretch.aligned else OTHER[asked.side]
        sides = sidewalk_sides(osm_way.tags, line, one_way_lines, side=driving_side)
        street = Street(driving_side, sides, country)
        try:
            if isinstance(asked, AddLane):
                tags = with_lane(osm_way.tags, side, asked.kind, asked.width_m, street)
            else:
                tags = without_lane(osm_way.tags, side, asked.kind, street)
        except ImpossibleLaneError as error:
            reasons.append(f"way/{osm_way.id}: {error}")
            continue
        part = edited.cut(osm_way, stretch.first, stretch.last)
        edited.ways[part] = replace(edited.ways[part], tags=tags)
        places.append(stretch_line)
        changes.append(f"{stretch.last - stretch.first:.0f} m of way/{osm_way.id}")
    if not changes:
        return Outcome(one, False, "; ".join(reasons))
    verb = "added to" if isinstance(asked, AddLane) else "removed from"
    summary = f"{asked.kind} lane {verb} {', '.join(changes)}"
    return Outcome(one, True, "; ".join([summary, *(f"not: {text}" for text in reasons)]), places)


def _is_street(way: Way) -> bool:
    return way.tags.get("highway") in NETWORK_CLASSES and way.tags.get("area") != "yes"


def _stations(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance of each point along a line (N,), metres."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _stretches(
    edited: _Map, ways: Sequence[Way], shapes: Sequence[shapely.Geometry]
) -> list[_Stretch]:
    """Return the stretches of ways along drawn lines, in the order of the drawing.

    Each metre of a drawn line belongs to the nearest way that is parallel to it in either
    direction.
    """
    lines = [shapely.LineString(edited.line(osm_way)) for osm_way in ways]
    tree = shapely.STRtree(lines)
    samples: dict[int, list[tuple[float, bool]]] = {}
    for shape in shapes:
        drawn = shapely.segmentize(shape, STEP_M)
        points = shapely.get_coordinates(drawn)
        for a, b in pairwise(points):
            middle, ahead = shapely.Point((a + b) / 2), (b - a) / max(np.linalg.norm(b - a), 1e-9)
            best: tuple[float, int, float, bool] | None = None
            for k in sorted(tree.query(middle, predicate="dwithin", distance=BESIDE_M).tolist()):
                station = float(lines[k].project(middle))
                cosine = float(_direction(lines[k], station) @ ahead)
                gap = lines[k].distance(middle)
                if abs(cosine) > ALONG and (best is None or gap < best[0]):
                    best = gap, k, station, cosine > 0
            if best is not None:
                samples.setdefault(best[1], []).append((best[2], best[3]))
    stretches = []
    for k, rows in samples.items():
        stations = np.array([station for station, _ in rows])
        length = lines[k].length
        first, last = float(stations.min()) - STEP_M / 2, float(stations.max()) + STEP_M / 2
        first = 0.0 if first < END_M else first
        last = length if last > length - END_M else last
        if last - first >= min(SHORTEST_M, length):
            aligned = 2 * sum(along for _, along in rows) >= len(rows)
            stretches.append(_Stretch(ways[k].id, first, last, aligned))
    return stretches


def _direction(line: shapely.LineString, station: float) -> NDArray[np.float64]:
    """Return the unit vector (2,) along a line at a distance along it."""
    a, b = (
        shapely.get_coordinates(line.interpolate(float(np.clip(station + d, 0, line.length))))[0]
        for d in (-0.5, 0.5)
    )
    return np.asarray((b - a) / max(float(np.linalg.norm(b - a)), 1e-9))


def _nearest(edited: _Map, ways: Sequence[Way], shapes: Sequence[shapely.Geometry]) -> str:
    """Return a text on the nearest way."""
    drawn = shapely.GeometryCollection(list(shapes))
    gaps: Mapping[int, float] = {
        osm_way.id: shapely.distance(drawn, shapely.LineString(edited.line(osm_way)))
        for osm_way in ways
    }
    nearest_id = min(gaps, key=lambda identity: (gaps[identity], identity))
    return f"the nearest is way/{nearest_id}, {gaps[nearest_id]:.0f} m away"
