"""Lateral separation of vehicles from others and from obstacles beside them.

SUMO's vehicles ignore the shapes of lanes where they meet, and obstacles at the kerb. So their
paths are changed after the simulation, as little and as smoothly as possible. The displacement of
each minimises

  sum over time of  |d|^2 + s^4 |d''|^2  (+ very stiff d' while standing),

with s the time of a change, under one constraint per step for each two boxes near each other: they
are apart along one direction. It is solved by the alternating direction method of multipliers (Boyd
et al., Foundations and Trends in Machine Learning 3, 2011; for contacts of moving bodies Overby et
al., IEEE TVCG 23, 2017): the paths are banded systems, the pairs are projections in closed form.

Vehicles move aside as far as their lane allows, heavier ones less. Pedestrians are handled in
`crowd`. Waiting is decided in `yielding`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded

from urbantwin.progress import Progress, between, each, untold
from urbantwin.traffic.compiled.displacements import displaced
from urbantwin.traffic.paths.box_plan import PlanBoxes, meetings, near_pairs
from urbantwin.traffic.paths.obstacles import Blocks

__all__ = [
    "ASIDE_M",
    "GAP_M",
    "MOVED_M",
    "NEAR_M",
    "STANDING_MS",
    "Moving",
    "PartingPaths",
    "separated",
]

#: Gap between boxes, metres.
GAP_M = 0.04
#: Displacement below which nothing changes, metres.
MOVED_M = 0.01
#: Distance within which pairs are considered, metres.
NEAR_M = 0.3
STANDING_MS = 0.15
#: Relative speed above which actors pass each other on one side, m/s; slower ones are separated
#: along the shortest direction.
_MIN_PASSING_MS = 0.4
#: Lateral displacement above which the shortest direction is used, metres: for small actors, and
#: beside longer ones; and half length above which an actor is long, metres.
ASIDE_M, _LONG_ASIDE_M, _LONG_HALF_LENGTH_M = 1.2, 2.4, 1.2
#: Maximum displacement ahead of a standing vehicle, metres: it may be at a stop line.
_MAX_CREEP_M = 0.3
#: Maximum overlap of two vehicles that is resolved laterally, metres, and maximum component of the
#: direction along either of them.
_BESIDE_M, _MAX_ALONG_COS = 0.6, 0.5
#: Least square root of the lateral yielding share of vehicles that avoid pedestrians.
_MIN_AVOIDING_SCALE = 0.05**0.5
#: Weight of the constraints relative to the paths, and number of rounds.
_CONSTRAINT_WEIGHT, _ROUNDS = 8.0, 40
_FIXED_WEIGHT = 1e7  # weight of fixed actors
_STIFF_S = 100.0  # stiffness of standing actors


@dataclass(frozen=True)
class _YieldLimits:
    """Readiness of a class to move.

    Attributes:
        along: share relative to a pedestrian, along its path.
        aside: share to the side.
        change_s: time of a change of its path, seconds.
        most_m: maximum displacement, along and aside, metres.
    """

    along: float
    aside: float
    change_s: float
    most_m: tuple[float, float]


_LIMITS_OF_CLASS = {
    # Pedestrians are handled in `crowd`.
    "pedestrian": _YieldLimits(1e-6, 1e-6, 1.0, (0.0, 0.0)),
    # Vehicles move a little aside; delays are decided in `yielding`.
    "bicycle": _YieldLimits(1e-6, 0.5, 1.0, (0.0, 1.0)),
    "motorcycle": _YieldLimits(1e-6, 0.3, 1.2, (0.0, 1.0)),
    "car": _YieldLimits(1e-6, 0.05, 1.5, (0.0, 0.8)),
    "van": _YieldLimits(1e-6, 0.05, 1.5, (0.0, 0.8)),
    "truck": _YieldLimits(1e-6, 0.02, 1.8, (0.0, 0.8)),
    "bus": _YieldLimits(1e-6, 0.02, 1.8, (0.0, 0.8)),
    # Trams stay on their rails.
    "tram": _YieldLimits(1e-6, 1e-6, 2.0, (0.0, 0.0)),
}
#: Bodies of an articulated vehicle are fixed by their joints.
_LIMITS_OF_JOINED = _YieldLimits(1e-6, 1e-6, 2.0, (0.0, 0.0))


@dataclass(frozen=True, eq=False)
class Moving:
    """N rows of actors, sorted by actor and time.

    Attributes:
        actor: (N,) actor of each row.
        boxes: boxes in plan, at their steps.
        speed: (N,) m/s.
        level: (N,) level of the road: actors of two levels never conflict.
        lane: (N,) index of the lane.
        classes: class of each actor.
        vehicles: vehicle that each actor is a body of.
    """

    actor: NDArray[np.integer]
    boxes: PlanBoxes
    speed: NDArray[np.float64]
    level: NDArray[np.integer]
    lane: NDArray[np.integer]
    classes: tuple[str, ...]
    vehicles: NDArray[np.integer]

    def take(self, rows: NDArray[np.integer]) -> Moving:
        """Return some rows."""
        return Moving(
            self.actor[rows],
            self.boxes.take(rows),
            self.speed[rows],
            self.level[rows],
            self.lane[rows],
            self.classes,
            self.vehicles,
        )

    @property
    def joined(self) -> NDArray[np.bool_]:
        """Whether each row is followed by the next step of the same actor (N - 1,)."""
        return np.asarray((np.diff(self.actor) == 0) & (np.diff(self.boxes.step) == 1))

    def pairs(
        self, within_m: float, xy: NDArray[np.float64], wanted: NDArray[np.bool_] | None = None
    ) -> NDArray[np.int64]:
        """Return the pairs (P, 2) of rows that are near each other at positions ``xy``.

        At least one of both is among those wanted (N,).
        """
        pairs = near_pairs(replace(self.boxes, xy=xy), within_m, wanted)
        first, second = pairs.T
        vehicle = self.vehicles[self.actor]
        relevant = (self.level[first] == self.level[second]) & (vehicle[first] != vehicle[second])
        return np.asarray(pairs[relevant])


class PartingPaths:
    """The paths of some rows, as banded systems, with obstacles appended.

    Args:
        moving: the rows.
        changed: (N,) which of them may be moved.
        blocks: obstacles.
        height: (N,) heights of the actors, metres.
        step_s: time between steps, seconds.
        already: (N,) initial displacement to the left of the own path, metres.
    """

    def __init__(
        self,
        moving: Moving,
        changed: NDArray[np.bool_],
        blocks: Blocks,
        height: NDArray[np.float64],
        step_s: float,
        already: NDArray[np.float64],
    ) -> None:
        self.moving, self.blocks, self.height, self.step_s = moving, blocks, height, step_s
        self.joined, self.kept, actor = moving.joined, ~changed, moving.actor
        _, vehicle, bodies = np.unique(moving.vehicles, return_inverse=True, return_counts=True)
        joined = bodies[vehicle] > 1
        gives = [
            _LIMITS_OF_JOINED
            if one_of_many
            else _LIMITS_OF_CLASS.get(name, _LIMITS_OF_CLASS["car"])
            for name, one_of_many in zip(moving.classes, joined.tolist(), strict=True)
        ]
        kind = np.array(
            [[limits.along, limits.aside, limits.change_s, *limits.most_m] for limits in gives]
        )[actor]
        self.on_foot = np.array([name == "pedestrian" for name in moving.classes])[actor]
        self.scale = np.sqrt(kind[:, :2])
        self.already = np.column_stack([np.zeros(len(already)), already])
        # An actor beyond its limit need not return at once.
        self.most = np.maximum(kind[:, 3:], np.abs(self.already))
        self.change = kind[:, 2] / step_s
        c, s = np.cos(moving.boxes.yaw), np.sin(moving.boxes.yaw)
        #: Directions of displacements along and aside, (N, 2, 2).
        self.axes = np.stack([np.column_stack([c, s]), np.column_stack([-s, c])], axis=1)
        self.axes *= self.scale[..., None] * changed[:, None, None]

    def place(self, moved: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the positions (N, 2) for displacements (N, 2) along and aside, site frame."""
        return np.asarray(self.moving.boxes.xy + np.einsum("na,nad->nd", moved, self.axes))

    def apart(self, moved: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return displacements (N, 2) nearer to those without overlaps."""
        place, count = self.place(moved), len(moved)
        pairs, direction, least = self._contacts(place)
        first, second = pairs[:, 0], np.minimum(pairs[:, 1], count)
        # Change of a pair's distance along its direction with the displacements of both.
        axes = np.concatenate([self.axes, np.zeros((1, 2, 2))])
        sides = np.stack([first, second], axis=1)
        slope = np.einsum("psad,pd->psa", axes[sides], direction) * np.array([1.0, -1.0])[:, None]
        displacement = np.concatenate([moved, np.zeros((1, 2))])
        short = least + (slope * displacement[sides]).sum(axis=(1, 2))
        system = self._system()
        system[2] += _CONSTRAINT_WEIGHT * np.bincount(sides.ravel(), minlength=count + 1)[:count]
        factor = cholesky_banded(system)
        separated = displaced(moved, sides, slope, short, factor, _CONSTRAINT_WEIGHT, _ROUNDS)
        low, high = (side * self.most - self.already for side in (-1.0, 1.0))
        return np.asarray(np.clip(separated, low / self.scale, high / self.scale))

    def _contacts(
        self, place: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Return pairs (P, 2), directions of separation (P, 2), and missing distances (P,).

        The second of a pair may be an obstacle, or the place where an actor stopped.
        """
        count = len(place)
        boxes, blocks = replace(self.moving.boxes, xy=place), self.blocks.boxes
        pairs = self.moving.pairs(NEAR_M, place, ~self.kept)
        pairs = pairs[self._aside(boxes, pairs)]
        free = np.flatnonzero(~self.kept)
        row, block = self.blocks.beside(boxes.take(free), self.height[free], NEAR_M)
        row = free[row]
        both = PlanBoxes.joined([boxes, blocks])
        pairs = np.concatenate([pairs, np.column_stack([row, block + count])])
        speed = np.concatenate([self.moving.speed, np.zeros(len(blocks.yaw))])
        number = np.arange(len(blocks.yaw)) + len(self.moving.classes)
        direction, least = _ways(both, speed, np.concatenate([self.moving.actor, number]), pairs)
        over, back, beyond = self._over(place)
        border = np.column_stack([over, np.full(len(over), len(both.yaw))])
        return (
            np.concatenate([pairs, border]),
            np.concatenate([direction, back]),
            np.concatenate([least, beyond]),
        )

    def _aside(self, boxes: PlanBoxes, pairs: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which pairs (P,) can be separated laterally.

        Two vehicles can if they are side by side and overlap little; beside pedestrians light
        vehicles can.
        """
        deep, direction = meetings(boxes, pairs)
        ahead = boxes.axes[pairs, 0]
        along = np.abs((ahead * direction[:, None]).sum(axis=2)).max(axis=1)
        beside = (deep < _BESIDE_M) & (along < _MAX_ALONG_COS)
        with_pedestrian = self.on_foot[pairs].any(axis=1)
        light = (self.scale[pairs, 1] >= _MIN_AVOIDING_SCALE).any(axis=1)
        return np.asarray(np.where(with_pedestrian, light, beside))

    def _over(
        self, place: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Return standing vehicles too far ahead (R,), the way back (R, 2), and distance (R,)."""
        ahead = self.moving.boxes.axes[:, 0]
        by = ((place - self.moving.boxes.xy) * ahead).sum(axis=1)
        stopped = ~self.on_foot & (self.moving.speed < STANDING_MS)
        rows = np.flatnonzero(stopped & (by > _MAX_CREEP_M))
        return rows, -ahead[rows], by[rows] - _MAX_CREEP_M

    def _system(self) -> NDArray[np.float64]:
        """Return the paths' matrix (3, N) in upper banded form: position, change, bending."""
        joined, stopped = self.joined, self.moving.speed < STANDING_MS
        band = np.zeros((3, len(stopped)))
        band[2] = np.where(self.kept, _FIXED_WEIGHT, 1.0)
        # First differences, if one of both stands.
        tie = np.where(joined & (stopped[1:] | stopped[:-1]), (_STIFF_S / self.step_s) ** 2, 0.0)
        band[2, 1:] += tie
        band[2, :-1] += tie
        band[1, 1:] -= tie
        # Second differences.
        bend = np.where(joined[1:] & joined[:-1], self.change[1:-1] ** 4, 0.0)
        for k, weight in enumerate((1.0, 4.0, 1.0)):
            band[2, k : len(stopped) - 2 + k] += weight * bend
        band[1, 1:-1] -= 2 * bend
        band[1, 2:] -= 2 * bend
        band[0, 2:] += bend
        return band

    def speeds(self, moved: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the speeds (N,) with displacements (N, 2)."""
        shift = self.place(moved) - self.moving.boxes.xy
        change = np.zeros_like(shift)
        change[1:][self.joined] = np.diff(shift, axis=0)[self.joined] / self.step_s
        ahead = self.moving.boxes.axes[:, 0]
        return np.asarray(np.maximum(self.moving.speed + (change * ahead).sum(axis=1), 0.0))


def _ways(
    boxes: PlanBoxes,
    speed: NDArray[np.float64],
    actor: NDArray[np.integer],
    pairs: NDArray[np.int64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the direction of separation of each pair (P, 2), and the missing distance (P,).

    An actor passes another on the side on which they are at the least distance, for the whole
    encounter; others are separated along the shortest direction.
    """
    first, second = pairs.T
    _, shortest = meetings(boxes, pairs)
    velocity = speed[:, None] * boxes.axes[:, 0]
    past = velocity[first] - velocity[second]
    pace = np.hypot(*past.T)
    between = boxes.xy[first] - boxes.xy[second]
    lateral = np.column_stack([-past[:, 1], past[:, 0]]) / np.maximum(pace, 1e-9)[:, None]
    offset = (lateral * between).sum(axis=1)
    key = actor[first].astype(np.int64) * (int(actor.max(initial=0)) + 1) + actor[second]
    _, meeting_id = np.unique(key, return_inverse=True)
    weight = np.exp(-((between**2).sum(axis=1))) * (pace > _MIN_PASSING_MS)
    side = np.bincount(meeting_id, offset * weight)
    sign = np.where(side[meeting_id] < 0, -1.0, 1.0)
    lateral *= sign[:, None]
    most = np.where(
        boxes.half[pairs].max(axis=(1, 2)) > _LONG_HALF_LENGTH_M, _LONG_ASIDE_M, ASIDE_M
    )
    passes = (pace > _MIN_PASSING_MS) & (
        _extents_along(boxes, pairs, lateral) - sign * offset < most
    )
    direction = np.where(passes[:, None], lateral, shortest)
    least = _extents_along(boxes, pairs, direction) + GAP_M - (direction * between).sum(axis=1)
    # The side does not matter before they are beside each other.
    onward = past / np.maximum(pace, 1e-9)[:, None]
    ahead = np.abs((onward * between).sum(axis=1)) > _extents_along(boxes, pairs, onward) + GAP_M
    return direction, np.where(passes & ahead, -np.inf, least)


def _extents_along(
    boxes: PlanBoxes, pairs: NDArray[np.int64], way: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the sum of the extents of both boxes of a pair along a direction (P,)."""
    along = np.abs(np.einsum("psad,pd->psa", boxes.axes[pairs], way))
    return np.asarray((along * boxes.half[pairs]).sum(axis=(1, 2)))


#: Time before and after an encounter in which paths are changed, seconds.
_BEFORE_S = 5.0
#: Maximum number of updates of the directions of separation.
_MAX_UPDATES = 6
#: Overlap above which a path bent into an obstacle is restored, metres, and the others solved
#: again; maximum number of attempts.
_MAX_OVERLAP_M, _MAX_ATTEMPTS = 0.04, 3


def separated(
    moving: Moving,
    blocks: Blocks,
    height: NDArray[np.float64],
    step_s: float,
    aside: NDArray[np.float64] | None = None,
    begin: int | None = None,
    tell: Progress = untold,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return positions of actors with fewer overlaps (N, 2), and their speeds (N,).

    Actors without conflicts, and pedestrians, keep their paths bit-identical.

    Args:
        moving: all actors.
        blocks: obstacles at every step.
        height: (N,) heights of the actors, metres.
        step_s: time between steps, seconds.
        aside: (N,) existing displacement to the left of the own path, metres, which counts towards
            the limit; ``None``: none.
        begin: first step that may change; ``None``: any.
        tell: called with the fraction done (0..1) and what is being done.
    """
    xy, speed = moving.boxes.xy.copy(), moving.speed.copy()
    driving = np.array([name != "pedestrian" for name in moving.classes], np.bool_)[moving.actor]
    drives = driving if begin is None else driving & (moving.boxes.step >= begin)
    # Conflicts among pedestrians change nothing here.
    pairs = moving.pairs(ASIDE_M, xy, driving)
    meeting = np.zeros(len(xy), np.bool_)
    meeting[pairs[meetings(moving.boxes, pairs)[0] > -GAP_M]] = True
    rows = np.flatnonzero(drives)
    meeting[rows[blocks.beside(moving.boxes.take(rows), height[rows], 0.0)[0]]] = True
    changed = _rows_to_change(moving, meeting & drives, pairs, step_s) & drives
    already = np.zeros(len(xy)) if aside is None else aside
    bent = xy, speed
    for attempt in range(_MAX_ATTEMPTS):
        if not changed.any():
            return xy, speed
        # Later attempts are rare.
        telling = between(tell, 1 - 0.5**attempt, 1 - 0.5 ** (attempt + 1))
        bent = _separated_rows(moving, changed, blocks, height, step_s, already, telling)
        into = _rows_into_obstacles(moving, bent[0], changed, blocks, height)
        if not into.any():
            break
        changed &= ~into
    return bent


def _separated_rows(
    moving: Moving,
    changed: NDArray[np.bool_],
    blocks: Blocks,
    height: NDArray[np.float64],
    step_s: float,
    aside: NDArray[np.float64],
    tell: Progress,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return positions (N, 2) and speeds (N,) of actors with some rows (N,) changed."""
    xy, speed = moving.boxes.xy.copy(), moving.speed.copy()
    # Other actors nearby keep their paths, and so do all actors before and after.
    pairs = moving.pairs(2 * ASIDE_M, xy, changed)
    involved = changed | _within(changed, moving.actor, 2)
    involved |= _within(changed[::-1], moving.actor[::-1], 2)[::-1]
    involved[pairs[changed[pairs].any(axis=1)]] = True
    rows = np.flatnonzero(involved)
    paths = PartingPaths(
        moving.take(rows), changed[rows], blocks, height[rows], step_s, aside[rows]
    )
    moved = np.zeros((len(rows), 2))
    for _ in each(range(_MAX_UPDATES), tell, "past each other"):
        before, moved = moved, paths.apart(moved)
        if np.abs(moved - before).max() < MOVED_M:
            break
    xy[rows] = paths.place(moved)
    speed[rows] = paths.speeds(moved)
    return xy, speed


def _rows_into_obstacles(
    moving: Moving,
    xy: NDArray[np.float64],
    changed: NDArray[np.bool_],
    blocks: Blocks,
    height: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Return the stretches of paths, as rows (N,), that are bent into an obstacle.

    Stretches that already overlapped an obstacle are excluded.
    """
    rows = np.flatnonzero(changed & (xy != moving.boxes.xy).any(axis=1))
    own = moving.boxes.take(rows)
    was, now = (
        np.unique(blocks.beside(boxes, height[rows], -_MAX_OVERLAP_M)[0])
        for boxes in (own, replace(own, xy=xy[rows]))
    )
    stretch = np.cumsum(np.diff(changed, prepend=False) | (np.diff(moving.actor, prepend=-1) != 0))
    into = np.zeros(int(stretch[-1]) + 1, np.bool_)
    into[stretch[rows[now]]] = True
    into[stretch[rows[was]]] = False
    return np.asarray(into[stretch] & changed)


def _rows_to_change(
    moving: Moving, meeting: NDArray[np.bool_], near: NDArray[np.int64], step_s: float
) -> NDArray[np.bool_]:
    """Return the rows (N,) to change because some rows have conflicts.

    They include a time before and after, and other actors nearby; standing actors are moved for the
    whole time of standing.
    """
    reach = round(_BEFORE_S / step_s)
    still = moving.speed < STANDING_MS
    stay = np.cumsum(np.concatenate([[True], ~(moving.joined & still[1:] & still[:-1])]))
    wanted = meeting.copy()
    for _ in range(2):
        stays = np.zeros(int(stay[-1]) + 1, np.bool_)
        stays[stay[wanted & still]] = True
        wanted |= stays[stay] & still
        wanted |= (
            _within(wanted, moving.actor, reach)
            | _within(wanted[::-1], moving.actor[::-1], reach)[::-1]
        )
        wanted[near[wanted[near].any(axis=1)]] = True
    return wanted


def _within(wanted: NDArray[np.bool_], actor: NDArray[np.integer], reach: int) -> NDArray[np.bool_]:
    """Return which rows (N,) follow a wanted one of the same actor within ``reach`` rows."""
    row = np.arange(len(wanted))
    last = np.maximum.accumulate(np.where(wanted, row, -1))
    return np.asarray((last >= 0) & (row - last <= reach) & (actor[last] == actor))
