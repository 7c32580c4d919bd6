"""Addition of side lanes to the lane model."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from urbantwin.roads.cross_section import (
    CarriagewayLane,
    CrossSection,
    MappedSegment,
    Roadside,
)
from urbantwin.roads.model import CURB_HEIGHT_M, RAISED_KINDS, LaneModel, ModelRoad, Profile, fitted
from urbantwin.roads.model.curve import all_at, aside
from urbantwin.roads.side_lanes.clearance import STEP_M, Clearance
from urbantwin.roads.side_lanes.island import BEYOND_M, islands_on, moved_aside, stations_on
from urbantwin.roads.side_lanes.lane_insertion import Insertion, Renumbering, relinked, with_lanes

__all__ = ["MatchedWay", "add_side_lanes"]

#: Range of gaps between carriageways that are medians, metres: smaller ones are lines, larger ones
#: land.
NARROWEST_M, WIDEST_M = 0.6, 8.0
#: Minimum length of a median, and length of its noses, metres.
SHORTEST_M, NOSE_M = 6.0, 2.0
#: Minimum cosine of the angle between parallel or opposite carriageways.
PARALLEL = 0.8
#: Tolerance of a median's width profile, metres.
TOLERANCE_M = 0.05
#: Maximum distance between a road and its OSM way, metres.
OFF_M = 15.0
#: Shorter parts are left out, metres.
SHORTEST_MATCH_M = 0.5
#: Distance without parking from a junction or the crossing before it, metres. Germany: StVO section
#: 12 (3), 5 m. United States: Uniform Vehicle Code 11-1003, 20 ft from a crosswalk at an
#: intersection. Australia: Australian Road Rules 170, 10 m. United Kingdom: Highway Code 243, 10 m.
#: Taiwan: Road Traffic Safety Rules 111, 10 m. Japan: Road Traffic Act 44, 5 m. Elsewhere: Vienna
#: Convention on Road Traffic, article 23, 5 m.
CLEAR_M = {"US": 6.1, "CA": 6.1, "AU": 10.0, "NZ": 6.0, "GB": 10.0, "IE": 5.0, "TW": 10.0}
#: Minimum length of a side lane without its tapers: one parallel space, metres.
SHORTEST_LANE_M = 5.5
#: Tapers: parking lanes taper over their own depth, shoulders over ten times their width, within
#: bounds in metres.
SHORTEST_TAPER_M, LONGEST_TAPER_M, SHOULDER_SLANT = 1.5, 12.0, 10.0
#: Widths with a smaller difference are equal, metres.
SAME_M = 0.05
#: Start and end station, width, whether a cycle track lies beyond, and orientation of parking.
Run = tuple[float, float, float, bool, str]
#: Length without side lanes at either end where a road continues in the next, metres.
NEXT_M = 0.5


@dataclass(frozen=True)
class MatchedWay:
    """A part of a road, from station ``first`` to ``last``, of one OSM way.

    ``aligned``: whether the way is drawn along the road's reference line.
    """

    first: float
    last: float
    section: CrossSection
    aligned: bool

    def roadside(self, side: int) -> Roadside:
        """Return the roadside to the left (1) or right (-1) of the road."""
        return self.section.left if (side > 0) == self.aligned else self.section.right

    def lanes(self, side: int) -> tuple[CarriagewayLane, ...]:
        """Return the lanes on the left (1) or right (-1) of the middle of the road."""
        forward = self.section.outward == (side if self.aligned else -side)
        return self.section.lanes(forward=forward)


def add_side_lanes(
    model: LaneModel,
    segments: Iterable[MappedSegment],
    *,
    country: str = "",
    obstacles: Sequence[shapely.Polygon] = (),
    crossings: ArrayLike = (),
    islands: ArrayLike = (),
) -> LaneModel:
    """Return the model with parking lanes, shoulders, medians and islands on its streets.

    They lie between the carriageway and the sidewalk, which moves outwards, and between the
    carriageways of dual streets. Junctions are unchanged: side lanes taper to zero before them.
    Lane ids are renumbered from the reference line outwards; strips stay.

    Args:
        model: roads in plan, before heights and objects.
        segments: OSM ways of the streets, with their cross sections.
        country: ISO 3166-1 alpha-2, for the law on parking; empty if unknown.
        obstacles: areas that no road may grow into, such as buildings, site frame.
        crossings: (N, 2) pedestrian crossings, without parking, site frame.
        islands: (N, 2) crossings with a refuge, site frame.
    """
    segments_of_way = by_way(segments)
    meeting: dict[int, set[int]] = defaultdict(set)
    streets = [road for road in model.roads if road.junction < 0]
    for road in streets:
        for link in (road.predecessor, road.successor):
            if link is not None and link.element == "junction":
                meeting[link.id].add(road.id)
    room = Clearance(model, obstacles)
    between = medians(model, room.footprints)
    changed: dict[int, Renumbering] = {}
    roads: dict[int, ModelRoad] = {}
    for road in streets:
        meets = {}
        for end, link in (("start", road.predecessor), ("end", road.successor)):
            if link is None:
                meets[end] = "nothing"
            elif link.element == "junction" and len(meeting[link.id]) > 2:
                meets[end] = "junction"
            else:
                meets[end] = "street"
        refuges = islands_on(road, stations_on(road, islands, beyond=BEYOND_M), room)
        parts = match_ways(road, segments_of_way)
        clear = stations_on(road, crossings)
        items = parking_and_shoulders(road, parts, meets, clear, room=room, country=country)
        sides_taken = {item.side for item in items}
        items += [item for item in between.get(road.id, []) if item.side not in sides_taken]
        items += refuges
        if items:
            wider, changed[road.id] = with_lanes(road, items)
            roads[road.id] = moved_aside(wider, refuges) if refuges else wider
    if not roads:
        return model
    widened = replace(model, roads=tuple(roads.get(road.id, road) for road in model.roads))
    return relinked(widened, changed)


def medians(
    model: LaneModel, footprints: Mapping[int, shapely.Geometry]
) -> dict[int, list[Insertion]]:
    """Return the median lanes of one-way streets, by road.

    A median lies on the inner side. It fills half of the gap to an opposite carriageway, and all of
    the gap to a parallel one, and narrows to a nose before the junction.

    Args:
        model: the lane model.
        footprints: area of each street in plan, by id.
    """
    streets = [road for road in model.roads if road.junction < 0 and _is_driven(road)]
    shapes = [footprints[road.id] for road in streets]
    # Outer roads have no OSM ways: there is no median between them.
    roads = [road for road in streets if any(road.ways) and _inner_side(road)]
    stations = [
        np.linspace(0.0, road.length, max(3, int(road.length / STEP_M) + 2)) for road in roads
    ]
    lanes_of: dict[int, list[Insertion]] = {}
    widths = _widths(roads, stations, streets, shapes)
    for road, s, width in zip(roads, stations, widths, strict=True):
        side = _inner_side(road)
        items = [
            item for a, b in _spans(width) if (item := _median(road, side, s[a:b], width[a:b]))
        ]
        if items:
            lanes_of[road.id] = items
    return lanes_of


def _is_driven(road: ModelRoad) -> bool:
    """Return whether a road is more than a footway."""
    return any(lane.kind not in RAISED_KINDS for part in road.sections for lane in part.lanes)


def _inner_side(road: ModelRoad) -> int:
    """Return the side without lanes of a one-way road: 1 or -1; 0 if it has both."""
    if any(lane.opposite for section in road.sections for lane in section.lanes):
        return 0
    ids = {lane.id > 0 for section in road.sections for lane in section.lanes}
    return 0 if len(ids) != 1 else (-1 if ids.pop() else 1)


def _widths(
    roads: Sequence[ModelRoad],
    stations: Sequence[NDArray[np.float64]],
    streets: Sequence[ModelRoad],
    shapes: Sequence[shapely.Geometry],
) -> list[NDArray[np.float64]]:
    """Return the width (N,) of each road's median at its stations (N,), metres; nan without one."""
    if not roads:
        return []
    counts = [len(s) for s in stations]
    side, number, level = np.repeat(
        [(_inner_side(road), road.id, road.level) for road in roads], counts, axis=0
    ).T
    pose = all_at([road.curve for road in roads], stations)
    edge = np.concatenate([road.offset.at(s) for road, s in zip(roads, stations, strict=True)])
    starts, ends = aside(pose, edge + side * 0.02), aside(pose, edge + side * (WIDEST_M + 0.5))
    probes = shapely.linestrings(np.stack([starts, ends], axis=1))
    probe, street_index = shapely.STRtree(shapes).query(probes, predicate="intersects")
    street_keys = np.array([(road.id, road.level) for road in streets])[street_index]
    fits = (street_keys[:, 0] != number[probe]) & (street_keys[:, 1] == level[probe])
    probe, street_index = probe[fits], street_index[fits]
    crossed = shapely.intersection(np.asarray(shapes, object)[street_index], probes[probe])
    reach = shapely.distance(shapely.points(starts[probe]), crossed) + 0.02
    width = np.full(len(pose), math.nan)
    order = np.lexsort((reach, probe))
    # The nearest street at each station.
    nearest = order[np.unique(probe[order], return_index=True)[1]]
    for j in np.unique(street_index[nearest]):
        other, rows = streets[j], nearest[street_index[nearest] == j]
        k, gap = probe[rows], reach[rows]
        heading = other.curve.at(other.curve.locate(starts[k])[0])[:, 2]
        along = np.cos(heading - pose[k, 2])
        # A carriageway in the opposite direction has half of the median; a parallel one has none.
        share = np.where((along < -PARALLEL) & bool(_inner_side(other)), 0.5, 1.0)
        ok = (np.abs(along) > PARALLEL) & (gap > NARROWEST_M) & (gap < WIDEST_M)
        width[k[ok]] = (gap * share)[ok]
    return np.split(width, np.cumsum(counts)[:-1])


