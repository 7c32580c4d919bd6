"""Counts beyond the main junction: turns at fully visible junctions, and roads.

A vehicle that passes two junctions is counted at both, as by counters there; so rows are consistent
even if its track is broken between them. A broken track never counts twice: a turn is taken once,
and a road is counted at one cross-section.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads import Road, RoadNetwork
from urbantwin.traffic.calibration.passages import MOTORS, Passage, SeenTrack
from urbantwin.traffic.paths.lane_below import LanesBelow

__all__ = ["CountedElsewhere", "Spot", "counted_elsewhere", "ways_between"]

#: Least share of the vehicles on a junction with visible approach and exit roads.
_MIN_VISIBLE_SHARE = 0.75
#: Least number, and share, of passing vehicles that never come to the main junction. With fewer,
#: the place adds nothing to the counts there.
_MIN_NEW_VEHICLES, _MIN_NEW_SHARE = 5, 0.05

#: Place of a count: fields of a row of ``traffic.counts``, by name.
Spot = tuple[tuple[str, str], ...]


@dataclass(frozen=True, eq=False)
class CountedElsewhere:
    """Vehicles counted beyond the main junction.

    Attributes:
        times: place -> class -> times of passing, seconds.
        empty: visible roads without any traffic.
        tracks: name -> begin of the track, seconds.
    """

    times: dict[Spot, dict[str, list[float]]]
    empty: tuple[str, ...]
    tracks: dict[str, float]

    def besides(self, passages: Sequence[Passage], until_s: float) -> int:
        """Return the number of tracks begun before a time, seconds, not over the main junction."""
        over = {
            passage.seen.track.name for passage in passages if passage.approach and passage.leaving
        }
        return sum(
            name not in over and 0.5 < time_s < until_s for name, time_s in self.tracks.items()
        )


def counted_elsewhere(
    tracks: Sequence[SeenTrack],
    roads: RoadNetwork,
    junction: str,
    classes: Collection[str] = MOTORS,
) -> CountedElsewhere:
    """Count vehicles at all other junctions, and on roads that lead to none of those.

    Args:
        tracks: the tracks.
        roads: the lanes.
        junction: the main junction, which is counted separately.
        classes: classes to count: motor traffic, or bicycles.
    """
    user = "car" if set(classes) <= set(MOTORS) else "bicycle"
    below, road_pairs = LanesBelow(roads), ways_between(roads)
    by_id = {road.id: road for road in roads.roads}
    turns: dict[tuple[str, str], list[tuple[SeenTrack, float]]] = defaultdict(list)
    stretches: dict[str, list[tuple[SeenTrack, NDArray[np.float64]]]] = defaultdict(list)
    main_roads = {
        road.id for road in roads.roads if junction in (road.from_junction, road.to_junction)
    }
    others: set[str] = set()
    touched: Counter[str] = Counter()
    for seen in tracks:
        if seen.track.actor_class not in classes:
            continue
        lanes = [roads.lane_by_id.get(str(name)) for name in below.at(seen.xy, seen.yaw, user)]
        on = [
            (lane.road, k)
            for k, lane in enumerate(lanes)
            if lane is not None and lane.road in by_id
        ]
        runs = [
            (road, [k for _, k in moments])
            for road, moments in groupby(on, lambda lane_and_index: lane_and_index[0])
        ]
        junctions_passed = {lane.junction for lane in lanes if lane is not None and not lane.road}
        if main_roads.isdisjoint(road for road, _ in runs):
            others.add(seen.track.name)
        for (first, _), (last, moments) in pairwise(runs):
            if (first, last) in road_pairs:
                turns[first, last].append((seen, float(seen.time_s[moments[0]])))
                junctions_passed.add(by_id[first].to_junction)
        touched.update(junctions_passed)
        for road, moments in runs:
            stretches[road].append((seen, np.array(moments)))
    at_junction: dict[str, list[tuple[SeenTrack, float]]] = defaultdict(list)
    for (first, _), passed in turns.items():
        at_junction[by_id[first].to_junction] += passed
    whole = {
        junction_id
        for junction_id, passed in at_junction.items()
        if junction_id != junction
        and len(passed) >= _MIN_VISIBLE_SHARE * touched[junction_id]
        and _adds_information(passed, others)
    }
    counts: dict[Spot, list[tuple[SeenTrack, float]]] = {
        (("approach", first), ("turn", last)): passed
        for (first, last), passed in sorted(turns.items())
        if by_id[first].to_junction in whole
    }
    covered = whole | {junction}
    for road, tracks_on_road in sorted(stretches.items()):
        if not covered & {by_id[road].from_junction, by_id[road].to_junction}:
            passed = _at_a_section(by_id[road], roads, tracks_on_road)
            if _adds_information(passed, others):
                counts[("road", road),] = passed
    approaches = {first for first, _ in turns}
    return CountedElsewhere(
        {spot: _by_class(passed) for spot, passed in counts.items()},
        tuple(
            sorted(
                road.id
                for road in roads.roads
                if road.to_junction in whole
                and road.from_junction != junction
                and road.id not in approaches
                and any(user in roads.lane_by_id[lane].allowed for lane in road.lanes)
            )
        ),
        {
            seen.track.name: float(seen.time_s[0])
            for passed in counts.values()
            for seen, _ in passed
        },
    )


def _adds_information(passed: Sequence[tuple[SeenTrack, float]], others: set[str]) -> bool:
    """Return whether enough vehicles pass a place that are counted nowhere else."""
    count = sum(seen.track.name in others for seen, _ in passed)
    return count >= max(_MIN_NEW_VEHICLES, _MIN_NEW_SHARE * len(passed))


def _by_class(passed: Sequence[tuple[SeenTrack, float]]) -> dict[str, list[float]]:
    times: dict[str, list[float]] = defaultdict(list)
    for seen, time_s in passed:
        times[seen.track.actor_class].append(time_s)
    return dict(times)


def ways_between(roads: RoadNetwork) -> set[tuple[str, str]]:
    """Return the pairs of roads connected over a junction."""
    return {
        (lane.road, after.road)
        for lane in roads.lanes
        if lane.road
        for after in roads.lanes_beyond(lane)
    }


def _at_a_section(
    road: Road, roads: RoadNetwork, those: Sequence[tuple[SeenTrack, NDArray[np.float64]]]
) -> list[tuple[SeenTrack, float]]:
    """Return the tracks that pass the middle of a road's visible part, with times, seconds."""
    line = shapely.LineString(roads.lane_by_id[road.lanes[-1]].centre[:, :2])
    stations = [
        shapely.line_locate_point(line, shapely.points(seen.xy[rows])) for seen, rows in those
    ]
    section = float(np.median([(station_m.min() + station_m.max()) / 2 for station_m in stations]))
    return [
        (seen, float(seen.time_s[rows[int(np.argmax(station_m >= section))]]))
        for (seen, rows), station_m in zip(those, stations, strict=True)
        if station_m[0] < section <= station_m.max()
    ]
