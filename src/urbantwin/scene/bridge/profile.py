"""Profiles of bridges: clearance over the ways they cross, and ramps up to them."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
import shapely.ops
from numpy.typing import NDArray
from shapely import Geometry, LineString, Polygon

from urbantwin.number_text import whole_number
from urbantwin.roads.grade_separation import HIGHEST_LAYER
from urbantwin.scene.bridge.decks import Deck, Decks
from urbantwin.scene.placement import on_ground
from urbantwin.scene.solids import GroundHeight
from urbantwin.scene.tag_values import length_m_of
from urbantwin.site.extract import OsmFeature

__all__ = ["WIDTHS_M", "bridge_decks"]

#: Clear height under bridges (RAS-Q, AASHTO: 4.5 to 4.9 m over streets; EN 15273 gauge and
#: contact wire: 6.0 m over railways; 2.5 m over paths), metres.
OVER_STREET_M, OVER_RAILWAY_M, OVER_PATH_M = 4.7, 6.0, 2.6
#: Thickness of slabs: of foot bridges, of bridges of roads and railways, metres.
THICKNESS_M = {"foot": 0.4, "road": 0.8, "rail": 1.0}
#: Steepest ramps; steps rise 1 in 2.
RAMP, STEPS, RAIL_RAMP = 0.12, 0.5, 0.03
MOST_RAMPS = 24
#: A deck that descends to a road has its full height up to this distance from the crossing, metres.
CLEAR_OF_CROSSING_M = 5.0
#: Bridges lower than this above the ground need no ramp, metres.
LOW_M = 0.05
STEP_M = 2.0
WIDTHS_M = {
    "footway": 2.5, "path": 2.0, "cycleway": 3.0, "pedestrian": 4.0, "steps": 2.0, "service": 4.5,
    "track": 3.5, "bridleway": 2.5, "corridor": 2.5,
}  # fmt: skip
TRACK_M = 4.2
RAILWAYS = ("rail", "tram", "light_rail", "narrow_gauge", "subway", "monorail")
ROADS = ("service", "track")


@dataclass(frozen=True)
class _Way:
    id: int
    kind: str
    line: LineString
    width: float
    layer: int
    is_steps: bool


def bridge_decks(
    features: Sequence[OsmFeature],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    lane_decks: Geometry,
) -> tuple[Decks, dict[str, int]]:
    """Find the bridges of footways, cycleways, service roads, tracks and railways.

    A deck is a straight line between the ground heights at its ends. If its clearance over a
    crossed way is too small, the whole bridge is raised, and the ways that lead to it become ramps.

    Args:
        features: the map's features, site frame.
        region: bridges outside it are left out.
        ground_height: heights of the ground.
        lane_decks: decks of the lane model in plan, which have their own footways.
    """
    notes: Counter[str] = Counter()
    ways, beneath, walks = _sorted_ways(features, region, lane_decks, notes)
    decks: list[Deck] = []
    for group in _groups(ways):
        chords = [_chord(way, ground_height) for way in group]
        found = [
            _lack(way, chord, beneath, ground_height)
            for way, chord in zip(group, chords, strict=True)
        ]
        lift = max(lack for lack, _ in found)
        uses = Counter(_key(end) for way in group for end in _ends(way))
        ramped: dict[tuple[float, float], bool] = {}
        if lift > LOW_M:
            for end in sorted(end for end, count in uses.items() if count == 1):
                if not region.covers(shapely.Point(end)):
                    continue  # The feature at its end is unknown.
                ramps = _ramps(end, lift, group[0].kind, walks, ground_height)
                ramped[end] = bool(ramps)
                decks += ramps
                notes["ramps to bridges"] += len(ramps)
                notes["bridges that slope down to a road"] += not ramps
        for way, (stations, heights), (_, over) in zip(group, chords, found, strict=True):
            share = np.ones(len(stations))
            for tip, along in zip(_ends(way), (stations, stations[-1] - stations), strict=True):
                if not ramped.get(_key(tip), True):
                    # No way leads to this end: the deck itself descends to it.
                    places = over if tip == _ends(way)[0] else stations[-1] - over
                    reach = max(float(places.min(initial=stations[-1])) - CLEAR_OF_CROSSING_M, 1.0)
                    share = np.minimum(share, np.clip(along / reach, 0, 1))
            decks.append(_deck(way, stations, heights + lift * share, is_ramp=False))
        notes["bridges"] += 1
    inside = [deck for deck in decks if region.intersects(deck.plan)]
    return Decks(tuple(inside)), dict(sorted((k, n) for k, n in notes.items() if n))


def _key(point: Sequence[float]) -> tuple[float, float]:
    return (round(point[0], 2), round(point[1], 2))


def _sorted_ways(
    features: Sequence[OsmFeature], region: Polygon, lane_decks: Geometry, notes: Counter[str]
) -> tuple[list[_Way], list[tuple[OsmFeature, int]], dict[tuple[float, float], list[_Way]]]:
    """Return bridges, crossed features with their layers, and other ways by their ends."""
    bridges, beneath = [], []
    walks: dict[tuple[float, float], list[_Way]] = defaultdict(list)
    for feature in features:
        tags, line = feature.tags, feature.geometry
        if not isinstance(line, LineString) or not ("highway" in tags or "railway" in tags):
            continue
        if tags.get("railway") in ("abandoned", "razed", "disused", "proposed", "construction"):
            continue
        if tags.get("tunnel", "no") != "no" or tags.get("indoor", "no") != "no":
            continue
        way = _way(feature)
        is_bridge = tags.get("bridge", "no") not in ("no", "aqueduct")
        if not is_bridge:
            if way is None or way.layer <= 0:
                beneath.append((feature, 0 if way is None else way.layer))
            if way is not None and way.layer >= 0:
                for node in {_key(node) for node in line.coords}:
                    walks[node].append(way)
            continue
        if way is None or not region.intersects(line):
            continue
        shared = shapely.intersection(line, lane_decks).length if not lane_decks.is_empty else 0.0
        if shared > 0.5 * line.length:
            notes["bridges that roads' decks carry"] += 1
            continue
        bridges.append(way)
    return bridges, beneath, walks


def _way(feature: OsmFeature) -> _Way | None:
    tags = feature.tags
    said = whole_number(tags.get("layer", "").split(";")[0])
    known = said is not None and abs(said) <= HIGHEST_LAYER
    layer = said if known and said is not None else int(tags.get("bridge", "no") != "no")
    assert isinstance(feature.geometry, LineString)
    line = LineString(shapely.get_coordinates(feature.geometry))
    if line.length < 0.5:
        return None
    if tags.get("railway") in RAILWAYS:
        return _Way(feature.id, "rail", line, TRACK_M, layer, False)
    usual = WIDTHS_M.get(tags.get("highway", ""))
    if usual is None:
        return None
    width = min(max(length_m_of(tags.get("width")) or usual, 1.2), 15.0)
    kind = "road" if tags["highway"] in ROADS else "foot"
    return _Way(feature.id, kind, line, width, layer, tags["highway"] == "steps")


def _ends(way: _Way) -> list[tuple[float, ...]]:
    return [way.line.coords[0], way.line.coords[-1]]


def _groups(ways: Sequence[_Way]) -> list[list[_Way]]:
    """Return bridges that follow each other end to end, together."""
    groups: list[list[_Way]] = []
    where: dict[tuple[float, float], int] = {}
    for way in ways:
        ends = [_key(end) for end in _ends(way)]
        known = sorted({where[end] for end in ends if end in where})
        number = known[0] if known else len(groups)
        if not known:
            groups.append([])
        groups[number].append(way)
        for other in known[1:]:
            groups[number] += groups[other]
            groups[other] = []
            where = {end: number if k == other else k for end, k in where.items()}
        where.update(dict.fromkeys(ends, number))
    return [group for group in groups if group]


def _chord(
    way: _Way, ground_height: GroundHeight
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return stations and heights of a straight line between the ground at a bridge's ends."""
    count = max(int(np.ceil(way.line.length / STEP_M)), 1)
    stations = np.linspace(0, way.line.length, count + 1)
    ends = shapely.get_coordinates(way.line)[[0, -1]]
    low, high = on_ground(ends, ground_height(ends))[:, 2]
    return stations, low + (high - low) * stations / way.line.length


