"""Checks of frames: points in metres, of one place, from fixed sensors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.errors import InputError
from urbantwin.fidelity.discovery.close_fit import closely_fitted
from urbantwin.fidelity.discovery.point_rays import PointRays
from urbantwin.fidelity.discovery.result import FoundSensor

__all__ = ["check_frames", "check_ranges", "check_standing"]

#: Maximum extent of nearly all points of a frame about their median, metres.
_FARTHEST_M = 1000.0
#: Width of the cells that are tested for raised objects, and the minimum height that the points of
#: a raised cell span, metres.
_CELL_M, _TALL_M = 0.5, 0.8
#: Bin size of heights, and distance from the ground of points off the ground, metres. z points down
#: if this share of the points is below the ground, and this many times those above it.
_LEVEL_M, _OFF_GROUND_M, _LEAST_BELOW, _SO_MANY_TIMES = 0.5, 1.5, 0.02, 10.0
#: Minimum share of a frame's raised cells beside one of another frame of the same place.
_SAME_PLACE = 0.5
#: Frames with fewer raised cells are not compared.
_FEWEST_CELLS = 30
#: Minimum number of a sensor's points in any frame, as a share of its maximum.
_STAYS = 0.2
#: A sensor moved if its positions in the first and the last frame differ by more than this, metres,
#: and by more than this many standard deviations.
_MOVED_M, _DEVIATIONS = 0.1, 5.0
#: Ranges beyond this multiple of the model's maximum are in another unit (a foot is 0.3 m), if more
#: than this share of the points have them.
_BEYOND, _SHARE_BEYOND = 1.15, 0.01


def check_frames(frames: Sequence[NDArray[np.float64]], names: Sequence[str]) -> None:
    """Raise an error for frames in units far from metres, upside down, or of different places.

    Raises:
        InputError: names the frame.
    """
    for points, name in zip(frames, names, strict=True):
        far = np.percentile(np.abs(points - np.median(points, axis=0)).max(axis=1), 90)
        if far > _FARTHEST_M:
            raise InputError(
                f"points of {name} are {far:.0f} m apart",
                expected="metres (are these millimetres or centimetres?)",
            )
    if frames and _is_upside_down(np.concatenate([points[:, 2] for points in frames])):
        raise InputError(
            f"most points of {names[0]} lie in the highest places", expected="z that points up"
        )
    tall = [_tall_cells(points) for points in frames]
    first = next((n for n, cells in enumerate(tall) if len(cells) >= _FEWEST_CELLS), None)
    if first is None:
        return
    tree = cKDTree(tall[first])
    for number in range(first + 1, len(frames)):
        if len(tall[number]) < _FEWEST_CELLS:
            continue
        there = tree.query(tall[number], distance_upper_bound=1.5)[0] < 1.5
        here = cKDTree(tall[number]).query(tall[first], distance_upper_bound=1.5)[0] < 1.5
        same = max(float(there.mean()), float(here.mean()))
        if same < _SAME_PLACE:
            raise InputError(
                f"{names[first]} and {names[number]} do not show the same place: "
                f"{same:.0%} of what rises from the ground is in both",
                expected="frames of static sensors, or one frame alone",
            )


def _is_upside_down(heights: NDArray[np.float64]) -> bool:
    """Return whether most points are at the ground's height, and nearly all others below it."""
    count, edges = np.histogram(
        heights, np.arange(heights.min(), heights.max() + _LEVEL_M, _LEVEL_M)
    )
    ground = edges[int(count.argmax())] + _LEVEL_M / 2
    below = (heights < ground - _OFF_GROUND_M).mean()
    above = (heights > ground + _OFF_GROUND_M).mean()
    return bool(below > _LEAST_BELOW and below > _SO_MANY_TIMES * above)


def _tall_cells(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the raised cells (T, 2)."""
    cell = np.floor(points[:, :2] / _CELL_M).astype(np.int64)
    cells, row = np.unique(cell, axis=0, return_inverse=True)
    low, high = np.full(len(cells), np.inf), np.full(len(cells), -np.inf)
    np.minimum.at(low, row.ravel(), points[:, 2])
    np.maximum.at(high, row.ravel(), points[:, 2])
    return np.asarray(cells[high - low > _TALL_M])


def check_standing(
    frames: Sequence[NDArray[np.float64]],
    names: Sequence[str],
    rays: Sequence[PointRays],
    sensors: Sequence[FoundSensor],
) -> None:
    """Raise an error if sensors moved between frames.

    A sensor that moves by more than the distance of its rings is found once per position.

    Raises:
        InputError: names the frames.
    """
    for number, one in enumerate(sensors):
        count = np.array([int((ray.sensor == number).sum()) for ray in rays])
        if count.min() < _STAYS * count.max():
            low, high = names[int(count.argmin())], names[int(count.argmax())]
            raise InputError(
                f"{one.name} has {count.max()} points in {high} and {count.min()} in {low}: the "
                "sensors moved",
                expected="frames of static sensors, or one frame alone",
            )
    if len(frames) < 2:
        return
    ends = [closely_fitted(sensors[0].fit, 0, [frames[n]], [rays[n]])[0] for n in (0, -1)]
    moved = ends[1].seen_from.place - ends[0].seen_from.place
    known = np.sqrt(sum(np.diag(one.covariance)[:3] for one in ends))
    far = np.hypot(*moved[:2])
    if far > _MOVED_M and far > _DEVIATIONS * np.hypot(*known[:2]):
        raise InputError(
            f"{sensors[0].name} moved by {far:.2f} m from {names[0]} to {names[-1]}",
            expected="frames of static sensors, or one frame alone",
        )


def check_ranges(
    frames: Sequence[NDArray[np.float64]],
    rays: Sequence[PointRays],
    sensors: Sequence[FoundSensor],
) -> None:
    """Raise an error for ranges beyond those of the model found, which are in another unit.

    Angles are the same in every unit, so rings alone do not distinguish metres from feet.

    Raises:
        InputError: gives the ranges.
    """
    for number, one in enumerate(sensors):
        model = one.fit.unit.model
        if model is None or model.range_max_m is None:
            continue
        ranges = [
            np.sqrt(((points[ray.sensor == number] - one.place) ** 2).sum(axis=1))
            for points, ray in zip(frames, rays, strict=True)
        ]
        every = np.concatenate(ranges)
        if (every > _BEYOND * model.range_max_m).mean() > _SHARE_BEYOND:
            raise InputError(
                f"{one.name}, a {model.name}, has points at {np.percentile(every, 99.9):.0f} m, "
                f"and reaches {model.range_max_m:g} m",
                expected="metres (are these feet?)",
            )
