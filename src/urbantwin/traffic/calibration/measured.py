"""Measurements of traffic, the same for recorded and simulated tracks."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads import RoadNetwork
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.calibration.free_speed import free_speeds
from urbantwin.traffic.calibration.gap_acceptance import Decision
from urbantwin.traffic.calibration.passages import (
    HEAVY,
    MOTORS,
    SETTLES_S,
    STANDS_MS,
    Passage,
    SeenTrack,
)
from urbantwin.traffic.calibration.queue_discharge import discharge_headways, first_of_queues
from urbantwin.traffic.calibration.setting_out import (
    FADES_MS,
    FIRST_MS,
    first_to_set_out,
    setting_out,
)
from urbantwin.traffic.calibration.turns_taken import turns_taken

__all__ = ["Measured", "joined", "measured"]

#: Spacing of speed samples along the path, metres, so that waiting vehicles get no extra weight.
_SPEED_SPACING_M = 2.0
#: Longer headways do not describe following, seconds.
_FOLLOWING_S = 15.0
#: Least length of a path for top speeds, metres.
_MIN_PATH_M = 20.0
_MIN_GAP_M, _MAX_GAP_M = 0.3, 8.0
#: Least speed of a follower, m/s, largest difference to the leader's speed, m/s, and longest time
#: gap, seconds.
_FOLLOWS_MS, _AS_FAST_MS, _FOLLOWS_S = 3.0, 1.5, 4.0
_SAME_MOMENT_S = 0.03


@dataclass(frozen=True, eq=False)
class Measured:
    """Statistics of traffic.

    Attributes:
        seconds: observed duration.
        classes: class -> number of tracks.
        new: class -> number of tracks that begin during the observation.
        turns: (approach, exit) -> number of passages.
        speeds: speeds every two metres of each motor vehicle's path, m/s, by vehicle.
        headways: lane -> times between vehicles that pass its end, seconds.
        gaps: gaps between standing vehicles, metres, one per pair.
        following: time gaps, bumper to bumper, of followers at about the leader's speed, seconds,
            one per pair.
        driving: the same, of followers that have not stood since the begin of their track.
        discharge: approach -> times between consecutive vehicles that leave a queue at the stop
            line, without trucks and buses, seconds.
        accelerations: from 1 to 5 m/s after standing, m/s2, one per vehicle, without trucks and
            buses.
        faded: from 6 to 9 m/s, m/s2, the same.
        leading: as ``accelerations``, of the first vehicles of queues.
        heavy_accelerations: of trucks and buses, as ``accelerations``.
        heavy_faded: of trucks and buses, as ``faded``.
        free: exit -> speeds, as shares of the limit, of leaving vehicles without one close ahead.
        tops: 90 % quantile of each vehicle's speed along its path, as a share of the road's limit.
        bends: (approach, exit) -> lateral accelerations in turns, m/s2, one per vehicle.
        turning: (approach, exit) -> speeds in the same turns, m/s.
        lane_use: (approach, exit) -> lane of the approach -> number of vehicles that entered the
            junction from it.
        gap_choices: (longest rejected, accepted) gaps of yielding vehicles, seconds.
    """

    seconds: float
    classes: dict[str, int]
    new: dict[str, int]
    turns: dict[tuple[str, str], int]
    speeds: tuple[NDArray[np.float64], ...] = ()
    headways: dict[str, list[float]] = field(default_factory=dict)
    gaps: list[float] = field(default_factory=list)
    following: list[float] = field(default_factory=list)
    driving: list[float] = field(default_factory=list)
    discharge: dict[str, list[float]] = field(default_factory=dict)
    accelerations: list[float] = field(default_factory=list)
    faded: list[float] = field(default_factory=list)
    leading: list[float] = field(default_factory=list)
    heavy_accelerations: list[float] = field(default_factory=list)
    heavy_faded: list[float] = field(default_factory=list)
    free: dict[str, list[float]] = field(default_factory=dict)
    tops: list[float] = field(default_factory=list)
    bends: dict[tuple[str, str], list[float]] = field(default_factory=dict)
    turning: dict[tuple[str, str], list[float]] = field(default_factory=dict)
    gap_choices: list[tuple[float, float]] = field(default_factory=list)
    lane_use: dict[tuple[str, str], dict[str, int]] = field(default_factory=dict)

    @property
    def all_headways(self) -> NDArray[np.float64]:
        """Headways of all lanes up to 15 s."""
        headways_s = np.array(
            [headway_s for of_lane in self.headways.values() for headway_s in of_lane]
        )
        return headways_s[headways_s <= _FOLLOWING_S]

    @property
    def all_free(self) -> list[float]:
        """Free-flow speeds of all exits, as shares of the limit."""
        return [share for _, of_exit in sorted(self.free.items()) for share in of_exit]

    @property
    def all_discharge(self) -> list[float]:
        """Discharge headways of all approaches, seconds."""
        return [
            headway_s
            for _, of_approach in sorted(self.discharge.items())
            for headway_s in of_approach
        ]


def joined(parts: Sequence[Measured]) -> Measured:
    """Return the measurements of several spans as one."""

    def added(name: str) -> dict[Any, int]:
        return dict(sum((Counter(getattr(part, name)) for part in parts), Counter()))

    def all_of(name: str) -> list[Any]:
        return [value for part in parts for value in getattr(part, name)]

    def by_place(name: str) -> dict[Any, list[float]]:
        pooled: dict[Any, list[float]] = defaultdict(list)
        for part in parts:
            for place, values in getattr(part, name).items():
                pooled[place] += values
        return dict(pooled)

    lane_use: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    for part in parts:
        for movement, used in part.lane_use.items():
            lane_use[movement].update(used)
    values: dict[str, Any] = {
        "seconds": sum(part.seconds for part in parts),
        "speeds": tuple(all_of("speeds")),
        "lane_use": {movement: dict(used) for movement, used in lane_use.items()},
    }
    values |= {name: added(name) for name in ("classes", "new", "turns")}
    values |= {
        name: by_place(name) for name in ("headways", "discharge", "bends", "turning", "free")
    }
    values |= {
        field.name: all_of(field.name) for field in fields(Measured) if field.name not in values
    }
    return Measured(**values)


def measured(
    tracks: Sequence[SeenTrack],
    passages: Sequence[Passage],
    roads: RoadNetwork,
    begin_s: float,
    end_s: float,
    *,
    decisions: Sequence[Decision] = (),
) -> Measured:
    """Measure the traffic between two times, seconds.

    Args:
        tracks: all tracks.
        passages: passages over the junction.
        roads: the lanes.
        begin_s: begin of the span.
        end_s: end of the span.
        decisions: decisions of yielding vehicles; those without information are excluded.
    """
    present = [seen for seen in tracks if seen.time_s[-1] >= begin_s and seen.time_s[0] < end_s]
    new = [seen for seen in present if seen.time_s[0] > max(begin_s, 0.5)]
    turns: Counter[tuple[str, str]] = Counter()
    passed: dict[str, list[Passage]] = defaultdict(list)
    lane_use: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    for crossing in passages:
        passed_s = float(np.nan_to_num(crossing.passed_s, nan=crossing.seen.time_s[0]))
        if not begin_s <= passed_s < end_s:
            continue
        if crossing.approach and crossing.leaving:
            turns[crossing.approach, crossing.leaving] += 1
            if crossing.lane:
                lane_use[crossing.approach, crossing.leaving][crossing.lane] += 1
        if crossing.lane and np.isfinite(crossing.passed_s):
            passed[crossing.lane].append(crossing)
    headways = {}
    for lane, in_order in sorted(passed.items()):
        in_order.sort(key=lambda crossing: crossing.passed_s)
        headways[lane] = [b.passed_s - a.passed_s for a, b in pairwise(in_order)]
    motors = [seen for seen in present if seen.track.actor_class in MOTORS]
    heavy = [seen for seen in motors if seen.track.actor_class in HEAVY]
    light = [seen for seen in motors if seen.track.actor_class not in HEAVY]
    first = [
        passage
        for passage in first_of_queues(passages)
        if passage.seen.track.actor_class not in HEAVY
    ]
    limits = {lane.road: lane.speed_limit for lane in roads.lanes if lane.speed_limit > 0}
    stand, follow, drive = _gaps(passages, begin_s, end_s)
    return Measured(
        end_s - begin_s,
        _counts(present),
        _counts(new),
        dict(turns),
        tuple(s for seen in motors if len(s := _speeds(seen, begin_s, end_s))),
        headways,
        stand,
        follow,
        drive,
        discharge_headways(passages, begin_s, end_s),
        setting_out(light, begin_s, end_s, FIRST_MS),
        setting_out(light, begin_s, end_s, FADES_MS),
        first_to_set_out(first, begin_s, end_s, FIRST_MS),
        setting_out(heavy, begin_s, end_s, FIRST_MS),
        setting_out(heavy, begin_s, end_s, FADES_MS),
        free_speeds(present, passages, limits, begin_s, end_s),
        [
            x
            for passage in passages
            if (x := _top_speed_share(passage, limits, begin_s, end_s)) is not None
        ],
        *turns_taken(passages, begin_s, end_s),
        [
            (decision.refused_s, decision.taken_s)
            for decision in decisions
            if begin_s <= decision.at_s < end_s
            and (decision.refused_s > 0 or np.isfinite(decision.taken_s))
        ],
        {movement: dict(used) for movement, used in lane_use.items()},
    )


def _counts(tracks: Sequence[SeenTrack]) -> dict[str, int]:
    counted = Counter(seen.track.actor_class for seen in tracks)
    return {name: counted[name] for name in ACTOR_CLASSES if counted[name]}


def _speeds(one: SeenTrack, begin_s: float, end_s: float) -> NDArray[np.float64]:
    settled_s = float(one.time_s[0]) + SETTLES_S
    in_span = (one.time_s >= max(begin_s, settled_s)) & (one.time_s < end_s)
    if in_span.sum() < 3:
        return np.zeros(0)
    speed = np.abs(one.speed[in_span])
    steps = np.linalg.norm(np.diff(one.xy[in_span], axis=0), axis=1)
    # Tracker noise lets standing vehicles drift by metres per minute, which is no travel.
    steps[np.minimum(speed[1:], speed[:-1]) <= STANDS_MS] = 0.0
    travelled_m = np.concatenate([[0.0], np.cumsum(steps)])
    moves = np.concatenate([[True], steps > 0])
    station_m = np.arange(_SPEED_SPACING_M / 2, travelled_m[-1], _SPEED_SPACING_M)
    return np.asarray(np.interp(station_m, travelled_m[moves], speed[moves]))


def _top_speed_share(
    one: Passage, limits: dict[str, float], begin_s: float, end_s: float
) -> float | None:
    """Return the 90 % quantile of the speed along the path, as a share of the road's limit."""
    limit = limits.get(one.leaving) or limits.get(one.approach)
    speeds = _speeds(one.seen, begin_s, end_s)
    if limit is None or len(speeds) < _MIN_PATH_M / _SPEED_SPACING_M:
        return None
    return float(np.quantile(speeds, 0.9)) / limit


