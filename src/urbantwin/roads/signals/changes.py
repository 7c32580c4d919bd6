"""Intergreen changes between stages of a signal program, and the resulting phases."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from urbantwin.roads.model.furniture import Phase
from urbantwin.roads.signals.controlled_links import Link, Signalised

__all__ = ["Change", "Changes", "all_red_s", "crossing_s", "phases_of_stages", "yellow_s"]

#: Duration of yellow by speed limit, m/s -> s (RiLSA 2015, 2.4: 3 s at 50 km/h, 4 s at 60, 5 s at
#: 70).
YELLOW_S = ((52 / 3.6, 3.0), (62 / 3.6, 4.0), (math.inf, 5.0))
#: All-red time: (path length + vehicle length) / speed - 1 s (ITE, Guidelines for Determining
#: Traffic Signal Change and Clearance Intervals, 2020: the first second is the next driver's
#: reaction); metres, m/s, s.
VEHICLE_M, SLOWEST_M_S, REACTION_S = 6.1, 6.0, 1.0
SHORTEST_ALL_RED_S, LONGEST_ALL_RED_S = 1.0, 5.0
#: Walking speed, m/s (RiLSA 2015, 2.5).
WALK_M_S = 1.2
#: Green after the pedestrians' green for lanes that only turn across crossings, seconds: with many
#: pedestrians no vehicle would pass otherwise.
AFTER_WALKERS_S = 5.0
#: A link within the junction stays green until the last of a queue reaches it at this speed, m/s,
#: for at most the second, seconds.
INNER_M_S, LONGEST_INNER_S = 6.0, 15.0


def yellow_s(ending: Iterable[Link]) -> float:
    """Return the yellow time of links whose green ends, seconds."""
    fastest = max(link.speed for link in ending)
    return next(seconds for limit, seconds in YELLOW_S if fastest <= limit)


def all_red_s(ending: Iterable[Link]) -> float:
    """Return the clearance time of the last vehicles of links, seconds."""
    clear = max(
        (link.length + VEHICLE_M) / max(link.speed, SLOWEST_M_S) - REACTION_S for link in ending
    )
    return float(min(max(math.ceil(clear - 1e-6), SHORTEST_ALL_RED_S), LONGEST_ALL_RED_S))


def crossing_s(link: Link) -> int:
    """Return the walking time over a crossing, seconds."""
    return math.ceil(link.length / WALK_M_S - 1e-6)


@dataclass(frozen=True)
class Change:
    """The change from one stage to the next; seconds from the end of the first.

    Attributes:
        seconds: start of the next stage.
        yellow: duration of yellow for vehicles whose green ends.
        starts: link -> start of its green, if not with the stage.
        ends: link -> end of its green, if not with the stage; that of pedestrians is earlier.
        over: end of all yellow and clearance times of the first stage.
    """

    seconds: float
    yellow: float
    starts: Mapping[int, float] = field(default_factory=dict)
    ends: Mapping[int, float] = field(default_factory=dict)
    over: float = 0.0


class Changes:
    """Changes between the stages of a junction.

    Args:
        junction: the signalised junction.
    """

    def __init__(self, junction: Signalised) -> None:
        self.junction = junction

    def between(self, green: Collection[int], after: Collection[int]) -> Change:
        """Return the change from the links of one stage to those of another.

        Each green begins after conflicting traffic has cleared, later at links within the junction.
        The next stage begins when all other links have green.
        """
        junction = self.junction
        late = self._late(green, after)
        links = [link for k in late for link in junction.of_index[k]]
        yellow = yellow_s(links) if links else 0.0
        clear = {k: end + yellow + all_red_s(junction.of_index[k]) for k, end in late.items()}
        starts = {
            k: max((t for j, t in clear.items() if not junction.together(j, k)), default=0.0)
            for k in sorted(set(after) - set(green))
        }
        outer = [seconds for k, seconds in starts.items() if not junction.feeders[k]]
        clear_s = max(clear.values(), default=0.0)
        begins = max(outer or starts.values(), default=clear_s)
        ends = dict(late)
        for k in sorted(set(green) - set(after)):
            if junction.is_walk(k):
                first = [t for j, t in starts.items() if not junction.together(j, k)]
                needed = float(max(map(crossing_s, junction.of_index[k])))
                ends[k] = min(0.0, min(first, default=begins) - needed)
                if self._holds_up(k, green):
                    ends[k] = min(ends[k], -needed - AFTER_WALKERS_S)
        return Change(begins, yellow, starts, ends, clear_s)

    def _holds_up(self, walk: int, green: Collection[int]) -> bool:
        """Return whether pedestrians of a crossing and others block a lane completely."""
        junction = self.junction
        people = [link for k in green if junction.is_walk(k) for link in junction.of_index[k]]
        own_links = junction.of_index[walk]
        lanes: dict[str, list[Link]] = defaultdict(list)
        for link in junction.links:
            if link.index in green and not junction.is_walk(link.index):
                lanes[link.lane].append(link)
        return any(
            all(any(junction.gives_way(link, other) for other in people) for link in links)
            and any(junction.gives_way(link, other) for link in links for other in own_links)
            for links in lanes.values()
        )

    def _late(self, green: Collection[int], after: Collection[int]) -> dict[int, float]:
        """Return the delay of the end of green of each ending link after its stage, seconds."""
        driven = [k for k in sorted(green) if not self.junction.is_walk(k)]
        # Admitted traffic reaches all inner links, including those that stay green.
        late = {k: 0.0 for k in driven if k not in after}
        for _ in driven:
            for k in driven:
                needed = [
                    late[feeder.index] + math.ceil(feeder.length / INNER_M_S)
                    for feeder in self.junction.feeders[k]
                    if feeder.index in late
                ]
                if needed:
                    late[k] = min(max(needed), LONGEST_INNER_S)
        return {k: seconds for k, seconds in late.items() if k not in after}


def phases_of_stages(
    junction: Signalised,
    stages: Sequence[Collection[int]],
    seconds: Sequence[float],
    changes: Sequence[Change],
) -> tuple[Phase, ...]:
    """Return the phases of a program.

    Args:
        junction: the signalised junction.
        stages: links that have green in each stage.
        seconds: duration of each stage without the change after it.
        changes: from each stage to the next.
    """
    begins = [0.0]
    for length, change in zip(seconds, changes, strict=True):
        begins.append(begins[-1] + length + change.seconds)
    cycle = begins.pop()
    greens: list[tuple[int, float, float]] = []
    yellows: list[tuple[int, float, float]] = []
    for k, stage in enumerate(stages):
        before, change = changes[k - 1], changes[k]
        end = begins[k] + seconds[k]
        for index in sorted(stage):
            goes_on = index in stages[(k + 1) % len(stages)] and len(stages) > 1
            was_green = index in stages[k - 1] and len(stages) > 1
            early = 0.0 if was_green else before.starts.get(index, before.seconds) - before.seconds
            stop = end + (change.seconds if goes_on else change.ends.get(index, 0.0))
            greens.append((index, begins[k] + early, stop))
            if not goes_on and not junction.is_walk(index):
                yellows.append((index, stop, stop + change.yellow))
    times = {0.0, cycle, *(round(t % cycle, 6) for _, *ends in (*greens, *yellows) for t in ends)}
    phases = []
    for start, stop in pairwise(sorted(times)):
        green, yellow = (_links_at((start + stop) / 2, spans, cycle) for spans in (greens, yellows))
        phases.append((stop - start, _state(junction, green, yellow - green)))
    return _joined(phases)


def _links_at(time: float, spans: Sequence[tuple[int, float, float]], cycle: float) -> set[int]:
    """Return the links with a time span that includes a time of the cycle."""
    return {
        index
        for index, start, stop in spans
        if start < time < stop or start < time - cycle < stop or start < time + cycle < stop
    }


def _state(junction: Signalised, green: set[int], yellow: set[int]) -> str:
    """Return the state of a phase; ``g`` where a link yields to another active one."""
    active: Mapping[int, str] = dict.fromkeys(green, "G") | dict.fromkeys(yellow, "y")
    on = [link for index in sorted(active) for link in junction.of_index[index]]
    waiting = {
        link.index
        for link in on
        if link.movement != "walk"
        and any(other.index in active for other in junction.yields_to[link] if other is not link)
    }
    letters = {k: "g" if letter == "G" and k in waiting else letter for k, letter in active.items()}
    return "".join(letters.get(index, "r") for index in range(junction.size))


def _joined(phases: Sequence[Phase]) -> tuple[Phase, ...]:
    """Merge consecutive phases with equal states."""
    joined: list[Phase] = []
    for seconds, state in phases:
        if joined and joined[-1][1] == state:
            joined[-1] = (joined[-1][0] + seconds, state)
        else:
            joined.append((seconds, state))
    return tuple((round(seconds, 3), state) for seconds, state in joined)
