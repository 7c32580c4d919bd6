"""Discovery of the sensors that recorded frames, from their points alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.discovery.close_fit import closely_fitted
from urbantwin.fidelity.discovery.elevation_match import TableFit
from urbantwin.fidelity.discovery.joint_fit import draws_rings, fitted_together
from urbantwin.fidelity.discovery.point_rays import (
    PointRays,
    column_step_deg,
    columns_of,
    point_rays,
)
from urbantwin.fidelity.discovery.result import NONE_MISSED, ONE_TURN, Discovery, FoundSensor
from urbantwin.fidelity.discovery.ring_pieces import RingPieces, ring_pieces
from urbantwin.fidelity.discovery.search import FEWEST_PIECES, search_standpoints
from urbantwin.fidelity.discovery.usable_frames import (
    check_frames,
    check_ranges,
    check_standing,
)
from urbantwin.fidelity.sampling import evenly
from urbantwin.lidar import Sensor, sensor, sensor_names
from urbantwin.progress import Progress, between, untold

__all__ = ["discover", "reports_two"]

#: Points nearer than this (columns) are of one firing, and returns farther apart than this (metres,
#: half a pulse of 5 ns) are separate echoes.
_SAME, _APART_M = 0.03, 0.75
#: Gaps (columns) between points on a wrong ring, which measure chance pairs.
_CHANCE = (0.1, 0.9)
#: Minimum share of a sensor's points with a second return, and minimum ratio to chance. Of five
#: real sensors, three have 0.9 to 5 % and a ratio of 60 or more, two 0.4 % and at most 7.
_LEAST, _TIMES = 0.005, 20.0


def reports_two(
    frames: Sequence[NDArray[np.float64]],
    rays: Sequence[PointRays],
    sensor: int,
    place: NDArray[np.float64],
    step_rad: float,
) -> bool:
    """Return whether firings of a sensor have two returns.

    Args:
        frames: (N, 3) points of each frame.
        rays: rays of the same frames.
        sensor: index of the sensor in the rays.
        place: (3,) position of the sensor.
        step_rad: angle between columns.
    """
    points, twice, chance = 0, 0, 0
    for frame, one in zip(frames, rays, strict=True):
        rows = np.flatnonzero(one.sensor == sensor)
        rows = rows[np.lexsort((one.azimuth[rows], one.ring[rows]))]
        range_m = np.linalg.norm(frame[rows] - place, axis=1)
        gap = np.diff(one.azimuth[rows]) / step_rad
        echoes = (np.diff(one.ring[rows]) == 0) & (np.abs(np.diff(range_m)) > _APART_M)
        points += len(rows)
        twice += int((echoes & (gap < _SAME)).sum())
        chance += int((echoes & (gap > _CHANCE[0]) & (gap < _CHANCE[1])).sum())
    by_chance = chance * _SAME / (_CHANCE[1] - _CHANCE[0])
    return twice > max(_LEAST * points, _TIMES * by_chance)


#: Points in all frames around which pieces of rings are searched, and frames whose points are all
#: assigned to sensors for the final fit.
_SEEDS, _CLOSE_FRAMES = 60_000, 4
#: Neighbours of a point among which its piece of a ring is searched: a dozen are on its own ring,
#: others on crossing rings. The larger number is used if most points remain on no ring: with rings
#: as close as columns, few neighbours are on the same ring.
_NEIGHBOURS, _MORE = 24, 64
#: Rounds of assigning points and fitting sensors, and the initial standard deviation of elevations
#: on a ring.
_ROUNDS, _FIRST_SPREAD_DEG = 4, 0.03
#: Log posterior odds below which two models are not distinguished; and the factor by which log odds
#: are tempered, because residuals of a unit's channels are not independent.
_DECIDED, _BELIEVED = 15.0, 5.0
#: Pieces of rings that usually suffice to find a sensor.
_ENOUGH_PIECES = 400
_WITHIN_DEG = 0.05
#: The model's number of columns is used if the measured one differs by less than this share.
_LOCKED = 0.015
#: Minimum share of all points per sensor: fewer are leftovers of another sensor.
_LEAST_SHARE = 0.005
#: Quantile of the points per ring that represents a full ring.
_FULL = 0.9
#: Maximum standard deviation of a sensor's position in plan, metres.
_PLACED_M = 0.25

_T = TypeVar("_T")


def discover(
    frames: Sequence[NDArray[np.float64]],
    names: Sequence[str],
    *,
    models: Sequence[Sensor] | None = None,
    seed: int = 0,
    tell: Progress = untold,
) -> Discovery:
    """Return the positions, tilts and models of the sensors of unlabelled frames.

    Args:
        frames: (N, 3) points of each frame, metres, in one frame of reference with fixed sensors
            and z up. One frame is enough if it has many rings.
        names: names of the frames.
        models: candidate models; the catalogue's spinning sensors if not given.
        seed: seed of all random draws.
        tell: called with the fraction done and the current step.

    Raises:
        InputError: no sensor is found, with the reason: points in another unit, moving sensors,
            several places, too few frames, or no rings left.
    """
    check_frames(frames, names)
    if models is None:
        models = [one for one in map(sensor, sensor_names()) if one.pattern is None]
    found = _found(frames, names, models, _NEIGHBOURS, seed, tell)
    if found.discovery.on_rings < NONE_MISSED:
        found = _with_missed(frames, names, models, found, seed, tell)
    if found.discovery.misses:
        try:
            again = _found(frames, names, models, _MORE, seed, tell)
        except InputError:
            again = found
        found = max(found, again, key=lambda one: one.discovery.on_rings)
    close, sensors = _close_frames(frames), found.discovery.sensors
    # Points of a missed sensor lie on rings of other sensors by chance.
    if not (found.discovery.misses or found.discovery.crowded):
        check_ranges(close, found.rays, sensors)
    check_standing(close, _close_frames(names), found.rays, sensors)
    return found.discovery


@dataclass(frozen=True, eq=False)
class _Found:
    """The sensors found, their fits, and the rays of the frames with assigned points."""

    discovery: Discovery
    fits: list[list[TableFit]]
    rays: list[PointRays]


def _found(
    frames: Sequence[NDArray[np.float64]],
    names: Sequence[str],
    models: Sequence[Sensor],
    neighbours: int,
    seed: int,
    tell: Progress,
) -> _Found:
    """Return the sensors found with a given number of neighbours per point."""
    tell(0.02, "pieces of rings")
    pieces = ring_pieces(frames, _SEEDS, neighbours, seed)
    if len(pieces) < FEWEST_PIECES:
        raise InputError(
            f"no ring is left in {_counted(frames)}: {len(pieces)} pieces of lines in all",
            expected="rings as sensors draw them, on more than a few metres of ground or walls",
        )
    fits = _fits(pieces, models, seed, tell)
    found = _fitted(frames, names, fits, tell) if fits else None
    if found is None:
        raise _nothing_found(frames, len(pieces))
    return found


def _with_missed(
    frames: Sequence[NDArray[np.float64]],
    names: Sequence[str],
    models: Sequence[Sensor],
    first: _Found,
    seed: int,
    tell: Progress,
) -> _Found:
    """Return the sensors found, with further ones in the points that are on no ring.

    Where rings of many sensors cross, few neighbours of a point are on its own ring. Among the
    remaining points, most are.
    """
    left = [
        points[one.sensor < 0]
        for points, one in zip(_close_frames(frames), first.rays, strict=True)
    ]
    tell(0.02, "pieces of rings that are left")
    fits = _fits(ring_pieces(left, _SEEDS, _MORE, seed), models, seed, tell)
    known = [one[0].seen_from for one in first.fits]
    new = [one for one in fits if not any(map(one[0].seen_from.is_beside, known))]
    more = _fitted(frames, names, [*first.fits, *new], tell) if new else None
    if more is None or more.discovery.on_rings <= first.discovery.on_rings:
        return first
    return more


def _fits(
    pieces: RingPieces, models: Sequence[Sensor], seed: int, tell: Progress
) -> list[list[TableFit]]:
    """Return the fits of each sensor to pieces of rings, the likeliest first."""
    found = search_standpoints(
        pieces,
        lambda some, place: draws_rings(some, place, models),
        between(tell, 0.1, 0.45),
        seed,
    )
    return fitted_together(pieces, found, models, between(tell, 0.45, 0.75))


def _fitted(
    frames: Sequence[NDArray[np.float64]],
    names: Sequence[str],
    fits: list[list[TableFit]],
    tell: Progress,
) -> _Found | None:
    """Return the sensors fitted to points; None if none has enough points."""
    rays, sensors = _closely(_close_frames(frames), fits, between(tell, 0.75, 1.0))
    if not sensors:
        return None
    off = np.concatenate([one.off_deg for one in rays])
    on_rings = float((np.abs(np.nan_to_num(off, nan=np.inf)) < _WITHIN_DEG).mean())
    return _Found(Discovery(tuple(sensors), tuple(names), len(off), on_rings), fits, rays)


def _close_frames(every: Sequence[_T]) -> list[_T]:
    """Return the frames, or their names, whose points are assigned."""
    return [every[number] for number in evenly(len(every), _CLOSE_FRAMES)]


def _closely(
    frames: Sequence[NDArray[np.float64]], fits: Sequence[Sequence[TableFit]], tell: Progress
) -> tuple[list[PointRays], list[FoundSensor]]:
    """Return the sensor of each point, and the fitted sensors by falling number of points."""
    best = [one[0] for one in fits]
    spreads = [_FIRST_SPREAD_DEG] * len(best)
    steps = [0.2 if one.unit.model is None else 360 / one.unit.model.columns for one in best]
    measured: list[float | None] = [None] * len(best)
    for turn in range(_ROUNDS):
        tell(turn / _ROUNDS, "points on rings")
        rays = [point_rays(points, best, steps, spreads) for points in frames]
        for number in range(len(best)):
            measured[number] = column_step_deg(rays, number)
            steps[number] = measured[number] or steps[number]
        if turn < _ROUNDS - 1:
            closer = [closely_fitted(one, n, frames, rays) for n, one in enumerate(best)]
            best = [fit for fit, _ in closer]
            spreads = [spread for _, spread in closer]
    count = [sum(int((one.sensor == number).sum()) for one in rays) for number in range(len(best))]
    least = _LEAST_SHARE * sum(len(one.sensor) for one in rays)
    order = sorted(range(len(best)), key=lambda number: (-count[number], number))
    order = [number for number in order if count[number] > least and _is_placed(best[number])]
    sensors = []
    for rank, number in enumerate(order):
        models, confidence = _models(fits[number], measured[number])
        model = next((one.unit.model for one in fits[number] if one.unit.model in models), None)
        columns = round(360 / steps[number])
        offered = columns_of(model, measured[number])
        if offered is not None and abs(offered / columns - 1) < _LOCKED:
            columns = offered
        looks = _looks(rays, number, columns)
        sensors.append(
            FoundSensor(
                f"sensor-{rank + 1}",
                tuple(one.name for one in models),
                confidence,
                best[number],
                spreads[number],
                measured[number],
                columns,
                count[number],
                # In several rotations moving objects have two ranges, too.
                looks <= ONE_TURN
                and reports_two(
                    frames, rays, number, best[number].seen_from.place, 2 * np.pi / columns
                ),
                looks,
            )
        )
    place = np.full(len(best) + 1, -1)
    place[order] = np.arange(len(order))
    renamed = [
        PointRays(place[one.sensor], one.ring, one.off_deg, one.azimuth, one.sure) for one in rays
    ]
    return renamed, sensors


def _looks(rays: Sequence[PointRays], number: int, columns: int) -> float:
    """Return the number of points per frame and direction on a sensor's fullest rings."""
    ring = np.concatenate([one.ring[one.sensor == number] for one in rays])
    points = np.bincount(ring)
    return float(np.quantile(points[points > 0], _FULL)) / columns / len(rays)


