"""Guessed volumes, limited by the capacity of the signals.

A guess by road classes and lanes ignores how streets meet. Without counts, volumes are limited to
what the junctions' lanes can carry by their green times (`roads.signals.capacity`). Only routes
over a full lane are reduced.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from lxml import etree

from urbantwin.roads.assignment.movement_flows import IN_CARS
from urbantwin.roads.signals.capacity import Flows, LaneLoad, lane_loads
from urbantwin.roads.signals.controlled_links import Signalised, signalised_junctions
from urbantwin.roads.signals.coordination import passing_shares
from urbantwin.traffic.demand.circulation import Circulation
from urbantwin.traffic.demand.demand import Bound

__all__ = ["bounded_by_signals", "share_of_motor"]

#: Maximum load of a lane as a share of its capacity. Standards plan for 0.85 to 0.9 (HCM 2016,
#: chapter 19; RiLSA 2015), beyond which queues grow from cycle to cycle now and then. They do not
#: count pedestrians that delay turns, nor vehicles that wait on a junction: simulated hours of ten
#: places carry 0.6 to 0.75.
FULL = 0.6
#: Relative excess above which a lane counts as full.
EXCESS = 0.01
#: Loads depend on conflicting traffic: number of rounds in which they are computed again, and least
#: factor by which movements over a full lane are reduced in a round.
ROUNDS, LEAST = 40, 0.75
#: Movements with a smaller share of a lane's flow are not reduced.
LITTLE = 0.05


def bounded_by_signals(net: Path, circulation: Circulation) -> tuple[Circulation, Bound]:
    """Return the part of a guessed circulation that the signals carry, and its share.

    Args:
        net: the SUMO network, with its programs.
        circulation: the guess.
    """
    root = etree.parse(net).getroot()
    junctions = signalised_junctions(root)
    guessed, full = circulation, dict[str, LaneLoad]()
    for _ in range(ROUNDS):
        flows = circulation.flows()
        cuts: dict[tuple[str, str], float] = {}
        passing = passing_shares(root, junctions, flows)
        for lane in _overloaded_lanes(junctions, flows, passing):
            full.setdefault(lane.lane, lane)
            for link, flow in lane.links.items():
                if flow > LITTLE * lane.flow:
                    movement = link.road, link.to.rpartition("_")[0]
                    cuts[movement] = min(cuts.get(movement, 1.0), max(FULL / lane.load, LEAST))
        if not cuts:
            break
        circulation = circulation.lowered(cuts, IN_CARS.keys())
    return circulation, Bound(share_of_motor(circulation, guessed), _worst_lane(full.values()))


def share_of_motor(circulation: Circulation, guessed: Circulation) -> float:
    """Return the motor vehicles per hour of a circulation as a share of those guessed."""
    come, all_of_them = (
        sum(demand.per_hour[name] for name in sorted(IN_CARS)) for demand in (circulation, guessed)
    )
    return come / all_of_them if all_of_them else 1.0


def _overloaded_lanes(
    junctions: Sequence[Signalised], flows: Flows, passing: Mapping[tuple[str, int], float]
) -> list[LaneLoad]:
    """Return the lanes with a load beyond ``FULL`` even with the longest actuated greens."""
    full = []
    for junction in junctions:
        usual, longest = (
            {lane.lane: lane for lane in lane_loads(junction, phases, flows, passing)}
            for phases in (junction.phases, junction.longest)
        )
        least = (min(lane, longest[name], key=lambda x: x.load) for name, lane in usual.items())
        full += [lane for lane in least if lane.load > FULL * (1.0 + EXCESS)]
    return full


def _worst_lane(full: Iterable[LaneLoad]) -> str:
    """Return a description of the lane with the largest excess of the guess."""
    lanes = sorted(full, key=lambda lane: (-lane.flow * (1.0 - FULL / lane.load), lane.lane))
    if not lanes:
        return ""
    worst, others = lanes[0], len(lanes) - 1
    link = next(iter(worst.links))
    street = f"{link.street}, " if link.street else ""
    more = f"; as on {others} more lane{'s' * (others > 1)}" if others else ""
    return (
        f"of {worst.flow:.0f} cars an hour that come from the {link.arm} ({street}lane "
        f"{worst.lane}), its signal lets {FULL * worst.capacity:.0f} through without lasting "
        f"queues{more}"
    )
