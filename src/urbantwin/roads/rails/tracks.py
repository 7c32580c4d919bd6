"""Directed tracks of a region: pieces between switches, closed in a loop beyond the region.

A tram that leaves the region returns over an outer track, which is not visible: there is no ground.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely
from lxml import etree
from numpy.typing import NDArray

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.number_text import finite_number
from urbantwin.roads.grade_separation import way_layer
from urbantwin.roads.network import BusStop, RoadNetwork, Track
from urbantwin.site.extract import Extract, Relation, Way
from urbantwin.site.extract_coverage import mapped_area

__all__ = ["Track", "add_rails", "with_trams"]

#: Minimum cosine of the turn from a track to the next; larger turns are crossings of rails. Length
#: over which directions are measured, metres.
TURN_COS, CHORD_M = np.cos(np.radians(40.0)), 6.0
#: An end this near to the region's or the map's border continues beyond it, metres.
BORDER_M, RIM_M = 1.0, 40.0
#: Outer tracks: length of the straight part, distance round the region, metres, and angular step,
#: radians.
STRAIGHT_M, AROUND_M, ARC_STEP = 40.0, 60.0, 0.2
#: Up to this number of pairs each exit leads to each entry; else to the nearest.
MOST_PAIRS = 36
#: Half the length of a stop: trams stop with their centre at the mapped place, metres.
HALF_STOP_M = 15.0
#: Maximum distance of a stop that is not a node of a track, metres; two stops nearer than the
#: second along a track are one.
STOP_M, SAME_STOP_M = 4.0, 30.0
#: Default speed, m/s: 50 km/h, as other traffic in towns.
SPEED_MS = 50 / 3.6
#: Minimum length of a piece of track, metres.
SHORTEST_M = 0.5
RAILWAYS, ROUTES = ("tram", "light_rail"), ("tram", "light_rail")
#: Distance of two parallel tracks that are a pair, metres.
PAIR_M = (2.0, 7.0)
PARALLEL_COS = np.cos(np.radians(20.0))
_YES = {"yes": {1}, "forward": {1}, "1": {1}, "-1": {-1}, "reverse": {-1}, "backward": {-1}}
_TWO_WAY_VALUES = {"no": {1, -1}, "both": {1, -1}, "bidirectional": {1, -1}}
#: Width of a tram's lane, metres: its clearance.
RAIL_M = 2.6


@dataclass(frozen=True, eq=False)
class _Arc:
    """A piece of track in one direction: nodes at its ends, and its line."""

    start: int
    end: int
    line: NDArray[np.float64]
    way: int
    speed: float
    level: int
    leads_out: bool = False
    leads_in: bool = False

    @property
    def ahead(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Directions at its start and at its end."""
        return _direction(self.line), -_direction(self.line[::-1])


def with_trams(
    network: RoadNetwork,
    extract: Extract,
    frame: SiteFrame,
    region: shapely.Polygon,
    elevation: Elevation,
    *,
    closed_loop: bool,
) -> RoadNetwork:
    """Return a network with the tram tracks of a region and their stops.

    Tracks without continuation are left out, including those of termini inside the region: trams do
    not reverse here.

    Args:
        network: the lanes.
        extract: the map.
        frame: the site frame.
        region: region at whose border tracks end.
        elevation: the ground.
        closed_loop: whether outer tracks lead each exit back to an entry.
    """
    arcs = _arcs(extract, frame, region, network.driving_side)
    used, following = _connected_arcs(arcs)
    arcs = [arcs[k] for k in used]
    place = {old: new for new, old in enumerate(used)}
    names = [f"tram-{k + 1}" for k in range(len(arcs))]
    tracks = [
        Track(
            name,
            _at_ground(elevation, arc.line),
            round(arc.speed, 3),
            arc.level,
            tuple(names[place[n]] for n in following[k] if n in place),
            False,
        )
        for name, arc, k in zip(names, arcs, used, strict=True)
    ]
    if closed_loop and tracks:
        tracks = _closed(tracks, arcs, region, elevation)
    stops = _stops(tracks, extract, frame, region)
    return replace(network, tracks=tuple(tracks), tram_stops=tuple(stops))


