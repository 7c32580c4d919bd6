"""Polylines of lanes, for traffic and for the mesh."""

from __future__ import annotations

import dataclasses
import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.model import (
    LaneModel,
    LaneSection,
    ModelRoad,
    SectionLane,
    turned_round,
)
from urbantwin.roads.network import Junction, Lane, RoadNetwork, SignalHead

__all__ = ["SurfaceHeight", "network_of_model"]

#: Maximum distance of a polyline from its curve, metres.
CHORD_M = 0.005
#: Maximum step where heights or widths change, metres.
STEP_M = 2.0
#: Maximum extension of footways to the start of netconvert's walking areas, metres.
REACH_M = 8.0
#: Height of the carriageway (N,) at points (N, 2) of a level, metres.
SurfaceHeight = Callable[[NDArray[np.float64], int], NDArray[np.float64]]


@dataclasses.dataclass(frozen=True)
class _Run:
    """A lane along its whole road, in the order of travel: stations, points and widths."""

    road: ModelRoad
    lane: SectionLane
    s: NDArray[np.float64]
    points: NDArray[np.float64]
    width: NDArray[np.float64]


def network_of_model(model: LaneModel, raw: RoadNetwork, height: SurfaceHeight) -> RoadNetwork:
    """Return the network with all lanes at their positions in the lane model.

    Args:
        model: the lane model, with heights.
        raw: netconvert's network: topology, crossings, walking areas, programs.
        height: heights of the surface, for crossings and walking areas, which the lane model lacks.
    """
    raw_lanes = raw.lane_by_id
    placed: dict[str, Lane] = {}
    chains = []
    for run in sorted(_runs(model), key=_turn):
        pieces = _named(run, raw_lanes)
        chains.append(list(pieces))
        for name, piece in pieces.items():
            # If several movements share a lane, the straightest one determines it.
            if name not in placed:
                placed[name] = _lane(name, piece, raw_lanes.get(name))
    _join(placed, chains)
    _draw_to_corners(placed, raw_lanes, height)
    outlines = {junction.name: junction.outline for junction in model.junctions}
    inside = [lane for lane in raw.lanes if lane.id not in placed]
    ground = dict(zip((lane.id for lane in inside), _on_ground(inside, height), strict=True))
    lanes = [ground.get(lane.id) or placed.pop(lane.id) for lane in raw.lanes]
    every = {lane.id: lane for lane in (*lanes, *placed.values())}
    return dataclasses.replace(
        raw,
        lanes=tuple(every.values()),
        junctions=_outlined(raw.junctions, outlines),
        signals=tuple(_moved(head, every[head.lane]) for head in raw.signals),
    )


def _turn(run: _Run) -> float:
    if run.road.junction < 0:
        return 0.0
    pieces = run.road.curve.pieces
    return round(abs(pieces[-1].heading - pieces[0].heading), 3)


def _join(placed: dict[str, Lane], chains: list[list[str]]) -> None:
    """Move lanes to begin at the end of the previous ones, also if another curve was used there."""
    shared = Counter(name for chain in chains for name in chain)
    for chain in chains:
        for before, name in itertools.pairwise(chain):
            lane = placed[name]
            gap = placed[before].centre[-1] - lane.centre[0]
            if shared[name] > 1 or np.linalg.norm(gap) < 1e-3:
                continue
            step = np.linalg.norm(np.diff(lane.centre[:, :2], axis=0), axis=1)
            weight = 1.0 - np.concatenate([[0.0], np.cumsum(step)]) / max(step.sum(), 1e-9)
            placed[name] = dataclasses.replace(lane, centre=lane.centre + weight[:, None] * gap)


def _outlined(
    junctions: tuple[Junction, ...], outlines: Mapping[str, NDArray[np.float64]]
) -> tuple[Junction, ...]:
    return tuple(
        dataclasses.replace(junction, outline=outlines[junction.id])
        if junction.id in outlines
        else junction
        for junction in junctions
    )


def _runs(model: LaneModel) -> list[_Run]:
    """Return all lanes of the model, joined by strip over the sections of a road."""
    runs: list[_Run] = []
    for road in model.roads:
        ends = road.section_ends
        stations = _stations(road)
        parts: dict[str, list[_Run]] = {}
        for k, (section, end) in enumerate(zip(road.sections, ends, strict=True)):
            inner = stations[(stations > section.s + 1e-6) & (stations < end - 1e-6)]
            s = np.concatenate([[section.s], inner, [end]])
            for part in _section_runs(road, k, section, s):
                parts.setdefault(part.lane.strip, []).append(part)
        runs += [_joined(pieces) for pieces in parts.values()]
    return runs


