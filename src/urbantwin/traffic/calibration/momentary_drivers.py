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
_ASIDE_M, _ALIKE = 1.3, 0.4
#: Maximum gap of standing vehicles that count as a pair, metres.
_MOST_GAP_M = 6.0
#: Least speed, m/s, distance ahead, metres, and time gap, seconds, of a freely driving vehicle.
_DRIVES_MS, _FREE_M, _FREE_S = 4.0, 25.0, 3.0
#: Least number of values of a median, and of a spread.
_LEAST, _LEAST_SPREAD = 10, 20
#: Significance in standard errors; and relative error of observed heights: in recordings made by
#: this project people and bicycles appear up to 4 % taller than they are.
_SURE, _SEEN = 2.0, 0.05
#: Relative error of speeds, which is added to the standard error: they are 0.13 too low if the
#: vehicle ahead is not seen (Taipei, a recording made by this project).
_SPEED_SEEN = 0.13
#: Least number of spans of a simulation for an estimate of random differences, and of values in
#: each.
_SPANS, _OF_A_SPAN = 3, 5
#: Standard deviation of the error of gaps between completed boxes, metres.
_GAP_NOISE_M = 0.25
#: Classes with fully observed heights; lengths and widths are partly usual values.
_STATURES = ("pedestrian", "bicycle", "car")
#: Classes with the same driver parameters, which are evaluated together.
_ALIKE_CLASSES = ("car", "van")
#: Limits of desired speed factors, and of gaps, metres.
_SPEEDS, _GAPS_M = (0.5, 1.5), (0.8, 6.0)


class _Figure(NamedTuple):
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
        return abs(self.recorded - self.simulated) > _SURE * float(np.hypot(self.error, error))

    def row(self, what: str) -> dict[str, Any]:
        """Return the entry of ``calibration.json``."""
        told = {one: round(getattr(self, one), 3) for one in ("recorded", "simulated", "error")}
        return {"what": what, **told, "count": self.number}


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
    here = _within(recorded, area)
    spans = _spans(_within(simulated, area), moments)
    drivers = {name: dict(one) for name, one in (site.get("drivers") or {}).items()}
    sizes = {name: dict(one) for name, one in (site.get("size") or {}).items()}
    rows = []

    def told(what: str, of: Callable[[ObservedTracks], list[float]]) -> _Figure | None:
        found = _figure(of(here), [of(one) for one in spans])
        if found is not None:
            rows.append(found.row(what))
        return found

    gap = told("gap of who stands, m", _standing_gaps)
    if gap is not None:
        usual = float(drivers.get("car", {}).get("standing_gap_m", gap.simulated))
        asked = {}
        if gap.differs_beside():
            asked["standing_gap_m"] = _limited(usual + gap.recorded - gap.simulated, _GAPS_M)
        if gap.number >= _LEAST_SPREAD:
            spread = max(gap.spread**2 - _GAP_NOISE_M**2, 0.0) ** 0.5
            asked["standing_gap_spread_m"] = round(spread, 2)
        for name in _ALIKE_CLASSES if asked else ():
            drivers.setdefault(name, {}).update(asked)
    speed = told("speed of whom nobody holds up, m/s", _free_speeds)
    if speed is not None and speed.differs_beside(_SPEED_SEEN * speed.simulated):
        for name in _ALIKE_CLASSES:
            one = drivers.setdefault(name, {})
            share = float(one.get("speed_factor", 1.0)) * speed.recorded / speed.simulated
            one["speed_factor"] = _limited(share, _SPEEDS)
    for name in _STATURES:
        tall = told(f"height of {name}s, m", partial(_heights, actor_class=name))
        if (
            tall is not None
            and tall.differs_beside()
            and abs(tall.recorded / tall.simulated - 1) > _SEEN
        ):
            one = sizes.setdefault(name, {})
            one["height"] = round(one.get("height", 1.0) * tall.recorded / tall.simulated, 3)
    changed = {"drivers": drivers, "size": sizes}
    return {name: one for name, one in changed.items() if one}, rows


