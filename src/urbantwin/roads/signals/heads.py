"""Placement of signal heads on poles at the kerb and on mast arms, by country."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import wrapped
from urbantwin.roads.lane_polylines import SurfaceHeight
from urbantwin.roads.model import LaneModel, RoadSignal, SignalController
from urbantwin.roads.network import RoadNetwork
from urbantwin.roads.signals.approach import (
    Approach,
    Frame,
    WaitingLane,
    approaches_of,
    stop_lines_within,
)
from urbantwin.roads.signals.country_practice import Practice
from urbantwin.roads.signals.pole_sites import CLEARANCE_M, FreeGround

__all__ = ["REACH_M", "pedestrian_heads", "place_heads"]

#: Height of a pedestrian head's centre: 2.2 m clear of the footway (MUTCD 4E.05: 2.1 m), metres.
WALK_M = 2.65
#: Height and width of a head of two lights of 200 mm, metres.
WALKER_SIZE = (0.6, 0.3)


def pedestrian_heads(
    model: LaneModel,
    signal: RoadSignal,
    centre: NDArray[np.float64],
    width: float,
    ground: FreeGround,
) -> list[RoadSignal]:
    """Return a head at each end of a crossing that faces the other end."""
    area = next((a for a in model.areas if a.strip == signal.strip), None)
    road = model.road_by_id[area.road if area else signal.road]
    heads = []
    for end, other in ((centre[0], centre[1]), (centre[-1], centre[-2])):
        outward = math.atan2(end[1] - other[1], end[0] - other[0])
        frame = Frame(float(end[0]), float(end[1]), outward)
        spot = _beside_crossing(frame, width / 2 + 0.3, ground, road.level)
        if spot is None:
            continue
        xy = frame.place(*spot)
        pose = (
            float(xy[0, 0]),
            float(xy[0, 1]),
            WALK_M,
            wrapped(outward + math.pi),
        )
        s, t = (float(value[0]) for value in road.curve.locate(xy))
        heads.append(
            replace(
                signal,
                road=road.id,
                s=float(np.clip(s, 0.0, road.length)),
                t=t,
                z=WALK_M,
                orientation="none",
                lanes=(),
                height=WALKER_SIZE[0],
                width=WALKER_SIZE[1],
                pose=pose,
            )
        )
    return heads or [signal]


def _beside_crossing(
    frame: Frame, side: float, ground: FreeGround, level: int
) -> NDArray[np.float64] | None:
    """Return u, v of the nearest free place beyond a crossing's end, on either side of it."""
    u = np.arange(0.4, 9.0, 0.4)
    for v in (np.array([side]), np.arange(side + 0.4, side + 2.8, 0.4)):
        grid = np.stack(np.meshgrid(u, [*v, *-v], indexing="ij"), axis=-1).reshape(-1, 2)
        cost = grid[:, 0] + np.abs(grid[:, 1])
        free_index = ground.cheapest(frame.place(grid[:, 0], grid[:, 1]), cost, level)
        if free_index is not None:
            return np.asarray(grid[free_index])
    return None


#: Lateral search distance for a free place for a pole, metres.
SEARCH_M = 12.0
#: Search distance behind and before the stop line if there is no place at the kerb, metres.
BEHIND_M, AHEAD_M = 10.0, 30.0
#: Maximum length of an arm (usual up to 15 m: MUTCD-based state standards, e.g. Caltrans ES-7),
#: metres.
REACH_M = 15.0
#: Distance of far-side heads from the stop line, metres (MUTCD 2009, 4D.14: 40 to 180 ft).
NEAREST_M, FARTHEST_M = 12.0, 55.0
#: Heights of the centres of heads: over lanes 5.2 m clear (MUTCD 2009, 4D.15: 4.6 to 7.8 m; RiLSA:
#: 4.5 m), beside them 2.3 m clear (RiLSA 6.3: 2.1 m; MUTCD: 2.4 m), metres.
OVER_M, BESIDE_M = 5.7, 2.8
#: Height and width of a head of three lights of 300 mm, metres.
VEHICLE_SIZE = (1.0, 0.35)
#: Spacing of heads side by side on one pole, metres.
BESIDE_EACH_OTHER_M = 0.45
#: Maximum offset of a head from its pole towards the carriageway, metres.
OVER_KERB_M = 0.15
#: Minimum spacing of heads over lanes, metres.
SPACING_M = 1.6
#: Narrower lanes are cycle lanes without heads over them, metres.
CYCLE_LANE_M = 2.1
#: Maximum number of heads over one approach.
MOST_OVER = 5