def _is_placed(fit: TableFit) -> bool:
    return bool(np.sqrt(np.diag(fit.covariance)[:2]).max() < _PLACED_M)


def _models(fits: Sequence[TableFit], step_deg: float | None) -> tuple[list[Sensor], float]:
    """Return the possible models of a sensor, the likeliest first, and their joint probability.

    If the posterior odds do not decide between models, they are distinguished by azimuth
    resolution, provided that one of them offers the measured one.
    """
    if fits[0].unit.model is None:
        return [], 0.0
    every = [(one.unit.model, one.evidence) for one in fits if one.unit.model is not None]
    names = [model.name for model, _ in every]
    known = [one for n, one in enumerate(every) if one[0].name not in names[:n]]
    alike = [model for model, evidence in known if evidence > known[0][1] - _DECIDED]
    stepped = [one for one in alike if columns_of(one, step_deg) is not None]
    share = np.exp([(evidence - known[0][1]) / _BELIEVED for _, evidence in known])
    sure = sum(float(part) for (model, _), part in zip(known, share, strict=True) if model in alike)
    return stepped or alike, sure / float(share.sum())


def _counted(frames: Sequence[NDArray[np.float64]]) -> str:
    points = sum(map(len, frames))
    return f"{len(frames)} {'frame' if len(frames) == 1 else 'frames'} of {points} points"


def _nothing_found(frames: Sequence[NDArray[np.float64]], pieces: int) -> InputError:
    if pieces < _ENOUGH_PIECES:
        needed = -(-_ENOUGH_PIECES * len(frames) // pieces)
        return InputError(
            f"the rings of no sensor are found in {_counted(frames)}",
            expected=f"about {needed} frames like these",
        )
    return InputError(
        f"the rings of no sensor are found in {_counted(frames)}",
        expected="unprocessed frames of static rotating sensors",
    )
