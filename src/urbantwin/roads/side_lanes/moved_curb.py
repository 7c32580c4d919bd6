"""Curbs that a user drew: the adjacent lanes become wider or narrower."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.model import RAISED_KINDS, LaneModel, LaneSection, ModelRoad, SectionLane
from urbantwin.roads.side_lanes.clearance import straight_pieces
from urbantwin.roads.side_lanes.lane_insertion import Insertion, Renumbering, relinked, with_lanes

__all__ = ["CurbMove", "with_moved_curbs"]

#: Maximum displacement of a curb, metres, and minimum cosine of the angle to its line.
FARTHEST_M, ALONG = 6.0, 0.8
#: Sampling step along a line and along a road, metres.
FRONTAGE_STEP_M = 0.25
#: Length of the transition of a curb, as a multiple of its displacement, and its bounds, metres.
SLANT, SHORTEST_TAPER_M, LONGEST_TAPER_M = 3.0, 1.0, 12.0
#: Minimum length of a displaced stretch, and maximum gap within one, which is nearer to another
#: road, metres.
SHORTEST_M, BETWEEN_M = 1.0, 4.0
#: Maximum widening of a driving lane; beyond it a shoulder is added, metres.
WIDER_M = 0.75
#: Minimum widths of lanes, metres (RASt 06: 2.0 m at bottlenecks of side streets).
NARROWEST_M = {"parking": 0.0, "shoulder": 0.0, "bicycle": 0.8, "driving": 2.0, "bus": 2.5}
#: Tolerance of width profiles, metres.
NEAR_M = 0.004
#: Lanes of a section by id.
Lanes = dict[int, SectionLane]


@dataclass
class CurbMove:
    """Result of one drawn curb line.

    Attributes:
        metres: length of the curbs moved to it, metres.
        farthest_m: maximum displacement outwards or inwards, metres.
        why_not: distinct reasons for parts that were not moved.
        nearest_m: distance of the nearest curb, metres.
        has_curb: whether there is a raised lane beside all of it.
    """

    metres: float = 0.0
    farthest_m: float = 0.0
    why_not: list[str] = field(default_factory=list)
    nearest_m: float = float("inf")
    has_curb: bool = True


@dataclass(frozen=True, eq=False)
class _Follow:
    """A curb's new course: stations of a road's side, ascending, and distance outwards, metres."""

    road: int
    side: int
    s: NDArray[np.float64]
    out_m: NDArray[np.float64]
    number: int


def with_moved_curbs(
    model: LaneModel, lines: Mapping[int, Sequence[shapely.LineString]]
) -> tuple[LaneModel, dict[int, CurbMove]]:
    """Return the model with curbs on the drawn lines.

    The curb of a street is the outer border of its carriageway. Where it moves outwards, the
    parking lane or shoulder beside it becomes wider, or a shoulder is added. Where it moves
    inwards, they and then the outermost lane become narrower. Lanes beyond it move along. It
    returns to its place before a junction, and over some metres beyond both ends of a line.

    Args:
        model: roads in plan, with their side lanes and curbs.
        lines: index of a correction -> lines of the curb, site frame.
    """
    moves = {number: CurbMove() for number in lines}
    streets = [road for road in model.roads if road.junction < 0 and any(road.ways)]
    follows = [
        follow
        for number, parts in lines.items()
        for line in parts
        for follow in _followed_curbs(streets, line, number, moves[number])
    ]
    ends = _shared_ends(model, follows)
    roads = model.road_by_id
    edited: dict[int, ModelRoad] = {}
    changed: dict[int, Renumbering] = {}
    for follow in follows:
        road = edited.get(follow.road, roads[follow.road])
        moved, renumbering = _moved(road, follow, ends, moves[follow.number])
        if renumbering is not None:
            before = changed.get(road.id)
            changed[road.id] = renumbering if before is None else _composed(before, renumbering)
        edited[road.id] = moved
    if not edited:
        return model, moves
    changed_model = replace(model, roads=tuple(edited.get(road.id, road) for road in model.roads))
    return relinked(changed_model, changed), moves


def _composed(first: Renumbering, second: Renumbering) -> Renumbering:
    return Renumbering(
        {old: second.start.get(new, new) for old, new in first.start.items()},
        {old: second.end.get(new, new) for old, new in first.end.items()},
    )


def _flat(section: LaneSection, side: int) -> list[SectionLane]:
    """Return the lanes of a side of the carriageway, outwards."""
    lanes = sorted(
        (lane for lane in section.lanes if lane.id * side > 0), key=lambda lane: abs(lane.id)
    )
    raised = next((k for k, x in enumerate(lanes) if x.kind in RAISED_KINDS), len(lanes))
    return lanes[:raised]


def _curb_out(road: ModelRoad, side: int, s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance (N,) of a side's curb from the reference line, metres; nan without one.

    On the inner side of a one-way road it is where the lanes begin.
    """
    if _is_inner(road, side):
        return np.asarray(side * road.offset.at(s))
    distance_m = np.full(len(s), np.nan)
    section_index = (
        np.searchsorted([section.s for section in road.sections], s + 1e-9, side="right") - 1
    )
    for k, section in enumerate(road.sections):
        in_section, flat = section_index == k, _flat(section, side)
        if flat and in_section.any():
            distance_m[in_section] = side * road.border(
                section, flat[-1], s[in_section], outer=True
            )
    return distance_m


