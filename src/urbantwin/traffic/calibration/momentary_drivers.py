"""How those who were seen for moments stand and drive, and how tall they are.

A simulation is looked at in the same way, and what the two differ by moves what its drivers do.
Only what differs by more than chance is told.
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

#: Who is less far aside, metres, and heads the same way, radians, is on the same lane.
_ASIDE_M, _ALIKE = 1.3, 0.4
#: Who stands so far ahead is not who one stands behind, metres.
_MOST_GAP_M = 6.0
#: Nobody holds up who drives so fast, m/s, with nobody so far ahead, metres, and so long, seconds.
_DRIVES_MS, _FREE_M, _FREE_S = 4.0, 25.0, 3.0
#: So many pairs, vehicles or people tell a median; and a spread, pairs.
_LEAST, _LEAST_SPREAD = 10, 20
#: Told if off by so many standard errors; and by a share larger than what heights are seen with: of
#: our own recordings people and bicycles are seen up to 4 % taller than they are.
_SURE, _SEEN = 2.0, 0.05
#: Speeds are seen 0.13 too low where who is ahead is not seen (Taipei, our own recording), and add
#: such a share of themselves to the error.
_SPEED_SEEN = 0.13
#: Spans of a simulation tell what chance does if there are so many, each with so many of them.
_SPANS, _OF_A_SPAN = 3, 5
#: Gaps between completed boxes are off by so much, metres, standard deviation.
_GAP_NOISE_M = 0.25
#: Classes whose heights are as they were seen; lengths and widths are the usual ones in part.
_STATURES = ("pedestrian", "bicycle", "car")
#: Classes that stand and drive alike: what is found of them together holds for each.
_ALIKE_CLASSES = ("car", "van")
#: Desired speeds and gaps are not told beyond these.
_SPEEDS, _GAPS_M = (0.5, 1.5), (0.8, 6.0)


class _Figure(NamedTuple):
    """A median, recorded and simulated.

    Attributes:
        recorded: the median of ``number`` values, which have the standard deviation ``spread``.
        simulated: the median of all values of the simulation.
        error: the standard error of their difference.
        number, spread: see above.
    """

    recorded: float
    simulated: float
    error: float
    number: int
    spread: float

    def differs_beside(self, error: float = 0.0) -> bool:
        """Return whether the two differ by more than chance, and another error beside it."""
        return abs(self.recorded - self.simulated) > _SURE * float(np.hypot(self.error, error))

    def row(self, what: str) -> dict[str, Any]:
        """Return it as a row of ``calibration.json``."""
        told = {one: round(getattr(self, one), 3) for one in ("recorded", "simulated", "error")}
        return {"what": what, **told, "count": self.number}


def momentary_drivers(
    recorded: ObservedTracks,
    simulated: ObservedTracks,
    moments: int,
    area: shapely.Geometry,
    site: Mapping[str, Any],
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return what of a site's ``traffic`` makes who is simulated stand, drive and be as was seen.

    Args:
        recorded: what was observed.
        simulated: moments of a simulation of the site.
        moments: how many the recording has: spans of as many in the simulation differ by chance.
        area: what is seen well.
        site: ``traffic`` of the site that was simulated.

    Returns:
        ``drivers`` and ``size`` of ``traffic``, where they change; and a row of each thing that was
        looked at: both medians, the standard error, and how many there are of each.
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
    """Return parts of so many moments one after the other."""
    times = np.unique(of.time_s)
    cuts = times[:: max(moments, 1)]
    part = np.searchsorted(cuts, of.time_s, side="right")
    return [of.only(part == one) for one in np.unique(part)]


def _within(of: ObservedTracks, area: shapely.Geometry) -> ObservedTracks:
    return of.only(shapely.contains_xy(area, of.xy[:, 0], of.xy[:, 1]))


def _standing_gaps(of: ObservedTracks) -> list[float]:
    """Return the gaps between cars and vans that stand behind each other, pair by pair, metres."""
    found: dict[tuple[int, int], list[float]] = defaultdict(list)
    for behind, ahead, gap in _pairs(of, of.stands & np.isin(of.actor_class, MOTORS)):
        if 0 < gap < _MOST_GAP_M and of.actor_class[behind] in _ALIKE_CLASSES:
            found[int(of.track[behind]), int(of.track[ahead])].append(gap)
    return [float(np.median(one)) for one in found.values()]


def _free_speeds(of: ObservedTracks) -> list[float]:
    """Return how fast cars and vans drive whom nobody holds up, track by track, m/s."""
    known = np.isfinite(of.speed) & (of.speed > _DRIVES_MS)
    free = known & np.isin(of.actor_class, _ALIKE_CLASSES)
    for behind, _, gap in _pairs(of, of.actor_class != "pedestrian"):
        if gap < max(_FREE_M, _FREE_S * of.speed[behind]):
            free[behind] = False
    return [
        float(np.median(of.speed[free & (of.track == one)])) for one in np.unique(of.track[free])
    ]


def _heights(of: ObservedTracks, actor_class: str) -> list[float]:
    """Return how tall those of a class are, track by track, metres."""
    mine = of.only(of.actor_class == actor_class)
    _, first = np.unique(mine.track, return_index=True)
    heights = mine.size[first, 2]
    return [float(one) for one in heights[np.isfinite(heights)]]


def _pairs(of: ObservedTracks, rows: NDArray[np.bool_]) -> Iterator[tuple[int, int, float]]:
    """Give who is next ahead of whom on one lane at one moment, and the gap between, metres."""
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
    """Return medians of what was recorded and of what is simulated; ``None`` of too few.

    What is seen in seconds is of one moment of the signals, and of few drivers: by how much spans
    of the simulation differ is added to the error of the median.
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
