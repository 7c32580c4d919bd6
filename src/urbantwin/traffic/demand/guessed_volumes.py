"""Guessed volumes, bounded by what the signals can let through.

A guess by road classes and lanes knows nothing of how streets meet. Where nobody counted, no more
is guessed than the junctions' lanes have green for (`roads.signals.capacity`). Only vehicles whose
route leads over a full lane are left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from lxml import etree

from urbantwin.roads.assignment.movement_flows import IN_CARS
from urbantwin.roads.signals.capacity import Flows, LaneLoad, lane_loads
from urbantwin.roads.signals.controlled_links import Signalised, signalised_junctions
from urbantwin.traffic.demand.circulation import Circulation
from urbantwin.traffic.demand.demand import Bound

__all__ = ["bounded_by_signals", "share_of_motor"]

#: A guess loads lanes to at most this share of their capacity. Standards plan for 0.85 to 0.9 (HCM
#: 2016, chapter 19; RiLSA 2015), beyond which queues grow from cycle to cycle now and then. They
#: do not count people on foot who hold up turns, nor vehicles that wait on a junction: simulated
#: hours of ten places carry 0.62 to 0.75.
FULL = 0.62
#: Lanes are full beyond this excess.
EXCESS = 0.01
#: Loads depend on what else comes, so they are worked out anew so often, and ways over a lane that
#: is full are lowered by this factor at most each time.
ROUNDS, LEAST = 40, 0.75
#: Movements that have a smaller share of a lane are not what fills it.
LITTLE = 0.05


def bounded_by_signals(net: Path, circulation: Circulation) -> tuple[Circulation, Bound]:
    """Return the part of a guessed circulation that the signals carry, and its share.

    Args:
        net: the SUMO network, with its programs.
        circulation: as guessed.
    """
    junctions = signalised_junctions(etree.parse(net).getroot())
    guessed, full = circulation, dict[str, LaneLoad]()
    for _ in range(ROUNDS):
        flows = circulation.flows()
        cuts: dict[tuple[str, str], float] = {}
        for lane in _full(junctions, flows):
            full.setdefault(lane.lane, lane)
            for link, flow in lane.links.items():
                if flow > LITTLE * lane.flow:
                    movement = link.road, link.to.rpartition("_")[0]
                    cuts[movement] = min(cuts.get(movement, 1.0), max(FULL / lane.load, LEAST))
        if not cuts:
            break
        circulation = circulation.lowered(cuts, IN_CARS.keys())
    return circulation, Bound(share_of_motor(circulation, guessed), _reason(full.values()))


def share_of_motor(circulation: Circulation, guessed: Circulation) -> float:
    """Return how many motor vehicles come in by the hour of those who were guessed."""
    come, all_of_them = (
        sum(one.per_hour[name] for name in sorted(IN_CARS)) for one in (circulation, guessed)
    )
    return come / all_of_them if all_of_them else 1.0


def _full(junctions: Sequence[Signalised], flows: Flows) -> list[LaneLoad]:
    """Return the lanes with a load beyond ``FULL``, however long traffic extends the greens."""
    full = []
    for junction in junctions:
        usual, longest = (
            {lane.lane: lane for lane in lane_loads(junction, phases, flows)}
            for phases in (junction.phases, junction.longest)
        )
        least = (min(lane, longest[name], key=lambda x: x.load) for name, lane in usual.items())
        full += [lane for lane in least if lane.load > FULL * (1.0 + EXCESS)]
    return full


def _reason(full: Iterable[LaneLoad]) -> str:
    """Return the lane that most vehicles of the guess cannot pass, in words."""
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
