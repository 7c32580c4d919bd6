"""Moments of a motion at which layouts are judged: the actors and the target actors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.dataset.frame_motion import FrameMotions
from urbantwin.dataset.motion_interpolation import SAME_TIME_S, posed_actors
from urbantwin.errors import InputError
from urbantwin.lidar import PosedActor
from urbantwin.lidar.sight.ground import JunctionGround
from urbantwin.traffic import Motion

__all__ = ["Moment", "Moments", "Squares", "Targets", "moments_of"]

#: First track of parked vehicles: they hide others, and are no targets.
_FIRST_PARKED = 30_001
#: Maximum number of moments: a long motion is sampled in wider steps.
_MOST_MOMENTS = 2000


@dataclass(frozen=True, eq=False)
class Moment:
    """One moment.

    Attributes:
        index: number of the rig's frame at that time.
        time_s: time of the motion, seconds.
        actors: all moving and parked actors, sorted by track.
    """

    index: int
    time_s: float
    actors: tuple[PosedActor, ...]


@dataclass(frozen=True, eq=False)
class Targets:
    """P rows, one for each actor that moves within the region at a moment.

    Attributes:
        moment: (P,) int64, number of the moment.
        actor: (P,) int64, index of the actor among the actors of the moment.
        track: (P,) int64.
        kind: (P,) class as text.
        middle: (P, 3) float64, middle of its box, site frame.
        size: (P, 3) float64, length, width and height.
        yaw: (P,) float64.
    """

    moment: NDArray[np.int64]
    actor: NDArray[np.int64]
    track: NDArray[np.int64]
    kind: NDArray[np.str_]
    middle: NDArray[np.float64]
    size: NDArray[np.float64]
    yaw: NDArray[np.float64]

    def __len__(self) -> int:
        """Return P."""
        return len(self.track)

    def class_counts(self) -> dict[str, int]:
        """Return the number of different actors of each class."""
        _, first = np.unique(self.track, return_index=True)
        names, counts = np.unique(self.kind[first], return_counts=True)
        return dict(zip(names.tolist(), counts.tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class Squares:
    """Lanes and crossings around the middle, in squares of `CELL_M`.

    Attributes:
        ground: centres of the squares, slightly above the road.
        crossing: (M,) True for squares of a crossing.
    """

    ground: JunctionGround
    crossing: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Moments:
    """The moments of a motion.

    Attributes:
        every: number of rig frames from one moment to the next.
        step_s: time between two moments, seconds.
        targets: the moving actors in the region.
    """

    every: tuple[Moment, ...]
    step_s: float
    targets: Targets


def moments_of(motion: Motion, where: shapely.Geometry, rate_hz: float, step_s: float) -> Moments:
    """Divide a motion into moments.

    Args:
        motion: the motion.
        where: region in which actors count, site frame.
        rate_hz: frames per second of the rigs that are compared.
        step_s: time between two moments, rounded to whole frames.

    Raises:
        InputError: no actor moves in the region.
    """
    every = max(1, round(step_s * rate_hz))
    times = motion.times()
    last = float(times[-1]) if len(times) else -1.0
    count = int(np.floor((last + SAME_TIME_S) * rate_hz)) + 1 if last >= 0 else 0
    every *= max(1, -(-(count // every) // _MOST_MOMENTS))
    motions = FrameMotions(motion)
    found: list[Moment] = []
    for index in range(0, count, every):
        time_s = index / rate_hz
        # A turn lasts a frame, and the last column's channels fire a little later.
        around = motions.around(time_s, 0.0, 1.1 / rate_hz)
        actors = posed_actors(around.rows, around.paths())
        actors.sort(key=lambda one: one.track)
        found.append(Moment(index, time_s, tuple(actors)))
    targets = _targets(found, where)
    if not len(targets):
        raise InputError(
            "no actor moves where actors count",
            expected="a motion with traffic in the twin's region, within reach_m of the middle",
        )
    return Moments(tuple(found), every / rate_hz, targets)


def _targets(moments: Sequence[Moment], where: shapely.Geometry) -> Targets:
    rows: list[tuple[int, int, int]] = []
    kinds: list[str] = []
    middles, sizes, yaws = [], [], []
    for number, moment in enumerate(moments):
        for k, one in enumerate(moment.actors):
            if one.track >= _FIRST_PARKED:
                continue
            pose, size = one.site_SE3_asset, one.size or (1.0, 1.0, 1.0)
            up = np.array([one.ahead_m, 0.0, size[2] / 2])
            rows.append((number, k, one.track))
            kinds.append(one.actor_class)
            middles.append(pose.apply(up))
            sizes.append(size)
            yaws.append(float(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])))
    row = np.array(rows, np.int64).reshape(-1, 3)
    middle = np.array(middles).reshape(-1, 3)
    shapely.prepare(where)
    inside = np.flatnonzero(shapely.contains_xy(where, middle[:, 0], middle[:, 1]))
    number, actor, track = row[inside].T
    return Targets(
        number,
        actor,
        track,
        np.array(kinds, str)[inside],
        middle[inside],
        np.array(sizes, np.float64).reshape(-1, 3)[inside],
        np.array(yaws, np.float64)[inside],
    )