def _gaps(
    passages: Sequence[Passage], begin_s: float, end_s: float
) -> tuple[list[float], list[float], list[float]]:
    """Return the gaps of pairs behind each other on a lane, one value per pair.

    Returns:
        Median gaps of standing pairs, metres; of pairs at about the same speed, median times until
            the follower reaches the leader's rear, seconds; and the same of followers that have not
            stood yet.
    """
    on_lanes: dict[tuple[float, str], list[tuple[Passage, int]]] = defaultdict(list)
    for passage in passages:
        if not np.isfinite(passage.seen.track.size[0]):
            continue
        times = passage.seen.time_s
        first = max(begin_s, float(times[0]) + SETTLES_S)
        whole = np.abs(times - np.round(times)) < _SAME_MOMENT_S
        for k in np.flatnonzero(whole & (times >= first) & (times < end_s)).tolist():
            if passage.lanes[k]:
                on_lanes[round(float(times[k])), str(passage.lanes[k])].append((passage, k))
    stand: dict[tuple[str, str], list[float]] = defaultdict(list)
    follow: dict[tuple[str, str], list[float]] = defaultdict(list)
    drive: dict[tuple[str, str], list[float]] = defaultdict(list)
    stood_s = {id(passage.seen): _first_stood(passage.seen) for passage in passages}
    for on_lane in on_lanes.values():
        yaw = on_lane[0][0].seen.yaw[on_lane[0][1]]
        ahead = np.array([np.cos(yaw), np.sin(yaw)])
        on_lane.sort(key=lambda entry: float(entry[0].seen.xy[entry[1]] @ ahead))
        for (follower, k), (before, j) in pairwise(on_lane):
            a, b = follower.seen, before.seen
            gap = float(np.linalg.norm(b.xy[j] - a.xy[k]))
            gap -= float(a.track.size[0] + b.track.size[0]) / 2
            slow, fast = sorted((abs(float(a.speed[k])), abs(float(b.speed[j]))))
            pair = a.track.name, b.track.name
            if fast < STANDS_MS and _MIN_GAP_M < gap < _MAX_GAP_M:
                stand[pair].append(gap)
            elif slow > _FOLLOWS_MS and fast - slow < _AS_FAST_MS and 0 < gap < _FOLLOWS_S * slow:
                time = gap / abs(float(a.speed[k]))
                follow[pair].append(time)
                if a.time_s[k] < stood_s[id(a)]:
                    drive[pair].append(time)
    return _medians(stand), _medians(follow), _medians(drive)


def _medians(of_pairs: dict[tuple[str, str], list[float]]) -> list[float]:
    return [float(np.median(gaps)) for gaps in of_pairs.values()]


def _first_stood(seen: SeenTrack) -> float:
    """Return when a vehicle first stood, seconds; infinite if never."""
    settled = seen.time_s >= seen.time_s[0] + SETTLES_S
    stood = np.flatnonzero(settled & (np.abs(seen.speed) < STANDS_MS))
    return float(seen.time_s[stood[0]]) if len(stood) else np.inf
