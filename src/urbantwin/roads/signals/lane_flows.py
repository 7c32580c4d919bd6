"""Flow ratios of streams: what the lanes that wait carry, of what they could."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping

from lxml import etree

from urbantwin.roads.signals.green_times import SATURATION_VEH_H
from urbantwin.roads.signals.streams import Traffic
from urbantwin.site.usual_traffic import LANE_PER_HOUR, OTHER_PER_HOUR

__all__ = ["flow_ratios", "lane_volumes", "link_flows"]

#: Vehicles an hour on a lane with signals beyond what its class usually has at midday: the streets
#: that have signals are the busier ones of their class, and the busiest hour counts. No lane that
#: has to share its time carries more than a quarter of what it could.
MORE_VEH_H, MOST_VEH_H = 200.0, 450.0
#: Lanes whose vehicles wait for gaps in opposing traffic to turn take this much more green (HCM
#: 2016, 31: 2 to 3 through vehicles for each that turns, which a quarter to a third do).
WAITS_FOR_GAPS = 1.4
#: Of the vehicles of a lane, so many more go straight on than turn either way.
STRAIGHT_ON = 3.0


def lane_volumes(
    root: etree._Element, of_edge: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Return lane -> vehicles an hour: an edge's, in equal parts on its lanes for cars.

    Args:
        root: the network.
        of_edge: edge -> vehicles an hour; of others they are assumed by their class and lanes.
    """
    found: dict[str, float] = {}
    for edge in root.iterfind("edge"):
        if edge.get("function"):
            continue
        lanes = [lane.get("id") for lane in edge.iterfind("lane") if _for_cars(lane)]
        kind = edge.get("type", "").split("|")[-1].removeprefix("highway.")
        usual = LANE_PER_HOUR.get(kind, OTHER_PER_HOUR) + MORE_VEH_H
        assumed = len(lanes) * min(usual, MOST_VEH_H)
        whole = (of_edge or {}).get(edge.get("id"), assumed)
        found |= {lane: whole / len(lanes) for lane in lanes}
    return found


def _for_cars(lane: etree._Element) -> bool:
    allow, disallow = (lane.get(key, "").split() for key in ("allow", "disallow"))
    return "passenger" in allow if allow else not {"passenger", "all"} & set(disallow)


def flow_ratios(traffic: Traffic, volumes: Mapping[str, float]) -> list[float]:
    """Return the flow ratio of each stream's critical lane; 0 for crossings.

    Args:
        traffic: the streams of a junction.
        volumes: lane -> vehicles an hour.
    """
    waiting = {link.lane for link in traffic.junction.links if traffic.waits_for_gaps(link)}
    found = []
    for stream in traffic.streams:
        needed = [
            volumes.get(lane, 0.0) * (WAITS_FOR_GAPS if lane in waiting else 1.0)
            for lane in stream.lanes
        ]
        found.append(max(needed) / SATURATION_VEH_H)
    return found


def link_flows(traffic: Traffic, volumes: Mapping[str, float]) -> dict[int, float]:
    """Return link -> flow ratio of what takes it, of all lanes and turns that share its letter.

    Args:
        traffic: the streams of a junction.
        volumes: lane -> vehicles an hour.
    """
    weights: dict[str, float] = defaultdict(float)
    for link in traffic.junction.links:
        weights[link.lane] += STRAIGHT_ON if link.movement == "through" else 1.0
    found: dict[int, float] = defaultdict(float)
    for link in traffic.junction.links:
        share = (STRAIGHT_ON if link.movement == "through" else 1.0) / weights[link.lane]
        found[link.index] += share * volumes.get(link.lane, 0.0) / SATURATION_VEH_H
    return dict(found)
