"""Roads by which vehicles reach the main junction's approaches, and continue after its exits.

Turns of the main junction do not determine them if an approach is reached from two roads, or an
exit leads to two. The numbers counted there equal those over the main junction, so that rows are
consistent; vehicles that were not seen there are distributed like the others.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import groupby

import numpy as np

from urbantwin.roads import RoadNetwork
from urbantwin.traffic.calibration.elsewhere import Spot, ways_between
from urbantwin.traffic.calibration.passages import Passage

__all__ = ["ways_seen"]

#: Least number, and share, of the vehicles that were seen.
_MIN_VEHICLES, _MIN_SHARE = 5, 0.5

_Passed = tuple[Passage, tuple[str, ...]]


def ways_seen(
    passages: Iterable[Passage], roads: RoadNetwork, counted: Collection[Spot] = ()
) -> dict[Spot, dict[str, list[float]]]:
    """Count vehicles over the main junction where they reached its approach, and left its exit.

    Args:
        passages: passages of motor vehicles over the main junction.
        roads: the lanes.
        counted: places with counted turns; junctions with such turns are excluded.

    Returns:
        Turn at another junction -> class -> times of passing the main junction, seconds. Turns
            without vehicles are included, if others are used.
    """
    before, after_exit = defaultdict(set), defaultdict(set)
    driven = {
        road.id
        for road in roads.roads
        if any("car" in roads.lane_by_id[lane].allowed for lane in road.lanes)
    }
    for first, last in sorted(ways_between(roads)):
        if {first, last} <= driven:
            before[last].add(first)
            after_exit[first].add(last)
    arriving: dict[str, list[_Passed]] = defaultdict(list)
    departing: dict[str, list[_Passed]] = defaultdict(list)
    for passage in passages:
        if not passage.approach or not passage.leaving:
            continue
        lanes = (roads.lane_by_id.get(str(name)) for name in passage.lanes)
        road_ids = [road for road, _ in groupby(lane.road for lane in lanes if lane and lane.road)]
        ahead = road_ids[: road_ids.index(passage.approach)] if passage.approach in road_ids else []
        after = (
            road_ids[road_ids.index(passage.leaving) + 1 :] if passage.leaving in road_ids else []
        )
        arriving[passage.approach].append((passage, tuple(reversed(ahead))))
        departing[passage.leaving].append((passage, tuple(after)))
    counts: dict[Spot, list[Passage]] = {}
    for road, passed in sorted(arriving.items()):
        counts |= _turns_beyond(road, passed, before, after_exit, backwards=True)
    for road, passed in sorted(departing.items()):
        counts |= _turns_beyond(road, passed, after_exit, before, backwards=False)
    ends_at = {road.id: road.to_junction for road in roads.roads}
    done = {ends_at[name] for spot in counted for field, name in spot if field == "approach"}
    return {
        spot: _by_class(passages_of_spot)
        for spot, passages_of_spot in counts.items()
        if ends_at[spot[0][1]] not in done
    }


def _turns_beyond(
    road: str,
    those: Sequence[_Passed],
    onward: Mapping[str, set[str]],
    back: Mapping[str, set[str]],
    *,
    backwards: bool,
) -> dict[Spot, list[Passage]]:
    """Return turns between a road and those beyond it, as far as all their traffic is known.

    Args:
        road: an approach, or an exit; or, in recursion, a road beyond it.
        those: its passages, with the roads beyond it on which they were seen, the nearest first.
        onward: road -> roads beyond it.
        back: road -> roads that it leads to.
        backwards: whether beyond means upstream.
    """
    beyond = sorted(onward.get(road, ()))
    seen = Counter(
        roads_ahead[0] for _, roads_ahead in those if roads_ahead and roads_ahead[0] in beyond
    )
    total = sum(seen.values())
    if total < max(_MIN_VEHICLES, _MIN_SHARE * len(those)):
        return {}
    assigned: Counter[str] = Counter()
    through: dict[str, list[_Passed]] = {name: [] for name in beyond}
    for passage, roads_ahead in those:
        if roads_ahead and roads_ahead[0] in beyond:
            through[roads_ahead[0]].append((passage, roads_ahead[1:]))
            continue
        # Assigned to the road with the largest deficit relative to the observed shares.
        number = sum(assigned.values()) + 1
        lacks = {name: seen[name] / total * number - assigned[name] for name in beyond}
        name = max(beyond, key=lacks.__getitem__)
        assigned[name] += 1
        through[name].append((passage, ()))
    turns: dict[Spot, list[Passage]] = {}
    for name, passages in through.items():
        if len(beyond) > 1:
            first, last = (name, road) if backwards else (road, name)
            turns[("approach", first), ("turn", last)] = [passage for passage, _ in passages]
        if back[name] == {road}:  # no other traffic on it
            turns |= _turns_beyond(name, passages, onward, back, backwards=backwards)
    return turns


def _by_class(those: Sequence[Passage]) -> dict[str, list[float]]:
    times: dict[str, list[float]] = defaultdict(list)
    for passage in those:
        passed_s = float(np.nan_to_num(passage.passed_s, nan=passage.seen.time_s[0]))
        times[passage.seen.track.actor_class].append(passed_s)
    return dict(times)
