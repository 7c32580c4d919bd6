"""Load and capacity of signalised lanes, after the HCM's signalised junctions.

A lane's capacity is its saturation flow times the green share of its cycle. Permitted turns across
opposing traffic use gaps after the opposing queue, and two vehicles turn at the end of each green
(HCM 2016, 31). The loads of movements that share a lane are added (HCM 2016, 20, shared lanes).
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from lxml import etree

from urbantwin.roads.model.furniture import Phase
from urbantwin.roads.signals.controlled_links import Link, Signalised, admits_cars
from urbantwin.site.usual_traffic import LANE_PER_HOUR, OTHER_PER_HOUR

__all__ = [
    "LONGEST_CYCLE_S",
    "MOST_RATIO",
    "SATURATION_VEH_H",
    "SHORTEST_CYCLE_S",
    "STEP_S",
    "Choices",
    "Flows",
    "LaneLoad",
    "assumed_flows",
    "capped",
    "choices_of",
    "cycle_s",
    "gap_flow",
    "green_seconds",
    "lane_loads",
    "on_lanes",
    "saturation_flow",
]

#: Saturation flow of a lane, vehicles per hour of green (HCM 2016, 19: 1900 less usual
#: adjustments).
SATURATION_VEH_H = 1800.0
#: Cycles are 60 to 120 s (RiLSA 2015, 2.7.3: 90 s as a rule, at most 120 s), in steps of 5 s.
SHORTEST_CYCLE_S, LONGEST_CYCLE_S, STEP_S = 60.0, 120.0, 5.0
#: Maximum green share of a cycle.
MOST_RATIO = 0.9


def cycle_s(ratios: Sequence[float], lost_s: float, least_s: float) -> float:
    """Return the cycle length by Webster's formula within its bounds, seconds.

    Args:
        ratios: critical flow ratio of each stage.
        lost_s: time between the stages in total, seconds.
        least_s: minimum cycle from the shortest greens and the time between them, seconds.
    """
    ratio_sum = min(sum(ratios), MOST_RATIO)
    best = (1.5 * lost_s + 5.0) / (1.0 - ratio_sum)
    cycle = min(max(best, SHORTEST_CYCLE_S), LONGEST_CYCLE_S)
    return STEP_S * math.ceil(max(cycle, least_s) / STEP_S - 1e-6)


def capped(ratios: Sequence[float], most: float = MOST_RATIO) -> list[float]:
    """Return flow ratios limited to a feasible share.

    Ratios above ``most`` share what the others leave, but get no less than an equal share.

    Args:
        ratios: critical flow ratio of each stage.
        most: maximum green share of the cycle.
    """
    limited = np.asarray(ratios, np.float64)
    far = limited > most
    if far.any():
        share = (most - limited[~far].sum()) / far.sum()
        limited = np.where(far, max(share, most / len(limited)), limited)
    return [float(ratio) for ratio in limited]


def green_seconds(ratios: Sequence[float], least: Sequence[float], whole_s: float) -> list[float]:
    """Divide green time into whole seconds by flow ratio, with a minimum per stage.

    Args:
        ratios: critical flow ratio of each stage.
        least: shortest green of each stage, whole seconds.
        whole_s: total to divide, at least the sum of the shortest, seconds.
    """
    weights = np.maximum(np.asarray(ratios, np.float64), 1e-6)
    shortest = np.asarray(least, np.float64)
    green = shortest.copy()
    free = np.ones(len(green), bool)
    while free.any():
        share = (whole_s - shortest[~free].sum()) * weights / weights[free].sum()
        short = free & (share < shortest)
        if not short.any():
            green[free] = share[free]
            break
        free &= ~short
    floored = np.floor(green + 1e-6)
    rest = round(whole_s - floored.sum())
    # The remainder goes to the stages that rounding reduced most.
    for k in np.argsort(floored - green, kind="stable")[: max(rest, 0)]:
        floored[k] += 1.0
    return [float(seconds) for seconds in floored]


#: (edge, next edge, the one after that or empty) -> cars per hour.
Flows = Mapping[tuple[str, str, str], float]
#: Saturation flow of turns as a share of straight-on flow (HCM 2016, 19: 0.85 to 0.95), and of
#: movements with pedestrians crossing their exit.
TURNING, BESIDE_WALKERS = 0.9, 0.5
#: Headway of a queue in a bend: seconds, plus metres at the bend's speed (of simulated drivers;
#: Kimber, McDonald and Hounsell, TRRL Research Report 67, 1986, measured the effect of radius on
#: the flow of turns).
FOLLOWING_S, FOLLOWING_M = 1.35, 6.6
#: Critical gap of a turn across opposing traffic, and follow-up headway, seconds.
GAP_S, NEXT_S = 4.5, 2.5
#: Vehicles that turn at the end of a permitted green.
SNEAKERS = 2.0
#: Start-up lost time less the yellow time used, seconds (HCM 2016, 19: 2 s and 2 s; simulated
#: drivers use less of the yellow).
START_LOST_S = 1.0
#: Number of increments in which a movement's flow is assigned to lanes.
PARTS = 12
#: Capacity of a link without green, cars per hour.
NOTHING = 1e-3
#: Assumed flows without counts: added to the usual midday flow of a lane's class, because streets
#: with signals are busier and the peak hour counts; and the maximum, a quarter of the saturation
#: flow. Vehicles per hour.
MORE_VEH_H, MOST_VEH_H = 200.0, 450.0
#: Assumed ratio of straight-on vehicles to those of each turn.
STRAIGHT_ON = 3.0


@dataclass(frozen=True)
class LaneLoad:
    """Flow of a lane in total and per link, cars per hour, and its load as a share of capacity."""

    lane: str
    flow: float
    load: float
    links: Mapping[Link, float] = field(default_factory=dict)

    @property
    def capacity(self) -> float:
        """Capacity of the lane for the same mix of movements, cars per hour."""
        return self.flow / self.load if self.load else math.inf


def saturation_flow(link: Link) -> float:
    """Return the saturation flow of a link on an exclusive lane, cars per hour of green."""
    in_bend = 3600.0 / (FOLLOWING_S + FOLLOWING_M / link.bend_speed)
    return min(SATURATION_VEH_H * (TURNING if link.is_turn else 1.0), in_bend)


def gap_flow(opposing: float) -> float:
    """Return the capacity of turns in gaps of opposing traffic, cars per hour."""
    if opposing < 1.0:
        return 3600.0 / NEXT_S
    rate = opposing / 3600.0
    return opposing * math.exp(-rate * GAP_S) / -math.expm1(-rate * NEXT_S)


class Choices(NamedTuple):
    """Alternative links for each flow.

    Attributes:
        links: all links of vehicles.
        flows: alternative links and cars per hour, fewest alternatives first.
    """

    links: tuple[Link, ...]
    flows: tuple[tuple[Sequence[Link], float], ...]


def choices_of(junction: Signalised, flows: Flows) -> Choices:
    """Return the links of a junction that each of its flows may use."""
    by_movement: dict[tuple[str, str], list[Link]] = defaultdict(list)
    for link in junction.links:
        if link.movement != "walk":
            by_movement[link.road, link.to.rpartition("_")[0]].append(link)
    choices = []
    for edges, count in flows.items():
        links = by_movement.get(edges[:2], [])
        # Before a short road a vehicle must already be in the correct lane.
        lead_on = [link for link in links if edges[2] in junction.onward.get(link.to, ())]
        if links and count:
            choices.append((len(lead_on or links), edges, lead_on or links, count))
    choices.sort(key=lambda choice: choice[:2])
    every = tuple(link for links in by_movement.values() for link in links)
    return Choices(every, tuple((links, count) for _, _, links, count in choices))


def on_lanes(choices: Choices, capacity: Callable[[Link], float]) -> dict[Link, float]:
    """Return the flow of each link, cars per hour, if vehicles choose the least loaded lane.

    Args:
        choices: links and flows.
        capacity: capacity of a link on an exclusive lane, cars per hour.
    """
    load: dict[str, float] = defaultdict(float)
    flow = dict.fromkeys(choices.links, 0.0)
    for links, count in choices.flows:
        part = count / PARTS
        needed = [(link.lane, part / max(capacity(link), NOTHING), link) for link in links]
        for _ in range(PARTS):
            lane, more, best = min(needed, key=lambda item: (load[item[0]] + item[1], item[0]))
            load[lane] += more
            flow[best] += part
    return flow


def lane_loads(
    junction: Signalised,
    phases: Sequence[Phase],
    flows: Flows,
    passing: Mapping[tuple[str, int], float] | None = None,
) -> list[LaneLoad]:
    """Return the load of each waiting lane, the highest first.

    Args:
        junction: the signalised junction.
        phases: its program.
        flows: cars per hour from street to street.
        passing: (program, index) -> share of its green in which vehicles can leave; else 1.
    """
    shares = passing or {}
    choices = choices_of(junction, flows)
    even = on_lanes(choices, lambda link: SATURATION_VEH_H)
    capacity = {
        link: shares.get((junction.program, link.index), 1.0)
        * _capacity(junction, link, phases, even)
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
    loads = [LaneLoad(lane, flow[lane], load[lane], links[lane]) for lane in sorted(flow)]
    return sorted(loads, key=lambda item: -item.load)


def _capacity(
    junction: Signalised, link: Link, phases: Sequence[Phase], even: Mapping[Link, float]
) -> float:
    """Return the capacity of a link on an exclusive lane, cars per hour.

    Args:
        junction: the signalised junction.
        link: one of its links.
        phases: the program.
        even: flow of each link if all always had green, cars per hour.
    """
    cycle = sum(seconds for seconds, _ in phases)
    green = sum(seconds for seconds, state in phases if state[link.index] in "gG")
    foes = junction.yields_to[link]
    cars, blocked, waits = 0.0, 0.0, False
    lost_share = START_LOST_S / green if green else 0.0
    for seconds, state in phases:
        letter = state[link.index]
        if letter not in "gG":
            continue
        on = [other for other in foes if state[other.index] in "gG"]
        opposing = [other for other in on if other.movement != "walk"]
        walked = len(opposing) < len(on)
        rate = min(saturation_flow(link), SATURATION_VEH_H * (BESIDE_WALKERS if walked else 1.0))
        if letter == "g" and opposing:
            waits = True
            rate = min(rate, gap_flow(sum(even[other] for other in opposing)))
            blocked = max(blocked, rate * _queue_s(opposing, phases, cycle, even))
        cars += rate * seconds * max(1.0 - lost_share, 0.0)
    if waits:
        cars = max(cars - blocked, 0.0) + SNEAKERS * 3600.0
    return cars / cycle


def _queue_s(
    opposing: Sequence[Link], phases: Sequence[Phase], cycle: float, even: Mapping[Link, float]
) -> float:
    """Return the discharge time of the longest opposing queue after red, seconds."""
    lanes: dict[str, float] = defaultdict(float)
    for link in opposing:
        lanes[link.lane] += even[link]
    longest = 0.0
    for link in opposing:
        green = sum(seconds for seconds, state in phases if state[link.index] in "gG")
        rate = min(lanes[link.lane], 0.9 * SATURATION_VEH_H)
        longest = max(longest, rate * (cycle - green) / (SATURATION_VEH_H - rate))
    return longest


def assumed_flows(
    root: etree._Element, junctions: Iterable[Signalised]
) -> dict[tuple[str, str, str], float]:
    """Return (edge, next edge, empty) -> assumed cars per hour at signals, by class of street.

    Args:
        root: the network.
        junctions: all its signalised junctions.
    """
    flows: dict[tuple[str, str, str], float] = defaultdict(float)
    volumes = _lane_volumes(root)
    for junction in junctions:
        weights: dict[str, float] = defaultdict(float)
        driven = [link for link in junction.links if link.movement != "walk"]
        for link in driven:
            weights[link.lane] += _straightness(link)
        for link in driven:
            share = _straightness(link) / weights[link.lane]
            flows[link.road, link.to.rpartition("_")[0], ""] += share * volumes.get(link.lane, 0.0)
    return dict(flows)


def _straightness(link: Link) -> float:
    return STRAIGHT_ON if link.movement == "through" else 1.0


def _lane_volumes(root: etree._Element) -> dict[str, float]:
    volumes: dict[str, float] = {}
    for edge in root.iterfind("edge"):
        if edge.get("function"):
            continue
        kind = edge.get("type", "").split("|")[-1].removeprefix("highway.")
        usual = LANE_PER_HOUR.get(kind, OTHER_PER_HOUR) + MORE_VEH_H
        lanes = [lane.get("id") for lane in edge.iterfind("lane") if admits_cars(lane)]
        volumes |= dict.fromkeys(lanes, min(usual, MOST_VEH_H))
    return volumes