def place_heads(
    model: LaneModel,
    network: RoadNetwork,
    ground: FreeGround,
    practice: Practice,
    height: SurfaceHeight,
) -> LaneModel:
    """Return the model with signal heads placed by a country's practice.

    Lanes with identical states share heads. A head beside or over its own street is placed there;
    one beyond the junction keeps ``s`` at the stop line and has a ``pose``. Every lane that had a
    signal keeps one.

    Args:
        model: the lane model with a signal at every stop line and crossing.
        network: its lanes.
        ground: free places for poles.
        practice: the country's practice.
        height: heights of the surface.
    """
    approaches = approaches_of(model)
    model = replace(model, areas=(*model.areas, *stop_lines_within(model, approaches)))
    standing: list[RoadSignal] = []
    for approach in approaches:
        standing += _heads(approach, practice, ground)
    replaced = {lane.signal.id for approach in approaches for lane in approach.lanes}
    for signal in model.signals:
        lane = network.lane_by_id.get(signal.strip)
        if signal.dynamic and lane is not None and lane.kind == "crossing":
            replaced.add(signal.id)
            standing += pedestrian_heads(model, signal, lane.centre, lane.width, ground)
    standing = _raised(model, standing, height)
    remaining = [signal for signal in model.signals if signal.id not in replaced]
    first = model.next_id
    numbered = [replace(signal, id=first + k) for k, signal in enumerate(standing)]
    signals = (*remaining, *numbered)
    return replace(model, signals=signals, controllers=_controlled(model.controllers, signals))


def _raised(
    model: LaneModel, signals: Sequence[RoadSignal], height: SurfaceHeight
) -> list[RoadSignal]:
    """Return signals whose poses are raised by the height of the surface."""
    raised = list(signals)
    levels = [model.road_by_id[signal.road].level for signal in signals]
    for level in sorted(set(levels)):
        posed = [k for k, signal in enumerate(signals) if signal.pose and levels[k] == level]
        if not posed:
            continue
        ground = height(np.array([signals[k].pose[:2] for k in posed]), level)
        for k, z in zip(posed, ground, strict=True):
            x, y, up, heading = signals[k].pose
            raised[k] = replace(signals[k], pose=(x, y, float(z) + up, heading))
    return raised


def _controlled(
    controllers: Sequence[SignalController], signals: Sequence[RoadSignal]
) -> tuple[SignalController, ...]:
    of_program: dict[str, list[int]] = defaultdict(list)
    for signal in signals:
        if signal.dynamic and signal.program:
            of_program[signal.program].append(signal.id)
    return tuple(replace(item, signals=tuple(of_program[item.name])) for item in controllers)


def _heads(approach: Approach, practice: Practice, ground: FreeGround) -> list[RoadSignal]:
    """Return the heads of an approach, in the order in which drivers pass them."""
    has_arm = sum(lane.half > CYCLE_LANE_M / 2 for lane in approach.lanes) >= practice.arm_lanes
    far = _far_pole(approach, ground) if practice.far else None
    near_pole = None
    if practice.near or far is None:
        near_pole = _near_pole(approach, ground)
    if near_pole is None and far is None:
        # The kerb is too far away: use the far side instead.
        far = _far_pole(approach, ground)
    heads: list[RoadSignal] = []
    if near_pole is not None:
        heads += _on_pole(approach, near_pole, beyond=False)
        if has_arm and far is None:
            heads += _over_lanes(approach, near_pole, practice, beyond=False)
    if far is not None:
        if has_arm:
            heads += _over_lanes(approach, far, practice, beyond=True)
        heads += _on_pole(approach, far, beyond=True)
    if not heads:
        island = _nearest_pole(approach, ground)
        beyond = island is not None and island[0] > approach.line
        if island is not None:
            heads = _over_lanes(approach, island, practice, beyond=beyond)
    governed = {name for head in heads for name in head.strip.split()}
    # Lanes that no arm reaches: over their stop lines, from a span wire.
    return heads + [
        replace(lane.signal, z=OVER_M)
        for lane in approach.lanes
        if not governed & set(lane.signal.strip.split())
    ]


def _near_pole(approach: Approach, ground: FreeGround) -> NDArray[np.float64] | None:
    """Return u, v of a pole at the kerb beside the stop line; ``None`` if none is free."""
    v = approach.kerb + approach.outward * np.arange(CLEARANCE_M, SEARCH_M, 0.2)
    # Not beyond the stop line: waiting traffic must see it.
    u = approach.line - np.arange(0.0, 8.0, 0.5)
    return ground.nearest(approach.frame, u, v, approach.road.level)


def _nearest_pole(approach: Approach, ground: FreeGround) -> NDArray[np.float64] | None:
    """Return u, v of the free place, such as an island or a median, with the shortest arm."""
    middle = float(np.mean([lane.v for lane in approach.lanes]))
    u = approach.line + np.arange(-BEHIND_M, AHEAD_M, 1.0)
    v = middle + np.arange(-REACH_M, REACH_M + 0.25, 0.5)
    grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    # Distance along the street counts twice: waiting traffic must see the head.
    cost = np.abs(grid[:, 1] - middle) + 2.0 * np.abs(grid[:, 0] - approach.line)
    index = ground.cheapest(approach.frame.place(grid[:, 0], grid[:, 1]), cost, approach.road.level)
    return None if index is None else np.asarray(grid[index])


