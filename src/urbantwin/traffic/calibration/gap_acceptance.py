"""Gap acceptance: which gaps in the traffic that has priority drivers take, and which they leave.

Of each vehicle that gives way at a junction two gaps are told: the largest that it left and the
one that it took, both from one vehicle with priority to the next at the place where their ways
meet, the first of them from its own arrival on. Its critical gap lies between. Who takes the first
gap counts, too: without them the impatient are missing. Critical gaps of drivers are taken to be
log-normal, and their mean is that of greatest likelihood (Troutbeck 1992, Estimating the critical
acceptance gap from traffic movements, Queensland University of Technology, report 92-5; found the
least biased of ten methods by Brilon, Koenig and Troutbeck 1999, Transportation Research Part A 33,
161-186).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import ndtr

from urbantwin.traffic.calibration.passages import JunctionLinks, Passage

__all__ = ["GapChoice", "critical_gap_s", "gap_choices"]

#: Where two ways come so near to each other they meet, metres.
_MEET_M = 1.0
#: Who is so near to the stop line, metres, and no faster, m/s, waits there.
_WAITS_M, _WAITS_MS = 8.0, 3.0
#: Nobody with priority for so long: the gap that is taken has no end, seconds.
_ENDLESS_S = 15.0
#: A gap shorter than this lies between vehicles beside each other, seconds.
_BESIDE_S = 0.3
#: Where drivers are not consistent, the gap that they left counts as so much of the one they took.
_JUST_BELOW = 0.99
#: Logarithms of critical gaps vary at least by this.
_LEAST_SPREAD = 0.05


@dataclass(frozen=True)
class GapChoice:
    """What one driver did.

    Attributes:
        left_s: the largest gap that it did not take, seconds; 0: it took the first.
        taken_s: the gap that it took; inf without an end.
    """

    left_s: float
    taken_s: float


def gap_choices(
    passages: Sequence[Passage], links: JunctionLinks, begin_s: float, end_s: float
) -> list[GapChoice]:
    """Return the choices of drivers who met others with priority, in the order of the passages.

    At signals a vehicle looks for a gap from when it has passed the stop line (before that it may
    wait for green), elsewhere from when it is slow before the stop line; and not before who was
    ahead of it on its lane is where the ways meet.

    Args:
        passages: over the junction.
        links: its ways, and who has priority.
        begin_s: choices that were made from this moment on.
        end_s: choices that were made before this one.
    """
    by_way: dict[tuple[str, str], list[Passage]] = defaultdict(list)
    ahead: dict[str, Passage] = {}
    before: dict[int, Passage | None] = {}
    for one in sorted(passages, key=lambda one: one.passed_s):
        by_way[one.lane, one.leaving].append(one)
        if one.lane and np.isfinite(one.passed_s):
            before[id(one)] = ahead.get(one.lane)
            ahead[one.lane] = one
    found = []
    for one in passages:
        way = (one.lane, one.leaving)
        prior = links.prior.get(way, frozenset())
        if not prior or not begin_s <= one.passed_s < end_s:
            continue
        foes = [foe for other in sorted(prior) for foe in by_way.get(other, [])]
        since = _waits_since(one, signalised=way in links.links)
        choice = _choice(one, foes, since, before.get(id(one)))
        if choice is not None:
            found.append(choice)
    return found


def _waits_since(one: Passage, *, signalised: bool) -> float:
    """Return from when a vehicle looks for a gap, seconds."""
    if signalised:
        return one.passed_s
    seen = one.seen
    line = np.array([np.interp(one.passed_s, seen.time_s, seen.xy[:, k]) for k in range(2)])
    before = seen.time_s <= one.passed_s
    near = np.linalg.norm(seen.xy - line, axis=1) < _WAITS_M + float(np.nan_to_num(_half(one)))
    waits = np.flatnonzero(before & near & (np.abs(seen.speed) < _WAITS_MS))
    return float(seen.time_s[waits[0]]) if len(waits) else one.passed_s


def _half(one: Passage) -> float:
    return float(one.seen.track.size[0]) / 2


def _choice(
    one: Passage, foes: Sequence[Passage], since_s: float, leader: Passage | None
) -> GapChoice | None:
    """Return what a driver did among vehicles with priority; ``None`` if it met none."""
    mine = _line(one)
    # When each was at the place where both ways meet, less when this one was.
    away = []
    waited = 0.0
    for foe in foes:
        theirs = _line(foe)
        if mine is None or theirs is None:
            continue
        shared = mine.intersection(theirs.buffer(_MEET_M))
        if shared.is_empty:
            continue
        place = _first_of(mine, shared)
        at, other = _when(one, place), _when(foe, place)
        away.append(other - at)
        begin_s = since_s
        if leader is not None:
            begin_s = max(begin_s, _when(leader, place))
        waited = max(waited, at - begin_s)
    times = np.sort(np.array(away))
    times = times[np.diff(times, prepend=-np.inf) > _BESIDE_S]
    gone = np.concatenate([[-waited], times[(times < 0) & (times > -waited)]])
    left = float(np.diff(gone).max(initial=0.0))
    to_come = times[(times > 0) & (times < _ENDLESS_S)]
    taken = float(to_come[0] - gone[-1]) if len(to_come) else np.inf
    return GapChoice(left, taken) if left > 0 or len(to_come) else None


def _line(one: Passage) -> shapely.LineString | None:
    """Return the way of a vehicle from its stop line on; ``None``: it is a point."""
    rows = one.seen.time_s >= one.passed_s - 1.0
    if not np.isfinite(one.passed_s) or rows.sum() < 2:
        return None
    line = shapely.LineString(one.seen.xy[rows])
    return line if line.length > 1.0 else None


def _first_of(line: shapely.LineString, shared: shapely.Geometry) -> NDArray[np.float64]:
    """Return the place (2,) along a line at which it first comes to what it shares."""
    corners = shapely.get_coordinates(shared)
    along = shapely.line_locate_point(line, shapely.points(corners))
    return np.asarray(corners[int(np.argmin(along))])


def _when(one: Passage, place: NDArray[np.float64]) -> float:
    """Return when a vehicle's middle was nearest to a place (2,), between its moments, seconds."""
    seen = one.seen
    line = shapely.LineString(seen.xy)
    gone = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(seen.xy, axis=0), axis=1))])
    return float(np.interp(line.project(shapely.Point(place)), gone, seen.time_s))


def critical_gap_s(choices: Sequence[GapChoice]) -> float:
    """Return the mean critical gap of drivers, seconds, of greatest likelihood.

    Args:
        choices: one or more.
    """
    left = np.array([one.left_s for one in choices])
    taken = np.array([one.taken_s for one in choices])
    left = np.minimum(left, _JUST_BELOW * taken)
    with np.errstate(divide="ignore"):
        low, high = np.log(left), np.log(taken)
    known = np.concatenate([low[np.isfinite(low)], high[np.isfinite(high)]])

    def unlikely(place: NDArray[np.float64]) -> float:
        spread = max(float(np.exp(place[1])), _LEAST_SPREAD)
        share = ndtr((high - place[0]) / spread) - ndtr((low - place[0]) / spread)
        return -float(np.log(np.maximum(share, 1e-12)).sum())

    start = np.array([float(np.mean(known)), np.log(0.3)])
    best = minimize(unlikely, start, method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-6})
    spread = max(float(np.exp(best.x[1])), _LEAST_SPREAD)
    return float(np.exp(best.x[0] + spread**2 / 2))
