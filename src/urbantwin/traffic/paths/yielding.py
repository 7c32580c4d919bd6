"""Yielding: vehicles wait to avoid overlaps, and those that exceed their limits drive later.

`separation` bends paths, and leaves conflicts that no small change resolves: lanes that overlap,
cutting in, tight curves. Of each two that still overlap, the one that loses less time yields and
keeps its path (`retiming`). Vehicles behind wait in turn. The same step removes accelerations of
SUMO that no vehicle can have: braking and turning too hard.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from urbantwin.progress import Progress, between, each, untold
from urbantwin.traffic.compiled.waiting import first_contacts
from urbantwin.traffic.paths.box_plan import PlanBoxes, meetings, shared_areas
from urbantwin.traffic.paths.retiming import (
    BEHIND_M,
    GRID_M,
    LIMITS,
    Let,
    Pace,
    Way,
    curve_speeds,
    retimed,
)
from urbantwin.traffic.paths.separation import Moving

__all__ = ["Before", "yielded"]

#: Shared area in plan above which pairs overlap, square metres.
_OVERLAP_M2 = 0.02
#: Gap ahead of the yielding vehicle, and lateral gap, metres.
_GAP_AHEAD_M, _LATERAL_GAP_M = 0.7, 0.02
#: Weight of overlap (depth times time) relative to delay (distance times time).
_OVERLAP_WEIGHT = 1e3
_ROUNDS = 12
#: Yielding is accepted if it leaves less than this share of the overlap.
_MAX_OVERLAP_LEFT = 0.5
#: Number of steps processed together, to limit memory.
_STEPS_AT_ONCE = 300
#: Time before and after the first overlap in which two vehicles interact, seconds; distance that
#: ends the encounter, metres; and time after which another overlap is a new encounter, seconds.
_BEFORE_S, _AFTER_S, _ENCOUNTER_END_M, _NEW_ENCOUNTER_S = 30.0, 120.0, 60.0, 10.0
#: Look-back time before a change, seconds: drivers look no farther ahead.
_LOOK_BACK_S = 12.0
#: Time over which accelerations are averaged, seconds; maximum lateral acceleration, m/s2; and
#: factor on a class's acceleration that is tolerated.
_OVER_S, _SIDEWAYS_MS2, _ACCELERATION_FACTOR = 0.5, 3.8, 1.3
#: Delay below which a vehicle counts as on time, metres.
_ON_TIME_M = 0.005
#: Delay above which the reported speed is the derivative of the position, not SUMO's, metres.
_SUMO_SPEED_DELAY_M = 0.5

Columns = dict[str, NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Before:
    """The same traffic up to the moment at which an event changes it.

    Attributes:
        stretches: for each stretch of time, by trip and step: ``trip``, ``step`` and the delay
            ``behind``, metres, after each turn of waiting (N, T).
        until: first step that may differ.
        own: actors of the event, whose motion is never changed.
        rigid: vehicles that are rigid although their trips have articulated ones.
        begin: first step that is considered; ``None``: the first of all.
    """

    stretches: tuple[Columns, ...]
    until: int
    own: frozenset[int] = frozenset()
    rigid: frozenset[int] = frozenset()
    begin: int | None = None

    def stretch(self, number: int) -> Before:
        """Return the traffic of one stretch; empty if it does not exist."""
        return replace(self, stretches=self.stretches[number : number + 1])

    def turn(self, number: int) -> Before:
        """Return the traffic of one turn of waiting, with ``behind`` (N,)."""
        stretches = tuple(
            {**columns, "behind": columns["behind"][:, number]} for columns in self.stretches
        )
        return replace(self, stretches=stretches)


def yielded(
    columns: Columns,
    moving: Moving,
    half: NDArray[np.float64],
    step_s: float,
    before: Before | None = None,
    tell: Progress = untold,
) -> Columns:
    """Return poses with fewer overlaps, within the limits of each class.

    They have a further column ``behind``: the delay relative to the original, metres.

    Args:
        columns: poses by actor and step: ``trip``, ``step``, ``xy``, ``yaw``, ``speed``,
            ``distance``, ``lane``.
        moving: classes, levels and vehicles of the actors.
        half: (N, 2) half sizes of the boxes that must not overlap, metres.
        step_s: time between steps, seconds.
        before: the same traffic up to the moment at which an event, which no driver foresees,
            changes it.
        tell: called with the fraction done (0..1) and what is being done.
    """
    if not len(columns["trip"]):
        return {**columns, "behind": np.zeros(0)}
    return _Yielding(columns, moving, half, step_s, before).run(tell)


class _Yielding:
    def __init__(
        self,
        columns: Columns,
        moving: Moving,
        half: NDArray[np.float64],
        step_s: float,
        before: Before | None,
    ) -> None:
        self.step_s, self.columns, self.before = step_s, columns, before
        actor, step = columns["trip"], columns["step"]
        self.kinds = moving.classes
        boxes = PlanBoxes(step, columns["xy"].copy(), columns["yaw"].copy(), half)
        self.moving = replace(moving, boxes=boxes)
        breaks = np.flatnonzero((np.diff(actor) != 0) | (np.diff(step) != 1)) + 1
        parts = np.split(np.arange(len(actor)), breaks)
        drawn: dict[tuple[int, int, int], list[NDArray[np.int64]]] = {}
        for rows in parts:
            key = int(moving.vehicles[actor[rows[0]]]), int(step[rows[0]]), len(rows)
            drawn.setdefault(key, []).append(rows)
        for group in drawn.values():
            group.sort(key=lambda rows: int(actor[rows[0]]))
        self.bodies = [np.array(group) for group in drawn.values()]
        self.starts = [int(step[bodies[0, 0]]) for bodies in self.bodies]
        self.whose = np.empty(len(actor), np.int64)
        for number, bodies in enumerate(self.bodies):
            self.whose[bodies.ravel()] = number
        self.ways: dict[int, Way] = {}
        #: Paths that yield to a path.
        self.followers: dict[int, set[int]] = {}
        begin = before.begin if before else None
        self.changed = np.ones(len(actor), np.bool_) if begin is None else step >= begin
        own = before.own if before else frozenset()
        self.able = np.array(
            [
                self._kind(number) in LIMITS and int(actor[bodies[0, 0]]) not in own
                for number, bodies in enumerate(self.bodies)
            ]
        )
        self.were: dict[int, NDArray[np.float64]] = {}
        before = before or Before((), 0)
        for stretch in before.stretches:
            early = stretch["step"] < before.until
            actor_ids = stretch["trip"][early]
            place = np.flatnonzero(np.diff(actor_ids, prepend=-1))
            delay_m = np.split(stretch["behind"][early], place[1:])
            self.were = (
                dict(zip(actor_ids[place].tolist(), delay_m, strict=True)) if len(place) else {}
            )

    def run(self, tell: Progress) -> Columns:
        """Let vehicles wait, one after the other, until nothing overlaps or nothing helps."""
        first = between(tell, 0.0, 0.2)
        for number in each(range(len(self.bodies)), first, "waiting for each other"):
            if self._too_hard(number) or self._begun(number).any():
                path = self._way(number)
                self._go(path, self._solved(path, (), 0, len(path.at)))
        hopeless: set[tuple[int, int, int]] = set()
        for turn in range(_ROUNDS):
            # Later rounds have less to do.
            telling = between(tell, 1 - 0.8 * 0.5**turn, 1 - 0.8 * 0.5 ** (turn + 1))
            overlaps = self._overlaps(between(telling, 0.0, 0.4))
            pending = [meeting for meeting in overlaps if meeting not in hopeless]
            if not pending:
                break
            for meeting in each(pending, between(telling, 0.4, 1.0), "waiting for each other"):
                if not self._decided(*meeting):
                    hopeless.add(meeting)
        return self._columns()

    def _begun(self, number: int) -> NDArray[np.float64]:
        """Return a vehicle's delays in its steps before a change (M,), metres."""
        rows = self.bodies[number][0]
        were = self.were.get(int(self.columns["trip"][rows[0]]), np.zeros(0))
        steps = (self.before.until if self.before else 0) - int(self.columns["step"][rows[0]])
        return were[: min(steps, len(rows))] if len(were) == steps else np.zeros(0)

    def _kind(self, number: int) -> str:
        return self.kinds[int(self.columns["trip"][self.bodies[number][0, 0]])]

    def _way(self, number: int) -> Way:
        if number not in self.ways:
            bodies, kind = self.bodies[number], self._kind(number)
            first = bodies[0]
            moved = np.hypot(*np.diff(self.columns["xy"][first], axis=0).T)
            station_m = np.concatenate([[0.0], np.cumsum(moved)])
            yaw = np.unwrap(self.columns["yaw"][first])
            speeds = curve_speeds(station_m, yaw, self.step_s)
            pace = Pace(station_m, speeds, self.step_s)
            self.ways[number] = Way(number, bodies, kind, pace, station_m, self.starts[number])
        return self.ways[number]

    def _too_hard(self, number: int) -> bool:
        """Return whether a vehicle brakes, accelerates or turns harder than its class can."""
        kind, rows = self._kind(number), self.bodies[number][0]
        over = max(round(_OVER_S / self.step_s), 1)
        if not self.able[number] or len(rows) <= 2 * over:
            return False
        limits, ahead = LIMITS[kind], self.moving.boxes.take(rows).axes[:, 0]
        pace_ms = (np.gradient(self.columns["xy"][rows], self.step_s, axis=0) * ahead).sum(axis=1)
        turn = np.gradient(np.unwrap(self.columns["yaw"][rows]), self.step_s)
        for speed in (self.columns["speed"][rows], pace_ms):
            gain = uniform_filter1d(np.gradient(speed, self.step_s), over)
            sideways = np.abs(uniform_filter1d(turn, over) * speed)
            if (
                gain.min() < -limits.brakes[-1]
                or gain.max() > limits.starts * _ACCELERATION_FACTOR
                or sideways.max() > _SIDEWAYS_MS2
            ):
                return True
        return False

    def _overlaps(self, tell: Progress) -> list[tuple[int, int, int]]:
        """Return the pairs of changed paths that overlap, with the first step of each overlap."""
        step = self.moving.boxes.step
        steps = np.unique(step[self.changed])
        self.changed[:] = False
        when: dict[tuple[int, int], list[int]] = {}
        parts = np.split(steps, np.arange(_STEPS_AT_ONCE, len(steps), _STEPS_AT_ONCE))
        for part_steps in each(parts, tell, "waiting for each other"):
            for pair, overlap_step in self._pairs(np.flatnonzero(np.isin(step, part_steps))):
                when.setdefault(pair, []).append(overlap_step)
        meetings = []
        for (first, other), overlap_steps in when.items():
            ordered = np.unique(overlap_steps)
            apart = np.flatnonzero(np.diff(ordered) > self._steps(_NEW_ENCOUNTER_S)) + 1
            meetings += [(first, other, int(part[0])) for part in np.split(ordered, apart)]
        return sorted(meetings, key=lambda meeting: (meeting[2], meeting[:2]))

    def _steps(self, seconds: float) -> int:
        return round(seconds / self.step_s)

    def _pairs(self, rows: NDArray[np.int64]) -> list[tuple[tuple[int, int], int]]:
        """Return the pairs of paths that overlap in some rows, with the step."""
        boxes, subset = self.moving.boxes, self.moving.take(rows)
        pairs = rows[subset.pairs(0.0, subset.boxes.xy)]
        path_ids = np.sort(self.whose[pairs], axis=1)
        relevant = (path_ids[:, 0] != path_ids[:, 1]) & self.able[path_ids].any(axis=1)
        pairs, path_ids = pairs[relevant], path_ids[relevant]
        deep = shared_areas(boxes, pairs) > _OVERLAP_M2
        steps = boxes.step[pairs[deep, 0]].tolist()
        return [((a, b), step) for (a, b), step in zip(path_ids[deep].tolist(), steps, strict=True)]

    def _decided(self, one: int, other: int, step: int) -> bool:
        """Let one of two overlapping vehicles wait; return whether that may help."""
        before = self._through(one, other, step)
        best: tuple[float, float, Way, NDArray[np.float64], tuple[Let, ...]] | None = None
        for path_id, first in ((one, other), (other, one)):
            if not self.able[path_id]:
                continue
            path = self._way(path_id)
            constraint = self._let(path, first, step - path.start)
            again = self._steps(_NEW_ENCOUNTER_S)
            same = [
                earlier.first == first and abs(earlier.since - constraint.since) <= again
                for earlier in path.lets
            ]
            old = [earlier for earlier, is_same in zip(path.lets, same, strict=True) if is_same]
            others = [
                earlier for earlier, is_same in zip(path.lets, same, strict=True) if not is_same
            ]
            constraints = (*others, constraint)
            span = (
                min(x.begin for x in (*old, constraint)),
                max(x.until for x in (*old, constraint)),
            )
            station_m = self._solved(path, constraints, *span)
            lost = float((path.at - station_m).sum()) * self.step_s
            left = self._through(path_id, first, step, station_m)
            cost = lost + _OVERLAP_WEIGHT * left
            if best is None or cost < best[0]:
                best = cost, left, path, station_m, constraints
        if best is None:
            return False
        _, left, path, station_m, constraints = best
        if left > before * _MAX_OVERLAP_LEFT:
            return False
        path.lets = constraints
        self.followers.setdefault(constraints[-1].first, set()).add(path.number)
        low, high = self._go(path, station_m)
        for number in sorted(self.followers.get(path.number, ())):
            self._follow(self.ways[number], path.number, low + path.start, high + path.start)
        return True

    def _follow(self, way: Way, first: int, low: int, high: int) -> None:
        """Update a vehicle's waiting for another that changed between two steps."""
        constraints, spans = [], []
        for constraint in way.lets:
            is_affected = constraint.first == first and constraint.begin + way.start < high
            if is_affected and constraint.until + way.start > low:
                spans.append((constraint.begin, constraint.until))
                constraint = self._let(way, first, constraint.since)  # noqa: PLW2901 - the updated constraint
                spans.append((constraint.begin, constraint.until))
            constraints.append(constraint)
        if spans:
            way.lets = tuple(constraints)
            span = min(begin for begin, _ in spans), max(until for _, until in spans)
            self._go(way, self._solved(way, way.lets, *span))

    def _solved(
        self, way: Way, lets: tuple[Let, ...], begin: int, until: int
    ) -> NDArray[np.float64]:
        """Return a vehicle's positions under constraints that changed within some steps."""
        bound = np.full(len(way.at), np.inf)
        for constraint in lets:
            part = bound[constraint.begin : constraint.until]
            np.minimum(part, constraint.bound, out=part)
        delay_m = self._begun(way.number)
        was = way.at.copy()
        was[: len(delay_m)] = way.pace.at[: len(delay_m)] - delay_m
        since = max(begin - self._steps(_LOOK_BACK_S), len(delay_m), 1)
        return retimed(way.pace, bound, LIMITS[way.kind], was, since, until)

    def _let(self, way: Way, first: int, since: int) -> Let:
        """Return the bound on a vehicle's position that keeps it out of another's boxes."""
        boxes = self.moving.boxes
        begin, until = self._meeting(way, first, since)
        bound = np.full(until - begin, np.inf)
        width = int(BEHIND_M / GRID_M) + 1
        # Range of possible positions during the encounter.
        low = max(int(way.pace.at[begin] / GRID_M) - width, 0)
        grid = GRID_M * np.arange(low, int(way.pace.at[until - 1] / GRID_M) + 2)
        grid = np.minimum(grid, way.pace.at[-1])
        top = np.ceil(way.pace.at[begin:until] / GRID_M).astype(int) - low
        top = np.minimum(top, len(grid) - 1)
        for body in range(len(way.bodies)):
            own = _box_rows(self._along(way, body, grid, _GAP_AHEAD_M if body == 0 else 0.0))
            for rows in self.bodies[first]:
                other_rows, after = self._during(first, rows, begin + way.start, until + way.start)
                if not len(other_rows):
                    continue
                part = slice(after - begin - way.start, after - begin - way.start + len(other_rows))
                contact_cells = first_contacts(
                    top[part], width, own, _box_rows(boxes.take(other_rows)), _LATERAL_GAP_M
                )
                np.minimum(bound[part], (contact_cells + low) * GRID_M, out=bound[part])
        # While it was ahead of the other, and not in conflict yet, there is no bound.
        early = max(since - begin, 0)
        over = bound[:early] < way.at[begin : begin + early] - 0.05
        clear = np.flatnonzero(~over)
        before = np.flatnonzero(over[: clear[-1]] if len(clear) else over)
        if len(before):
            bound[: before[-1] + 1] = np.inf
        return Let(first, since, begin, bound)

    def _during(
        self, number: int, rows: NDArray[np.int64], low: int, high: int
    ) -> tuple[NDArray[np.int64], int]:
        """Return the rows of a path between two steps of the motion, and the step of the first."""
        first = max(low, self.starts[number])
        return rows[first - self.starts[number] : max(high - self.starts[number], 0)], first

    def _meeting(self, way: Way, first: int, since: int) -> tuple[int, int]:
        """Return the range of a path's steps in which it interacts with another."""
        begin = max(since - self._steps(_BEFORE_S), 0)
        until = min(since + self._steps(_AFTER_S), len(way.at))
        rows, after = self._during(
            first, self.bodies[first][0], since + way.start, until + way.start
        )
        own = way.bodies[0, after - way.start : after - way.start + len(rows)]
        xy = self.moving.boxes.xy
        parted = np.flatnonzero(np.hypot(*(xy[rows] - xy[own]).T) > _ENCOUNTER_END_M)
        return begin, after - way.start + int(parted[0]) if len(parted) else until

    def _along(
        self,
        way: Way,
        body: int,
        at: NDArray[np.float64],
        gap_m: float,
    ) -> PlanBoxes:
        """Return a body's boxes at positions along the path, extended ahead by a gap."""
        part = way.part(float(at.min()), float(at.max()))
        xy = way.between(self.columns["xy"], body, at, part)
        yaw = way.between(self.columns["yaw"], body, at, part)
        half = self.moving.boxes.half[way.bodies[body, 0]] + np.array([gap_m / 2, 0.0])
        ahead = np.column_stack([np.cos(yaw), np.sin(yaw)])
        xy = xy + ahead * gap_m / 2
        return PlanBoxes(np.zeros(len(at), np.int64), xy, yaw, np.tile(half, (len(at), 1)))

    def _through(
        self, mine: int, first: int, step: int, at: NDArray[np.float64] | None = None
    ) -> float:
        """Return the overlap of two vehicles around a step, metres times seconds."""
        boxes, total = self.moving.boxes, 0.0
        low = max(step - self._steps(_BEFORE_S), self.starts[mine], self.starts[first])
        high = step + self._steps(_AFTER_S)
        for body, body_rows in enumerate(self.bodies[mine]):
            rows, begin = self._during(mine, body_rows, low, high)
            own_boxes = boxes.take(rows)
            if at is not None and len(rows):
                begin -= self.starts[mine]
                own_boxes = self._along(self._way(mine), body, at[begin : begin + len(rows)], 0.0)
            for others in self.bodies[first]:
                other_boxes = boxes.take(self._during(first, others, low, high)[0])
                number = np.arange(min(len(own_boxes.yaw), len(other_boxes.yaw)))
                both = PlanBoxes.joined([own_boxes, other_boxes])
                deep, _ = meetings(both, np.column_stack([number, number + len(own_boxes.yaw)]))
                total += float(np.maximum(deep, 0.0).sum()) * self.step_s
        return total

    def _go(self, way: Way, at: NDArray[np.float64]) -> tuple[int, int]:
        """Set a vehicle's positions (N,); return the range of steps that changed."""
        at = np.where(way.pace.at - at < _ON_TIME_M, way.pace.at, at)
        new = np.flatnonzero(at != way.at)
        way.at = at
        if not len(new):
            return 0, 0
        span = slice(int(new[0]), int(new[-1]) + 1)
        boxes = self.moving.boxes
        for body, rows in enumerate(way.bodies):
            changed_rows = rows[span]
            now = self._along(way, body, way.at[span], 0.0)
            self.changed[changed_rows] |= (boxes.xy[changed_rows] != now.xy).any(axis=1)
            boxes.xy[changed_rows], boxes.yaw[changed_rows] = now.xy, now.yaw
        return span.start, span.stop

    def _columns(self) -> Columns:
        """Return the columns with all vehicles at their new positions."""
        columns = {name: values.copy() for name, values in self.columns.items()}
        columns["behind"] = np.zeros(len(columns["trip"]))
        for path in self.ways.values():
            late = path.at < path.pace.at
            if not late.any():
                continue
            when = path.row_at(path.at)
            was, now = (
                np.gradient(station_m, self.step_s) for station_m in (path.pace.at, path.at)
            )
            for body, rows in enumerate(path.bodies):
                columns["behind"][rows] = path.pace.at - path.at
                for name in {"xy", "yaw", "distance", "aside"} & self.columns.keys():
                    columns[name][rows[late]] = path.between(self.columns[name], body, path.at)[
                        late
                    ]
                nearest = rows[np.round(when).astype(int)]
                columns["lane"][rows[late]] = self.columns["lane"][nearest][late]
                # SUMO's speed differs slightly from the derivative of the position.
                own = np.interp(when, np.arange(len(was)), self.columns["speed"][rows] - was)
                pace = np.interp(when, np.arange(len(was)), was)
                share = np.minimum(now / np.maximum(pace, 0.5), 1.0)
                share *= np.clip(1.0 - (path.pace.at - path.at) / _SUMO_SPEED_DELAY_M, 0.0, 1.0)
                columns["speed"][rows[late]] = np.maximum(now + own * share, 0.0)[late]
        return columns


def _box_rows(boxes: PlanBoxes) -> NDArray[np.float64]:
    """Return boxes as rows (N, 6): centre, cosine and sine of the heading, half the size."""
    heading = np.column_stack([np.cos(boxes.yaw), np.sin(boxes.yaw)])
    return np.hstack([boxes.xy, heading, boxes.half])
