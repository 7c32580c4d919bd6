"""Directed tracks of a region: pieces between switches, closed in a loop beyond the region.

A tram that leaves the region comes back over an outer track. Nobody sees those: there is no ground.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.number_text import finite_number
from urbantwin.roads.grade_separation import way_layer
from urbantwin.roads.network import BusStop, RoadNetwork, Track
from urbantwin.roads.rails.directed_ways import tram_ways, ways_run
from urbantwin.site.extract import Extract
from urbantwin.site.extract_coverage import mapped_area

__all__ = ["Track", "with_trams"]

#: From a track to the next one a tram turns by less than this; what turns more is a crossing of
#: rails. Directions are measured over some metres.
TURN_COS, CHORD_M = np.cos(np.radians(40.0)), 6.0
#: An end this near to the region's border or the map's end leads on beyond it, metres.
BORDER_M, RIM_M = 1.0, 40.0
#: Outer tracks first lead straight on, then around the region, metres.
STRAIGHT_M, AROUND_M, ARC_STEP = 40.0, 60.0, 0.2
#: Every way out leads to every way in while there are no more of them; else to the nearest.
MOST_PAIRS = 36
#: Half the length of a stop: trams halt with their middle where it is mapped, metres.
HALF_STOP_M = 15.0
#: A stop that is not a node of a track is so near to it, metres; two stops nearer than this along
#: a track are one.
STOP_M, SAME_STOP_M = 4.0, 30.0
#: Speed where none is mapped, m/s: 50 km/h, as other traffic in towns.
SPEED_MS = 50 / 3.6
#: The shortest piece of track, metres.
SHORTEST_M = 0.5


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
    """Return a network with the tracks that trams run on in a region, and their stops.

    Tracks that lead nowhere are left out: those of termini inside the region are, for trams do not
    turn back here.

    Args:
        network: the lanes.
        extract: the map.
        frame: the site frame.
        region: tracks end at its border.
        elevation: the ground.
        closed_loop: whether outer tracks lead every way out back to a way in.
    """
    arcs = _arcs(extract, frame, region, network.driving_side)
    used, following = _that_lead_on(arcs)
    arcs = [arcs[k] for k in used]
    place = {old: new for new, old in enumerate(used)}
    names = [f"tram-{k + 1}" for k in range(len(arcs))]
    tracks = [
        Track(
            name,
            _on(elevation, arc.line),
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
    """Return the pieces between nodes that several ways share, in the directions that are run."""
    ways = tram_ways(extract, frame, region)
    if not ways:
        return []
    runs = ways_run(extract, frame, ways, driving_side)
    pieces = extract.clipped(frame, region, ways)
    uses = Counter(node for piece in pieces for node in dict.fromkeys(piece.nodes))
    rim = mapped_area(extract, frame).exterior
    found = []
    for piece in pieces:
        nodes, whole = piece.nodes, extract.ways[piece.way].nodes
        cuts = [k for k, node in enumerate(nodes) if 0 < k < len(nodes) - 1 and uses[node] > 1]
        for a, b in zip([0, *cuts], [*cuts, len(nodes) - 1], strict=True):
            line = piece.points[a : b + 1]
            if shapely.LineString(line).length < SHORTEST_M and uses[nodes[a]] + uses[nodes[b]] < 3:
                continue
            open_ends = []
            for k in (a, b):
                at = shapely.Point(piece.points[k])
                lost = k in (0, len(nodes) - 1) and nodes[k] not in (whole[0], whole[-1])
                near = region.exterior.distance(at) < BORDER_M or rim.distance(at) < RIM_M
                open_ends.append(uses[nodes[k]] == 1 and (lost or near))
            said = finite_number(piece.tags.get("maxspeed", ""))
            speed = min(max(said / 3.6, 2.0), 25.0) if said else SPEED_MS
            level = way_layer(piece.tags)
            if 1 in runs[piece.way]:
                ends = open_ends[1], open_ends[0]
                found.append(_Arc(nodes[a], nodes[b], line, piece.way, speed, level, *ends))
            if -1 in runs[piece.way]:
                ends = open_ends[0], open_ends[1]
                found.append(_Arc(nodes[b], nodes[a], line[::-1], piece.way, speed, level, *ends))
    return found


def _that_lead_on(arcs: Sequence[_Arc]) -> tuple[list[int], list[list[int]]]:
    """Return the arcs from a way in to a way out, or in a ring, and what follows each arc."""
    at: defaultdict[int, list[int]] = defaultdict(list)
    for k, arc in enumerate(arcs):
        at[arc.start].append(k)
    following = [
        [
            n
            for n in at[arc.end]
            if float(arc.ahead[1] @ arcs[n].ahead[0]) > TURN_COS
            and not (arcs[n].end == arc.start and arcs[n].way == arc.way)
        ]
        for arc in arcs
    ]
    used = set(range(len(arcs)))
    while True:
        reached = {n for k in used for n in following[k] if n in used}
        kept = {
            k
            for k in used
            if (arcs[k].leads_in or k in reached)
            and (arcs[k].leads_out or any(n in used for n in following[k]))
        }
        if kept == used:
            return sorted(used), following
        used = kept


def _closed(
    tracks: Sequence[Track],
    arcs: Sequence[_Arc],
    region: shapely.Polygon,
    elevation: Elevation,
) -> list[Track]:
    """Return tracks with outer ones from every way out to the ways in."""
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
        # The second nearest joins lines that do not meet inside.
        nearest |= {(outs[i], ins[int(gaps[i].argsort()[1])]) for i in range(len(outs))}
        pairs = sorted(nearest)
    outer: list[Track] = []
    onward: defaultdict[int, list[str]] = defaultdict(list)
    for a, b in pairs:
        name = f"tram-outer-{len(outer) + 1}"
        line = _around(arcs[a], arcs[b], middle, radius)
        outer.append(Track(name, _on(elevation, line), SPEED_MS, 0, (tracks[b].id,), True))
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
    """Return where trams halt: with their middle at the mapped place, on every track there."""
    inner = [track for track in tracks if not track.outer]
    lines = [shapely.LineString(track.line[:, :2]) for track in inner]
    by_id = {track.id: k for k, track in enumerate(inner)}
    found: dict[int, list[tuple[float, str]]] = defaultdict(list)
    for node, tags in sorted(extract.node_tags.items()):
        is_stop = tags.get("railway") == "tram_stop" or (
            tags.get("public_transport") == "stop_position"
            and "yes" in (tags.get("tram"), tags.get("light_rail"))
        )
        if not is_stop or node not in extract.nodes:
            continue
        at = shapely.Point(frame.site_from_lonlat([extract.nodes[node]])[0])
        if not region.contains(at):
            continue
        near = [k for k, line in enumerate(lines) if line.distance(at) < STOP_M]
        nearest = min((lines[k].distance(at) for k in near), default=0.0)
        for k in near:
            # Beside a pair of tracks, the stop is of the nearer one.
            if lines[k].distance(at) > nearest + 0.5:
                continue
            front, along = k, lines[k].project(at) + HALF_STOP_M
            while along > lines[front].length - 0.5:
                onward = [by_id[n] for n in inner[front].successors if n in by_id]
                if not onward:
                    along = lines[front].length - 0.5
                    break
                along, front = along - lines[front].length, onward[0]
            found[front].append((along, tags.get("name", "")))
    stops = []
    for k, places in sorted(found.items()):
        last = -np.inf
        for along, name in sorted(places):
            if along - last > SAME_STOP_M:
                start = max(along - 2 * HALF_STOP_M, 0.0)
                stops.append(BusStop(f"{inner[k].id}_0", name, round(start, 2), round(along, 2)))
            last = along
    return stops


def _on(elevation: Elevation, line: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.round(np.column_stack([line, elevation.raw_at(line)]), 4), np.float64)


def _direction(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the direction (2,) in which a line begins."""
    whole = shapely.LineString(line)
    ahead = shapely.get_coordinates(whole.interpolate(min(CHORD_M, whole.length)))[0] - line[0]
    return np.asarray(ahead / max(float(np.linalg.norm(ahead)), 1e-9))
