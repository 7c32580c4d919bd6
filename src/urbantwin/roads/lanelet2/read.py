"""Conversion of a Lanelet2 map to the lane model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.roads.driving_side import driving_side
from urbantwin.roads.lanelet2.build import BuiltRoads, LaneAt, build_streets_and_junctions
from urbantwin.roads.lanelet2.connecting_road import ConnectingRoad
from urbantwin.roads.lanelet2.document import Document, read_document
from urbantwin.roads.lanelet2.group import Member
from urbantwin.roads.lanelet2.lane_sections import Row
from urbantwin.roads.lanelet2.lanelet import Lanelet, bounds_of, lanelet_of
from urbantwin.roads.lanelet2.markings import BuiltMap, areas_of, hosts_of, island_ways, stop_lines
from urbantwin.roads.lanelet2.projection import Places, places_of
from urbantwin.roads.lanelet2.regulatory_elements import (
    POSTED,
    controllers_of,
    sign_ways,
    signals_of,
)
from urbantwin.roads.lanelet2.street import Street
from urbantwin.roads.lanelet2.traffic_rules import PAINTED, default_speed, speed_of
from urbantwin.roads.model import Connection, LaneModel, ModelJunction, ModelRoad, RoadLink
from urbantwin.roads.model.road import with_lane_marks

__all__ = ["Translation", "read_lanelet2", "translate", "translated"]

#: Connecting roads with a larger overlap belong to one junction, square metres.
OVERLAP_M2 = 0.5
#: Minimum vertical distance of roads on different levels, metres.
CLEARANCE_M = 2.5


@dataclass(frozen=True)
class Translation:
    """A lane model, with the place of each lanelet in it.

    Attributes:
        model: the lane model.
        lanes: lanelet -> (road, section index, lane) made from it. If a road ends obliquely, the
            rest of a lane is in the linked roads.
        notes: counts, assumptions and omissions.
    """

    model: LaneModel
    lanes: Mapping[int, tuple[LaneAt, ...]]
    notes: dict[str, object]


def read_lanelet2(path: Path, frame: SiteFrame) -> tuple[LaneModel, dict[str, object]]:
    """Read a Lanelet2 map (OSM XML) as a lane model in the site frame.

    Lanelets that share bounds lie on one road, both directions if they share the line between them.
    Bounds become borders of lanes within a few millimetres. If roads end obliquely, the rest of a
    lane belongs to the connecting roads. ``ways`` of roads are ids of lanelets. Lanelets, lights
    and signs that cannot be read are dropped: ``dropped`` in the notes lists each with its id, its
    position and the reason.

    Returns:
        The model, and notes: counts, assumptions and omissions.

    Raises:
        InputError: it is not a Lanelet2 map, nothing in it is for vehicles or readable, or it is
            far from the anchor.
        StageError: the lanelets make no roads.
    """
    translation = translate(path, frame)
    return translation.model, translation.notes


def translate(path: Path, frame: SiteFrame) -> Translation:
    """Return the result of ``read_lanelet2`` with the place of each lanelet in the model."""
    return translated(read_document(path), frame)


def translated(document: Document, frame: SiteFrame) -> Translation:
    """Translate a document that was read, or converted from another format."""
    notes: dict[str, object] = {}
    document, lanelets, places = _lanelets(document, frame, notes)
    side = driving_side(frame.latitude, frame.longitude)
    way_tags = {identity: osm_way.tags for identity, osm_way in document.ways.items()}
    if not any(n.drives for n in lanelets.values()):
        if document.dropped:
            raise document.dropped[0]
        raise document.error("has no lanelets that vehicles may use")
    notes["dropped"] = [f"{error.place}: {error.problem}" for error in document.dropped]
    parts = build_streets_and_junctions(lanelets, side, attributes_of(document), way_tags)
    first = 1 + len(parts.streets) + len(parts.connecting_roads)
    roads, junctions = junctions_of(parts.streets, parts.connecting_roads, first)
    if not any(tags.get("type") in PAINTED for tags in way_tags.values()):
        roads = tuple(_painted(road) for road in roads)
        notes["lines_between_lanes"] = "assumed: the map has none"
    hosts = hosts_of(roads)
    on_streets = BuiltMap(document, places, lanelets, parts.approaches, hosts)
    first += len(junctions)
    areas = areas_of(on_streets, first, notes)
    first += len(areas)
    signals = signals_of(on_streets, first, notes)
    signals, controllers = controllers_of(signals, hosts, first + len(signals))
    _note(notes, document, lanelets, parts)
    model = LaneModel(side, roads, junctions, areas, signals, controllers)
    return Translation(model, parts.lanes, notes)


def _lanelets(
    document: Document, frame: SiteFrame, notes: dict[str, object]
) -> tuple[Document, dict[int, Lanelet], Places]:
    """Return the document without unreadable elements, its lanelets, and node positions.

    Raises:
        InputError: no lanelet is readable, or the map is far from the anchor.
    """
    dropped = list(document.dropped)
    bounds: dict[int, tuple[int, int]] = {}
    for identity, relation in sorted(document.relations.items()):
        if relation.tags.get("type") == "lanelet":
            try:
                bounds[identity] = bounds_of(document, identity, relation)
            except InputError as error:
                dropped.append(error)
    if not bounds:
        raise dropped[0]
    needs: dict[int, int] = {way_id: i for i, pair in bounds.items() for way_id in pair}
    ways_of_relation = _ways_of_others(document)
    for identity, way_ids in ways_of_relation.items():
        for way_id in way_ids:
            needs.setdefault(way_id, identity)
    for way_id in stop_lines(document):
        needs.setdefault(way_id, next(iter(bounds)))
    used = {
        node: identity
        for way_id, identity in reversed(needs.items())
        if way_id in document.ways
        for node in document.ways[way_id].nodes
        if node in document.nodes
    }
    places = places_of(document, frame, used, notes)
    lanelets: dict[int, Lanelet] = {}
    for identity, pair in bounds.items():
        try:
            lanelets[identity] = lanelet_of(document, identity, pair, places)
        except InputError as error:
            dropped.append(error)
    relations = {
        identity: relation
        for identity, relation in document.relations.items()
        if relation.tags.get("type") != "lanelet" or identity in lanelets
    }
    for identity, way_ids in ways_of_relation.items():
        bad = {
            way_id: problem for way_id in way_ids if (problem := _problem(document, way_id, places))
        }
        if bad:
            dropped += [document.error(problem, identity) for problem in bad.values()]
            members = tuple(
                row for row in relations[identity].members if row[0] != "way" or row[1] not in bad
            )
            relations[identity] = replace(relations[identity], members=members)
    # Stop lines are ways without a relation.
    missing = {way_id for way_id in stop_lines(document) if _problem(document, way_id, places)}
    remaining_ways = {
        identity: osm_way for identity, osm_way in document.ways.items() if identity not in missing
    }
    sound = replace(document, ways=remaining_ways, relations=relations, dropped=tuple(dropped))
    return sound, lanelets, places


def _ways_of_others(document: Document) -> dict[int, list[int]]:
    """Return the ways of lights, signs, stop lines and islands, by relation."""
    way_ids = {}
    for identity, relation in sorted(document.relations.items()):
        if relation.tags.get("type") == "regulatory_element":
            way_ids[identity] = [*sign_ways(relation), *relation.of_role("ref_line")]
    for identity, relation in island_ways(document).items():
        way_ids[identity] = relation.of_role("outer")
    return way_ids


def _problem(document: Document, way: int, places: Places) -> str:
    """Return a way's error message, empty if it is valid."""
    if way not in document.ways:
        return f"refers to way {way}, which the file lacks"
    nodes = document.ways[way].nodes
    if not nodes:
        return f"way {way} has no points"
    for node in nodes:
        if node not in document.nodes:
            return f"way {way} refers to node {node}, which the file lacks"
        if node not in places:
            return f"node {node} has no finite latitude and longitude"
    return ""