def _arcs(
    extract: Extract, frame: SiteFrame, region: shapely.Polygon, driving_side: str
) -> list[_Arc]:
    """Return the pieces between shared nodes, in their directions of travel."""
    ways = tram_ways(extract, frame, region)
    if not ways:
        return []
    runs = ways_run(extract, frame, ways, driving_side)
    pieces = extract.clipped(frame, region, ways)
    uses = Counter(node for piece in pieces for node in dict.fromkeys(piece.nodes))
    rim = mapped_area(extract, frame).exterior
    arcs = []
    for piece in pieces:
        nodes, way_nodes = piece.nodes, extract.ways[piece.way].nodes
        cuts = [k for k, node in enumerate(nodes) if 0 < k < len(nodes) - 1 and uses[node] > 1]
        for a, b in zip([0, *cuts], [*cuts, len(nodes) - 1], strict=True):
            line = piece.points[a : b + 1]
            if shapely.LineString(line).length < SHORTEST_M and uses[nodes[a]] + uses[nodes[b]] < 3:
                continue
            open_ends = []
            for k in (a, b):
                end_point = shapely.Point(piece.points[k])
                is_cut = k in (0, len(nodes) - 1) and nodes[k] not in (way_nodes[0], way_nodes[-1])
                at_border = (
                    region.exterior.distance(end_point) < BORDER_M
                    or rim.distance(end_point) < RIM_M
                )
                open_ends.append(uses[nodes[k]] == 1 and (is_cut or at_border))
            limit_kmh = finite_number(piece.tags.get("maxspeed", ""))
            speed = min(max(limit_kmh / 3.6, 2.0), 25.0) if limit_kmh else SPEED_MS
            level = way_layer(piece.tags)
            if 1 in runs[piece.way]:
                ends = open_ends[1], open_ends[0]
                arcs.append(_Arc(nodes[a], nodes[b], line, piece.way, speed, level, *ends))
            if -1 in runs[piece.way]:
                ends = open_ends[0], open_ends[1]
                arcs.append(_Arc(nodes[b], nodes[a], line[::-1], piece.way, speed, level, *ends))
    return arcs


def _connected_arcs(arcs: Sequence[_Arc]) -> tuple[list[int], list[list[int]]]:
    """Return the arcs from an entry to an exit, or in a ring, and the successors of each arc."""
    arcs_from: defaultdict[int, list[int]] = defaultdict(list)
    for k, arc in enumerate(arcs):
        arcs_from[arc.start].append(k)
    following = [
        [
            n
            for n in arcs_from[arc.end]
            if float(arc.ahead[1] @ arcs[n].ahead[0]) > TURN_COS
            and not (arcs[n].end == arc.start and arcs[n].way == arc.way)
        ]
        for arc in arcs
    ]
    used = set(range(len(arcs)))
    while True:
        reached = {n for k in used for n in following[k] if n in used}
        remaining = {
            k
            for k in used
            if (arcs[k].leads_in or k in reached)
            and (arcs[k].leads_out or any(n in used for n in following[k]))
        }
        if remaining == used:
            return sorted(used), following
        used = remaining


def _closed(
    tracks: Sequence[Track],
    arcs: Sequence[_Arc],
    region: shapely.Polygon,
    elevation: Elevation,
) -> list[Track]:
    """Return tracks with outer ones from each exit to the entries."""
    middle = shapely.get_coordinates(region.centroid)[0]
    corners = shapely.get_coordinates(region.exterior)
    radius = float(np.linalg.norm(corners - middle, axis=1).max()) + AROUND_M
    outs = [k for k, arc in enumerate(arcs) if arc.leads_out]
    ins = [k for k, arc in enumerate(arcs) if arc.leads_in]
    pairs = [(a, b) for a in outs for b in ins]
    if len(pairs) > MOST_PAIRS:
        tails, heads = np.array([arcs[a].line[-1] for a in outs]), [arcs[b].line[0] for b in ins]
        gaps = np.linalg.norm(tails[:, None] - np.array(heads)[None], axis=2)
        nearest = {(outs[i], ins[int(gaps[i].argmin())]) for i in range(len(outs))}
        nearest |= {(outs[int(gaps[:, j].argmin())], ins[j]) for j in range(len(ins))}
        # The second nearest links lines that do not meet inside.
        nearest |= {(outs[i], ins[int(gaps[i].argsort()[1])]) for i in range(len(outs))}
        pairs = sorted(nearest)
    outer: list[Track] = []
    onward: defaultdict[int, list[str]] = defaultdict(list)
    for a, b in pairs:
        name = f"tram-outer-{len(outer) + 1}"
        line = _around(arcs[a], arcs[b], middle, radius)
        outer.append(Track(name, _at_ground(elevation, line), SPEED_MS, 0, (tracks[b].id,), True))
        onward[a].append(name)
    inner = [
        replace(track, successors=(*track.successors, *onward[k])) for k, track in enumerate(tracks)
    ]
    return [*inner, *outer]


