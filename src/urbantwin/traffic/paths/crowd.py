"""Pedestrian motion without overlaps: stepping aside and waiting.

SUMO's pedestrians ignore each other on walking areas, stand closer than their width and squeeze
past. So each path is simulated again, step by step. A pedestrian looks two seconds ahead and evades
early, is pushed out of contacts (position based dynamics: Mueller et al., Journal of Visual
Communication and Image Representation 18, 2007), returns to its path, and stays where it is if it
would still overlap. Delayed pedestrians hurry a little.

Without initial overlaps there are none later, except with vehicles that drive into pedestrians;
those vehicles wait (`yielding`). Since the look-ahead is two seconds, later events change nothing
earlier.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from urbantwin.progress import Progress, each, untold
from urbantwin.roads import RoadNetwork
from urbantwin.traffic.compiled.crowd import FASTEST_MS, walked
from urbantwin.traffic.paths.separation import Moving
from urbantwin.traffic.paths.stretches import LeftOff, far_at, no_walks
from urbantwin.traffic.paths.walked_ground import WalkedGround, box_rows

__all__ = ["NO_CROSSINGS", "Crossings", "crowd_walked"]

#: States of a link at which pedestrians start to cross.
_START_STATES = frozenset("Ggo")
#: Number of earlier rows that are searched for a waiting position.
_ROWS_SEARCHED_BACK = 80


@dataclass(frozen=True, eq=False)
class Crossings:
    """The crossings among the lanes of a motion, and their signals.

    Attributes:
        light: (L,) for each lane: -2 for no crossing, -1 for a crossing without a signal, else the
            row of ``green``.
        green: (K, S) uint8: whether pedestrians may start to cross, by step from the first one on.
    """

    light: NDArray[np.int64]
    green: NDArray[np.uint8]

    @classmethod
    def of(
        cls,
        network: RoadNetwork,
        lanes: Sequence[str],
        shown: Sequence[tuple[int, str, str]],
        first: int,
        end: int,
    ) -> Crossings:
        """Return the crossings of a network.

        Args:
            network: the lanes and the heads of their signals.
            lanes: names of lanes, by their indices.
            shown: (step, program, one letter per link) at each change of a program's state.
            first: first step.
            end: step after the last.
        """
        links: dict[str, list[tuple[str, int]]] = defaultdict(list)
        for head in network.signals:
            links[head.lane] += [(head.program, link) for link in head.links]
        light = np.full(len(lanes), -2, np.int64)
        count = end - first
        rows: list[NDArray[np.uint8]] = []
        states: dict[str, list[tuple[int, str]]] = defaultdict(list)
        for step, program, state in sorted(shown, key=lambda shown_state: shown_state[0]):
            states[program].append((step, state))
        for number, name in enumerate(lanes):
            lane = network.lane_by_id.get(name)
            if lane is None or lane.kind != "crossing":
                continue
            light[number] = -1
            crossing_links = [link for link in links[name] if states[link[0]]]
            if crossing_links:
                light[number] = len(rows)
                rows.append(_start_steps(crossing_links, states, first, count))
        return cls(light, np.array(rows, np.uint8).reshape(len(rows), count))

    def kerbs(
        self,
        lane: NDArray[np.integer],
        joined: NDArray[np.bool_],
        last: NDArray[np.int64],
        on_footway: Callable[[NDArray[np.int64]], NDArray[np.bool_]],
    ) -> NDArray[np.int64]:
        """Return the next crossing of every row (N, 4).

        The columns are the first row on it from this one on, -1 for none; and, for such a first
        row, the last row on the same crossing, its signal, and the row of the waiting position.
        That is the last row before it on the footway, since the areas of corners reach far into the
        roads.

        Args:
            lane: (N,) index of the lane.
            joined: (N,) whether the row before is the same actor's, a step earlier.
            last: (N,) the last row of the same actor that follows without a gap.
            on_footway: returns which of some rows (K,) are on the footway.
        """
        count = len(lane)
        next_crossing = np.full((count, 4), -1, np.int64)
        if not (self.light > -2).any():
            return next_crossing
        light = self.light[lane]
        new = np.concatenate([[True], lane[1:] != lane[:-1]]) | ~joined
        begins = np.flatnonzero(new & joined & (light > -2))
        runs = np.flatnonzero(new)
        ends = np.append(runs[1:], count) - 1
        next_crossing[begins, 1] = ends[np.searchsorted(runs, begins)]
        next_crossing[begins, 2] = light[begins]
        first = np.maximum.accumulate(np.where(joined, 0, np.arange(count)))[begins]
        # Not before the previous crossing; in the middle of an island without a footway.
        first[1:] = np.maximum(first[1:], next_crossing[begins[:-1], 1] + 1)
        begun = np.maximum(runs[np.searchsorted(runs, begins) - 1], first)
        next_crossing[begins, 3] = np.minimum((begun + begins - 1) // 2, begins - 1)
        waits = np.zeros(len(begins), np.bool_)
        for back in range(1, _ROWS_SEARCHED_BACK + 1):
            looks = np.flatnonzero(~waits & (begins - back >= first))
            looks = looks[on_footway(begins[looks] - back)]
            next_crossing[begins[looks], 3] = begins[looks] - back
            waits[looks] = True
        following = np.searchsorted(begins, np.arange(count))
        begin_row = np.append(begins, count)[following]
        next_crossing[:, 0] = np.where(begin_row <= last, begin_row, -1)
        return next_crossing


#: No crossings.
NO_CROSSINGS = Crossings(np.full(1, -2, np.int64), np.zeros((0, 1), np.uint8))


def _start_steps(
    links: Sequence[tuple[str, int]],
    states: dict[str, list[tuple[int, str]]],
    first: int,
    count: int,
) -> NDArray[np.uint8]:
    """Return the steps (S,) in which any of a crossing's links lets pedestrians start."""
    green = np.zeros(count, np.uint8)
    for program, link in links:
        changes = states[program]
        begins = [max(step - first, 0) for step, _ in changes]
        for begin, end, (_, state) in zip(begins, [*begins[1:], count], changes, strict=True):
            if link < len(state) and state[link] in _START_STATES:
                green[begin:end] = 1
    return green