def _is_inner(road: ModelRoad, side: int) -> bool:
    """Return whether only the other side has lanes of the carriageway."""
    return not any(_flat(section, side) for section in road.sections) and all(
        _flat(section, -side) for section in road.sections
    )


def _followed_curbs(
    streets: Sequence[ModelRoad], line: shapely.LineString, number: int, move: CurbMove
) -> list[_Follow]:
    """Return the curbs that follow a line: for each piece the nearest parallel one."""
    points = shapely.get_coordinates(shapely.segmentize(line, FRONTAGE_STEP_M))
    ahead = np.gradient(points, axis=0)
    heading = np.arctan2(ahead[:, 1], ahead[:, 0])
    gap = np.full(len(points), np.inf)
    owner = np.full(len(points), -1)
    sides = [(road, side) for road in streets for side in (1, -1)]
    stations: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
    for k, (road, side) in enumerate(sides):
        reach = 30.0 + FARTHEST_M
        if shapely.distance(road.curve.line, line) > reach:
            continue
        s, t = road.curve.locate(points)
        curb_m = _curb_out(road, side, np.clip(s, 0.0, road.length))
        away = np.abs(side * t - curb_m)
        along = np.abs(np.cos(road.curve.at(np.clip(s, 0, road.length))[:, 2] - heading)) > ALONG
        within = (
            (s >= -FRONTAGE_STEP_M)
            & (s <= road.length + FRONTAGE_STEP_M)
            & along
            & np.isfinite(curb_m)
        )
        nearest_m = away[within].min(initial=np.inf)
        move.nearest_m = min(move.nearest_m, float(nearest_m))
        better = within & (away < gap) & (away <= FARTHEST_M)
        gap[better], owner[better] = away[better], k
        stations[k] = s, side * t
    curbs = []
    for k, run in _runs(owner):
        s, curb_m = (value[run] for value in stations[k])
        order = np.argsort(s, kind="stable")
        s, curb_m = s[order], curb_m[order]
        keep = np.concatenate([[True], np.diff(s) > 1e-6])
        road, side = sides[k]
        if s[-1] - s[0] >= min(SHORTEST_M, line.length / 2):
            curbs.append(_Follow(road.id, side, s[keep], curb_m[keep], number))
    return curbs


