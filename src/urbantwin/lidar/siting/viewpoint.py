"""Judging places of a sensor by what it sees of its junction, and choosing among many."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import rotation_from_ypr
from urbantwin.lidar.coverage import LEVEL_M
from urbantwin.lidar.siting.field_of_view import FieldOfView
from urbantwin.lidar.siting.junction_ground import JunctionGround
from urbantwin.lidar.siting.surroundings import Surroundings
from urbantwin.progress import Progress, between, each, untold

__all__ = [
    "CLEAR_M",
    "HEIGHTS_M",
    "NEAR_M",
    "PITCHES_DEG",
    "Candidates",
    "Stance",
    "View",
    "best_view",
    "judged",
]

#: Heights at which roadside sensors are mounted, metres above the ground.
HEIGHTS_M = (5.5, 6.5, 7.5)
#: How far they look down, degrees.
PITCHES_DEG = (5.0, 10.0, 15.0)
#: Points closer to the sensor than this are lost on what is beside it, metres.
NEAR_M = 10.0
#: Nothing but its own pole is closer to a sensor, metres.
CLEAR_M = 3.0
_LOOKING = "standing the sensors"
#: Places are first judged by every so-many-th point; so many that see most are looked at closely.
_ROUGHLY, _FINALISTS = 3, 300
#: What a place loses, as a share of the junction: per share of its points that is near, for a thing
#: that is too close, and per metre that it is farther from the carriageway than usual.
_NEAR_COST, _CLOSE_COST, _OFF_COST, _USUAL_OFF_M = 1.0, 0.5, 0.01, 3.0
#: A point counts as seen though its line of sight ends so much before it, metres.
_SLACK_M = 0.3


class Candidates(NamedTuple):
    """Places where a sensor could hang, and how.

    Attributes:
        ground: (N, 3) the foot of each pole, site frame.
        off_m: (N,) how far each is from the carriageway.
        heights_m: to try at each.
        pitches: to try at each, radians.
        roll: of the sensor, radians.
    """

    ground: NDArray[np.float64]
    off_m: NDArray[np.float64]
    heights_m: tuple[float, ...]
    pitches: tuple[float, ...]
    roll: float


class Stance(NamedTuple):
    """A pose of a sensor.

    Attributes:
        place: (3,) site frame.
        height_m: above the foot of its pole.
        yaw: its heading, radians; as the next, REP-103.
        pitch: positive looks down, radians.
        roll: radians.
    """

    place: NDArray[np.float64]
    height_m: float
    yaw: float
    pitch: float
    roll: float

    def written(self) -> dict[str, float]:
        """Return it as a rig has it, but for its roll: metres and degrees."""
        return {
            "east_m": round(float(self.place[0]), 2),
            "north_m": round(float(self.place[1]), 2),
            "height_m": self.height_m,
            "yaw_deg": round(float(np.degrees(self.yaw)), 1),
            "pitch_deg": round(float(np.degrees(self.pitch)), 1),
        }


@dataclass(frozen=True, eq=False)
class View:
    """What a sensor sees.

    Attributes:
        stance: from where.
        sees: (M,) which points of the junction's ground.
        near: share (0..1) of its points that are of things, not of ground, within `NEAR_M`.
        nearest_m: to the nearest thing that is not ground.
        score: how good it is, among others at the junction.
    """

    stance: Stance
    sees: NDArray[np.bool_]
    near: float
    nearest_m: float
    score: float

    @property
    def seen(self) -> float:
        """Share (0..1) of the junction that is seen."""
        return float(self.sees.mean()) if len(self.sees) else 0.0


def best_view(
    candidates: Candidates,
    ground: JunctionGround,
    around: Surroundings,
    field: FieldOfView,
    tell: Progress = untold,
) -> View:
    """Return the best of all places, heights and pitches; the first of equals.

    Args:
        candidates: at least one.
        ground: what is to be seen.
        around: what stands in the way.
        field: of view of the sensor.
        tell: called with the fraction done (0..1) and what is being done.
    """
    found: list[tuple[float, Stance, float]] = []
    rough = replace(ground, points=ground.points[::_ROUGHLY])
    costs = _OFF_COST * np.maximum(0.0, candidates.off_m - _USUAL_OFF_M)
    places = list(zip(candidates.ground, costs.tolist(), strict=True))
    for foot, cost in each(places, between(tell, 0.0, 0.8), _LOOKING):
        toward = ground.middle - foot[:2]
        yaw = float(np.arctan2(toward[1], toward[0]))
        for height_m in candidates.heights_m:
            place = foot + [0.0, 0.0, height_m]
            free = _in_sight(place, rough, around, field)
            for pitch in candidates.pitches:
                stance = Stance(place, height_m, yaw, pitch, candidates.roll)
                lit = _lit(stance, free & _within(stance, rough, field), rough, field)
                found.append((round(lit - cost, 6), stance, cost))
    # A stable order, so that the choice does not hang on the last bit.
    found.sort(key=lambda one: -one[0])
    views = [
        judged(stance, ground, around, field, cost=cost)
        for _, stance, cost in each(found[:_FINALISTS], between(tell, 0.8, 1.0), _LOOKING)
    ]
    return max(views, key=lambda one: round(one.score, 6))


def judged(
    stance: Stance,
    ground: JunctionGround,
    around: Surroundings,
    field: FieldOfView,
    *,
    cost: float = 0.0,
) -> View:
    """Return what a sensor sees.

    Args:
        stance: its pose.
        ground: what is to be seen.
        around: what stands in the way.
        field: of view of the sensor.
        cost: what it loses for its place, as a share of the junction.
    """
    sees = _in_sight(stance.place, ground, around, field) & _within(stance, ground, field)
    at = stance.place[None, :]
    beams = field.sample @ rotation_from_ypr(*stance[2:]).T
    hits = around.cast(at, beams)
    returned = hits.range_m < field.farthest_m
    lost = returned & (hits.range_m < NEAR_M) & around.is_thing(hits)
    near = float(lost.sum() / max(int(returned.sum()), 1))
    nearest_m = float(around.nearest_thing(at).range_m[0])
    score = _lit(stance, sees, ground, field) - cost
    score -= _NEAR_COST * near + _CLOSE_COST * max(0.0, 1.0 - nearest_m / CLEAR_M)
    return View(stance, sees, near, nearest_m, score)


def _in_sight(
    place: NDArray[np.float64], ground: JunctionGround, around: Surroundings, field: FieldOfView
) -> NDArray[np.bool_]:
    """Return which points (M,) of the ground are in range and in sight from a place (3,)."""
    offset = ground.points - place
    away = np.linalg.norm(offset, axis=1)
    free = around.cast(place[None, :], offset / np.maximum(away, 1e-6)[:, None]).range_m
    return np.asarray((away <= field.farthest_m) & (free >= away - _SLACK_M))


def _within(stance: Stance, ground: JunctionGround, field: FieldOfView) -> NDArray[np.bool_]:
    """Return which points (M,) of the ground are within the field of view."""
    offset = (ground.points - stance.place) @ rotation_from_ypr(*stance[2:])
    away = np.linalg.norm(offset, axis=1)
    return field.holds(offset / np.maximum(away, 1e-6)[:, None])


def _lit(
    stance: Stance, sees: NDArray[np.bool_], ground: JunctionGround, field: FieldOfView
) -> float:
    """Return the share of the ground that is seen, less where points on it would be sparse.

    Beams lie on level ground, as points per square metre, as dense as ``per_steradian`` h / r^3,
    with h the height above it and r the range. Where that is less than one, it counts less.
    """
    if not len(ground.points):
        return 0.0
    offset = stance.place - ground.points[sees]
    range_m = np.linalg.norm(offset, axis=1)
    dense = field.per_steradian * (offset[:, 2] + LEVEL_M) / np.maximum(range_m, 1.0) ** 3
    return float(np.clip(dense, 0.0, 1.0).sum() / len(ground.points))