def _around(
    out: _Arc, back: _Arc, middle: NDArray[np.float64], radius: float
) -> NDArray[np.float64]:
    """Return the line of an outer track: straight on, around the region, and in again."""
    first = out.line[-1] + STRAIGHT_M * out.ahead[1]
    last = back.line[0] - STRAIGHT_M * back.ahead[0]
    angles = [float(np.arctan2(*(p - middle)[::-1])) for p in (first, last)]
    turn = float((angles[1] - angles[0] + np.pi) % (2 * np.pi) - np.pi)
    steps = max(2, int(np.ceil(abs(turn) / ARC_STEP)) + 1)
    arc = angles[0] + np.linspace(0.0, turn, steps)
    ring = middle + radius * np.column_stack([np.cos(arc), np.sin(arc)])
    return np.vstack([out.line[-1], first, ring, last, back.line[0]])


def _stops(
    tracks: Sequence[Track], extract: Extract, frame: SiteFrame, region: shapely.Polygon
) -> list[BusStop]:
    """Return tram stops, centred at the mapped place, on each track there."""
    inner = [track for track in tracks if not track.outer]
    lines = [shapely.LineString(track.line[:, :2]) for track in inner]
    by_id = {track.id: k for k, track in enumerate(inner)}
    stop_places: dict[int, list[tuple[float, str]]] = defaultdict(list)
    for node, tags in sorted(extract.node_tags.items()):
        is_stop = tags.get("railway") == "tram_stop" or (
            tags.get("public_transport") == "stop_position"
            and "yes" in (tags.get("tram"), tags.get("light_rail"))
        )
        if not is_stop or node not in extract.nodes:
            continue
        anchor = shapely.Point(frame.site_from_lonlat([extract.nodes[node]])[0])
        if not region.contains(anchor):
            continue
        near_tracks = [k for k, line in enumerate(lines) if line.distance(anchor) < STOP_M]
        nearest = min((lines[k].distance(anchor) for k in near_tracks), default=0.0)
        for k in near_tracks:
            # Beside a pair of tracks, the stop belongs to the nearer one.
            if lines[k].distance(anchor) > nearest + 0.5:
                continue
            front, along = k, lines[k].project(anchor) + HALF_STOP_M
            while along > lines[front].length - 0.5:
                onward = [by_id[n] for n in inner[front].successors if n in by_id]
                if not onward:
                    along = lines[front].length - 0.5
                    break
                along, front = along - lines[front].length, onward[0]
            stop_places[front].append((along, tags.get("name", "")))
    stops = []
    for k, places in sorted(stop_places.items()):
        last = -np.inf
        for along, name in sorted(places):
            if along - last > SAME_STOP_M:
                start = max(along - 2 * HALF_STOP_M, 0.0)
                stops.append(BusStop(f"{inner[k].id}_0", name, round(start, 2), round(along, 2)))
            last = along
    return stops


def _at_ground(elevation: Elevation, line: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.round(np.column_stack([line, elevation.raw_at(line)]), 4), np.float64)


