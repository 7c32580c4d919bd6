"""Begin and cause of queues, for reports about traffic that is not carried."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from urbantwin.roads import RoadNetwork
from urbantwin.traffic.demand.counted_places import arm_of

__all__ = ["Bottleneck", "bottleneck"]

#: Share of a lane's length taken by standing vehicles from which it is jammed, and length per
#: vehicle, metres.
JAMMED, SPACE_M = 0.4, 7.5
#: Maximum number of streets over which a queue is followed.
MOST_STREETS = 20


@dataclass(frozen=True)
class Bottleneck:
    """The begin of a queue: its road, and a description of the cause."""

    road: str = ""
    because: str = ""


def bottleneck(
    network: RoadNetwork, standing: Mapping[str, float], *, road: str = ""
) -> Bottleneck:
    """Return the begin and cause of the longest queue; empty if no vehicles stand.

    It is followed downstream from the lane with the longest queue while the lanes ahead are jammed.

    Args:
        network: the lanes, with signal programs.
        standing: lane -> mean number of standing vehicles.
        road: road whose queue is followed; empty: that of the lane with the longest.
    """
    lane_by_id = network.lane_by_id
    outside = {x: count for x, count in standing.items() if x in lane_by_id and lane_by_id[x].road}
    outside = {x: count for x, count in outside.items() if road in ("", lane_by_id[x].road)}
    if not outside:
        return Bottleneck()
    name = max(sorted(outside), key=lambda lane: outside[lane])
    passed = {lane_by_id[name].road}
    for _ in range(MOST_STREETS):
        ahead = [
            lane
            for lane in network.lanes_beyond(lane_by_id[name])
            if lane.id != name and standing.get(lane.id, 0.0) * SPACE_M > JAMMED * lane.length
        ]
        if not ahead:
            break
        name = max(ahead, key=lambda lane: (standing[lane.id], lane.id)).id
        if lane_by_id[name].road in passed:
            locked = f"queues on {_street(network, name)} lock each other up"
            return Bottleneck(lane_by_id[name].road, locked)
        passed.add(lane_by_id[name].road)
    begins = f"the queue on {_approach(network, name)} begins {_cause(network, name)}"
    return Bottleneck(lane_by_id[name].road, begins)


def _street(network: RoadNetwork, name: str) -> str:
    road = next(road for road in network.roads if road.id == network.lane_by_id[name].road)
    if road.name:
        return road.name
    return f"way {road.ways[0]}" if road.ways else "a road beyond the region"


def _approach(network: RoadNetwork, name: str) -> str:
    """Return the name of a street and its side, since both directions have the same name."""
    road = next(road for road in network.roads if road.id == network.lane_by_id[name].road)
    return f"{_street(network, name)} from the {arm_of(network, road, at_end=True)}"


def _cause(network: RoadNetwork, name: str) -> str:
    """Return a description of the end of a lane."""
    programs = {program.id: program for program in network.programs}
    for head in network.signals:
        if head.lane == name and head.program in programs:
            phases = programs[head.program].phases
            cycle = sum(seconds for seconds, _ in phases)
            green = sum(
                seconds
                for seconds, state in phases
                if any(state[link] in "gG" for link in head.links if link < len(state))
            )
            return f"at a signal that is green for {green:.0f} of {cycle:.0f} s"
    lane = network.lane_by_id[name]
    road = next(road for road in network.roads if road.id == lane.road)
    onward = len({after.id for after in network.lanes_beyond(lane)} - {name})
    if onward == 0:
        return "where its lane ends"
    lanes = len([x for x in road.lanes if network.lane_by_id[x].kind in ("driving", "bus")])
    if lanes > 1 and onward == 1:
        return f"where its {lanes} lanes merge or give way"
    return "where it gives way"
