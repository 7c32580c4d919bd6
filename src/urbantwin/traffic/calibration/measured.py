"""What is measured of traffic, recorded and simulated alike."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads import RoadNetwork
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.calibration.passages import MOTORS, Passage, SeenTrack

__all__ = ["Measured", "joined", "measured"]

#: Speeds are taken each so many metres of the way, so that those who wait do not outweigh others.
_EVERY_M = 2.0
#: Longer headways tell how many come, not how they follow, seconds.
_FOLLOWING_S = 15.0
_STANDS_MS, _SETS_OUT_MS, _DRIVES_MS = 0.5, 1.0, 5.0
_STOOD_S = 1.0
_LEAST_GAP_M, _MOST_GAP_M = 0.3, 8.0


@dataclass(frozen=True, eq=False)
class Measured:
    """Traffic in numbers.

    Attributes:
        seconds: for how long it was seen.
        classes: class -> how many were seen.
        new: class -> how many came meanwhile: were not there at the beginning.
        turns: (approach, exit) -> how many passed.
        speeds: every two metres of each motor vehicle's way, m/s, vehicle by vehicle.
        headways: lane -> times between those who passed its end, seconds.
        discharge: headways of those who had stood in the queue, seconds.
        gaps: between those who stand behind each other, metres, pair by pair.
        accelerations: from 1 to 5 m/s after standing, m/s2, vehicle by vehicle.
        passing: speeds at which the end of the lane is passed, m/s.
        lengths: of motor vehicles, metres, where they were told.
    """

    seconds: float
    classes: dict[str, int]
    new: dict[str, int]
    turns: dict[tuple[str, str], int]
    speeds: tuple[NDArray[np.float64], ...]
    headways: dict[str, list[float]]
    discharge: list[float]
    gaps: list[float]
    accelerations: list[float]
    passing: list[float]
    lengths: list[float]

    @property
    def all_headways(self) -> NDArray[np.float64]:
        """Headways of all lanes up to 15 s: how one follows another."""
        every = np.array([one for found in self.headways.values() for one in found])
        return every[every <= _FOLLOWING_S]


def joined(parts: Sequence[Measured]) -> Measured:
    """Return what was measured in several spans of time as one measurement."""

    def added(field: str) -> dict[Any, int]:
        return dict(sum((Counter(getattr(one, field)) for one in parts), Counter()))

    def every(field: str) -> list[Any]:
        return [value for one in parts for value in getattr(one, field)]

    headways: dict[str, list[float]] = defaultdict(list)
    for one in parts:
        for lane, found in one.headways.items():
            headways[lane] += found
    return Measured(
        sum(one.seconds for one in parts),
        added("classes"),
        added("new"),
        added("turns"),
        tuple(every("speeds")),
        dict(headways),
        *(every(x) for x in ("discharge", "gaps", "accelerations", "passing", "lengths")),
    )


def measured(
    tracks: Sequence[SeenTrack],
    passages: Sequence[Passage],
    roads: RoadNetwork,
    begin_s: float,
    end_s: float,
) -> Measured:
    """Measure the traffic between two moments, seconds."""
    there = [one for one in tracks if one.time_s[-1] >= begin_s and one.time_s[0] < end_s]
    new = [one for one in there if one.time_s[0] > max(begin_s, 0.5)]
    turns: Counter[tuple[str, str]] = Counter()
    passed: dict[str, list[Passage]] = defaultdict(list)
    for crossing in passages:
        at = float(np.nan_to_num(crossing.passed_s, nan=crossing.seen.time_s[0]))
        if not begin_s <= at < end_s:
            continue
        if crossing.approach and crossing.leaving:
            turns[crossing.approach, crossing.leaving] += 1
        if crossing.lane and np.isfinite(crossing.passed_s):
            passed[crossing.lane].append(crossing)
    headways, discharge, passing = {}, [], []
    for lane, ones in sorted(passed.items()):
        ones.sort(key=lambda one: one.passed_s)
        headways[lane] = [b.passed_s - a.passed_s for a, b in pairwise(ones)]
        for a, b in pairwise(ones):
            if _stood(a) and _stood(b) and b.passed_s - a.passed_s < _FOLLOWING_S:
                discharge.append(b.passed_s - a.passed_s)
                passing.append(float(np.interp(b.passed_s, b.seen.time_s, b.seen.speed)))
    motors = [one for one in there if one.track.actor_class in MOTORS]
    return Measured(
        end_s - begin_s,
        _counts(there),
        _counts(new),
        dict(turns),
        tuple(s for one in motors if len(s := _speeds(one, begin_s, end_s))),
        headways,
        discharge,
        _standing_gaps(passages, roads, begin_s, end_s),
        [x for one in motors if (x := _setting_out(one, begin_s, end_s)) is not None],
        passing,
        [float(one.track.size[0]) for one in motors if np.isfinite(one.track.size[0])],
    )


def _counts(tracks: Sequence[SeenTrack]) -> dict[str, int]:
    counted = Counter(one.track.actor_class for one in tracks)
    return {name: counted[name] for name in ACTOR_CLASSES if counted[name]}


def _speeds(one: SeenTrack, begin_s: float, end_s: float) -> NDArray[np.float64]:
    here = (one.time_s >= begin_s) & (one.time_s < end_s)
    if here.sum() < 3:
        return np.zeros(0)
    steps = np.linalg.norm(np.diff(one.xy[here], axis=0), axis=1)
    gone = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.arange(_EVERY_M / 2, gone[-1], _EVERY_M)
    return np.interp(at, gone, np.abs(one.speed[here]))


def _stood(one: Passage) -> bool:
    """Return whether a vehicle stood before it passed."""
    before = one.seen.time_s < one.passed_s
    return bool((np.abs(one.seen.speed[before]) < _STANDS_MS).any())


def _setting_out(one: SeenTrack, begin_s: float, end_s: float) -> float | None:
    """Return the mean acceleration from 1 to 5 m/s of the last time that it set out."""
    here = (one.time_s >= begin_s) & (one.time_s < end_s)
    speed, times = one.speed[here], one.time_s[here]
    stands = np.flatnonzero(speed < _STANDS_MS)
    if len(stands) < 2 or times[stands[-1]] - times[stands[0]] < _STOOD_S:
        return None
    after = np.arange(stands[-1], len(speed))
    out = after[speed[after] >= _SETS_OUT_MS]
    fast = after[speed[after] >= _DRIVES_MS]
    if not len(out) or not len(fast):
        return None
    took = float(times[fast[0]] - times[out[0]])
    return (_DRIVES_MS - _SETS_OUT_MS) / took if took > 0 else None


def _standing_gaps(
    passages: Sequence[Passage], roads: RoadNetwork, begin_s: float, end_s: float
) -> list[float]:
    """Return the median gap of each pair who stood behind each other on an approach, metres."""
    by_moment: dict[tuple[float, str], list[tuple[float, float, int]]] = defaultdict(list)
    for number, one in enumerate(passages):
        if not np.isfinite(one.seen.track.size[0]):
            continue
        seen = one.seen
        rows = np.flatnonzero(
            (np.abs(seen.speed) < _STANDS_MS) & (seen.time_s >= begin_s) & (seen.time_s < end_s)
        )
        for k in rows[::10]:
            lane = roads.lane_by_id.get(str(one.lanes[k]))
            if lane is None or not lane.road or len(lane.centre) < 2:
                continue
            moment = round(float(seen.time_s[k]))
            step = lane.centre[-1, :2] - lane.centre[-2, :2]
            along = float((seen.xy[k] - lane.centre[-1, :2]) @ step / np.linalg.norm(step))
            by_moment[moment, lane.id].append((along, float(seen.track.size[0]), number))
    pairs: dict[tuple[int, int], list[float]] = defaultdict(list)
    for ones in by_moment.values():
        for (back, long, a), (ahead, longer, b) in pairwise(sorted(ones)):
            gap = ahead - back - (long + longer) / 2
            if a != b and _LEAST_GAP_M < gap < _MOST_GAP_M:
                pairs[a, b].append(gap)
    return [float(np.median(found)) for found in pairs.values()]