#: Time before and after over which walking speeds are taken, seconds.
_SPEED_WINDOW_S = 5.0
#: Number of steps between two reports of progress.
_AT_ONCE = 50


def crowd_walked(  # noqa: PLR0913 - all inputs of pedestrian motion
    columns: dict[str, NDArray[Any]],
    moving: Moving,
    half: NDArray[np.float64],
    step_s: float,
    ground: WalkedGround,
    *,
    crossings: Crossings = NO_CROSSINGS,
    patience_s: tuple[float, float] = (15.0, 4.0),
    left: LeftOff | None = None,
    tell: Progress = untold,
) -> dict[str, NDArray[Any]]:
    """Return poses in which pedestrians step aside and wait to avoid overlaps.

    Paths without conflicts stay bit-identical. The result has the further columns of
    `stretches.WALKS`, which carry over to the next stretch.

    Args:
        columns: poses by actor and step: ``step``, ``xy``, ``yaw``, ``speed``, ``distance``,
            ``lane``.
        moving: classes, levels and vehicles of the actors.
        half: (N, 2) half sizes of the boxes that must not overlap, metres.
        step_s: time between steps, seconds.
        ground: static surroundings.
        crossings: crossings at which delayed pedestrians wait, from the first step to compute on.
        patience_s: waiting time for vehicles, without a signal, and at green.
        left: states at the end of the previous stretch.
        tell: called with the fraction done (0..1) and what is being done.
    """
    step, xy, yaw = columns["step"].astype(np.int64), columns["xy"], columns["yaw"]
    people = np.array([name == "pedestrian" for name in moving.classes], np.bool_)[moving.actor]
    if not people.any():
        return columns | no_walks(len(step))
    joined = np.concatenate([[False], (np.diff(moving.actor) == 0) & (np.diff(step) == 1)])
    first = np.flatnonzero(~joined)
    part = np.cumsum(~joined) - 1
    last = np.append(first[1:] - 1, len(step) - 1)[part]
    step_m = np.where(joined, np.hypot(*np.diff(xy, axis=0, prepend=xy[:1]).T), 0.0)
    far = np.cumsum(step_m)
    far -= far[first][part]
    boxes = np.concatenate([box_rows(xy, yaw, half), ground.boxes])
    row = np.arange(len(step))
    now, far_now = boxes.copy(), far.copy()
    place, come = np.zeros((len(step), 3)), row.astype(np.float64)
    held, yields = np.zeros((2, len(step)), np.int64)
    place[:, :2] = xy
    begin = int(step.min())
    if left is not None:
        begin = left.step
        rows, done = left.rows_among(columns, people)
        now[rows, :2] = place[rows, :2] = done["xy"]
        now[rows, 2], now[rows, 3] = np.cos(done["yaw"]), np.sin(done["yaw"])
        place[rows, 2], held[rows], yields[rows] = done["turn"], done["held"], done["let"]
        come[rows] = np.maximum(rows - done["lag"], first[part[rows]])
        far_now[rows] = far_at(far, come[rows], last)
    steps = np.arange(begin, step.max() + 2)
    own_rows, other_rows = (
        _by_step(step, chosen & (step >= begin)) for chosen in (people, ~people)
    )
    own_ends, other_ends = (np.searchsorted(step[rows], steps) for rows in (own_rows, other_rows))
    actor, level = moving.actor.astype(np.int64), moving.level.astype(np.int64)
    pace = _speed_around(step_m / step_s, first, round(_SPEED_WINDOW_S / step_s))
    kerbs = crossings.kerbs(
        columns["lane"], joined, last, lambda sampled: ground.on_footway(xy[sampled])
    )
    patience = np.round(np.array(patience_s) / step_s).astype(np.int64)
    for k in each(range(0, len(steps) - 1, _AT_ONCE), tell, "past each other"):
        walked(
            own_ends[k : k + _AT_ONCE + 1], own_rows, other_ends[k : k + _AT_ONCE + 1],
            other_rows, boxes, actor, level, far, pace, joined, last, kerbs,
            np.ascontiguousarray(crossings.green[:, k : k + _AT_ONCE]), patience,
            ground.still, ground.numbers, ground.within, ground.cells.cells, ground.cells.corner,
            step_s, now, place, come, far_now, held, yields,
        )  # fmt: skip
    low = come.astype(np.int64)
    changed = people & ((place[:, :2] != xy).any(axis=1) | (place[:, 2] != 0) | (come != row))
    walked_columns = {name: values.copy() for name, values in columns.items()}
    walked_columns["xy"] = place[:, :2].copy()
    walked_columns["yaw"][changed] = (yaw[low] + place[:, 2])[changed]
    walked_columns["lane"][changed] = columns["lane"][low][changed]
    walked_columns["distance"][changed] = far_at(columns["distance"], come, last)[changed]
    # Changed rows have the speed of their displacement.
    now_went = np.where(
        joined, np.hypot(*np.diff(place[:, :2], axis=0, prepend=place[:1, :2]).T), 0
    )
    other = changed & joined
    walked_columns["speed"][other] = (now_went / step_s)[other]
    return walked_columns | {
        "lag": row - come,
        "turn": place[:, 2].copy(),
        "held": held,
        "let": yields,
    }


def _by_step(step: NDArray[np.int64], wanted: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the selected rows, by step."""
    rows = np.flatnonzero(wanted)
    return rows[np.argsort(step[rows], kind="stable")]


def _speed_around(
    speed: NDArray[np.float64], first: NDArray[np.int64], reach: int
) -> NDArray[np.float64]:
    """Return the highest speed of each path around every row (N,), m/s."""
    parts = np.split(np.minimum(speed, FASTEST_MS), first[1:])
    return np.concatenate([maximum_filter1d(part, 2 * reach + 1, mode="nearest") for part in parts])
