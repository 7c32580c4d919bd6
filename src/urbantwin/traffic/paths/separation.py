"""Separation: ways of vehicles bent a little, where somebody or something is beside them.

SUMO's vehicles know of lanes, not of the shapes that lanes take where they meet, nor of who stands
at the kerb. So their ways are changed after the simulation, as little and as smoothly as it takes.
Each one's displacement minimises

    sum over time of  |d|^2 + s^4 |d''|^2  (+ very stiff d' while it stands),

with s the time within which it changes, under one constraint for each two boxes that come near
each other at a step: they are apart along one direction. It is solved by the alternating direction
method of multipliers (Boyd et al., Foundations and Trends in Machine Learning 3, 2011; for contacts
of moving bodies Overby et al., IEEE TVCG 23, 2017): the paths are banded systems, the pairs are
projections, one formula each.

Who drives goes aside as far as its lane allows; the heavier, the less. People see to themselves
(`crowd`). Where somebody has to wait, `yielding` finds who.
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

#: Room between boxes, metres.
GAP_M = 0.04
#: Less than this is no change, metres.
MOVED_M = 0.01
#: Pairs are looked after that come this near, metres.
NEAR_M = 0.3
STANDING_MS = 0.15
#: Actors move past each other at more than this, m/s, and pass on one side; else they are moved
#: apart wherever it is shortest.
_PASSING_MS = 0.4
#: Who would have to step aside by more than this, metres, goes the shortest way out: those of the
#: size of people, and beside longer ones.
ASIDE_M, _ROUND_M, _LONG_M = 1.2, 2.4, 1.2
#: No vehicle stands farther than this ahead of where it stopped, metres: it may be a stop line.
_CREEP_M = 0.3
#: Two who drive part aside if they lie less than this in each other, metres, along a way that leads
#: either of them ahead by less than this share.
_BESIDE_M, _ALONG = 0.6, 0.5
#: Who gives aside by this share goes round people who have no room.
_LIGHT = 0.05**0.5
#: Weight of the constraints against that of the paths, and rounds of both.
_RHO, _ROUNDS = 8.0, 40
_KEEP = 1e7  # weight of who is not to be moved
_STIFF_S = 100.0  # how stiffly who stands keeps to its place


@dataclass(frozen=True)
class _Give:
    """How readily a class gives way.

    Attributes:
        along: share of what a person gives, along its way.
        aside: share to the side.
        change_s: time within which it changes its way.
        most_m: farthest that it is moved, along and aside, metres.
    """

    along: float
    aside: float
    change_s: float
    most_m: tuple[float, float]


_GIVES = {
    # People go aside themselves (`crowd`).
    "pedestrian": _Give(1e-6, 1e-6, 1.0, (0.0, 0.0)),
    # Who drives goes a little aside; going later is another step (`yielding`).
    "bicycle": _Give(1e-6, 0.5, 1.0, (0.0, 1.0)),
    "motorcycle": _Give(1e-6, 0.3, 1.2, (0.0, 1.0)),
    "car": _Give(1e-6, 0.05, 1.5, (0.0, 0.8)),
    "van": _Give(1e-6, 0.05, 1.5, (0.0, 0.8)),
    "truck": _Give(1e-6, 0.02, 1.8, (0.0, 0.8)),
    "bus": _Give(1e-6, 0.02, 1.8, (0.0, 0.8)),
    # Who runs on rails stays on them.
    "tram": _Give(1e-6, 1e-6, 2.0, (0.0, 0.0)),
}
#: Bodies of a vehicle that bends stay where the joints between them hold.
_JOINED = _Give(1e-6, 1e-6, 2.0, (0.0, 0.0))


@dataclass(frozen=True, eq=False)
class Moving:
    """Where actors are, one row each and step; an actor's rows follow each other in time.

    Attributes:
        actor: (N,) whose row it is.
        boxes: in plan, at their steps.
        speed: (N,) m/s.
        level: (N,) of the road that they are on: actors of two levels never meet.
        lane: (N,) number of the lane that they are on.
        classes: the class of each actor, by its number.
        vehicles: the vehicle that each actor is a body of, by its number.
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
        """Return the pairs (P, 2) of rows that are near each other, were they at ``xy``.

        One of both at least is among those that are wanted (N,).
        """
        pairs = near_pairs(replace(self.boxes, xy=xy), within_m, wanted)
        one, other = pairs.T
        whose = self.vehicles[self.actor]
        met = (self.level[one] == self.level[other]) & (whose[one] != whose[other])
        return np.asarray(pairs[met])


