"""Gaps, speeds and heights from short observations.

A simulation is sampled in the same way, and the difference of both corrects its drivers. Only
significant differences are used.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import wrapped
from urbantwin.traffic.calibration.passages import MOTORS
from urbantwin.traffic.observed import ObservedTracks

__all__ = ["momentary_drivers"]

#: Lateral distance, metres, and difference in heading, radians, within which vehicles are on the
#: same lane.
_SAME_LANE_M, _SAME_HEADING_RAD = 1.3, 0.4
#: Maximum gap of standing vehicles that count as a pair, metres.
_MAX_GAP_M = 6.0
#: Least speed, m/s, distance ahead, metres, and time gap, seconds, of a freely driving vehicle.
_MIN_DRIVING_MS, _FREE_DISTANCE_M, _FREE_GAP_S = 4.0, 25.0, 3.0
#: Least number of values of a median, and of a spread.
_MIN_VALUES, _MIN_SPREAD_VALUES = 10, 20
#: Significance in standard errors; and relative error of observed heights: in recordings made by
#: this project people and bicycles appear up to 4 % taller than they are.
_MIN_ERRORS, _HEIGHT_ERROR = 2.0, 0.05
#: Relative error of speeds, which is added to the standard error: they are 0.13 too low if the
#: vehicle ahead is not seen (Taipei, a recording made by this project).
_SPEED_ERROR = 0.13
#: Least number of spans of a simulation for an estimate of random differences, and of values in
#: each.
_MIN_SPANS, _MIN_OF_SPAN = 3, 5
#: Standard deviation of the error of gaps between completed boxes, metres.
_GAP_NOISE_M = 0.25
#: Classes with fully observed heights; lengths and widths are partly usual values.
_STATURES = ("pedestrian", "bicycle", "car")
#: Classes with the same driver parameters, which are evaluated together.
_ALIKE_CLASSES = ("car", "van")
#: Limits of desired speed factors, and of gaps, metres.
_SPEED_LIMITS, _GAP_LIMITS_M = (0.5, 1.5), (0.8, 6.0)


class _Comparison(NamedTuple):
    """A median, recorded and simulated.

    Attributes:
        recorded: median of ``number`` values with the standard deviation ``spread``.
        simulated: median of all values of the simulation.
        error: standard error of their difference.
        number: see above.
        spread: see above.
    """

    recorded: float
    simulated: float
    error: float
    number: int
    spread: float

    def differs_beside(self, error: float = 0.0) -> bool:
        """Return whether the difference is significant, given a further error."""
        return abs(self.recorded - self.simulated) > _MIN_ERRORS * float(
            np.hypot(self.error, error)
        )

    def row(self, what: str) -> dict[str, Any]:
        """Return the entry of ``calibration.json``."""
        values = {
            name: round(getattr(self, name), 3) for name in ("recorded", "simulated", "error")
        }
        return {"what": what, **values, "count": self.number}


def momentary_drivers(
    recorded: ObservedTracks,
    simulated: ObservedTracks,
    moments: int,
    area: shapely.Geometry,
    site: Mapping[str, Any],
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return fields of a site's ``traffic`` that match gaps, speeds and heights observed.

    Args:
        recorded: the observation.
        simulated: sampled tracks of a simulation of the site.
        moments: number of frames of the observation; spans with as many in the simulation give the
            random differences.
        area: area in which nearly all actors are seen.
        site: ``traffic`` of the simulated site.

    Returns:
        ``drivers`` and ``size`` of ``traffic``, if they change; and an entry for each statistic:
            both medians, the standard error, and the number of values.
    """
    in_area = _within(recorded, area)
    spans = _spans(_within(simulated, area), moments)
    drivers = {name: dict(values) for name, values in (site.get("drivers") or {}).items()}
    sizes = {name: dict(values) for name, values in (site.get("size") or {}).items()}
    rows = []

    def add_figure(what: str, of: Callable[[ObservedTracks], list[float]]) -> _Comparison | None:
        figure = _comparison(of(in_area), [of(span) for span in spans])
        if figure is not None:
            rows.append(figure.row(what))
        return figure

    gap = add_figure("gap of who stands, m", _standing_gaps)
    if gap is not None:
        usual = float(drivers.get("car", {}).get("standing_gap_m", gap.simulated))
        gap_fields = {}
        if gap.differs_beside():
            gap_fields["standing_gap_m"] = _limited(
                usual + gap.recorded - gap.simulated, _GAP_LIMITS_M
            )
        if gap.number >= _MIN_SPREAD_VALUES:
            spread = max(gap.spread**2 - _GAP_NOISE_M**2, 0.0) ** 0.5
            gap_fields["standing_gap_spread_m"] = round(spread, 2)
        for name in _ALIKE_CLASSES if gap_fields else ():
            drivers.setdefault(name, {}).update(gap_fields)
    speed = add_figure("speed of whom nobody holds up, m/s", _free_speeds)
    if speed is not None and speed.differs_beside(_SPEED_ERROR * speed.simulated):
        for name in _ALIKE_CLASSES:
            fields = drivers.setdefault(name, {})
            share = float(fields.get("speed_factor", 1.0)) * speed.recorded / speed.simulated
            fields["speed_factor"] = _limited(share, _SPEED_LIMITS)
    for name in _STATURES:
        tall = add_figure(f"height of {name}s, m", partial(_heights, actor_class=name))
        if (
            tall is not None
            and tall.differs_beside()
            and abs(tall.recorded / tall.simulated - 1) > _HEIGHT_ERROR
        ):
            fields = sizes.setdefault(name, {})
            fields["height"] = round(fields.get("height", 1.0) * tall.recorded / tall.simulated, 3)
    changed = {"drivers": drivers, "size": sizes}
    return {name: values for name, values in changed.items() if values}, rows


