"""Parking and shoulders: lanes between the carriageway and the sidewalk."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads.model import RAISED_KINDS, ModelRoad, Profile
from urbantwin.roads.side_lanes.clearance import Clearance
from urbantwin.roads.side_lanes.lane_insertion import Insertion
from urbantwin.roads.side_lanes.map_matching import MatchedWay

__all__ = ["parking_and_shoulders"]

#: No parking within so many metres of a junction or the crossing before it. Germany: StVO
#: section 12 (3), 5 m. United States: Uniform Vehicle Code 11-1003, 20 ft from a crosswalk at an
#: intersection. Australia: Australian Road Rules 170, 10 m. United Kingdom: Highway Code 243,
#: 10 m. Taiwan: Road Traffic Safety Rules 111, 10 m. Japan: Road Traffic Act 44, 5 m. Elsewhere:
#: Vienna Convention on Road Traffic, article 23, 5 m.
CLEAR_M = {"US": 6.1, "CA": 6.1, "AU": 10.0, "NZ": 6.0, "GB": 10.0, "IE": 5.0, "TW": 10.0}
#: The shortest side lane without its tapers: one parallel space, metres.
SHORTEST_M = 5.5
#: Tapers: parking begins and ends over its own depth, shoulders over ten times their width.
SHORTEST_TAPER_M, LONGEST_TAPER_M, SHOULDER_SLANT = 1.5, 12.0, 10.0
#: The same width to a reader of the map, metres.
SAME_M = 0.05
#: From, to, width, whether a track lies beyond, and how vehicles park.
Run = tuple[float, float, float, bool, str]
#: What is taken off either end where a road merely goes on into the next, metres.
NEXT_M = 0.5


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

    Parking ends before junctions as the law says and tapers to nothing, so that the junction's own
    lanes and corners stay where they are; where there is no room beside the road there is none.

    Args:
        road: a street.
        parts: the ways that it is made from.
        meets: ``start`` and ``end`` -> ``junction``, ``street`` (it goes on) or ``nothing``.
        crossings: stations where people cross the street.
        room: what stands beside the roads; what is added here is taken off it.
        country: ISO 3166-1 alpha-2; empty if unknown.
    """
    found: list[Insertion] = []
    for side in (1, -1):
        walk = _has_walk(road, side)
        for kind, clear, slant in (
            ("shoulder", 0.0, SHOULDER_SLANT),
            ("parking", _clear_of_junction(country), 1.0),
        ):
            runs = _runs(parts, side, kind)
            if kind == "parking":
                runs = [free for run in runs for free in _clear_of(run, crossings, clear)]
            for first, last, width, track, stands in runs:
                a, b, ramps = _ends(road, (first, last), meets, clear=clear, moved=walk)
                taper = float(np.clip(slant * width, SHORTEST_TAPER_M, LONGEST_TAPER_M))
                place = "before_track" if track else "outer"
                for start, end, profile in _fitted(road, side, (a, b), ramps, (width, taper), room):
                    lane = Insertion(side, place, kind, start, end, profile, parking=stands)
                    found.append(lane)
                    room.grow(road, side, start, end, width)
    return found


def _has_walk(road: ModelRoad, side: int) -> bool:
    return any(
        lane.id * side > 0 and (lane.kind in RAISED_KINDS or lane.kind == "bicycle")
        for section in road.sections
        for lane in section.lanes
    )


def _runs(parts: Iterable[MatchedWay], side: int, kind: str) -> list[Run]:
    """Return where a roadside is the same, neighbours of one width joined."""
    runs: list[Run] = []
    for part in parts:
        beside = part.roadside(side)
        width, stands = beside.shoulder, ""
        if kind == "parking":
            width = beside.parking.width if beside.parking is not None else 0.0
            stands = beside.parking.orientation if beside.parking is not None else ""
        lanes = part.lanes(side)
        track = bool(lanes) and lanes[-1].track
        if width <= 0:
            continue
        before = runs[-1] if runs else None
        if (
            before is not None
            and abs(before[1] - part.first) < 1e-6
            and abs(before[2] - width) < SAME_M
            and before[3:] == (track, stands)
        ):
            runs[-1] = (before[0], part.last, *before[2:])
        else:
            runs.append((part.first, part.last, width, track, stands))
    return runs


def _clear_of(
    run: Run, crossings: Sequence[float] | NDArray[np.float64], clear: float
) -> list[Run]:
    """Return the parts of a run outside the surroundings of crossings."""
    first, last, width, track, stands = run
    found = []
    for s in sorted(float(at) for at in crossings):
        if first < s + clear and s - clear < last:
            found.append((first, s - clear, width, track, stands))
            first = s + clear
    found.append((first, last, width, track, stands))
    return [item for item in found if item[1] > item[0]]


def _ends(
    road: ModelRoad,
    run: tuple[float, float],
    meets: Mapping[str, str],
    *,
    clear: float,
    moved: bool,
) -> tuple[float, float, tuple[bool, bool]]:
    """Return where a lane begins and ends, and at which ends it tapers."""
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
            # Where nothing beyond it would have to move back, it goes on to the very end.
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
    """Return where within a run there is room for a lane, and its width along it."""
    found = []
    first, last = run
    width, taper = size
    if last - first < SHORTEST_M:
        return []
    for a, b in room.free(road, side, first, last, width):
        up = taper if ramps[0] or a > first + 1e-6 else 0.0
        down = taper if ramps[1] or b < last - 1e-6 else 0.0
        if b - a - up - down >= SHORTEST_M:
            found.append((a, b, _tapered(width, b - a, up, down)))
    return found


def _tapered(width: float, length: float, up: float, down: float) -> Profile:
    """Return a width that grows from 0, stays, and goes back to 0, without a kink."""
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
    """Return within what distance of a junction parking is banned, metres.

    Args:
        country: ISO 3166-1 alpha-2; empty if unknown.
    """
    return CLEAR_M.get(country, 5.0)