def _direction(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit vector (2,) in which a line begins."""
    polyline = shapely.LineString(line)
    ahead = (
        shapely.get_coordinates(polyline.interpolate(min(CHORD_M, polyline.length)))[0] - line[0]
    )
    return np.asarray(ahead / max(float(np.linalg.norm(ahead)), 1e-9))


def tram_ways(extract: Extract, frame: SiteFrame, region: shapely.Polygon) -> list[Way]:
    """Return the tracks in the open with tram lines; if no line is mapped, all except sidings."""
    tracks = [
        osm_way
        for _, osm_way in sorted(extract.ways.items())
        if osm_way.tags.get("railway") in RAILWAYS
        and osm_way.tags.get("tunnel", "no") == "no"
        and way_layer(osm_way.tags) >= 0
        and len(line := extract.way_line(osm_way, frame)) > 1
        and region.intersects(shapely.LineString(line))
    ]
    used = {
        way_id for route in _routes(extract) for kind, way_id, _ in route.members if kind == "w"
    }
    on_lines = [osm_way for osm_way in tracks if osm_way.id in used]
    return on_lines or [osm_way for osm_way in tracks if "service" not in osm_way.tags]


def ways_run(
    extract: Extract, frame: SiteFrame, ways: Sequence[Way], driving_side: str
) -> dict[int, frozenset[int]]:
    """Return for each way whether trams run along it (1), against it (-1), or both.

    The way's tags take precedence (``railway:preferred_direction``, ``oneway``), then the order of
    the ways in mapped lines, then the side of the other track of a pair. A single track is used in
    both directions.
    """
    lines = {osm_way.id: extract.way_line(osm_way, frame) for osm_way in ways}
    by_route = _directions_of_routes(extract, {osm_way.id: osm_way for osm_way in ways})
    directions = {}
    for osm_way in ways:
        direction_tag = osm_way.tags.get("railway:preferred_direction") or osm_way.tags.get(
            "oneway", ""
        )
        tagged = _YES.get(direction_tag) or _TWO_WAY_VALUES.get(direction_tag)
        beside = _direction_in_pair(osm_way.id, lines, driving_side)
        directions[osm_way.id] = frozenset(tagged or by_route.get(osm_way.id) or beside or {1, -1})
    return directions


def _routes(extract: Extract) -> list[Relation]:
    return [
        relation
        for _, relation in sorted(extract.relations.items())
        if relation.tags.get("type") == "route" and relation.tags.get("route") in ROUTES
    ]


def _directions_of_routes(extract: Extract, ways: Mapping[int, Way]) -> dict[int, set[int]]:
    """Return the directions of lines on ways, by the order of a line's members."""
    directions: defaultdict[int, set[int]] = defaultdict(set)
    for route in _routes(extract):
        rows = [member for kind, member, role in route.members if kind == "w" and role == ""]
        for first, second in pairwise(rows):
            a, b = extract.ways.get(first), extract.ways.get(second)
            if a is None or b is None or len(a.nodes) < 2 or len(b.nodes) < 2:
                continue
            for k, sign in ((-1, 1), (0, -1)):
                if a.nodes[k] in (b.nodes[0], b.nodes[-1]):
                    if first in ways:
                        directions[first].add(sign)
                    if second in ways:
                        directions[second].add(1 if a.nodes[k] == b.nodes[0] else -1)
                    break
    return directions


def _direction_in_pair(
    own: int, lines: Mapping[int, NDArray[np.float64]], driving_side: str
) -> set[int] | None:
    """Return the direction of a track from the side of the other one of the pair; else ``None``."""
    line = lines[own]
    middle = shapely.LineString(line).interpolate(0.5, normalized=True)
    ahead = _heading(line, middle)
    middle_xy = shapely.get_coordinates(middle)[0]
    for other, points in lines.items():
        polyline = shapely.LineString(points)
        if other == own or not PAIR_M[0] <= polyline.distance(middle) <= PAIR_M[1]:
            continue
        if abs(float(ahead @ _heading(points, middle))) < PARALLEL_COS:
            continue
        gap = shapely.get_coordinates(polyline.interpolate(polyline.project(middle)))[0] - middle_xy
        left = float(ahead[0] * gap[1] - ahead[1] * gap[0]) > 0
        # In right-hand traffic the opposite direction is on the left.
        return {1} if left == (driving_side == "right") else {-1}
    return None


def _heading(line: NDArray[np.float64], near: shapely.Point) -> NDArray[np.float64]:
    """Return the unit vector (2,) along a line where it is nearest to a point."""
    polyline = shapely.LineString(line)
    station_m = polyline.project(near)
    ends = shapely.line_interpolate_point(
        polyline, [max(station_m - 1.0, 0.0), min(station_m + 1.0, polyline.length)]
    )
    leg = np.diff(shapely.get_coordinates(ends), axis=0)[0]
    return np.asarray(leg / max(float(np.linalg.norm(leg)), 1e-9))


def add_rails(path: Path, tracks: Sequence[Track]) -> None:
    """Add tracks to a ``.net.xml``, rewritten in place.

    Args:
        path: the network.
        tracks: the tracks, with the ids of their successors.
    """
    if not tracks:
        return
    tree = etree.parse(path, etree.XMLParser(remove_blank_text=True))
    root = tree.getroot()
    nodes = _nodes(tracks)
    groups: dict[str, list[etree._Element]] = {"edge": [], "junction": [], "connection": []}
    for track in tracks:
        start, end = nodes[track.id]
        groups["edge"].append(_edge(track, start, end))
    by_id = {track.id: track for track in tracks}
    into: defaultdict[str, list[Track]] = defaultdict(list)
    for track in tracks:
        into[nodes[track.id][1]].append(track)
    for name in sorted({node for ends in nodes.values() for node in ends}):
        entering = sorted(into[name], key=lambda track: track.id)
        links = [(track, by_id[n]) for track in entering for n in track.successors]
        ends = [track.line[-1] for track in entering]
        ends += [track.line[0] for track in tracks if nodes[track.id][0] == name]
        groups["junction"].append(_junction(name, ends[0][:2].tolist(), entering, links))
        groups["connection"] += [
            etree.Element(
                "connection",
                {"from": a.id, "to": b.id, "fromLane": "0", "toLane": "0"},
                dir="s",
                state="M" if len({x.id for x, y in links if y is b}) < 2 else "=",
            )
            for a, b in links
        ]
    for tag, items in groups.items():
        last = root.findall(tag)[-1:]
        place = root.index(last[0]) + 1 if last else len(root)
        for k, item in enumerate(items):
            root.insert(place + k, item)
    etree.indent(root, space=" ")
    tree.write(path, encoding="UTF-8", xml_declaration=True)


def _nodes(tracks: Sequence[Track]) -> dict[str, tuple[str, str]]:
    """Return the names of the nodes of each track's start and end; linked tracks share them."""
    parent: dict[str, str] = {}

    def top(name: str) -> str:
        while parent.setdefault(name, name) != name:
            name = parent[name]
        return name

    for track in tracks:
        for following in track.successors:
            a, b = top(f"{track.id}>"), top(f"<{following}")
            parent[max(a, b)] = min(a, b)
    ends = [(track.id, top(f"<{track.id}"), top(f"{track.id}>")) for track in tracks]
    tops = sorted({name for end in ends for name in end[1:]})
    number = {name: f"rails-{k + 1}" for k, name in enumerate(tops)}
    return {name: (number[a], number[b]) for name, a, b in ends}


def _edge(track: Track, start: str, end: str) -> etree._Element:
    edge = etree.Element(
        "edge", {"id": track.id, "from": start, "to": end}, priority="-1", type="railway.tram"
    )
    etree.SubElement(
        edge,
        "lane",
        id=f"{track.id}_0",
        index="0",
        allow="tram",
        speed=f"{track.speed:.2f}",
        length=f"{max(shapely.LineString(track.line[:, :2]).length, 0.1):.3f}",
        width=f"{RAIL_M:.2f}",
        shape=" ".join(f"{x:.3f},{y:.3f}" for x, y, _ in track.line.tolist()),
    )
    return edge


def _junction(
    name: str, point: list[float], entering: list[Track], links: list[tuple[Track, Track]]
) -> etree._Element:
    x, y = point
    kind = "priority" if links else "dead_end"
    item = etree.Element(
        "junction",
        id=name,
        type=kind,
        x=f"{x:.3f}",
        y=f"{y:.3f}",
        incLanes=" ".join(f"{track.id}_0" for track in entering),
        intLanes="",
        shape=f"{x - 0.1:.3f},{y:.3f} {x:.3f},{y + 0.1:.3f} {x + 0.1:.3f},{y:.3f}",
    )
    for k, (a, b) in enumerate(links):
        foes = [b is d and a is not c for c, d in links]
        # Where two tracks merge, trams on the later of them wait.
        first = [foe and n < k for n, foe in enumerate(foes)]
        etree.SubElement(
            item, "request", index=str(k), response=_bits(first), foes=_bits(foes), cont="0"
        )
    return item


def _bits(flags: list[bool]) -> str:
    """Return flags in SUMO's order: the first is the last character."""
    return "".join("1" if flag else "0" for flag in reversed(flags))
