"""Signal programs as CARLA runs them: a controller per stage.

CARLA 0.9.16 knows no programs. It gives green to all signals of one controller, then to those of
the next controller of the junction, and so on (``TrafficLightManager.cpp``,
``TrafficLightGroup.cpp``: one controller at a time, one controller per signal). With all signals of
a junction in one controller, all approaches would be green at once.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from urbantwin.roads.model import LaneModel, RoadSignal, SignalController
from urbantwin.roads.opendrive.vocabulary import DRIVEN
from urbantwin.roads.streets.furniture import WALKER_LIGHTS

__all__ = ["with_carla_stages"]

#: ``validity`` of a signal that is for no lane of its road.
NO_LANE = (0,)

Heads = frozenset[int]


def with_carla_stages(model: LaneModel) -> LaneModel:
    """Return a lane model with a controller for every stage of every program.

    The heads of a stage are green together in some phase of the program; stages are few, and in
    the order of those phases. A head for people on foot goes with a stage for vehicles that it is
    green with. Where no program is known, every road that comes in is a stage.

    Every signal names its lanes: of one without, CARLA would take lanes of the other direction
    (``MapBuilder::GenerateDefaultValiditiesForSignalReferences``), and heads for people on foot
    would stop vehicles.
    """
    model = replace(model, signals=tuple(_with_lanes(model, one) for one in model.signals))
    heads = {signal.id: signal for signal in model.signals if signal.dynamic}
    number = model.next_id
    controllers: list[SignalController] = []
    for one in model.controllers:
        for k, stage in enumerate(_stages(one, [heads[k] for k in one.signals if k in heads])):
            signals = tuple(k for k in one.signals if k in stage)
            controllers.append(replace(one, id=number if k else one.id, signals=signals))
            number += bool(k)
    return replace(model, controllers=tuple(controllers))


def _with_lanes(model: LaneModel, signal: RoadSignal) -> RoadSignal:
    if signal.lanes:
        return signal
    if signal.type == WALKER_LIGHTS:
        return replace(signal, lanes=NO_LANE)
    section = model.road_by_id[signal.road].section_at(signal.s)
    lanes = (
        lane.id
        for lane in section.lanes
        if lane.kind in DRIVEN and signal.orientation != ("-" if lane.forward else "+")
    )
    return replace(signal, lanes=tuple(sorted(lanes)) or NO_LANE)


def _stages(program: SignalController, heads: Iterable[RoadSignal]) -> list[Heads]:
    """Return the heads of each stage."""
    heads = list(heads)
    walkers = frozenset(head.id for head in heads if head.type == WALKER_LIGHTS)
    vehicles = frozenset(head.id for head in heads) - walkers
    shown = {head.id: _green(program, head) for head in heads}
    green = [
        frozenset(one for one, lit in shown.items() if lit[number])
        for number in range(len(program.phases))
    ]
    found = _covered(green, vehicles)
    left = set(walkers)
    for number, stage in enumerate(found):
        also = {one for phase in green if stage <= phase for one in left & phase}
        found[number] = stage | also
        left -= also
    found += _covered(green, frozenset(left))
    found.sort(key=lambda stage: next(k for k, phase in enumerate(green) if stage & phase))
    # Never green, or nobody knows when.
    rest = [head for head in heads if not any(head.id in stage for stage in found)]
    roads = sorted({head.road for head in rest})
    return found + [frozenset(head.id for head in rest if head.road == road) for road in roads]


def _green(program: SignalController, head: RoadSignal) -> list[bool]:
    """Return in which phases a head is green: all of its links, or the longest of them."""
    links = [
        [state[link : link + 1] in ("G", "g") for _, state in program.phases] for link in head.links
    ]
    every = [bool(links) and all(lit) for lit in zip(*links, strict=True)]
    if any(every):
        return every
    return max(links, key=lambda lit: _seconds(program, lit), default=[False] * len(program.phases))


def _seconds(program: SignalController, lit: list[bool]) -> float:
    return sum(seconds for (seconds, _), on in zip(program.phases, lit, strict=True) if on)


def _covered(green: list[Heads], wanted: Heads) -> list[Heads]:
    """Return heads that are green at once, the most of those left first, until all were."""
    left, found = wanted, []
    while most := max((phase & left for phase in green), key=len, default=frozenset()):
        found.append(most)
        left -= most
    return found
