"""Critical gaps: which gaps in the traffic that has priority are taken, and which are not.

Who has to give way decides for each gap between those who come across: it is taken or it is not.
Nobody's critical gap is seen, only that it lies between the longest gap that was refused and the
one that was taken. The likeliest lognormal distribution of such pairs is that of Troutbeck
(Estimating the critical acceptance gap from traffic movements, Queensland University of Technology,
Research Report 92-5, 1992; Brilon, Koenig and Troutbeck, Transportation Research A 33, 1999).
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

#: Who is so near to the conflict decides, metres, and passes it within so much of its path.
_DECIDES_M, _BESIDE_M = 15.0, 3.0
#: Longer gaps are left out, seconds: whoever refuses one has another reason (a red signal).
_LONG_S = 12.0
#: Bounds of the lognormal distribution: its median in seconds, its deviation in logarithms.
_MEDIAN_S, _SPREAD = (0.3, 15.0), (0.05, 0.8)


@dataclass(frozen=True, eq=False)
class Conflict:
    """Two ways over a junction that meet.

    Attributes:
        minor: the way that gives way: (lane before, road after).
        major: the way that has priority.
        place: (2,) where they meet, site frame, metres.
    """

    minor: tuple[str, str]
    major: tuple[str, str]
    place: NDArray[np.float64]


@dataclass(frozen=True)
class Decision:
    """What one who had to give way did.

    Attributes:
        at_s: when it passed the first who came across, seconds.
        refused_s: the longest gap that it refused, seconds; 0 if none.
        taken_s: the gap that it took; infinite if nobody came for long.
    """

    at_s: float
    refused_s: float
    taken_s: float


def conflicts_of(links: JunctionLinks, net: Path, roads: RoadNetwork) -> list[Conflict]:
    """Return where ways over the main junction meet of which one gives way to the other.

    At signals, of ways that are green at the same time: others wait for the signal.

    Args:
        links: the ways.
        net: SUMO's network, whose junction says who yields to whom (``request``).
        roads: the same network's lanes.
    """
    junctions = etree.parse(net).getroot().iterfind("junction")
    (junction,) = (one for one in junctions if one.get("id") == links.junction)
    inner = (junction.get("intLanes") or "").split()
    lines: dict[tuple[str, str], list[NDArray[np.float64]]] = defaultdict(list)
    for lane, way in links.ways.items():
        if lane in roads.lane_by_id:
            lines[way].append(roads.lane_by_id[lane].centre[:, :2])
    found = []
    for request in junction.iterfind("request"):
        minor = links.ways.get(inner[int(request.get("index", 0))])
        for number, bit in enumerate(reversed(request.get("response", ""))):
            major = links.ways.get(inner[number])
            if bit == "0" or minor is None or major is None or minor[0] == major[0]:
                continue
            if not links.together(minor, major):
                continue
            one, other = (
                shapely.MultiLineString([part.tolist() for part in lines[way]])
                for way in (minor, major)
            )
            meet = shapely.get_coordinates(one.intersection(other))
            if len(meet):
                found.append(Conflict(minor, major, meet[0]))
    return found


def decisions_of(
    passages: Sequence[Passage], conflicts: Sequence[Conflict], links: JunctionLinks
) -> list[Decision]:
    """Return what those decided who had to give way, in the order of the passages.

    A gap begins when one who has priority is where the ways meet, or when who gives way is near
    enough to decide and has passed its signal; it ends with the next who has priority.
    """
    by_way: dict[tuple[str, str], list[Passage]] = defaultdict(list)
    for one in passages:
        by_way[one.lane, one.leaving].append(one)
    met = []  # conflict, and when each of its traffic with priority is there
    for conflict in conflicts:
        there = [_there_s(one, conflict.place) for one in by_way[conflict.major]]
        met.append((conflict, np.array([at for at in there if at is not None])))
    found = []
    for one in passages:
        across: list[float] = []  # when others come, after who gives way is there itself
        own: list[tuple[float, Conflict]] = []
        for conflict, times in met:
            if conflict.minor == (one.lane, one.leaving):
                at = _there_s(one, conflict.place)
                if at is not None:
                    across += (times - at).tolist()
                    own.append((at, conflict))
        if not own:
            continue
        at, first = min(own, key=lambda pair: pair[0])
        near = np.linalg.norm(one.seen.xy - first.place, axis=1) < _DECIDES_M
        ready = float(one.seen.time_s[np.argmax(near)])
        if links.signals is not None:
            ready = max(ready, float(np.nan_to_num(one.passed_s, nan=ready)))
        begins = min(ready - at, 0.0)
        before = [begins, *sorted(k for k in across if begins < k <= 0)]
        refused = [b - a for a, b in pairwise(before) if b - a < _LONG_S]
        after = min((k for k in across if k > 0), default=np.inf) - before[-1]
        taken = float(after) if after < _LONG_S else np.inf
        found.append(Decision(at, max(refused, default=0.0), taken))
    return found


def critical_gap(decisions: Sequence[tuple[float, float]]) -> float:
    """Return the mean critical gap of the likeliest lognormal distribution, seconds.

    Args:
        decisions: (refused, taken) gaps, seconds; a refused one of 0 and a taken one that is
            infinite are none. Decisions in which a longer gap was refused than taken are left out.
    """
    telling = [one for one in decisions if one[0] < one[1] and one != (0.0, np.inf)]
    pairs = np.array(telling, np.float64).reshape(-1, 2)
    if not len(pairs):
        return float("nan")

    low, high = np.log(np.maximum(pairs, 1e-9)).T

    def unlikely(values: NDArray[np.float64]) -> float:
        share = ndtr((high - values[0]) / values[1]) - ndtr((low - values[0]) / values[1])
        return -float(np.log(np.maximum(share, 1e-12)).sum())

    # It has one minimum, but is flat far from it: the simplex needs no gradient.
    bounds = [tuple(np.log(_MEDIAN_S)), _SPREAD]
    seen = np.concatenate([low[pairs[:, 0] > 0], high[np.isfinite(high)]])
    start = (float(np.clip(seen.mean(), *bounds[0])), 0.3)
    fit = minimize(unlikely, start, method="Nelder-Mead", bounds=bounds)
    middle, spread = fit.x
    return float(np.exp(middle + spread**2 / 2))


def _there_s(one: Passage, place: NDArray[np.float64]) -> float | None:
    """Return when a vehicle was nearest to a place, seconds; ``None`` where it did not pass it."""
    away = np.linalg.norm(one.seen.xy - place, axis=1)
    k = int(np.argmin(away))
    if away[k] > _BESIDE_M or k in (0, len(away) - 1):
        return None
    return float(one.seen.time_s[k])