def _section_runs(
    road: ModelRoad, number: int, section: LaneSection, s: NDArray[np.float64]
) -> Iterable[_Run]:
    """Yield the lanes of a section; vectorised equivalent of ``ModelRoad.place``."""
    pose, bank, crown = road.curve.at(s), road.bank.at(s), road.crown.at(s)
    left = np.column_stack([-np.sin(pose[:, 2]), np.cos(pose[:, 2])]) * np.cos(bank)[:, None]
    rise, level, offset = np.sin(bank), road.elevation.at(s), road.offset.at(s)
    for side in (1, -1):
        edge = offset
        for lane in sorted(
            (lane for lane in section.lanes if lane.id * side > 0), key=lambda lane: abs(lane.id)
        ):
            width = lane.width.at(s - section.s)
            t, edge = edge + side * width / 2, edge + side * width
            if lane.kind == "none":
                continue
            points = np.empty((len(s), 3))
            points[:, :2] = pose[:, :2] + t[:, None] * left
            points[:, 2] = level + t * rise - crown * np.abs(t)
            named_lane = lane
            if not lane.strip:
                named_lane = dataclasses.replace(lane, strip=f"{road.id}:{number}:{lane.id}")
            yield _Run(road, named_lane, s, points, np.maximum(width, 0.0))
            if named_lane.opposite:
                yield _Run(road, turned_round(named_lane), s, points, np.maximum(width, 0.0))


def _joined(parts: list[_Run]) -> _Run:
    first = parts[0]
    s, points, width = first.s, first.points, first.width
    if len(parts) > 1:
        s, points, width = (
            np.concatenate([getattr(first, key), *(getattr(p, key)[1:] for p in parts[1:])])
            for key in ("s", "points", "width")
        )
    if not first.lane.forward:
        s, points, width = s[::-1], points[::-1], width[::-1]
    return _Run(first.road, first.lane, s, points, width)


def _stations(road: ModelRoad) -> NDArray[np.float64]:
    """Return stations at which chords stay close to the road's lines."""
    curve = road.curve
    reach = max(
        sum(float(lane.width.abcd[0, 0]) for lane in section.lanes) for section in road.sections
    )
    starts = curve.starts
    length = np.diff(starts)
    turn = np.abs([piece.curvature for piece in curve.pieces]) * length
    if any(piece.u for piece in curve.pieces):
        middle = starts[:-1] + length / 2
        s = np.concatenate([starts[:-1] + 1e-9, middle, starts[1:] - 1e-9])
        heading = np.unwrap(curve.at(s)[:, 2].reshape(3, -1), axis=0)
        # The tighter half of a piece applies to all of it.
        turn = 2 * np.abs(np.diff(heading, axis=0)).max(axis=0)
    radius = length / np.maximum(turn, 1e-9) + reach
    # The sagitta of a chord over an angle a of a circle is radius x a^2 / 8.
    steps = np.where(turn > 1e-6, np.ceil(turn * np.sqrt(radius / (8 * CHORD_M))), 1).astype(int)
    within = np.arange(steps.sum()) - np.repeat(np.cumsum(steps) - steps, steps)
    stations = [np.repeat(starts[:-1], steps) + within * np.repeat(length / steps, steps), starts]
    uneven = len(road.elevation.start) > 1 or np.abs(road.elevation.abcd[:, 2:]).max() > 1e-9
    uneven |= not road.bank.is_zero or len(road.crown.start) > 1 or len(road.offset.start) > 1
    uneven |= any(
        len(lane.width.start) > 1 or np.abs(lane.width.abcd[:, 1:]).max() > 1e-9
        for section in road.sections
        for lane in section.lanes
    )
    if uneven:
        stations.append(np.linspace(0, curve.length, int(np.ceil(curve.length / STEP_M)) + 1))
        stations += [
            section.s + lane.width.start for section in road.sections for lane in section.lanes
        ]
    merged = np.sort(np.concatenate(stations))
    return np.asarray(merged[np.concatenate([[True], np.diff(merged) > 1e-3])])