def _lack(
    way: _Way,
    chord: tuple[NDArray[np.float64], NDArray[np.float64]],
    beneath: Sequence[tuple[OsmFeature, int]],
    ground_height: GroundHeight,
) -> tuple[float, NDArray[np.float64]]:
    """Return the missing clearance of a bridge, and the stations of the crossings."""
    worst, where = 0.0, [np.zeros(0)]
    inner = shapely.buffer(way.line, 0.01)
    for other, layer in beneath:
        if layer >= way.layer or not other.geometry.intersects(inner):
            continue
        spots = shapely.get_coordinates(shapely.intersection(other.geometry, way.line))
        along = shapely.line_locate_point(way.line, shapely.points(spots))
        # Ways that touch it at its ends lead onto it.
        spots = spots[(along > 0.5) & (along < way.line.length - 0.5)]
        if not len(spots):
            continue
        room = OVER_PATH_M if _way(other) is not None else OVER_STREET_M
        if other.tags.get("highway") in ROADS:
            room = OVER_STREET_M - 0.5
        if other.tags.get("railway") in RAILWAYS:
            room = OVER_RAILWAY_M
        ground = on_ground(spots, ground_height(spots))[:, 2]
        along = shapely.line_locate_point(way.line, shapely.points(spots))
        deck = np.interp(along, *chord)
        worst = max(worst, float((ground + room + THICKNESS_M[way.kind] - deck).max()))
        where.append(along)
    return worst, np.concatenate(where)