def _spans(width: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return index ranges of the stretches with a median."""
    is_finite = np.concatenate([[False], np.isfinite(width), [False]])
    change = np.flatnonzero(is_finite[1:] != is_finite[:-1])
    return [(int(a), int(b)) for a, b in change.reshape(-1, 2)]


def _median(
    road: ModelRoad, side: int, s: NDArray[np.float64], width: NDArray[np.float64]
) -> Insertion | None:
    if len(s) < 3 or s[-1] - s[0] < SHORTEST_M:
        return None
    fine = np.linspace(0.0, float(s[-1] - s[0]), max(8, int((s[-1] - s[0]) / 0.5) + 1))
    full_m = np.interp(fine, s - s[0], width)
    nose = np.clip(np.minimum(fine, fine[-1] - fine) / NOSE_M, 0.0, 1.0)
    shape = full_m * nose**2 * (3 - 2 * nose)
    profile = fitted(fine, shape, tolerance=TOLERANCE_M, slopes=(0.0, 0.0))
    return Insertion(side, "reference", "median", float(s[0]), float(s[-1]), profile, CURB_HEIGHT_M)


def by_way(segments: Iterable[MappedSegment]) -> dict[int, list[MappedSegment]]:
    """Return segments by id of their way."""
    grouped: dict[int, list[MappedSegment]] = {}
    for segment in segments:
        grouped.setdefault(segment.way, []).append(segment)
    return grouped


def match_ways(
    road: ModelRoad, segments: Mapping[int, Sequence[MappedSegment]]
) -> list[MatchedWay]:
    """Return the parts of a road by ways, from its start to its end, without gaps."""
    matched = [segment for way_id in road.ways for segment in segments.get(way_id, ())]
    if not matched:
        return []
    every, lateral_m = road.curve.locate(np.concatenate([segment.points for segment in matched]))
    matches = []
    end = 0
    for segment in matched:
        begin, end = end, end + len(segment.points)
        if np.abs(lateral_m[begin:end]).max() >= OFF_M:
            continue
        start, goal = float(every[begin]), float(every[end - 1])
        first = min(max(min(start, goal), 0.0), road.length)
        last = min(max(start, goal, 0.0), road.length)
        if last - first >= min(SHORTEST_MATCH_M, road.length / 2):
            matches.append(MatchedWay(first, last, segment.section, goal > start))
    matches.sort(key=lambda part: (part.first, part.last))
    gapless: list[MatchedWay] = []
    for k, part in enumerate(matches):
        first = gapless[-1].last if gapless else 0.0
        last = road.length if k == len(matches) - 1 else part.last
        if last > first:
            gapless.append(MatchedWay(first, last, part.section, part.aligned))
    return gapless


def parking_and_shoulders(
    road: ModelRoad,
    parts: Sequence[MatchedWay],
    meets: Mapping[str, str],
    crossings: Sequence[float] | NDArray[np.float64],
    *,
    room: Clearance,
    country: str,
) -> list[Insertion]:
    """Return the parking and shoulder lanes of a road.

    Parking ends before junctions as required by law and tapers to zero, so that the junction's
    lanes and corners are unchanged. Without room beside the road there is none.

    Args:
        road: a street.
        parts: the OSM ways that it is made from.
        meets: ``start`` and ``end`` -> ``junction``, ``street`` (a continuation) or ``nothing``.
        crossings: stations of pedestrian crossings, metres.
        room: free space beside the roads; added lanes are subtracted from it.
        country: ISO 3166-1 alpha-2; empty if unknown.
    """
    lanes: list[Insertion] = []
    for side in (1, -1):
        walk = _has_walk(road, side)
        for kind, clear, slant in (
            ("shoulder", 0.0, SHOULDER_SLANT),
            ("parking", _clear_of_junction(country), 1.0),
        ):
            runs = _runs(parts, side, kind)
            if kind == "parking":
                runs = [free for run in runs for free in _clear_of(run, crossings, clear)]
            for first, last, width, track, orientation in runs:
                a, b, ramps = _ends(road, (first, last), meets, clear=clear, moved=walk)
                taper = float(np.clip(slant * width, SHORTEST_TAPER_M, LONGEST_TAPER_M))
                place = "before_track" if track else "outer"
                for start, end, profile in _fitted(road, side, (a, b), ramps, (width, taper), room):
                    lane = Insertion(side, place, kind, start, end, profile, parking=orientation)
                    lanes.append(lane)
                    room.grow(road, side, start, end, width)
    return lanes


def _has_walk(road: ModelRoad, side: int) -> bool:
    return any(
        lane.id * side > 0 and (lane.kind in RAISED_KINDS or lane.kind == "bicycle")
        for section in road.sections
        for lane in section.lanes
    )


def _runs(parts: Iterable[MatchedWay], side: int, kind: str) -> list[Run]:
    """Return the runs of a constant roadside; adjacent ones of equal width are joined."""
    runs: list[Run] = []
    for part in parts:
        beside = part.roadside(side)
        width, orientation = beside.shoulder, ""
        if kind == "parking":
            width = beside.parking.width if beside.parking is not None else 0.0
            orientation = beside.parking.orientation if beside.parking is not None else ""
        lanes = part.lanes(side)
        track = bool(lanes) and lanes[-1].track
        if width <= 0:
            continue
        before = runs[-1] if runs else None
        if (
            before is not None
            and abs(before[1] - part.first) < 1e-6
            and abs(before[2] - width) < SAME_M
            and before[3:] == (track, orientation)
        ):
            runs[-1] = (before[0], part.last, *before[2:])
        else:
            runs.append((part.first, part.last, width, track, orientation))
    return runs


def _clear_of(
    run: Run, crossings: Sequence[float] | NDArray[np.float64], clear: float
) -> list[Run]:
    """Return the parts of a run outside the surroundings of crossings."""
    first, last, width, track, orientation = run
    free_runs = []
    for s in sorted(float(station_m) for station_m in crossings):
        if first < s + clear and s - clear < last:
            free_runs.append((first, s - clear, width, track, orientation))
            first = s + clear
    free_runs.append((first, last, width, track, orientation))
    return [item for item in free_runs if item[1] > item[0]]


def _ends(
    road: ModelRoad,
    run: tuple[float, float],
    meets: Mapping[str, str],
    *,
    clear: float,
    moved: bool,
) -> tuple[float, float, tuple[bool, bool]]:
    """Return the start and end station of a lane, and at which ends it tapers."""
    first, last = run
    gaps, ramps = [], []
    for at_end, touches in (("start", first < 1.0), ("end", last > road.length - 1.0)):
        meeting = meets.get(at_end, "nothing")
        if not touches:
            gaps.append(0.0)
            ramps.append(True)
        elif meeting == "junction":
            gaps.append(clear)
            ramps.append(True)
        else:
            # If no lane beyond it would have to move back, it extends to the end.
            gaps.append(NEXT_M if moved else 0.0)
            ramps.append(moved)
    return first + gaps[0], last - gaps[1], (ramps[0], ramps[1])


def _fitted(
    road: ModelRoad,
    side: int,
    run: tuple[float, float],
    ramps: tuple[bool, bool],
    size: tuple[float, float],
    room: Clearance,
) -> list[tuple[float, float, Profile]]:
    """Return the parts of a run with room for a lane, with its width along it."""
    lane_parts = []
    first, last = run
    width, taper = size
    if last - first < SHORTEST_LANE_M:
        return []
    for a, b in room.free(road, side, first, last, width):
        up = taper if ramps[0] or a > first + 1e-6 else 0.0
        down = taper if ramps[1] or b < last - 1e-6 else 0.0
        if b - a - up - down >= SHORTEST_LANE_M:
            lane_parts.append((a, b, _tapered(width, b - a, up, down)))
    return lane_parts


def _tapered(width: float, length: float, up: float, down: float) -> Profile:
    """Return a smooth width profile that grows from 0, stays constant, and returns to 0."""
    starts, rows = [], []
    if up > 0:
        starts.append(0.0)
        rows.append(Profile.ramp(0.0, width, up).abcd[0])
    starts.append(up)
    rows.append(np.array([width, 0.0, 0.0, 0.0]))
    if down > 0:
        starts.append(length - down)
        rows.append(Profile.ramp(width, 0.0, down).abcd[0])
    return Profile(np.array(starts), np.array(rows))


def _clear_of_junction(country: str) -> float:
    """Return the distance from a junction within which parking is banned, metres.

    Args:
        country: ISO 3166-1 alpha-2; empty if unknown.
    """
    return CLEAR_M.get(country, 5.0)