def _spans(of: ObservedTracks, moments: int) -> list[ObservedTracks]:
    """Return consecutive parts with ``moments`` times each."""
    times = np.unique(of.time_s)
    cuts = times[:: max(moments, 1)]
    part = np.searchsorted(cuts, of.time_s, side="right")
    return [of.only(part == one) for one in np.unique(part)]


def _within(of: ObservedTracks, area: shapely.Geometry) -> ObservedTracks:
    return of.only(shapely.contains_xy(area, of.xy[:, 0], of.xy[:, 1]))


def _standing_gaps(of: ObservedTracks) -> list[float]:
    """Return the gaps between cars and vans standing behind each other, by pair, metres."""
    found: dict[tuple[int, int], list[float]] = defaultdict(list)
    for behind, ahead, gap in _pairs(of, of.stands & np.isin(of.actor_class, MOTORS)):
        if 0 < gap < _MOST_GAP_M and of.actor_class[behind] in _ALIKE_CLASSES:
            found[int(of.track[behind]), int(of.track[ahead])].append(gap)
    return [float(np.median(one)) for one in found.values()]


def _free_speeds(of: ObservedTracks) -> list[float]:
    """Return the speeds of cars and vans without one close ahead, by track, m/s."""
    known = np.isfinite(of.speed) & (of.speed > _DRIVES_MS)
    free = known & np.isin(of.actor_class, _ALIKE_CLASSES)
    for behind, _, gap in _pairs(of, of.actor_class != "pedestrian"):
        if gap < max(_FREE_M, _FREE_S * of.speed[behind]):
            free[behind] = False
    return [
        float(np.median(of.speed[free & (of.track == one)])) for one in np.unique(of.track[free])
    ]


def _heights(of: ObservedTracks, actor_class: str) -> list[float]:
    """Return the heights of a class, by track, metres."""
    mine = of.only(of.actor_class == actor_class)
    _, first = np.unique(mine.track, return_index=True)
    heights = mine.size[first, 2]
    return [float(one) for one in heights[np.isfinite(heights)]]


def _pairs(of: ObservedTracks, rows: NDArray[np.bool_]) -> Iterator[tuple[int, int, float]]:
    """Yield follower, next vehicle ahead on the same lane at the same time, and gap, metres."""
    chosen = np.flatnonzero(rows)
    for moment in np.unique(of.time_s[chosen]):
        here = chosen[of.time_s[chosen] == moment]
        for one in here.tolist():
            c, s = np.cos(of.yaw[one]), np.sin(of.yaw[one])
            away = of.xy[here] - of.xy[one]
            along, aside = away @ (c, s), np.abs(away @ (-s, c))
            alike = np.abs(wrapped(of.yaw[here] - of.yaw[one])) < _ALIKE
            ahead = np.flatnonzero(alike & (aside < _ASIDE_M) & (along > 0))
            if len(ahead):
                next_one = int(ahead[along[ahead].argmin()])
                other = int(here[next_one])
                half_m = float(of.size[one, 0] + of.size[other, 0]) / 2
                yield one, other, float(along[next_one]) - half_m


def _figure(here: list[float], spans: list[list[float]]) -> _Figure | None:
    """Return medians of recording and simulation; ``None`` for too few values.

    A short observation covers one phase of the signals and few drivers: the spread among spans of
    the simulation is included in the standard error.
    """
    there = [float(np.median(one)) for one in spans if len(one) >= _OF_A_SPAN]
    if len(here) < _LEAST or len(there) < _SPANS:
        return None
    low, middle, high = np.quantile(here, [0.16, 0.5, 0.84])
    spread = float(high - low) / 2
    chance = float(np.std(there, ddof=1)) * (1 + 1 / len(there)) ** 0.5
    error = max(1.25 * spread / len(here) ** 0.5, chance)
    every = [value for one in spans for value in one]
    return _Figure(float(middle), float(np.median(every)), error, len(here), spread)


def _limited(value: float, limits: tuple[float, float]) -> float:
    return round(min(max(value, limits[0]), limits[1]), 2)