def _named(run: _Run, known: Mapping[str, Lane]) -> dict[str, _Run]:
    """Return the run cut into the lanes of the network that it represents, in their order.

    A connecting road may consist of several consecutive lanes in the network; they divide its
    length in proportion to theirs.
    """
    names = run.lane.strip.split()
    if len(names) == 1:
        return {names[0]: run}
    share = np.cumsum([max(known[name].length, 1e-3) for name in names])
    cuts = np.concatenate([[0.0], share / share[-1]]) * run.road.length
    stations = run.s if run.lane.forward else run.road.length - run.s
    cut_runs = {}
    for name, a, b in zip(names, cuts, cuts[1:], strict=False):
        inner = stations[(stations > a + 1e-3) & (stations < b - 1e-3)]
        where = np.concatenate([[a], inner, [b]])
        columns = (run.s, *run.points.T, run.width)
        s, x, y, z, width = (np.interp(where, stations, value) for value in columns)
        cut_runs[name] = _Run(run.road, run.lane, s, np.column_stack([x, y, z]), width)
    return cut_runs


def _lane(name: str, run: _Run, raw: Lane | None) -> Lane:
    centre, widths = run.points, run.width
    constant = float(np.ptp(widths)) < 1e-3
    within = run.road.junction >= 0
    kind = "connection" if within else run.lane.kind
    return Lane(
        id=name,
        road="" if raw is None else raw.road,
        kind=kind if raw is None else raw.kind,
        width=float(widths.mean()),
        speed_limit=run.lane.speed_limit if raw is None else raw.speed_limit,
        centre=centre,
        outline=np.zeros((0, 2)),
        level=run.road.level,
        allowed=run.lane.allowed if raw is None else raw.allowed,
        successors=() if raw is None else raw.successors,
        junction="" if raw is None else raw.junction,
        arrows=None if raw is None else raw.arrows,
        widths=np.zeros(0) if constant else widths,
        parking=run.lane.parking,
        opposite=run.lane.opposite,
    )


#: Minimum cosine between a footway's direction and its extension to its end in the network.
_MIN_COSINE = 0.5


def _draw_to_corners(
    placed: dict[str, Lane], known: Mapping[str, Lane], height: SurfaceHeight
) -> None:
    """Extend footways to their ends in the network, which are not cut back like roads."""
    extensions: dict[int, list[tuple[str, int, NDArray[np.float64]]]] = {}
    for name, lane in placed.items():
        if name not in known or known[name].kind != "sidewalk":
            continue
        for end, inner in ((0, 1), (-1, -2)):
            corner, lane_end = known[name].centre[end, :2], lane.centre[end, :2]
            leg, missing_m = (
                lane_end - lane.centre[inner, :2],
                float(np.linalg.norm(corner - lane_end)),
            )
            # An extension beside the end, not ahead of it, would be a jog wider than long.
            ahead = leg @ (corner - lane_end) > _MIN_COSINE * missing_m * np.linalg.norm(leg)
            if ahead and 0.02 < missing_m < REACH_M:
                extensions.setdefault(lane.level, []).append(
                    (name, end, np.array([lane_end, corner]))
                )
    for level, rows in sorted(extensions.items()):
        z = height(np.concatenate([xy for _, _, xy in rows]), level).reshape(-1, 2)
        # Only the slope is that of the surface: the footway continues without a step.
        for (name, end, xy), rise in zip(rows, z[:, 1] - z[:, 0], strict=True):
            lane = placed[name]
            point = np.append(xy[1], lane.centre[end, 2] + rise)
            place = 0 if end == 0 else len(lane.centre)
            centre = np.insert(lane.centre, place, point, axis=0)
            widths = lane.widths
            if len(widths):
                widths = np.insert(widths, place, widths[end])
            placed[name] = dataclasses.replace(lane, centre=centre, widths=widths)


def _on_ground(lanes: Sequence[Lane], height: SurfaceHeight) -> list[Lane]:
    """Return lanes that are not in the lane model, placed on the surface."""
    places = [
        shapely.get_coordinates(shapely.LineString(lane.centre[:, :2]).segmentize(4.0))
        for lane in lanes
    ]
    result = list(lanes)
    for level in sorted({lane.level for lane in lanes}):
        on_level = [k for k, lane in enumerate(lanes) if lane.level == level]
        z = height(np.concatenate([places[k] for k in on_level]), level)
        cuts = np.cumsum([len(places[k]) for k in on_level])[:-1]
        for k, heights in zip(on_level, np.split(z, cuts), strict=True):
            centre = np.column_stack([places[k], heights])
            result[k] = dataclasses.replace(lanes[k], centre=centre)
    return result


def _moved(head: SignalHead, lane: Lane) -> SignalHead:
    """Return a signal with its stop line at the lane's end (or its crossing's start)."""
    if lane.kind == "crossing":
        return head
    before, end = lane.centre[-2, :2], lane.centre[-1, :2]
    yaw = float(np.arctan2(*(end - before)[::-1]))
    return dataclasses.replace(head, x=float(end[0]), y=float(end[1]), yaw=yaw)