def _deck(
    way: _Way, stations: NDArray[np.float64], heights: NDArray[np.float64], *, is_ramp: bool
) -> Deck:
    plan = way.line.buffer(way.width / 2, cap_style="flat", join_style="mitre", mitre_limit=2)
    return Deck(
        way.id, way.kind, way.line, way.width, stations, heights, THICKNESS_M[way.kind], is_ramp,
        plan,
    )  # fmt: skip


def _ramps(
    end: tuple[float, float],
    lift: float,
    kind: str,
    walks: dict[tuple[float, float], list[_Way]],
    ground_height: GroundHeight,
) -> list[Deck]:
    """Return ramps from a bridge's end along the connected ways, down to the ground."""
    found: list[Deck] = []
    seen: set[int] = set()
    waiting = [(end, lift)]
    while waiting and len(seen) < MOST_RAMPS:
        at, left = waiting.pop(0)
        for way in walks.get(at, []):
            if way.id in seen or (way.kind == "rail") != (kind == "rail"):
                continue
            seen.add(way.id)
            grade = STEPS if way.is_steps else RAIL_RAMP if kind == "rail" else RAMP
            for line in _onward(way.line, at):
                part = shapely.ops.substring(line, 0, min(left / grade, line.length))
                if part.length < 0.3:
                    continue
                count = max(int(np.ceil(part.length / STEP_M)), 1)
                stations = np.linspace(0, part.length, count + 1)
                xy = shapely.get_coordinates(shapely.line_interpolate_point(part, stations))
                ground = on_ground(xy, ground_height(xy))[:, 2]
                heights = ground + np.maximum(left - grade * stations, 0.0)
                ramp = _Way(way.id, way.kind, part, way.width, way.layer, way.is_steps)
                found.append(_deck(ramp, stations, heights, is_ramp=True))
                rest = left - grade * part.length
                if rest > LOW_M:
                    waiting.append((_key(line.coords[-1]), rest))
    return found


def _onward(line: LineString, at: tuple[float, float]) -> list[LineString]:
    """Return the parts of a line from one of its nodes to each of its ends."""
    keys = [_key(node) for node in line.coords]
    number = keys.index(at)
    both = [list(line.coords)[number:], list(line.coords)[number::-1]]
    return [LineString(nodes) for nodes in both if len(nodes) > 1]
