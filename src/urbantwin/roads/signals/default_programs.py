"""Fixed-time programs for signals whose own nobody mapped or planned."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from lxml import etree

from urbantwin.roads.model.furniture import Phase
from urbantwin.roads.signals.capacity import Flows
from urbantwin.roads.signals.controlled_links import Signalised, signalised_junctions
from urbantwin.roads.signals.coordination import (
    COORDINATED_M,
    least_waiting,
    neighbourhoods,
    offsets,
)
from urbantwin.roads.signals.green_times import SHORTEST_CYCLE_S, STEP_S
from urbantwin.roads.signals.inner_links import Feed, feeds
from urbantwin.roads.signals.junction_timing import Timing, timings_of
from urbantwin.roads.signals.lane_flows import assumed_flows, link_flows
from urbantwin.roads.signals.queue_model import QueueModel
from urbantwin.roads.signals.streams import INNER_M

__all__ = ["set_default_programs"]

#: So many cycles between the shortest and the one that the busiest junction needs are tried where
#: signals hold each other up: what finds room between them is as much for a short green.
CYCLES = 3
#: A shorter cycle is taken if what waits is less than this share: it loses time at every change.
WORTH = 0.7


@dataclass(frozen=True)
class _Plan:
    """Programs of neighbours, their offsets, and how bad they are."""

    programs: Mapping[str, Sequence[Phase]]
    offsets: Mapping[str, float]
    cost: float = 0.0


def set_default_programs(net: Path, *, flows: Flows | None = None) -> None:
    """Give every signalised junction a program in place of netconvert's.

    Args:
        net: the ``.net.xml``, rewritten.
        flows: cars an hour; assumed by the streets' class and lanes when none are given.
    """
    tree = etree.parse(net)
    root = tree.getroot()
    there = signalised_junctions(root)
    ways = feeds(root, there, COORDINATED_M)
    flows = flows or assumed_flows(root, there)
    left_hand = root.get("lefthand") == "true"
    choices = {x.program: timings_of(x, ways, flows, left_hand=left_hand) for x in there}
    logics = {item.get("id"): item for item in root.iter("tlLogic")}
    for names in neighbourhoods(choices, ways):
        best = _best({name: choices[name] for name in names}, ways, flows)
        for name, offset in best.offsets.items():
            _write(logics[name], offset, best.programs[name])
    if choices:
        text = etree.tostring(root, xml_declaration=True, encoding="UTF-8")
        net.write_bytes(text + b"\n")


def _best(near: Mapping[str, Sequence[Timing]], ways: Sequence[Feed], flows: Flows) -> _Plan:
    """Return the plan of neighbours with which least waits.

    Where few vehicles have room between two, their other timings are tried, too.
    """
    alone = {name: timings[0] for name, timings in near.items()}
    tight = {
        name
        for way in ways
        if way.program in near and way.to_program != way.program and way.room < INNER_M
        for name in (way.program, way.to_program)
    }
    first, *shorter = (_planned(alone, cycle, ways, flows) for cycle in _cycles(alone))
    best = min([first, *shorter], key=lambda plan: plan.cost)
    chosen = dict(alone)
    for name in sorted(tight):
        for other in near[name][1:]:
            tried = {**chosen, name: other}
            plans = [_planned(tried, cycle, ways, flows) for cycle in _cycles(tried)]
            plan = min(plans, key=lambda plan: plan.cost)
            if plan.cost < best.cost:
                best, chosen = plan, tried
    return best if best.cost < WORTH * first.cost else first


def _cycles(near: Mapping[str, Timing]) -> Iterator[float]:
    """Yield the common cycles that are tried, seconds: the longest first."""
    longest = max(timing.cycle for timing in near.values())
    yield longest
    shortest = max(SHORTEST_CYCLE_S, *(timing.shortest_cycle for timing in near.values()))
    if len(near) > 1:
        for part in range(1, CYCLES):
            cycle = longest + (shortest - longest) * part / (CYCLES - 1)
            cycle = STEP_S * -(-cycle // STEP_S)
            if cycle < longest:
                yield cycle


def _planned(near: Mapping[str, Timing], cycle: float, ways: Sequence[Feed], flows: Flows) -> _Plan:
    """Return the programs of neighbours for a common cycle, seconds, with their offsets."""
    programs: dict[str, Sequence[Phase]] = {}
    for name, timing in near.items():
        times = 2 if timing.fits(cycle / 2) else 1
        programs[name] = timing.phases(cycle / times) * times
    first = max(near, key=lambda name: near[name].cycle)
    flow = {
        (name, index): ratio
        for name, timing in near.items()
        for index, ratio in link_flows(timing.carried).items()
    }
    late = offsets(programs, ways, flow, first)
    if len(near) == 1:
        return _Plan(programs, late)
    junctions: list[Signalised] = [timing.junction for timing in near.values()]
    model = QueueModel(junctions, programs, ways, flows)
    late, cost = least_waiting(model, late, round(cycle), first)
    return _Plan(programs, late, cost)


def _write(logic: etree._Element, offset: float, phases: Sequence[Phase]) -> None:
    for phase in list(logic.iter("phase")):
        logic.remove(phase)
    logic.set("offset", f"{offset:g}")
    logic.set("type", "static")
    for seconds, state in phases:
        etree.SubElement(logic, "phase", duration=f"{seconds:g}", state=state)
    etree.indent(logic, space=" ", level=1)
