"""Time between greens: yellow, all-red, and the time to empty what lies between stop lines."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field

from urbantwin.roads.signals.controlled_links import Link
from urbantwin.roads.signals.inner_links import Feed
from urbantwin.roads.signals.streams import LONG_TURN_M, Traffic

__all__ = ["Change", "Intergreens", "all_red_s", "crossing_s", "yellow_s"]

#: Yellow by speed limit, m/s -> s (RiLSA 2015, 2.4: 3 s at 50 km/h, 4 s at 60, 5 s at 70).
YELLOW_S = ((52 / 3.6, 3.0), (62 / 3.6, 4.0), (math.inf, 5.0))
#: All red: (way + vehicle) / speed - 1 s (ITE, Guidelines for Determining Traffic Signal Change and
#: Clearance Intervals, 2020: the first second is the next driver's reaction), metres, m/s, s.
VEHICLE_M, SLOWEST_M_S, REACTION_S = 6.1, 6.0, 1.0
SHORTEST_ALL_RED_S, LONGEST_ALL_RED_S = 1.0, 5.0
#: People walk 1.2 m/s (RiLSA 2015, 2.5).
WALK_M_S = 1.2
#: Vehicles that can only turn over crossings where people have green have so much of it for
#: themselves when these are over, seconds: where many walk, nobody would get through else.
AFTER_WALKERS_S = 5.0
#: Inner links stay green until who set out last from a queue is there, m/s, and no longer, s.
INNER_M_S, LONGEST_INNER_S = 6.0, 15.0
#: Vehicles set out with 2 m/s2 (ITE, Transportation Planning Handbook: 1.5 to 2.2 in town), from
#: where this share of a turn's way is left to go.
ACCELERATION_M_S2, MIDDLE = 2.0, 0.6


def yellow_s(ending: Iterable[Link]) -> float:
    """Return the yellow of links whose green ends, seconds."""
    fastest = max(link.speed for link in ending)
    return next(seconds for limit, seconds in YELLOW_S if fastest <= limit)


def all_red_s(ending: Iterable[Link]) -> float:
    """Return the seconds in which the last vehicles of links leave the junction."""
    clear = max(
        (link.length + VEHICLE_M) / max(link.speed, SLOWEST_M_S) - REACTION_S for link in ending
    )
    return float(min(max(math.ceil(clear - 1e-6), SHORTEST_ALL_RED_S), LONGEST_ALL_RED_S))


def crossing_s(link: Link) -> int:
    """Return the seconds that people take over a crossing."""
    return math.ceil(link.length / WALK_M_S - 1e-6)


@dataclass(frozen=True)
class Change:
    """The change from one stage to the next; seconds from the end of the first.

    Attributes:
        seconds: when the next stage begins.
        yellow: of vehicles whose green ends.
        starts: link -> when its green begins, where that is not with the stage.
        ends: link -> when its green ends, where that is not with the stage; people's before it.
        over: when everything of the first stage is over.
    """

    seconds: float
    yellow: float
    starts: Mapping[int, float] = field(default_factory=dict)
    ends: Mapping[int, float] = field(default_factory=dict)
    over: float = 0.0


class Intergreens:
    """Changes between the stages of one junction.

    Args:
        traffic: its streams.
    """

    def __init__(self, traffic: Traffic) -> None:
        self._traffic = traffic
        self._of_index = traffic.junction.of_index
        self._own = {k for stream in traffic.streams for k in stream.links if not stream.walk}
        self._feeders: dict[int, list[Feed]] = defaultdict(list)
        for ways in traffic.inner.values():
            for feed in ways:
                self._feeders[feed.to_index].append(feed)
        self._known: dict[tuple[frozenset[int], frozenset[int]], Change] = {}

    def change(self, green: frozenset[int], after: frozenset[int]) -> Change:
        """Return the change from the links of one stage to those of another.

        Green begins where who set out last before is out of the way, at the inner links later than
        at the others; the stage begins when all but these have green.
        """
        if (green, after) not in self._known:
            self._known[green, after] = self._change(green, after)
        return self._known[green, after]

    def _change(self, green: frozenset[int], after: frozenset[int]) -> Change:
        late = self._late(green, after)
        links = [link for k in late for link in self._of_index[k]]
        yellow = yellow_s(links) if links else 0.0
        clear = {k: end + yellow + self._all_red(k) for k, end in late.items()}
        starts = {
            k: max((t for j, t in clear.items() if not self._traffic.together(j, k)), default=0.0)
            for k in sorted(after - green)
        }
        own = [seconds for k, seconds in starts.items() if k in self._own]
        over = max(clear.values(), default=0.0)
        begins = max(own or starts.values(), default=over)
        ends = dict(late)
        for k in sorted(green - after):
            if self._walks(k):
                first = [t for j, t in starts.items() if not self._traffic.together(j, k)]
                needed = float(max(map(crossing_s, self._of_index[k])))
                ends[k] = min(0.0, min(first, default=begins) - needed)
                if self._holds_up(k, green):
                    ends[k] = min(ends[k], -needed - AFTER_WALKERS_S)
        return Change(begins, yellow, starts, ends, over)

    def _holds_up(self, walk: int, green: Collection[int]) -> bool:
        """Whether some lane can go nowhere while people walk, one of the ways being over these."""
        junction = self._traffic.junction
        people = [link for k in green if self._walks(k) for link in self._of_index[k]]
        own = self._of_index[walk]
        lanes: dict[str, list[Link]] = defaultdict(list)
        for link in junction.links:
            if link.index in green and not self._walks(link.index):
                lanes[link.lane].append(link)
        return any(
            all(any(junction.gives_way(link, other) for other in people) for link in links)
            and any(junction.gives_way(link, other) for link in links for other in own)
            for links in lanes.values()
        )

    def _all_red(self, index: int) -> float:
        """Return the seconds in which the last vehicles of a link leave the junction.

        Who waits for a gap in the middle of a long turn sets out from there when opposing traffic
        has stopped.
        """
        links = self._of_index[index]
        waiting = [
            link.length
            for link in links
            if link.length > LONG_TURN_M and link.index in self._traffic.permitted
        ]
        rest = MIDDLE * max(waiting, default=0.0)
        return max(all_red_s(links), float(math.ceil(math.sqrt(2.0 * rest / ACCELERATION_M_S2))))

    def _late(self, green: Collection[int], after: Collection[int]) -> dict[int, float]:
        """Return by how many seconds each link's green ends later than its stage."""
        driven = [k for k in sorted(green) if not self._walks(k)]
        # Who was let in meets inner links that stay green as well as those that do not.
        late = {k: 0.0 for k in driven if k not in after}
        for _ in driven:
            for k in driven:
                ways = [feed for feed in self._feeders[k] if feed.index in late]
                needed = [late[way.index] + math.ceil(way.length / INNER_M_S) for way in ways]
                if needed:
                    late[k] = min(max(needed), LONGEST_INNER_S)
        return {k: seconds for k, seconds in late.items() if k not in after}

    def _walks(self, index: int) -> bool:
        return self._of_index[index][0].movement == "walk"
