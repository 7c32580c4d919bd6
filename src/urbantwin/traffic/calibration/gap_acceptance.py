"""Critical gaps: accepted and rejected gaps in the traffic with priority.

A yielding driver accepts or rejects each gap between vehicles with priority. The critical gap
itself is not observable; it lies between the longest rejected gap and the accepted one. The
maximum-likelihood lognormal distribution of such pairs is that of Troutbeck (Estimating the
critical acceptance gap from traffic movements, Queensland University of Technology, Research Report
92-5, 1992; Brilon, Koenig and Troutbeck, Transportation Research A 33, 1999).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely
from lxml import etree
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import ndtr

from urbantwin.roads import RoadNetwork
from urbantwin.traffic.calibration.passages import JunctionLinks, Passage

__all__ = ["Conflict", "Decision", "conflicts_of", "critical_gap", "decisions_of"]

#: Distance to the conflict from which a driver decides, and largest distance of its path from it,
#: metres.
_DECISION_DISTANCE_M, _PASSES_WITHIN_M = 15.0, 3.0
#: Longer gaps are ignored, seconds: a driver who rejects one has another reason (a red signal).
_MAX_GAP_S = 12.0
#: Bounds of the lognormal distribution: median in seconds, standard deviation of logarithms.
_MEDIAN_BOUNDS_S, _SPREAD_BOUNDS = (0.3, 15.0), (0.05, 0.8)


@dataclass(frozen=True, eq=False)
class Conflict:
    """Two movements over a junction that intersect.

    Attributes:
        minor: the yielding movement: (lane before, road after).
        major: the movement with priority.
        place: (2,) their intersection, site frame, metres.
    """

    minor: tuple[str, str]
    major: tuple[str, str]
    place: NDArray[np.float64]


@dataclass(frozen=True)
class Decision:
    """The decision of a yielding driver.

    Attributes:
        at_s: time at which it passed the first conflict, seconds.
        refused_s: longest rejected gap, seconds; 0 if none.
        taken_s: accepted gap; infinite if no vehicle came for long.
    """

    at_s: float
    refused_s: float
    taken_s: float


def conflicts_of(links: JunctionLinks, net: Path, roads: RoadNetwork) -> list[Conflict]:
    """Return the conflicts of movements over the main junction of which one yields to the other.

    At signals, only of movements that are green at the same time.

    Args:
        links: the movements.
        net: SUMO's network, whose junction has the rules of priority (``request``).
        roads: the same network's lanes.
    """
    junctions = etree.parse(net).getroot().iterfind("junction")
    (junction,) = (element for element in junctions if element.get("id") == links.junction)
    inner = (junction.get("intLanes") or "").split()
    lines: dict[tuple[str, str], list[NDArray[np.float64]]] = defaultdict(list)
    for lane, movement in links.ways.items():
        if lane in roads.lane_by_id:
            lines[movement].append(roads.lane_by_id[lane].centre[:, :2])
    conflicts = []
    for request in junction.iterfind("request"):
        minor = links.ways.get(inner[int(request.get("index", 0))])
        for number, bit in enumerate(reversed(request.get("response", ""))):
            major = links.ways.get(inner[number])
            if bit == "0" or minor is None or major is None or minor[0] == major[0]:
                continue
            if not links.together(minor, major):
                continue
            minor_lines, major_lines = (
                shapely.MultiLineString([part.tolist() for part in lines[movement]])
                for movement in (minor, major)
            )
            meet = shapely.get_coordinates(minor_lines.intersection(major_lines))
            if len(meet):
                conflicts.append(Conflict(minor, major, meet[0]))
    return conflicts


def decisions_of(
    passages: Sequence[Passage], conflicts: Sequence[Conflict], links: JunctionLinks
) -> list[Decision]:
    """Return the decisions of yielding drivers, in the order of the passages.

    A gap begins when a vehicle with priority is at the conflict, or when the yielding one is near
    enough to decide and has passed its signal. It ends with the next vehicle with priority.
    """
    by_way: dict[tuple[str, str], list[Passage]] = defaultdict(list)
    for passage in passages:
        by_way[passage.lane, passage.leaving].append(passage)
    times_of_conflict = []  # conflict, and times of its traffic with priority
    for conflict in conflicts:
        passing_times_s = [
            _passing_time_s(passage, conflict.place) for passage in by_way[conflict.major]
        ]
        times_of_conflict.append(
            (conflict, np.array([passed_s for passed_s in passing_times_s if passed_s is not None]))
        )
    decisions = []
    for passage in passages:
        across: list[float] = []  # times of other vehicles after the yielding one
        own: list[tuple[float, Conflict]] = []
        for conflict, times in times_of_conflict:
            if conflict.minor == (passage.lane, passage.leaving):
                passed_s = _passing_time_s(passage, conflict.place)
                if passed_s is not None:
                    across += (times - passed_s).tolist()
                    own.append((passed_s, conflict))
        if not own:
            continue
        passed_s, first = min(own, key=lambda pair: pair[0])
        is_near = np.linalg.norm(passage.seen.xy - first.place, axis=1) < _DECISION_DISTANCE_M
        ready = float(passage.seen.time_s[np.argmax(is_near)])
        if links.signals is not None:
            ready = max(ready, float(np.nan_to_num(passage.passed_s, nan=ready)))
        begins = min(ready - passed_s, 0.0)
        before = [begins, *sorted(k for k in across if begins < k <= 0)]
        refused = [b - a for a, b in pairwise(before) if b - a < _MAX_GAP_S]
        after = min((k for k in across if k > 0), default=np.inf) - before[-1]
        taken = float(after) if after < _MAX_GAP_S else np.inf
        decisions.append(Decision(passed_s, max(refused, default=0.0), taken))
    return decisions


def critical_gap(decisions: Sequence[tuple[float, float]]) -> float:
    """Return the mean critical gap of the maximum-likelihood lognormal distribution, seconds.

    Args:
        decisions: (rejected, accepted) gaps, seconds; a rejected one of 0 and an infinite accepted
            one are none. Decisions with a rejected gap longer than the accepted one are excluded.
    """
    telling = [
        intervals_s
        for intervals_s in decisions
        if intervals_s[0] < intervals_s[1] and intervals_s != (0.0, np.inf)
    ]
    pairs = np.array(telling, np.float64).reshape(-1, 2)
    if not len(pairs):
        return float("nan")

    low, high = np.log(np.maximum(pairs, 1e-9)).T

    def unlikely(values: NDArray[np.float64]) -> float:
        share = ndtr((high - values[0]) / values[1]) - ndtr((low - values[0]) / values[1])
        return -float(np.log(np.maximum(share, 1e-12)).sum())

    # There is one minimum, but the function is flat far from it: the simplex needs no gradient.
    bounds = [tuple(np.log(_MEDIAN_BOUNDS_S)), _SPREAD_BOUNDS]
    seen = np.concatenate([low[pairs[:, 0] > 0], high[np.isfinite(high)]])
    start = (float(np.clip(seen.mean(), *bounds[0])), 0.3)
    fit = minimize(unlikely, start, method="Nelder-Mead", bounds=bounds)
    middle, spread = fit.x
    return float(np.exp(middle + spread**2 / 2))


def _passing_time_s(one: Passage, place: NDArray[np.float64]) -> float | None:
    """Return when a vehicle was nearest to a point, seconds; ``None`` if it did not pass it."""
    away = np.linalg.norm(one.seen.xy - place, axis=1)
    k = int(np.argmin(away))
    if away[k] > _PASSES_WITHIN_M or k in (0, len(away) - 1):
        return None
    return float(one.seen.time_s[k])