def _spans(of: ObservedTracks, moments: int) -> list[ObservedTracks]:
    """Return consecutive parts with ``moments`` times each."""
    times = np.unique(of.time_s)
    cuts = times[:: max(moments, 1)]
    part = np.searchsorted(cuts, of.time_s, side="right")
    return [of.only(part == number) for number in np.unique(part)]


def _within(of: ObservedTracks, area: shapely.Geometry) -> ObservedTracks:
    return of.only(shapely.contains_xy(area, of.xy[:, 0], of.xy[:, 1]))


def _standing_gaps(of: ObservedTracks) -> list[float]:
    """Return the gaps between cars and vans standing behind each other, by pair, metres."""
    gaps: dict[tuple[int, int], list[float]] = defaultdict(list)
    for follower, ahead, gap in _pairs(of, of.stands & np.isin(of.actor_class, MOTORS)):
        if 0 < gap < _MAX_GAP_M and of.actor_class[follower] in _ALIKE_CLASSES:
            gaps[int(of.track[follower]), int(of.track[ahead])].append(gap)
    return [float(np.median(of_pair)) for of_pair in gaps.values()]


def _free_speeds(of: ObservedTracks) -> list[float]:
    """Return the speeds of cars and vans without one close ahead, by track, m/s."""
    drives = np.isfinite(of.speed) & (of.speed > _MIN_DRIVING_MS)
    free = drives & np.isin(of.actor_class, _ALIKE_CLASSES)
    for follower, _, gap in _pairs(of, of.actor_class != "pedestrian"):
        if gap < max(_FREE_DISTANCE_M, _FREE_GAP_S * of.speed[follower]):
            free[follower] = False
    return [
        float(np.median(of.speed[free & (of.track == track)]))
        for track in np.unique(of.track[free])
    ]


def _heights(of: ObservedTracks, actor_class: str) -> list[float]:
    """Return the heights of a class, by track, metres."""
    of_class = of.only(of.actor_class == actor_class)
    _, first = np.unique(of_class.track, return_index=True)
    heights = of_class.size[first, 2]
    return [float(height) for height in heights[np.isfinite(heights)]]


def _pairs(of: ObservedTracks, rows: NDArray[np.bool_]) -> Iterator[tuple[int, int, float]]:
    """Yield follower, next vehicle ahead on the same lane at the same time, and gap, metres."""
    chosen = np.flatnonzero(rows)
    for moment in np.unique(of.time_s[chosen]):
        at_moment = chosen[of.time_s[chosen] == moment]
        for index in at_moment.tolist():
            c, s = np.cos(of.yaw[index]), np.sin(of.yaw[index])
            away = of.xy[at_moment] - of.xy[index]
            along, lateral_m = away @ (c, s), np.abs(away @ (-s, c))
            alike = np.abs(wrapped(of.yaw[at_moment] - of.yaw[index])) < _SAME_HEADING_RAD
            ahead = np.flatnonzero(alike & (lateral_m < _SAME_LANE_M) & (along > 0))
            if len(ahead):
                next_one = int(ahead[along[ahead].argmin()])
                other = int(at_moment[next_one])
                half_m = float(of.size[index, 0] + of.size[other, 0]) / 2
                yield index, other, float(along[next_one]) - half_m


def _comparison(here: list[float], spans: list[list[float]]) -> _Comparison | None:
    """Return medians of recording and simulation; ``None`` for too few values.

    A short observation covers one phase of the signals and few drivers: the spread among spans of
    the simulation is included in the standard error.
    """
    medians = [float(np.median(span)) for span in spans if len(span) >= _MIN_OF_SPAN]
    if len(here) < _MIN_VALUES or len(medians) < _MIN_SPANS:
        return None
    low, middle, high = np.quantile(here, [0.16, 0.5, 0.84])
    spread = float(high - low) / 2
    chance = float(np.std(medians, ddof=1)) * (1 + 1 / len(medians)) ** 0.5
    error = max(1.25 * spread / len(here) ** 0.5, chance)
    all_simulated = [value for span in spans for value in span]
    return _Comparison(float(middle), float(np.median(all_simulated)), error, len(here), spread)


def _limited(value: float, limits: tuple[float, float]) -> float:
    return round(min(max(value, limits[0]), limits[1]), 2)
