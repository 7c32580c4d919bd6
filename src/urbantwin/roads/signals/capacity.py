"""What lanes with signals can carry, of what comes to them: after the HCM's signalised junctions.

A lane's capacity is its saturation flow times the share of the cycle in which it has green. Who
turns across gets through gaps of opposing traffic when that has left its queue behind, and two at
the end of each green (HCM 2016, 31, permitted left turns). Turns that share a lane hold each other
up: of a lane, the loads of its movements add up (HCM 2016, 20, shared lanes).
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from urbantwin.roads.model.furniture import Phase
from urbantwin.roads.signals.controlled_links import Link, Signalised
from urbantwin.roads.signals.green_times import SATURATION_VEH_H

__all__ = [
    "FOLLOWING_M",
    "Choices",
    "Flows",
    "LaneLoad",
    "choices_of",
    "gap_flow",
    "lane_loads",
    "on_lanes",
    "saturation_flow",
]

#: (edge, next edge, the one after that or nothing) -> cars an hour.
Flows = Mapping[tuple[str, str, str], float]
#: Turns leave a lane so much more slowly than those who go straight on (HCM 2016, 19: 0.85 to
#: 0.95), where people cross at their exit as well.
TURNING, BESIDE_WALKERS = 0.9, 0.75
#: Who follows through a bend keeps this distance in time, and this length of the queue in space:
#: seconds, metres (the headway of simulated drivers; Kimber, McDonald and Hounsell, TRRL Research
#: Report 67, 1986, measured how radius lowers what turns).
FOLLOWING_S, FOLLOWING_M = 1.35, 6.6
#: Gaps that turns across opposing traffic take, and from one to the next of a queue, seconds.
GAP_S, NEXT_S = 4.5, 2.5
#: How many turn in the change at the end of green.
SNEAKERS = 2.0
#: What is lost of a green when queues set out, less what they use of the yellow, seconds (HCM 2016,
#: 19: 2 s and 2 s; simulated drivers use less of the yellow).
START_LOST_S = 1.0
#: A movement's flow is put onto its lanes in so many parts.
PARTS = 12
#: Who never has green.
NOTHING = 1e-3


@dataclass(frozen=True)
class LaneLoad:
    """What a lane carries and could: cars an hour, in all and of each link."""

    lane: str
    flow: float
    load: float
    links: Mapping[Link, float] = field(default_factory=dict)

    @property
    def capacity(self) -> float:
        """What it could carry of the same movements."""
        return self.flow / self.load if self.load else math.inf


def saturation_flow(link: Link, *, in_bends: bool = True) -> float:
    """Return the saturation flow of a link from a lane of its own, cars per hour of green.

    Args:
        link: the link.
        in_bends: whether a narrow bend lowers it.
    """
    in_bend = 3600.0 / (FOLLOWING_S + FOLLOWING_M / (link.bend_speed if in_bends else math.inf))
    return min(SATURATION_VEH_H * (TURNING if link.is_turn else 1.0), in_bend)


def gap_flow(opposing: float) -> float:
    """Return how many an hour turn through the gaps of opposing traffic, cars an hour."""
    if opposing < 1.0:
        return 3600.0 / NEXT_S
    rate = opposing / 3600.0
    return opposing * math.exp(-rate * GAP_S) / -math.expm1(-rate * NEXT_S)


class Choices(NamedTuple):
    """Links that vehicles of each flow may take, the flow with the fewest of them first.

    Attributes:
        links: all links of vehicles.
        flows: links, and cars an hour that take one of them.
    """

    links: tuple[Link, ...]
    flows: tuple[tuple[Sequence[Link], float], ...]


def choices_of(junction: Signalised, flows: Flows) -> Choices:
    """Return which links of a junction its flows may take."""
    ways: dict[tuple[str, str], list[Link]] = defaultdict(list)
    for link in junction.links:
        if link.movement != "walk":
            ways[link.road, link.to.rpartition("_")[0]].append(link)
    choices = []
    for way, count in flows.items():
        links = ways.get(way[:2], [])
        # Beyond a short road one has to be on the right lane before it.
        lead_on = [link for link in links if way[2] in junction.onward.get(link.to, ())]
        if links and count:
            choices.append((len(lead_on or links), way, lead_on or links, count))
    choices.sort(key=lambda choice: choice[:2])
    every = tuple(link for links in ways.values() for link in links)
    return Choices(every, tuple((links, count) for _, _, links, count in choices))


def on_lanes(choices: Choices, capacity: Callable[[Link], float]) -> dict[Link, float]:
    """Return what each link carries, cars an hour, where vehicles choose the lane with most room.

    Args:
        choices: links and flows.
        capacity: of a link, if the lane were its own.
    """
    load: dict[str, float] = defaultdict(float)
    found = dict.fromkeys(choices.links, 0.0)
    for links, count in choices.flows:
        part = count / PARTS
        needed = [(link.lane, part / max(capacity(link), NOTHING), link) for link in links]
        for _ in range(PARTS):
            lane, more, best = needed[0]
            if len(needed) > 1:
                lane, more, best = min(needed, key=lambda one: (load[one[0]] + one[1], one[0]))
            load[lane] += more
            found[best] += part
    return found


def lane_loads(
    junction: Signalised,
    phases: Sequence[Phase],
    flows: Flows,
    behind: Mapping[int, Mapping[int, float]] | None = None,
    *,
    in_bends: bool = True,
    even: Mapping[Link, float] | None = None,
    choices: Choices | None = None,
) -> list[LaneLoad]:
    """Return the load of every lane that waits, the highest first.

    Args:
        junction: its links.
        phases: its program.
        flows: what goes from street to street.
        behind: link -> inner links that what it lets go comes to -> room to wait there, metres.
        in_bends: whether who turns in a narrow bend leaves more slowly.
        even: what each link would carry if all had green all the time, where that is known.
        choices: of the flows, where they are known.
    """
    cycle = sum(seconds for seconds, _ in phases)
    if choices is None:
        choices = choices_of(junction, flows)
    if even is None:
        even = on_lanes(choices, lambda link: SATURATION_VEH_H)
    capacity = {
        link: min(
            _capacity(junction, link, phases, cycle, even, in_bends),
            _capacity_behind(
                junction, link, phases, even, (behind or {}).get(link.index, {}), in_bends
            ),
        )
        for link in even
    }
    carried = on_lanes(choices, capacity.__getitem__)
    flow: dict[str, float] = defaultdict(float)
    load: dict[str, float] = defaultdict(float)
    links: dict[str, dict[Link, float]] = defaultdict(dict)
    for link, count in carried.items():
        links[link.lane][link] = count
        flow[link.lane] += count
        load[link.lane] += count / max(capacity[link], NOTHING)
    found = [LaneLoad(lane, flow[lane], load[lane], links[lane]) for lane in sorted(flow)]
    return sorted(found, key=lambda one: -one.load)


def _capacity_behind(
    junction: Signalised,
    link: Link,
    phases: Sequence[Phase],
    even: Mapping[Link, float],
    behind: Mapping[int, float],
    in_bends: bool,
) -> float:
    """Return how many an hour the inner lanes that a link leads to take of it.

    Those that leave there while it has green, and in each cycle as many as find room to wait there.
    """
    inner = {
        other.lane: room
        for k, room in behind.items()
        for other in junction.of_index[k]
        if other.lane != link.lane
    }
    if link.to in inner:
        inner = {link.to: inner[link.to]}  # inside nobody changes lanes
    cycle = sum(seconds for seconds, _ in phases)
    own = [(seconds, state) for seconds, state in phases if state[link.index] in "gG"]
    carries = 0.0
    for lane, room in sorted(inner.items()):
        ways = [other for other in even if other.lane == lane]
        whole = sum(even[other] for other in ways)
        shares = [even[other] / whole if whole else 1.0 / len(ways) for other in ways]
        needed = sum(
            share / max(_capacity(junction, other, own, cycle, even, in_bends), NOTHING)
            for other, share in zip(ways, shares, strict=True)
            if share
        )
        carries += 1.0 / needed + room // FOLLOWING_M * 3600.0 / cycle
    return carries if inner else math.inf


def _capacity(
    junction: Signalised,
    link: Link,
    phases: Sequence[Phase],
    cycle: float,
    even: Mapping[Link, float],
    in_bends: bool,
) -> float:
    """Return how many an hour a link could carry, if the lane were its own."""
    green = [seconds for seconds, state in phases if state[link.index] in "gG"]
    foes = junction.yields_to[link]
    driven = [other for other in foes if other.movement != "walk"]
    cars, blocked = 0.0, 0.0
    lost = START_LOST_S / sum(green) if green else 0.0
    saturation = saturation_flow(link, in_bends=in_bends)
    waits = False
    for seconds, state in phases:
        letter = state[link.index]
        if letter not in "gG":
            continue
        opposing = [other for other in driven if state[other.index] in "gG"]
        walked = any(state[k.index] in "gG" for k in foes if k.movement == "walk")
        rate = min(saturation, SATURATION_VEH_H * (BESIDE_WALKERS if walked else 1.0))
        if letter == "g" and opposing:
            waits = True
            rate = min(rate, gap_flow(sum(even[other] for other in opposing)))
            blocked = max(blocked, rate * _queue_s(opposing, phases, cycle, even))
        cars += rate * seconds * max(1.0 - lost, 0.0)
    if waits:
        cars = max(cars - blocked, 0.0) + SNEAKERS * 3600.0
    return cars / cycle


def _queue_s(
    opposing: Sequence[Link], phases: Sequence[Phase], cycle: float, even: Mapping[Link, float]
) -> float:
    """Return how long opposing queues of a red take to leave, seconds."""
    lanes: dict[str, float] = defaultdict(float)
    for link in opposing:
        lanes[link.lane] += even[link]
    longest = 0.0
    for link in opposing:
        green = sum(seconds for seconds, state in phases if state[link.index] in "gG")
        rate = min(lanes[link.lane], 0.9 * SATURATION_VEH_H)
        longest = max(longest, rate * (cycle - green) / (SATURATION_VEH_H - rate))
    return longest
