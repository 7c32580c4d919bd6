"""Flow ratios of streams: what the lanes that wait carry, of what they could."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping

from lxml import etree

from urbantwin.roads.signals.capacity import gap_flow
from urbantwin.roads.signals.controlled_links import Link, Signalised
from urbantwin.roads.signals.green_times import SATURATION_VEH_H
from urbantwin.roads.signals.streams import Traffic
from urbantwin.site.usual_traffic import LANE_PER_HOUR, OTHER_PER_HOUR

__all__ = ["assumed_flows", "flow_ratios", "link_flows"]

#: Vehicles an hour on a lane with signals beyond what its class usually has at midday: the streets
#: that have signals are the busier ones of their class, and the busiest hour counts. No lane that
#: has to share its time carries more than a quarter of what it could.
MORE_VEH_H, MOST_VEH_H = 200.0, 450.0
#: Of the vehicles of a lane, so many more go straight on than turn either way.
STRAIGHT_ON = 3.0
#: Who waits for gaps takes at most so much more green than who goes straight on (HCM 2016, 31).
MOST_PATIENT = 4.0


def assumed_flows(
    root: etree._Element, junctions: Iterable[Signalised]
) -> dict[tuple[str, str, str], float]:
    """Return (edge, next edge, nothing) -> vehicles an hour at signals, by the edges' class, lanes.

    Args:
        root: the network.
        junctions: all that is signalised in it.
    """
    found: dict[tuple[str, str, str], float] = defaultdict(float)
    volumes = _lane_volumes(root)
    for junction in junctions:
        weights: dict[str, float] = defaultdict(float)
        driven = [link for link in junction.links if link.movement != "walk"]
        for link in driven:
            weights[link.lane] += _straightness(link)
        for link in driven:
            share = _straightness(link) / weights[link.lane]
            found[link.road, link.to.rpartition("_")[0], ""] += share * volumes.get(link.lane, 0.0)
    return dict(found)


def _straightness(link: Link) -> float:
    return STRAIGHT_ON if link.movement == "through" else 1.0


def _lane_volumes(root: etree._Element) -> dict[str, float]:
    found: dict[str, float] = {}
    for edge in root.iterfind("edge"):
        if edge.get("function"):
            continue
        kind = edge.get("type", "").split("|")[-1].removeprefix("highway.")
        usual = LANE_PER_HOUR.get(kind, OTHER_PER_HOUR) + MORE_VEH_H
        lanes = [lane.get("id") for lane in edge.iterfind("lane") if _for_cars(lane)]
        found |= dict.fromkeys(lanes, min(usual, MOST_VEH_H))
    return found


def _for_cars(lane: etree._Element) -> bool:
    allow, disallow = (lane.get(key, "").split() for key in ("allow", "disallow"))
    return "passenger" in allow if allow else not {"passenger", "all"} & set(disallow)


def flow_ratios(traffic: Traffic, carried: Mapping[Link, float]) -> list[float]:
    """Return the flow ratio of each stream's critical lane; 0 for crossings.

    Args:
        traffic: the streams of a junction.
        carried: vehicles an hour on each link.
    """
    lanes: dict[str, float] = defaultdict(float)
    for link, count in carried.items():
        waits = traffic.waits_for_gaps(link)
        lanes[link.lane] += count * (_patience(traffic, link, carried) if waits else 1.0)
    return [
        0.0 if stream.walk else max(lanes[lane] for lane in stream.lanes) / SATURATION_VEH_H
        for stream in traffic.streams
    ]


def _patience(traffic: Traffic, link: Link, carried: Mapping[Link, float]) -> float:
    """Return how many go straight on in the time that one takes who waits for a gap."""
    junction = traffic.junction
    opposing = sum(
        count
        for other, count in carried.items()
        if junction.gives_way(link, other) and traffic.together(link.index, other.index)
    )
    return min(SATURATION_VEH_H / max(gap_flow(opposing), 1.0), MOST_PATIENT)


def link_flows(carried: Mapping[Link, float]) -> dict[int, float]:
    """Return link -> flow ratio of what takes it, of all lanes and turns that share its letter.

    Args:
        carried: vehicles an hour on each link.
    """
    found: dict[int, float] = defaultdict(float)
    for link, count in carried.items():
        found[link.index] += count / SATURATION_VEH_H
    return dict(found)
