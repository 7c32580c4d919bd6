"""Demand from presence, for short recordings: Little's law with simulated sojourn times.

In half a minute few vehicles are seen from an approach to an exit, but many are present, and
waiting ones represent a minute of arrivals. The number present is the flow times the sojourn time
(J. D. C. Little, "A Proof for the Queuing Formula: L = lambda W", Operations Research 9(3), 1961).
Sojourn times, with queues at signals, come from simulations of the same place in which presence is
counted in the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads import RoadNetwork
from urbantwin.traffic.calibration.passages import MOTORS, SeenTrack
from urbantwin.traffic.demand.counted_places import main_junction
from urbantwin.traffic.observed import ObservedTracks

__all__ = [
    "Presence",
    "arms_of",
    "corrected",
    "corrected_arms",
    "first_flows",
    "flows_of_arms",
    "misfit",
    "passed_per_hour",
    "passes_an_arm",
    "presence_of",
    "sampled",
]

#: Least visible length of an arm, metres.
_MIN_VISIBLE_ARM_M = 5.0
#: Speed below which a pedestrian stands, and is not counted, m/s.
_STANDING_M_S = 0.3
_NOTHING = np.zeros(0)
#: Initial sojourn time, seconds; and largest factor of a correction.
_SOJOURN_S, _MAX_CORRECTION = 40.0, 1.6
#: Streets are full if they carry less than this share of the requested flow.
_FULL_SHARE = 0.85
#: A vehicle seen within this time of the end has not left, seconds.
_NOT_LEFT_S = 1.0
#: Number added to both sides of a ratio, for small numbers.
_PSEUDO_COUNT = 0.5
#: Least flow, per hour.
_MIN_FLOW = 5.0


@dataclass(frozen=True, eq=False)
class Presence:
    """Numbers of actors present over time.

    Attributes:
        times: number of samples T.
        classes: class -> (T,) number of actors.
        arms: id of a road -> (T,) motor vehicles on it.
    """

    times: int
    classes: dict[str, NDArray[np.float64]]
    arms: dict[str, NDArray[np.float64]]

    def spread(self, moments: int) -> dict[str, dict[str, float]]:
        """Return the relative standard deviations of means over spans of ``moments`` samples."""
        spreads: dict[str, dict[str, float]] = {"classes": {}, "arms": {}}
        count = self.times // max(moments, 1)
        for kind, presences in (("classes", self.classes), ("arms", self.arms)):
            for name, present in presences.items():
                means = present[: count * moments].reshape(count, -1).mean(axis=1)
                if count > 1 and means.mean() > 0:
                    spreads[kind][name] = float(means.std(ddof=1) / means.mean())
        return spreads


def arms_of(roads: RoadNetwork, area: shapely.Geometry) -> dict[str, shapely.Geometry]:
    """Return the visible roads into the main junction and past it, with the areas of their lanes.

    Roads that lead away from the junction are excluded, since their traffic was counted before; so
    are those that only lead to another arm, where their traffic is counted.
    """
    junction = main_junction(roads)
    outline = {
        road.id: shapely.union_all(
            [roads.lane_by_id[name].polygon for name in road.lanes if _driven(roads, name)]
        )
        for road in roads.roads
    }
    seen = {
        road.id: max(
            (
                shapely.LineString(roads.lane_by_id[name].centre[:, :2]).intersection(area).length
                for name in road.lanes
                if _driven(roads, name)
            ),
            default=0.0,
        )
        for road in roads.roads
    }
    nearby = [road for road in roads.roads if seen[road.id] > 0]
    beside = [road for road in nearby if road.to_junction != junction]
    away, reached = set[str](), {junction}
    while more := {road.id for road in beside if road.from_junction in reached} - away:
        away |= more
        reached |= {road.to_junction for road in beside if road.id in more}
    arms = [road for road in nearby if road.id not in away and seen[road.id] >= _MIN_VISIBLE_ARM_M]
    from_here = {road.from_junction for road in arms}
    return {
        road.id: outline[road.id]
        for road in arms
        if road.to_junction == junction or road.to_junction not in from_here
    }


def _driven(roads: RoadNetwork, lane: str) -> bool:
    return any(name in roads.lane_by_id[lane].allowed for name in MOTORS)


def presence_of(
    tracks: Sequence[SeenTrack] | ObservedTracks,
    moments_s: NDArray[np.float64],
    area: shapely.Geometry,
    arms: Mapping[str, shapely.Geometry],
) -> Presence:
    """Count the actors present in an area at times (T,), seconds.

    Standing pedestrians are excluded, since frames do not distinguish them from posts; of those
    seen only once the walking share of the others is counted.
    """
    of = tracks if isinstance(tracks, ObservedTracks) else sampled(tracks, moments_s)
    inside = shapely.contains_xy(area, of.xy[:, 0], of.xy[:, 1])
    on_foot = of.actor_class == "pedestrian"
    inside &= ~(on_foot & of.stands)
    counts = np.ones(len(of.xy))
    if of.once is not None:
        identified = on_foot & ~of.once
        if identified.any():
            counts[on_foot & of.once] = 1 - of.stands[identified].mean()
    moment = np.searchsorted(moments_s, of.time_s - 1e-6)
    count = len(moments_s)

    def by_moment(rows: NDArray[np.bool_]) -> NDArray[np.float64]:
        counted = rows & inside
        present = np.bincount(moment[counted], counts[counted], minlength=count)[:count]
        return present.astype(np.float64)

    motors = np.isin(of.actor_class, MOTORS)
    return Presence(
        count,
        {str(name): by_moment(of.actor_class == name) for name in np.unique(of.actor_class)},
        {
            name: by_moment(motors & shapely.contains_xy(polygon, of.xy[:, 0], of.xy[:, 1]))
            for name, polygon in arms.items()
        },
    )


def sampled(tracks: Sequence[SeenTrack], moments_s: NDArray[np.float64]) -> ObservedTracks:
    """Return the tracks sampled at times (T,), seconds, as frames would show them."""
    times_in_track = [
        moments_s[(moments_s >= x.time_s[0]) & (moments_s <= x.time_s[-1])] for x in tracks
    ]
    counts = [len(times) for times in times_in_track]
    pairs = list(zip(times_in_track, tracks, strict=True))

    def along(column: Callable[[SeenTrack], NDArray[np.float64]]) -> NDArray[np.float64]:
        return np.concatenate([np.interp(t, x.time_s, column(x)) for t, x in pairs] or [_NOTHING])

    speed = along(lambda seen: seen.speed)
    return ObservedTracks(
        np.repeat(np.arange(len(tracks)), counts),
        np.repeat(np.array([seen.track.actor_class for seen in tracks], object), counts),
        np.concatenate([*times_in_track, _NOTHING]),
        np.column_stack([along(lambda seen: seen.xy[:, 0]), along(lambda seen: seen.xy[:, 1])]),
        along(lambda seen: np.unwrap(seen.yaw)),
        np.repeat(np.reshape([seen.track.size for seen in tracks], (-1, 3)), counts, axis=0),
        speed,
        speed < _STANDING_M_S,
    )


def first_flows(recorded: Presence) -> dict[str, float]:
    """Return class -> initial flow per hour, with the same sojourn time for all."""
    return {
        name: max(float(present.mean()) * 3600 / _SOJOURN_S, _MIN_FLOW)
        for name, present in recorded.classes.items()
    }


def passes_an_arm(tracks: Sequence[SeenTrack], arms: Mapping[str, shapely.Geometry]) -> float:
    """Return the share of motor vehicles that are on an arm at any time; 0 without vehicles."""
    all_arms = shapely.union_all(list(arms.values()))
    shapely.prepare(all_arms)
    motors = [seen for seen in tracks if seen.track.actor_class in MOTORS]
    on_arm = sum(bool(shapely.contains_xy(all_arms, *seen.xy.T).any()) for seen in motors)
    return on_arm / max(len(motors), 1)


def passed_per_hour(tracks: Sequence[SeenTrack], area: shapely.Geometry, seconds: float) -> float:
    """Return the motor vehicles per hour that leave an area, from tracks over some seconds."""
    shapely.prepare(area)
    left = 0
    for seen in tracks:
        if seen.track.actor_class in MOTORS:
            inside = shapely.contains_xy(area, seen.xy[:, 0], seen.xy[:, 1])
            left += int((inside[:-1] & ~inside[1:]).sum())
            left += int(inside[-1] and seen.time_s[-1] < seconds - _NOT_LEFT_S)
    return left * 3600 / seconds


def corrected(
    per_hour: Mapping[str, float], recorded: Presence, simulated: Presence, passed: float = np.inf
) -> dict[str, float]:
    """Return flows times the ratio of recorded to simulated presence.

    Motor vehicles are corrected together, since the presence of rare classes is random. If fewer
    pass in the simulation than requested, they queue, and more demand would only wait; then the
    flow that passes is requested.

    Args:
        per_hour: simulated flows by class.
        recorded: presence in the recording.
        simulated: presence in the simulation.
        passed: motor vehicles per hour that passed in the simulation.
    """
    motors = sum(value for name, value in per_hour.items() if name in MOTORS)

    of_motors = _ratio(_motors(recorded), _motors(simulated))
    if passed < _FULL_SHARE * motors:
        of_motors = min(of_motors, passed / motors)
    return {
        name: max(
            value
            * (
                of_motors
                if name in MOTORS
                else _ratio(_mean(recorded, name), _mean(simulated, name))
            ),
            _MIN_FLOW,
        )
        for name, value in per_hour.items()
    }


def corrected_arms(
    per_hour: Mapping[str, float],
    recorded: Presence,
    simulated: Presence,
    passed: Mapping[str, float],
) -> dict[str, float]:
    """Return motor vehicles per hour by arm, times the ratio of recorded to simulated presence.

    Half of the ratio's logarithm is that of the arm, which includes its queue; half is that beyond
    all arms, in the junction and behind it, without queues. For a full arm the flow that passes is
    requested, plus a little.

    Args:
        per_hour: simulated flows by arm.
        recorded: presence in the recording.
        simulated: presence in the simulation.
        passed: motor vehicles per hour that left each arm in the simulation.
    """
    beyond = _ratio(_off_arms(recorded), _off_arms(simulated))
    corrected = {}
    for name, value in per_hour.items():
        of_arm = _ratio(float(recorded.arms[name].mean()), float(simulated.arms[name].mean()))
        ratio = float(np.sqrt(of_arm * beyond))
        if passed[name] < _FULL_SHARE * value:
            ratio = min(ratio, passed[name] / (_FULL_SHARE * value))
        corrected[name] = max(value * ratio, _MIN_FLOW)
    return corrected


def misfit(recorded: Presence, simulated: Presence) -> float:
    """Return the deviation between two presences; 0 if they are equal for all classes and arms.

    It is the sum of absolute log ratios: of motor vehicles in total and beyond all arms, of the
    other classes, and of arms weighted by their numbers.
    """
    others = [name for name in recorded.classes if name not in MOTORS]
    off = [abs(np.log(_ratio(of(recorded), of(simulated)))) for of in (_motors, _off_arms)]
    off += [abs(np.log(_ratio(_mean(recorded, name), _mean(simulated, name)))) for name in others]
    on = {name: float(samples.mean()) for name, samples in recorded.arms.items()}
    for name, mean in on.items():
        ratio = _ratio(mean, float(simulated.arms[name].mean()))
        off.append(abs(np.log(ratio)) * mean / max(sum(on.values()), 1e-9))
    return float(sum(off))


def _mean(of: Presence, name: str) -> float:
    return float(of.classes[name].mean()) if name in of.classes else 0.0


def _motors(of: Presence) -> float:
    return sum(_mean(of, name) for name in MOTORS)


def _off_arms(of: Presence) -> float:
    """Return the number of motor vehicles on no arm."""
    return max(_motors(of) - sum(float(samples.mean()) for samples in of.arms.values()), 0.0)


def _ratio(here: float, there: float) -> float:
    ratio = (here + _PSEUDO_COUNT) / (there + _PSEUDO_COUNT)
    return float(np.clip(ratio, 1 / _MAX_CORRECTION, _MAX_CORRECTION))


def flows_of_arms(per_hour: Mapping[str, float], recorded: Presence) -> dict[str, float]:
    """Return motor vehicles per hour by arm, in proportion to their presence."""
    motors = sum(value for name, value in per_hour.items() if name in MOTORS)
    present = {name: float(samples.mean()) for name, samples in recorded.arms.items()}
    total = sum(present.values()) or 1.0
    return {name: motors * presence / total for name, presence in sorted(present.items())}
