"""The rays of a real frame, found from the frame itself: with and without a return.

A spinning sensor fires evenly. Where two neighbouring points of a ring are some steps of azimuth
apart, the rays between them returned nothing; they point to between the two. So neither the model
of the sensor nor the phase of its encoder needs to be known, and neither does what was done to the
points to undo the vehicle's motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame

__all__ = ["FrameRays", "last_true", "rays_of"]

#: Azimuth that falls by more than this begins another ring, radians.
_BACK = 0.1
#: Rings of a file without numbers of rings: so many, each this even in elevation, radians.
_RINGS, _EVEN = (8, 300), 0.006
#: Fewer points are no ring.
_LEAST_IN_RING = 20
#: Gaps wider than this are left empty, radians: what is beyond is not between two points.
_WIDEST = 0.35


@dataclass(frozen=True, eq=False)
class FrameRays:
    """The R rays of one sensor, ring by ring, each ring by azimuth.

    Attributes:
        origin: (3,) where they leave, frame of the points.
        direction: (R, 3) unit vectors.
        range_m: (R,) where they ended; inf where nothing came back.
        point: (R,) number of the point in the frame; -1 where nothing came back.
        before: (R,) the nearest ray before it in its ring that returned.
        after: (R,) the nearest behind it.
    """

    origin: NDArray[np.float64]
    direction: NDArray[np.float64]
    range_m: NDArray[np.float64]
    point: NDArray[np.int64]
    before: NDArray[np.int64]
    after: NDArray[np.int64]


def rays_of(frame: Frame) -> list[FrameRays]:
    """Return the rays of each sensor of a frame.

    Raises:
        InputError: neither does the frame number its rings, nor are its points in their order.
    """
    sensor = np.zeros(len(frame.points), np.int64) if frame.sensor is None else frame.sensor
    places = frame.sensor_places
    found = []
    for one in np.unique(sensor):
        mine = np.flatnonzero(sensor == one)
        origin = places[min(int(one), len(places) - 1)]
        ring = None if frame.ring is None else frame.ring[mine]
        found.append(_of_sensor(frame.points[mine] - origin, ring, mine, origin, frame.name))
    return found


def _of_sensor(
    seen: NDArray[np.float64],
    ring: NDArray[np.int64] | None,
    number: NDArray[np.int64],
    origin: NDArray[np.float64],
    name: str,
) -> FrameRays:
    azimuth = np.arctan2(seen[:, 1], seen[:, 0]) % (2 * np.pi)
    flat = np.hypot(seen[:, 0], seen[:, 1])
    elevation = np.arctan2(seen[:, 2], flat)
    if ring is None:
        ring = _rings_in_order(azimuth, elevation, name)
    order = np.lexsort([azimuth, ring])
    cuts = np.flatnonzero(np.diff(ring[order])) + 1
    angles, points = [], []
    for mine in np.split(order, cuts):
        if len(mine) < _LEAST_IN_RING:
            continue
        away = np.append(np.diff(azimuth[mine]), azimuth[mine[0]] + 2 * np.pi - azimuth[mine[-1]])
        step = _step(away)
        missing = np.maximum(np.rint(away / step).astype(np.int64) - 1, 0)
        missing[away > _WIDEST] = 0
        begin = np.arange(len(mine)) + np.concatenate([[0], np.cumsum(missing)[:-1]])
        total = len(mine) + int(missing.sum())
        point = np.full(total, -1, np.int64)
        point[begin] = mine
        left = np.repeat(np.arange(len(mine)), missing + 1)
        part = (np.arange(total) - begin[left]) / (missing[left] + 1)
        right = mine[(left + 1) % len(mine)]
        up = elevation[mine[left]] + part * (elevation[right] - elevation[mine[left]])
        angles.append(np.column_stack([azimuth[mine[left]] + part * away[left], up]))
        points.append(point)
    if not points:
        raise InputError("has no ring of points", place=name, expected="a spinning sensor's frame")
    turn, up = np.concatenate(angles).T
    point = np.concatenate(points)
    before, after = [], []
    start = 0
    for one in points:
        before.append(start + last_true(one >= 0))
        after.append(start + len(one) - 1 - last_true(one[::-1] >= 0)[::-1])
        start += len(one)
    range_m = np.where(point >= 0, np.linalg.norm(seen, axis=1)[point], np.inf)
    direction = np.column_stack([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)])
    back = point >= 0
    direction[back] = seen[point[back]] / range_m[back, None]
    return FrameRays(
        origin,
        direction,
        range_m,
        np.where(back, number[point], -1),
        np.concatenate(before),
        np.concatenate(after),
    )


def last_true(good: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the place of the nearest true value before each place, round a ring."""
    place = np.where(good, np.arange(len(good)), -1)
    last = np.maximum.accumulate(place)
    end = int(last[-1])
    found = np.concatenate([[end], last[:-1]])
    return np.where(found < 0, end, found)


def _step(away: NDArray[np.float64]) -> float:
    """Return the azimuth from firing to firing: the median of the gaps that are one step."""
    usual = float(np.median(away[away > 1e-5])) if (away > 1e-5).any() else 1.0
    single = away[(away > 0.5 * usual) & (away < 1.5 * usual)]
    return float(np.median(single)) if len(single) else usual


def _rings_in_order(
    azimuth: NDArray[np.float64], elevation: NDArray[np.float64], name: str
) -> NDArray[np.int64]:
    """Return the rings (N,) of points that stand ring by ring, each by azimuth, as KITTI's do."""
    turn = np.diff(azimuth)
    if np.median(turn) < 0:
        turn = -turn
    ring = np.concatenate([[0], np.cumsum(turn < -_BACK)])
    many = np.bincount(ring)
    mean = np.bincount(ring, elevation) / many
    off = np.abs(elevation - mean[ring])
    if not _RINGS[0] <= len(many) <= _RINGS[1] or np.median(off) > _EVEN:
        raise InputError(
            "has no rings, and its points do not stand in their order",
            place=name,
            expected="a ring (channel, laser number) for every point",
        )
    return ring
