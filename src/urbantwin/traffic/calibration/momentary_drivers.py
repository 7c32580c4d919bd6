"""How those who were seen for moments stand and drive, and how tall they are.

A simulation is looked at in the same way, and what the two differ by moves what its drivers do.
Only what differs by more than chance is told.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
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
#: Told if off by so many standard errors, and by a share larger than what sizes are seen with.
_SURE, _SEEN = 2.0, 0.02
#: Gaps between completed boxes are off by so much, metres, standard deviation.
_GAP_NOISE_M = 0.25
#: Which classes' sides are as they were seen, and not the usual ones: columns of sizes.
_SIDES = {"pedestrian": ("height",), "bicycle": ("height",), "car": ("height",)}
_COLUMN = {"length": 0, "width": 1, "height": 2}
#: Classes that stand and drive alike: what is found of them together holds for each.
_ALIKE_CLASSES = ("car", "van")
#: Desired speeds and gaps are not told beyond these.
_SPEEDS, _GAPS_M = (0.5, 1.5), (0.8, 6.0)


class _Median(NamedTuple):
    """The median of something, its standard error, how many it is of, and how they spread."""

    value: float
    error: float
    number: int
    spread: float


def momentary_drivers(
    recorded: ObservedTracks,
    simulated: ObservedTracks,
    area: shapely.Geometry,
    drivers: Mapping[str, Mapping[str, Any]],
    sizes: Mapping[str, Mapping[str, float]],
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return what of a site's ``traffic`` makes who is simulated stand, drive and be as was seen.

    Args:
        recorded: what was observed.
        simulated: moments of a simulation of the site.
        area: what is seen well.
        drivers: ``traffic.drivers`` of the site that was simulated.
        sizes: ``traffic.size`` of it.

    Returns:
        ``drivers`` and ``size`` of ``traffic``, where they change; and a row of each thing that was
        looked at: both medians, standard errors, and how many there are of each.
    """
    here, there = (_within(one, area) for one in (recorded, simulated))
    own = {name: dict(one) for name, one in drivers.items()}
    tall = {name: dict(one) for name, one in sizes.items()}
    rows: list[dict[str, Any]] = []
    gaps, theirs = _median(_standing_gaps(here)), _median(_standing_gaps(there))
    if gaps and theirs:
        rows.append(_row("gap of who stands, m", gaps, theirs))
        usual = float(own.get("car", {}).get("standing_gap_m", theirs.value))
        told = {}
        if _differ(gaps, theirs):
            told["standing_gap_m"] = _round(usual + gaps.value - theirs.value, _GAPS_M)
        if gaps.number >= _LEAST_SPREAD:
            spread = np.sqrt(max(gaps.spread**2 - _GAP_NOISE_M**2, 0.0))
            told["standing_gap_spread_m"] = round(float(spread), 2)
        for name in _ALIKE_CLASSES if told else ():
            own.setdefault(name, {}).update(told)
    speeds, theirs = _median(_free_speeds(here)), _median(_free_speeds(there))
    if speeds and theirs:
        rows.append(_row("speed of whom nobody holds up, m/s", speeds, theirs))
        if _differ(speeds, theirs):
            for name in _ALIKE_CLASSES:
                usual = float(own.get(name, {}).get("speed_factor", 1.0))
                factor = _round(usual * speeds.value / theirs.value, _SPEEDS)
                own.setdefault(name, {})["speed_factor"] = factor
    for name, sides in _SIDES.items():
        for side in sides:
            seen, theirs = (_median(_sizes(one, name, side)) for one in (here, there))
            if not seen or not theirs:
                continue
            rows.append(_row(f"{side} of {name}s, m", seen, theirs))
            share = seen.value / theirs.value
            if _differ(seen, theirs) and abs(share - 1) > _SEEN:
                before = tall.get(name, {}).get(side, 1.0)
                tall.setdefault(name, {})[side] = round(before * share, 3)
    changed = {"drivers": own, "size": tall}
    return {name: one for name, one in changed.items() if one}, rows


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


def _sizes(of: ObservedTracks, actor_class: str, side: str) -> list[float]:
    """Return a side of a class, track by track, metres."""
    mine = of.actor_class == actor_class
    _, first = np.unique(of.track[mine], return_index=True)
    sizes = of.size[mine][first, _COLUMN[side]]
    return [float(one) for one in sizes[np.isfinite(sizes)]]


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


def _median(values: list[float]) -> _Median | None:
    """Return the median of enough values; ``None`` of fewer."""
    if len(values) < _LEAST:
        return None
    low, middle, high = np.quantile(values, [0.16, 0.5, 0.84])
    spread = float(high - low) / 2
    return _Median(float(middle), 1.25 * spread / len(values) ** 0.5, len(values), spread)


def _differ(one: _Median, other: _Median) -> bool:
    return abs(one.value - other.value) > _SURE * float(np.hypot(one.error, other.error))


def _round(value: float, limits: tuple[float, float]) -> float:
    return round(min(max(value, limits[0]), limits[1]), 2)


def _row(what: str, here: _Median, there: _Median) -> dict[str, Any]:
    return {
        "what": what,
        "recorded": round(here.value, 3),
        "standard_error": round(here.error, 3),
        "count": here.number,
        "simulated": round(there.value, 3),
        "simulated_count": there.number,
    }