def _painted(road: ModelRoad) -> ModelRoad:
    """Return a street with default lane lines; connecting roads, which overlap, get none."""
    if road.junction >= 0:
        return road
    return replace(road, sections=tuple(with_lane_marks(section) for section in road.sections))


def _note(
    notes: dict[str, object],
    document: Document,
    lanelets: Mapping[int, Lanelet],
    parts: BuiltRoads,
) -> None:
    """Add counts of read, dropped and suspicious elements to the notes."""
    counts: Counter[str] = Counter()
    otherwise: list[str] = []
    counts["lanelets"] = len(lanelets)
    for identity, lanelet in lanelets.items():
        is_used = identity in parts.lanes or identity in parts.stubs
        if lanelet.kind != "crosswalk" and not is_used:
            subtype = lanelet.tags.get("subtype", "")
            name = f"{subtype}s_apart_from_streets" if lanelet.kind else f"of_subtype_{subtype}"
            counts[f"left_out_lanelets_{name}"] += 1
        if lanelet.drives and lanelet.tags.get("one_way", "yes") == "no":
            counts["lanelets_for_both_directions_used_in_one"] += 1
            note = document.error("one_way=no: used in one direction", identity)
            otherwise.append(f"{note.place}: {note.problem}")
        counts["missing_regulatory_elements"] += sum(
            i not in document.relations for i in lanelet.regulations
        )
    for identity, relation in document.relations.items():
        if relation.tags.get("type") == "multipolygon" and identity not in island_ways(document):
            counts["left_out_areas_of_subtype_" + relation.tags.get("subtype", "")] += 1
        elif relation.tags.get("type") == "regulatory_element":
            subtype = relation.tags.get("subtype", "")
            counts[f"left_out_regulatory_elements_of_subtype_{subtype}"] += subtype not in POSTED
    counts["left_out_lanelets_that_make_no_road"] = len(parts.stubs)
    counts["lanes_that_end_at_junctions_cut_across"] = len(parts.shortened)
    counts["crossings_without_a_junction"] = len(parts.plan.crossed)
    counts["corners_of_borders_that_turn_back"] = sum(
        [*(s.dropped for s in parts.streets), *(p.dropped for p in parts.connecting_roads)]
    )
    notes.update({key: n for key, n in counts.items() if n})
    if otherwise:
        notes["reinterpreted"] = otherwise
    loose = _loose(parts)
    if loose:
        notes["lanelets_that_end_on_others_without_sharing_points"] = loose


