"""Parting: the displacements with which actors that come near each other are apart.

See `separation` for what is minimised, under which constraints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded

from urbantwin.traffic.compiled.displacements import displaced
from urbantwin.traffic.paths.box_plan import PlanBoxes, meetings, near_pairs
from urbantwin.traffic.paths.obstacles import Blocks

__all__ = ["ASIDE_M", "GAP_M", "MOVED_M", "NEAR_M", "STANDING_MS", "Moving", "PartingPaths"]

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