def _runs(owner: NDArray[np.int64]) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Yield runs of points with one owner, and the owner; short interruptions are ignored."""
    for k in np.unique(owner[owner >= 0]).tolist():
        indices = np.flatnonzero(owner == k)
        apart = np.flatnonzero(np.diff(indices) > BETWEEN_M / FRONTAGE_STEP_M) + 1
        for run in np.split(indices, apart):
            yield k, run


def _shared_ends(model: LaneModel, follows: Sequence[_Follow]) -> set[tuple[int, str, int]]:
    """Return ends (road, start or end, side) beyond which the next road's curb moves too.

    There the curb need not return to its place.
    """
    roads = model.road_by_id
    reached: set[tuple[int, str, int]] = set()
    for follow in follows:
        road = roads[follow.road]
        for end, touches in (
            ("start", follow.s[0] < 2 * FRONTAGE_STEP_M),
            ("end", follow.s[-1] > road.length - 2 * FRONTAGE_STEP_M),
        ):
            if touches:
                reached.add((follow.road, end, follow.side))
    shared = set()
    for number, end, side in reached:
        link = roads[number].predecessor if end == "start" else roads[number].successor
        if link is None or link.element != "road":
            continue
        other = side if link.contact != end else -side
        if (link.id, link.contact, other) in reached:
            shared.add((number, end, side))
    return shared


def _moved(
    road: ModelRoad, one: _Follow, ends: set[tuple[int, str, int]], move: CurbMove
) -> tuple[ModelRoad, Renumbering | None]:
    """Return a road with one curb moved to its line."""
    s, shift_m = _displacements(road, one, ends)
    if len(s) < 2:
        return road, None
    inner = _is_inner(road, one.side)
    outwards, inwards = np.maximum(shift_m, 0.0), np.maximum(-shift_m, 0.0)
    short = _missing(road, -one.side if inner else one.side, s, inwards, most=1 if inner else None)
    if short > NEAR_M:
        move.why_not.append(f"lanes would be {short:.2f} m too narrow for traffic")
        return road, None
    drawn = (s >= one.s[0]) & (s <= one.s[-1])
    move.metres += float(one.s[-1] - one.s[0])
    move.farthest_m = max(move.farthest_m, float(np.abs(shift_m[drawn]).max(initial=0.0)))
    raised = [lane for lane in road.section_at(float(one.s.mean())).lanes if lane.id * one.side > 0]
    move.has_curb &= any(lane.kind in RAISED_KINDS for lane in raised)
    if inner:
        return _inner_moved(road, one.side, s, shift_m), None
    if inwards.max() > NEAR_M:
        road = _narrower(road, one.side, s, inwards)
    if outwards.max() <= NEAR_M:
        return road, None
    beside = {
        flat[-1].kind
        for section, end in zip(road.sections, road.section_ends, strict=True)
        if end > s[0] and section.s < s[-1] and (flat := _flat(section, one.side))
    }
    if beside <= {"parking", "shoulder"} or outwards.max() <= WIDER_M:
        return _wider(road, one.side, s, outwards), None
    shoulder = Insertion(
        one.side,
        "outer",
        "shoulder",
        float(s[0]),
        float(s[-1]),
        straight_pieces(s - s[0], outwards, NEAR_M),
    )
    return with_lanes(road, [shoulder])


def _displacements(
    road: ModelRoad, one: _Follow, ends: set[tuple[int, str, int]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return stations (N,) and displacements outwards (N,) of the curb, with transitions."""
    first, last = max(float(one.s[0]), 0.0), min(float(one.s[-1]), road.length)
    if (road.id, "start", one.side) in ends and first < 2 * FRONTAGE_STEP_M:
        first = 0.0
    if (road.id, "end", one.side) in ends and last > road.length - 2 * FRONTAGE_STEP_M:
        last = road.length
    s = np.unique(np.concatenate([np.arange(first, last, FRONTAGE_STEP_M), [last]]))
    curb = _curb_out(road, one.side, s)
    shift_m = np.interp(s, one.s, one.out_m) - curb
    is_finite = np.isfinite(shift_m)
    s, shift_m = s[is_finite], shift_m[is_finite]
    if len(s) < 2:
        return s, shift_m
    before = _taper(float(s[0]), float(shift_m[0]), goes_on=(road.id, "start", one.side) in ends)
    after = _taper(
        road.length - float(s[-1]), float(shift_m[-1]), goes_on=(road.id, "end", one.side) in ends
    )
    stations = np.unique(
        np.concatenate(
            [s, s[0] - np.linspace(0, before[0], 12), s[-1] + np.linspace(0, after[0], 12)]
        )
    )
    moved = np.interp(stations, s, shift_m)
    for (outside, inside), end, sign in ((before, s[0], 1.0), (after, s[-1], -1.0)):
        if outside + inside > 0:
            u = np.clip((sign * (stations - end) + outside) / (outside + inside), 0.0, 1.0)
            moved = moved * u * u * (3 - 2 * u)
    return stations, moved


def _taper(room: float, far: float, *, goes_on: bool) -> tuple[float, float]:
    """Return the transition lengths of a curb outside and inside its line, metres."""
    if goes_on and room < 2 * FRONTAGE_STEP_M:
        return 0.0, 0.0
    length = float(np.clip(SLANT * abs(far), SHORTEST_TAPER_M, LONGEST_TAPER_M))
    outside = min(room, length)
    return outside, max(0.0, min(length, 2 * abs(far) + SHORTEST_TAPER_M) - outside)


def _missing(
    road: ModelRoad,
    side: int,
    s: NDArray[np.float64],
    inwards: NDArray[np.float64],
    most: int | None = None,
) -> float:
    """Return the width that lanes would lack below their minimum, metres.

    ``most``: number of lanes that give up width, from the reference line outwards.
    """
    short = 0.0
    for section, end in zip(road.sections, road.section_ends, strict=True):
        in_section = (s >= section.s) & (s <= end)
        if not in_section.any():
            continue
        spare_m = np.zeros(int(in_section.sum()))
        for lane in _flat(section, side)[:most]:
            usual = lane.width.at(s[in_section] - section.s)
            spare_m = spare_m + np.maximum(usual - NARROWEST_M.get(lane.kind, usual), 0.0)
        short = max(short, float((inwards[in_section] - spare_m).max()))
    return short