def _loose(parts: BuiltRoads) -> list[int]:
    """Return lanelets without successor that end within another one."""
    drives = parts.topology.lanelets
    ids = list(drives)
    tree = shapely.STRtree([drives[i].polygon for i in ids])
    lanelet_ids = []
    for i, lanelet in drives.items():
        if parts.topology.successors[i]:
            continue
        line = lanelet.centre
        end = shapely.line_interpolate_point(line, line.length - min(0.5, line.length / 2))
        own_street = parts.topology.place[i][0]
        hits = tree.query(end, predicate="intersects")
        if any(parts.topology.place[ids[k]][0] != own_street for k in hits):
            lanelet_ids.append(i)
    return lanelet_ids


def junctions_of(
    streets: Sequence[Street], connecting_roads: Sequence[ConnectingRoad], first: int
) -> tuple[tuple[ModelRoad, ...], tuple[ModelJunction, ...]]:
    """Return all roads, linked to each other and to junctions, and the junctions.

    Args:
        streets: the streets.
        connecting_roads: the connecting roads.
        first: id of the first junction.
    """
    number = _clusters(connecting_roads)
    identity = {k: first + n for n, k in enumerate(dict.fromkeys(number))}
    junction_at: dict[tuple[int, bool], int] = {}
    rows: dict[int, list[Connection]] = {i: [] for i in identity.values()}
    roads = []
    for connecting_road, cluster in zip(connecting_roads, number, strict=True):
        junction = identity[cluster]
        for gate in (connecting_road.start, connecting_road.end):
            junction_at[gate.street.road.id, gate.end] = junction
        road = replace(connecting_road.road, junction=junction)
        lane = road.sections[0].lanes[0].id
        rows[junction].append(
            Connection(
                connecting_road.start.street.road.id,
                road.id,
                "start",
                ((connecting_road.start.lane, lane),),
            )
        )
        roads.append(road)
    linked = [
        replace(
            street.road,
            predecessor=_link(junction_at.get((street.road.id, False))),
            successor=_link(junction_at.get((street.road.id, True))),
        )
        for street in streets
    ]
    junctions = tuple(ModelJunction(i, "", tuple(rows[i])) for i in sorted(rows))
    return (*linked, *roads), junctions


