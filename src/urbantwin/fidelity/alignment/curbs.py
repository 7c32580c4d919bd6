"""Detection of the foot of curbs in the rings of one frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter
from scipy.spatial import cKDTree

from urbantwin.fidelity.alignment.ground_plane import leveling

__all__ = ["Curbs", "above_lowest", "curbs_of"]

#: Length of a ring's arm on each side of a point, and its maximum deviation from a line, metres.
_ARM_M, _STRAIGHT_M = 0.8, 0.05
#: Maximum elevation difference of points of one ring over that length, if rings are not numbered.
_RING_DEG = 0.12
#: A ring at a curb turns at least by this angle in plan, and rises this much more than a straight
#: one (sum of both arms' slopes). This selects the foot, not the top, and no crease of a road.
_BEND_DEG, _RISE = 12.0, 0.04
#: Maximum height of a curb point above the lowest point around, metres.
_MOST_M = 0.45
_FEWEST = 4


@dataclass(frozen=True, eq=False)
class Curbs:
    """Points where rings leave the carriageway.

    Attributes:
        points: (N, 3) foot of the curb, in the frame of the points.
        road: (N, 3) unit vectors in the frame of the points, along the ring towards the road.
    """

    points: NDArray[np.float64]
    road: NDArray[np.float64]


def above_lowest(level: NDArray[np.float64], cell_m: float = 1.0) -> NDArray[np.float64]:
    """Return the height of (N, 3) level points above the lowest point in the 3 x 3 cells around."""
    if not len(level):
        return np.zeros(0)
    cell = np.floor(level[:, :2] / cell_m).astype(np.int64)
    cell -= cell.min(axis=0)
    low = np.full(cell.max(axis=0) + 1, np.inf)
    np.minimum.at(low, tuple(cell.T), level[:, 2])
    return np.asarray(level[:, 2] - minimum_filter(low, 3, mode="constant", cval=np.inf)[*cell.T])


def curbs_of(
    points: NDArray[np.float64],
    up: NDArray[np.float64],
    ring: NDArray[np.int64] | None = None,
) -> Curbs:
    """Return the points where rings bend at the foot of a curb.

    A rotating beam traces a smooth line on a road. At a curb the line climbs the face, along the
    curb, and then crosses the sidewalk: at the foot it bends in plan and upward. Height steps
    between neighbouring cells, the usual cue, do not work from a car's roof: at 15 m a ring needs
    1.5 m to climb 15 cm.

    Args:
        points: (N, 3) points of one sensor, which is at their origin, in any order.
        up: (3,) unit vector away from the ground, in the frame of the points.
        ring: (N,) ring of each point; otherwise points of similar elevation form a ring.
    """
    level = points @ leveling(up).T
    low = np.flatnonzero(above_lowest(level) < _MOST_M)
    at, level = points[low], level[low]
    count = len(low)
    first, second = _neighbours(at, None if ring is None else ring[low])
    ahead = np.arctan2(at[:, 1], at[:, 0])
    side = np.angle(np.exp(1j * (ahead[second] - ahead[first])))
    away = level[second] - level[first]
    arms = [
        _arm(first[side * sign > 0], away[side * sign > 0], count, _ARM_M) for sign in (1.0, -1.0)
    ]
    (one, fit), (other, also_fit) = arms
    plan = [arm[:, :2] / np.maximum(np.linalg.norm(arm[:, :2], axis=1), 1e-9)[:, None]
            for arm in (one, other)]  # fmt: skip
    bend = np.arccos(np.clip(-(plan[0] * plan[1]).sum(axis=1), -1.0, 1.0))
    rise = one[:, 2] + other[:, 2]
    found = fit & also_fit & (bend > np.radians(_BEND_DEG)) & (rise > _RISE)
    # The sharpest bend in a neighbourhood is the foot.
    sharp = np.where(found, bend, 0.0)
    sharpest = np.zeros(count)
    np.maximum.at(sharpest, first, sharp[second])
    feet = np.flatnonzero(found & (sharp >= sharpest))
    down = np.where((one[:, 2] < other[:, 2])[:, None], one, other)[feet]
    down[:, 2] = 0.0
    down /= np.maximum(np.linalg.norm(down, axis=1), 1e-9)[:, None]
    return Curbs(at[feet], down @ leveling(up))


def _neighbours(
    points: NDArray[np.float64], ring: NDArray[np.int64] | None
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return pairs (both ways) of nearby points of one ring."""
    if len(points) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    if ring is not None:  # a fourth coordinate separates rings
        apart = np.column_stack([points, 2.0 * _ARM_M * ring])
        pairs = cKDTree(apart).query_pairs(_ARM_M, output_type="ndarray")
    else:
        pairs = cKDTree(points).query_pairs(_ARM_M, output_type="ndarray")
        elevation = np.arcsin(points[:, 2] / np.maximum(np.linalg.norm(points, axis=1), 1e-9))
        same = np.abs(elevation[pairs[:, 0]] - elevation[pairs[:, 1]]) < np.radians(_RING_DEG)
        pairs = pairs[same]
    return np.concatenate([pairs[:, 0], pairs[:, 1]]), np.concatenate([pairs[:, 1], pairs[:, 0]])


def _arm(
    first: NDArray[np.int64], away: NDArray[np.float64], count: int, reach: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the direction (N, 3) of a ring from each point, and whether it is straight there."""
    length = np.linalg.norm(away, axis=1)
    number = np.bincount(first, minlength=count)
    arm = np.stack([np.bincount(first, away[:, k] * length, count) for k in range(3)], axis=1)
    arm = arm / np.maximum(np.linalg.norm(arm, axis=1), 1e-12)[:, None]
    beside = length**2 - (away * arm[first]).sum(axis=1) ** 2
    scatter = np.sqrt(np.maximum(np.bincount(first, beside, count), 0) / np.maximum(number, 1))
    farthest = np.zeros(count)
    np.maximum.at(farthest, first, length)
    return arm, (number >= _FEWEST) & (farthest > 0.6 * reach) & (scatter < _STRAIGHT_M)