def _narrower(
    road: ModelRoad, side: int, s: NDArray[np.float64], inwards: NDArray[np.float64]
) -> ModelRoad:
    """Return a road whose outer lanes give up width, from the outermost inwards."""

    def changed(
        lanes: Sequence[SectionLane], ds: NDArray[np.float64], at: NDArray[np.float64]
    ) -> Lanes:
        needed_m = np.interp(at, s, inwards, left=0.0, right=0.0)
        narrowed = {}
        for lane in reversed(lanes):
            usual = lane.width.at(ds)
            reduction_m = np.clip(usual - NARROWEST_M.get(lane.kind, usual), 0.0, needed_m)
            if reduction_m.max(initial=0.0) > 0:
                narrowed[lane.id] = replace(
                    lane, width=straight_pieces(ds, usual - reduction_m, NEAR_M)
                )
            needed_m = needed_m - reduction_m
        return narrowed

    return _with_widths(road, side, s, changed)


def _wider(
    road: ModelRoad, side: int, s: NDArray[np.float64], out: NDArray[np.float64]
) -> ModelRoad:
    """Return a road whose outermost lane of the carriageway is wider."""

    def changed(
        lanes: Sequence[SectionLane], ds: NDArray[np.float64], at: NDArray[np.float64]
    ) -> Lanes:
        lane = lanes[-1]
        width = lane.width.at(ds) + np.interp(at, s, out, left=0.0, right=0.0)
        return {lane.id: replace(lane, width=straight_pieces(ds, width, NEAR_M))}

    return _with_widths(road, side, s, changed)


def _inner_moved(
    road: ModelRoad, side: int, s: NDArray[np.float64], out: NDArray[np.float64]
) -> ModelRoad:
    """Return a one-way road whose lanes begin farther out on its inner side.

    The lane there becomes wider, and a raised lane beside it (a median) becomes narrower.
    """
    stations = np.unique(
        np.concatenate(
            [np.arange(0.0, road.length, FRONTAGE_STEP_M), [road.length], s, road.offset.start]
        )
    )
    stations = stations[(stations >= 0.0) & (stations <= road.length)]
    offset = road.offset.at(stations) + side * np.interp(stations, s, out, left=0.0, right=0.0)
    road = replace(road, offset=straight_pieces(stations, offset, NEAR_M))

    def wider(
        lanes: Sequence[SectionLane], ds: NDArray[np.float64], at: NDArray[np.float64]
    ) -> Lanes:
        lane = lanes[0]
        width = lane.width.at(ds) + np.interp(at, s, out, left=0.0, right=0.0)
        return {lane.id: replace(lane, width=straight_pieces(ds, width, NEAR_M))}

    def narrower(
        lanes: Sequence[SectionLane], ds: NDArray[np.float64], at: NDArray[np.float64]
    ) -> Lanes:
        lane = lanes[0]
        width = lane.width.at(ds) - np.interp(at, s, out, left=0.0, right=0.0)
        return {lane.id: replace(lane, width=straight_pieces(ds, np.maximum(width, 0.0), NEAR_M))}

    return _with_widths(_with_widths(road, -side, s, wider), side, s, narrower, raised=True)


def _with_widths(
    road: ModelRoad,
    side: int,
    s: NDArray[np.float64],
    changed: Callable[[Sequence[SectionLane], NDArray[np.float64], NDArray[np.float64]], Lanes],
    *,
    raised: bool = False,
) -> ModelRoad:
    """Return a road whose lanes on a side change width in the sections around stations.

    ``changed``: function of these lanes, outwards, with stations in their section and along the
    road. ``raised``: whether it is applied to the lane beside the carriageway instead.
    """
    sections = []
    for section, end in zip(road.sections, road.section_ends, strict=True):
        lanes = _flat(section, side)
        if raised:
            lanes = [lane for lane in section.lanes if lane.id == side]
        if lanes and end > s[0] and section.s < s[-1]:
            knots = [lane.width.start + section.s for lane in lanes]
            steps = np.linspace(
                section.s, end, max(2, int((end - section.s) / FRONTAGE_STEP_M) + 2)
            )
            stations = np.unique(np.concatenate([steps, s, *knots]))
            stations = stations[(stations >= section.s) & (stations <= end)]
            new = changed(lanes, stations - section.s, stations)
            section = replace(  # noqa: PLW2901
                section, lanes=tuple(new.get(lane.id, lane) for lane in section.lanes)
            )
        sections.append(section)
    return replace(road, sections=tuple(sections))