def _link(junction: int | None) -> RoadLink | None:
    return None if junction is None else RoadLink("junction", junction)


def _clusters(connecting_roads: Sequence[ConnectingRoad]) -> list[int]:
    """Return for each connecting road the index of the first one of its junction."""
    parent = list(range(len(connecting_roads)))

    def root(k: int) -> int:
        while parent[k] != k:
            k = parent[k]
        return k

    def join(a: int, b: int) -> None:
        a, b = root(a), root(b)
        parent[max(a, b)] = min(a, b)

    first: dict[tuple[int, bool], int] = {}
    for k, connecting_road in enumerate(connecting_roads):
        for gate in (connecting_road.start, connecting_road.end):
            join(k, first.setdefault((gate.street.road.id, gate.end), k))
    areas = np.array([connecting_road.area for connecting_road in connecting_roads], object)
    tree = shapely.STRtree(areas)
    for a, b in zip(*tree.query(areas, predicate="intersects"), strict=True):
        if a < b and root(a) != root(b):
            common = shapely.intersection(areas[a], areas[b])
            if common.area > OVERLAP_M2 and _level(
                connecting_roads[a], connecting_roads[b], common
            ):
                join(int(a), int(b))
    return [root(k) for k in range(len(connecting_roads))]


def _level(a: ConnectingRoad, b: ConnectingRoad, common: shapely.Geometry) -> bool:
    point = np.array(common.representative_point().coords)[:, :2]
    heights = []
    for road in (a.road, b.road):
        s, t = road.curve.locate(point)
        heights.append(float(road.heights(np.clip(s, 0.0, road.length), t)[0]))
    return abs(heights[0] - heights[1]) < CLEARANCE_M


def attributes_of(document: Document) -> Callable[[Member], Row]:
    """Return a function that returns the attributes of a lanelet along its road.

    The speed limit is that of its tag ``speed_limit``, else of its regulatory element, else of a
    tag ``maxspeed`` as in street maps, else that of its subtype and location.
    """
    limits: dict[int, float | None] = {}
    for identity, relation in document.relations.items():
        if relation.tags.get("subtype") == "speed_limit":
            signs = [
                document.ways[way_id].tags.get("subtype", "")
                for way_id in relation.of_role("refers")
                if way_id in document.ways
            ]
            limits[identity] = speed_of([relation.tags.get("sign_type", ""), *signs])

    def row(member: Member) -> Row:
        lanelet = member.lanelet
        tags = lanelet.tags
        regulated = next((limits[i] for i in lanelet.regulations if limits.get(i)), None)
        speed = (
            speed_of([tags.get("speed_limit", "")])
            or regulated
            or speed_of([tags.get("maxspeed", "")])
            or default_speed(tags)
        )
        left, right = (
            (way_id, turned == member.forward)
            for way_id, turned in zip(lanelet.ways, lanelet.turned, strict=True)
        )
        if not member.forward:
            left, right = right, left
        return Row(
            lanelet.kind,
            member.forward,
            speed if lanelet.drives else 0.0,
            lanelet.allowed,
            (left, right),
        )

    return row