def _far_pole(approach: Approach, ground: FreeGround) -> NDArray[np.float64] | None:
    """Return u, v of a pole beyond the junction, at the kerb of the exit straight on."""
    level = approach.road.level
    if approach.exit is not None:
        frame = approach.exit.frame
        v = approach.exit.outer + approach.outward * np.arange(CLEARANCE_M, SEARCH_M, 0.2)
        spot = ground.nearest(frame, np.arange(2.0, 12.0, 0.5), v, level)
        if spot is None:
            return None
        u, v_there = approach.frame.locate(frame.place(*spot)[0])
        pole = np.array([u, v_there])
    else:
        # The street ends at the junction: opposite, where the carriageway ends.
        middle = float(np.mean([lane.v for lane in approach.lanes]))
        ahead = approach.line + np.arange(NEAREST_M, FARTHEST_M, 0.25)
        free = ground.free(approach.frame.place(ahead, middle), level)
        if not free.any():
            return None
        pole = np.array([float(ahead[np.argmax(free)]) + 0.3, middle])
    return pole if NEAREST_M <= pole[0] - approach.line <= FARTHEST_M else None


def _on_pole(approach: Approach, pole: NDArray[np.float64], *, beyond: bool) -> list[RoadSignal]:
    """Return a head for each group of lanes, side by side on a pole."""
    heads = []
    last = len(approach.groups) - 1
    inward = min(BESIDE_EACH_OTHER_M * last / 2, OVER_KERB_M)
    # Groups nearer to the middle of the road hang nearer to it, none over the carriageway.
    for k, group in reversed(list(enumerate(approach.groups))):
        v = pole[1] + approach.outward * (BESIDE_EACH_OTHER_M * (last - k) - inward)
        heads.append(_head(approach, group, pole[0], v, BESIDE_M, beyond=beyond))
    return heads


def _over_lanes(
    approach: Approach,
    pole: NDArray[np.float64],
    practice: Practice,
    *,
    beyond: bool,
) -> list[RoadSignal]:
    """Return a head over each lane that an arm from the pole reaches, at the pole's u."""
    middle = float(np.mean([lane.v for lane in approach.lanes]))
    from_kerb = approach.outward * (float(pole[1]) - middle) >= 0.0
    inward = -approach.outward if from_kerb else approach.outward
    rows: list[tuple[float, list[WaitingLane]]] = [
        (lane.v, [lane]) for lane in approach.lanes if lane.half > CYCLE_LANE_M / 2
    ]
    if len(rows) > MOST_OVER:
        rows = [(float(np.mean([lane.v for lane in group])), group) for group in approach.groups]
    heads = []
    last = -math.inf
    for v, lanes in rows if from_kerb else rows[::-1]:
        # If lanes are not in front of the arm, its heads are spaced along it in their order.
        reach = max(inward * (v - float(pole[1])), last + SPACING_M, 1.5)
        if reach > REACH_M:
            break
        last = reach
        where = float(pole[1]) + inward * reach
        head = _head(approach, lanes, float(pole[0]), where, OVER_M, beyond=beyond)
        if practice.horizontal:
            head = replace(head, height=VEHICLE_SIZE[1], width=VEHICLE_SIZE[0])
        heads.append(head)
    return heads


def _head(
    approach: Approach,
    lanes: Sequence[WaitingLane],
    u: float,
    v: float,
    up: float,
    *,
    beyond: bool,
) -> RoadSignal:
    """Return a head at u, v of an approach's frame, ``up`` metres above the carriageway."""
    model = lanes[0].signal
    sign = 1.0 if approach.forward else -1.0
    common = replace(
        model,
        road=approach.road.id,
        orientation="+" if approach.forward else "-",
        name=" ".join(["links", *(str(link) for lane in lanes for link in lane.signal.links)]),
        lanes=tuple(dict.fromkeys(k for lane in lanes for k in lane.signal.lanes)),
        links=tuple(sorted({link for lane in lanes for link in lane.signal.links})),
        strip=" ".join(lane.signal.strip for lane in lanes),
        z=up,
        height=VEHICLE_SIZE[0],
        width=VEHICLE_SIZE[1],
    )
    if not beyond and u <= 0.0:
        s = float(np.clip(approach.s + sign * u, 0.0, approach.road.length))
        return replace(common, s=s, t=float(sign * v))
    xy = approach.frame.place(u, v)
    facing = wrapped(approach.frame.heading + math.pi)
    middle = float(np.mean([lane.v for lane in lanes]))
    pose = (float(xy[0, 0]), float(xy[0, 1]), up, facing)
    return replace(common, s=approach.s, t=sign * middle, pose=pose)