class PartingPaths:
    """The paths of the actors of some rows, as banded systems; what stands follows after them.

    Args:
        moving: their rows.
        changed: (N,) which of them may be moved.
        blocks: what stands in the way.
        height: (N,) of whom they are, metres.
        step_s: time between steps.
        already: (N,) how far to the left of its own way each is at first, metres.
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
            _JOINED if one_of_many else _GIVES.get(name, _GIVES["car"])
            for name, one_of_many in zip(moving.classes, joined.tolist(), strict=True)
        ]
        kind = np.array([[one.along, one.aside, one.change_s, *one.most_m] for one in gives])[actor]
        self.on_foot = np.array([name == "pedestrian" for name in moving.classes])[actor]
        self.scale = np.sqrt(kind[:, :2])
        self.already = np.column_stack([np.zeros(len(already)), already])
        # Who is farther aside than it may be, as it was turned since, need not go back at once.
        self.most = np.maximum(kind[:, 3:], np.abs(self.already))
        self.change = kind[:, 2] / step_s
        c, s = np.cos(moving.boxes.yaw), np.sin(moving.boxes.yaw)
        #: Where displacements along and aside lead, (N, 2, 2).
        self.axes = np.stack([np.column_stack([c, s]), np.column_stack([-s, c])], axis=1)
        self.axes *= self.scale[..., None] * changed[:, None, None]

    def place(self, moved: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where displacements (N, 2) along and aside lead, (N, 2) site frame."""
        return np.asarray(self.moving.boxes.xy + np.einsum("na,nad->nd", moved, self.axes))

    def apart(self, moved: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return displacements (N, 2) nearer to those with which nobody overlaps."""
        place, count = self.place(moved), len(moved)
        pairs, way, least = self._contacts(place)
        near, beside = pairs[:, 0], np.minimum(pairs[:, 1], count)
        # How a pair's distance along its way changes with the displacements of both.
        axes = np.concatenate([self.axes, np.zeros((1, 2, 2))])
        sides = np.stack([near, beside], axis=1)
        slope = np.einsum("psad,pd->psa", axes[sides], way) * np.array([1.0, -1.0])[:, None]
        here = np.concatenate([moved, np.zeros((1, 2))])
        short = least + (slope * here[sides]).sum(axis=(1, 2))
        system = self._system()
        system[2] += _RHO * np.bincount(sides.ravel(), minlength=count + 1)[:count]
        factor = cholesky_banded(system)
        found = displaced(moved, sides, slope, short, factor, _RHO, _ROUNDS)
        low, high = (side * self.most - self.already for side in (-1.0, 1.0))
        return np.asarray(np.clip(found, low / self.scale, high / self.scale))

    def _contacts(
        self, place: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Return pairs (P, 2), the way along which they are to part, and how far yet (P,).

        The second of a pair that is no row is a block, or the place where one stopped.
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
        way, least = _ways(both, speed, np.concatenate([self.moving.actor, number]), pairs)
        over, back, beyond = self._over(place)
        border = np.column_stack([over, np.full(len(over), len(both.yaw))])
        return (
            np.concatenate([pairs, border]),
            np.concatenate([way, back]),
            np.concatenate([least, beyond]),
        )

    def _aside(self, boxes: PlanBoxes, pairs: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which pairs (P,) can part by going aside.

        Two who drive do where they go beside each other and lie little in each other; beside
        people who is light enough.
        """
        deep, way = meetings(boxes, pairs)
        ahead = boxes.axes[pairs, 0]
        along = np.abs((ahead * way[:, None]).sum(axis=2)).max(axis=1)
        beside = (deep < _BESIDE_M) & (along < _ALONG)
        afoot = self.on_foot[pairs].any(axis=1)
        light = (self.scale[pairs, 1] >= _LIGHT).any(axis=1)
        return np.asarray(np.where(afoot, light, beside))

    def _over(
        self, place: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Return who stands too far ahead (R,), the way back (R, 2), and how far (R,)."""
        ahead = self.moving.boxes.axes[:, 0]
        by = ((place - self.moving.boxes.xy) * ahead).sum(axis=1)
        stands = ~self.on_foot & (self.moving.speed < STANDING_MS)
        rows = np.flatnonzero(stands & (by > _CREEP_M))
        return rows, -ahead[rows], by[rows] - _CREEP_M

    def _system(self) -> NDArray[np.float64]:
        """Return the paths' matrix (3, N) in upper banded form: place, change, bend."""
        joined, stands = self.joined, self.moving.speed < STANDING_MS
        band = np.zeros((3, len(stands)))
        band[2] = np.where(self.kept, _KEEP, 1.0)
        # First differences, where one of both stands.
        tie = np.where(joined & (stands[1:] | stands[:-1]), (_STIFF_S / self.step_s) ** 2, 0.0)
        band[2, 1:] += tie
        band[2, :-1] += tie
        band[1, 1:] -= tie
        # Second differences.
        bend = np.where(joined[1:] & joined[:-1], self.change[1:-1] ** 4, 0.0)
        for k, weight in enumerate((1.0, 4.0, 1.0)):
            band[2, k : len(stands) - 2 + k] += weight * bend
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
    """Return along which way each pair is to part (P, 2), and how far yet (P,), metres.

    Who moves past somebody passes on the side on which they are when they are nearest, for the
    whole of the meeting; others part wherever it is shortest.
    """
    one, other = pairs.T
    _, shortest = meetings(boxes, pairs)
    velocity = speed[:, None] * boxes.axes[:, 0]
    past = velocity[one] - velocity[other]
    pace = np.hypot(*past.T)
    between = boxes.xy[one] - boxes.xy[other]
    aside = np.column_stack([-past[:, 1], past[:, 0]]) / np.maximum(pace, 1e-9)[:, None]
    offset = (aside * between).sum(axis=1)
    key = actor[one].astype(np.int64) * (int(actor.max(initial=0)) + 1) + actor[other]
    _, met = np.unique(key, return_inverse=True)
    weight = np.exp(-((between**2).sum(axis=1))) * (pace > _PASSING_MS)
    side = np.bincount(met, offset * weight)
    sign = np.where(side[met] < 0, -1.0, 1.0)
    aside *= sign[:, None]
    most = np.where(boxes.half[pairs].max(axis=(1, 2)) > _LONG_M, _ROUND_M, ASIDE_M)
    passes = (pace > _PASSING_MS) & (_reach(boxes, pairs, aside) - sign * offset < most)
    way = np.where(passes[:, None], aside, shortest)
    least = _reach(boxes, pairs, way) + GAP_M - (way * between).sum(axis=1)
    # On which side does not matter before they are beside each other.
    onward = past / np.maximum(pace, 1e-9)[:, None]
    ahead = np.abs((onward * between).sum(axis=1)) > _reach(boxes, pairs, onward) + GAP_M
    return way, np.where(passes & ahead, -np.inf, least)


def _reach(
    boxes: PlanBoxes, pairs: NDArray[np.int64], way: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the sum of what both boxes of a pair reach along a way (P,)."""
    along = np.abs(np.einsum("psad,pd->psa", boxes.axes[pairs], way))
    return np.asarray((along * boxes.half[pairs]).sum(axis=(1, 2)))


#: Paths are changed for so long before and after a meeting, seconds.
_BEFORE_S = 5.0
#: The ways along which pairs part are found anew so often, at the most.
_OUTER = 6
#: Who is bent into something that stands, by more than this, metres, keeps to its way, and the
#: others are bent anew: so often at the most.
_TOUCH_M, _TRIES = 0.04, 3


def separated(
    moving: Moving,
    blocks: Blocks,
    height: NDArray[np.float64],
    step_s: float,
    aside: NDArray[np.float64] | None = None,
    begin: int | None = None,
    tell: Progress = untold,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where actors are of whom fewer overlap (N, 2), and their speeds (N,).

    Who meets nobody, and who is on foot, keeps its path to the bit.

    Args:
        moving: everybody.
        blocks: what stands in the way, at whatever step.
        height: (N,) of each, metres.
        step_s: time between steps.
        aside: (N,) how far to the left of its own way each is already, metres; not at all where not
            given. Nobody goes farther aside in all than it may.
        begin: the first step that may be another, where it is not the first of all.
        tell: called with the fraction done (0..1) and what is being done.
    """
    xy, speed = moving.boxes.xy.copy(), moving.speed.copy()
    driving = np.array([one != "pedestrian" for one in moving.classes], np.bool_)[moving.actor]
    drives = driving if begin is None else driving & (moving.boxes.step >= begin)
    # Whom people meet among themselves changes nothing here.
    near = moving.pairs(ASIDE_M, xy, driving)
    meeting = np.zeros(len(xy), np.bool_)
    meeting[near[meetings(moving.boxes, near)[0] > -GAP_M]] = True
    rows = np.flatnonzero(drives)
    meeting[rows[blocks.beside(moving.boxes.take(rows), height[rows], 0.0)[0]]] = True
    changed = _around(moving, meeting & drives, near, step_s) & drives
    already = np.zeros(len(xy)) if aside is None else aside
    bent = xy, speed
    for attempt in range(_TRIES):
        if not changed.any():
            return xy, speed
        # The later attempts are rare.
        telling = between(tell, 1 - 0.5**attempt, 1 - 0.5 ** (attempt + 1))
        bent = _parted(moving, changed, blocks, height, step_s, already, telling)
        into = _bent_into(moving, bent[0], changed, blocks, height)
        if not into.any():
            break
        changed &= ~into
    return bent


def _parted(
    moving: Moving,
    changed: NDArray[np.bool_],
    blocks: Blocks,
    height: NDArray[np.float64],
    step_s: float,
    aside: NDArray[np.float64],
    tell: Progress,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where actors are (N, 2), and their speeds (N,), some rows (N,) being changed."""
    xy, speed = moving.boxes.xy.copy(), moving.speed.copy()
    # Whoever else comes near keeps its path, and so does everybody before and after.
    near = moving.pairs(2 * ASIDE_M, xy, changed)
    there = changed | _within(changed, moving.actor, 2)
    there |= _within(changed[::-1], moving.actor[::-1], 2)[::-1]
    there[near[changed[near].any(axis=1)]] = True
    rows = np.flatnonzero(there)
    paths = PartingPaths(
        moving.take(rows), changed[rows], blocks, height[rows], step_s, aside[rows]
    )
    moved = np.zeros((len(rows), 2))
    for _ in each(range(_OUTER), tell, "past each other"):
        before, moved = moved, paths.apart(moved)
        if np.abs(moved - before).max() < MOVED_M:
            break
    xy[rows] = paths.place(moved)
    speed[rows] = paths.speeds(moved)
    return xy, speed


def _bent_into(
    moving: Moving,
    xy: NDArray[np.float64],
    changed: NDArray[np.bool_],
    blocks: Blocks,
    height: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Return the stretches of ways, as rows (N,), that are bent into something that stands.

    Those are not that lead into something that stands as they were.
    """
    rows = np.flatnonzero(changed & (xy != moving.boxes.xy).any(axis=1))
    own = moving.boxes.take(rows)
    was, now = (
        np.unique(blocks.beside(boxes, height[rows], -_TOUCH_M)[0])
        for boxes in (own, replace(own, xy=xy[rows]))
    )
    stretch = np.cumsum(np.diff(changed, prepend=False) | (np.diff(moving.actor, prepend=-1) != 0))
    into = np.zeros(int(stretch[-1]) + 1, np.bool_)
    into[stretch[rows[now]]] = True
    into[stretch[rows[was]]] = False
    return np.asarray(into[stretch] & changed)


def _around(
    moving: Moving, meeting: NDArray[np.bool_], near: NDArray[np.int64], step_s: float
) -> NDArray[np.bool_]:
    """Return the rows (N,) that are to be changed where some rows meet somebody.

    That is a while before and after them, of whoever comes near then too; who stands is moved for
    as long as it stands.
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
    """Return which rows (N,) follow a wanted one of the same actor by so many or fewer."""
    row = np.arange(len(wanted))
    last = np.maximum.accumulate(np.where(wanted, row, -1))
    return np.asarray((last >= 0) & (row - last <= reach) & (actor[last] == actor))
