"""Default programs of signals, with SUMO's ``actuated`` controller.

netconvert determines the stages: which lanes and crossings have green together, with separate
stages for left turns on exclusive lanes. Stages are kept as far as they agree with the network's
conflict table. Yellow, all-red and clearance times come from ``changes``, as do the minimum greens.
Traffic extends a stage up to its maximum green; the maximum greens divide the longest cycle by
Webster's rule, so that all lanes are equally saturated.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from lxml import etree

from urbantwin.roads.model.furniture import Phase
from urbantwin.roads.signals.capacity import (
    LONGEST_CYCLE_S,
    SATURATION_VEH_H,
    SHORTEST_CYCLE_S,
    Flows,
    assumed_flows,
    capped,
    choices_of,
    cycle_s,
    gap_flow,
    green_seconds,
    on_lanes,
)
from urbantwin.roads.signals.changes import Change, Changes, phases_of_stages
from urbantwin.roads.signals.controlled_links import Link, Signalised, signalised_junctions
from urbantwin.roads.signals.coordination import Stream, best_offset_s, streams_between
from urbantwin.roads.signals.plan import WALK_S

__all__ = ["set_default_programs"]

#: Minimum green of vehicles (RiLSA 2015, 2.7.2: 5 s, on main streets 10 s), and their minimum red
#: at a mid-block crossing: 5 s to set out and 8 m at 1.2 m/s (RiLSA 2015, 2.5), seconds.
SHORTEST_GREEN_S, CROSSING_RED_S = 8.0, 12.0
#: Minimum flow ratio of a stage, and maximum straight-on equivalent of a permitted turn (HCM 2016,
#: 31).
LEAST_RATIO, MOST_PATIENT = 0.02, 4.0
#: Maximum share of the cycle for one stage before it is limited to what the others leave.
MOST_LOAD = 0.8
#: Parameters of SUMO's controller: queues that have been stopped at a stop line for longer do not
#: extend the green, seconds.
PARAMETERS = {"jam-threshold": "30"}


def set_default_programs(net: Path, *, flows: Flows | None = None, fixed: bool = False) -> None:
    """Write new programs for the signals of a network, with its existing stages.

    Args:
        net: the ``.net.xml``, rewritten.
        flows: cars per hour; by default assumed from the class and lanes of streets.
        fixed: write fixed-time programs, for counted flows.
    """
    tree = etree.parse(net)
    root = tree.getroot()
    junctions = signalised_junctions(root)
    flows = flows or assumed_flows(root, junctions)
    logics = {logic.get("id"): logic for logic in root.iter("tlLogic")}
    timings = [
        _Timing(junction, _stages(junction, _main_states(logics[junction.program])), flows)
        for junction in junctions
    ]
    plans = _coordinated(timings, streams_between(root, junctions, flows))
    for timing in timings:
        name = timing.junction.program
        cycle, offset = plans.get(name, (None, 0))
        _write(logics[name], timing, cycle, offset, fixed=fixed or name in plans)
    net.write_bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8") + b"\n")


def _main_states(logic: etree._Element) -> list[str]:
    """Return the states of the stages: the extended phases, or else those without yellow."""
    phases = list(logic.iter("phase"))
    extended = [phase for phase in phases if phase.get("minDur") is not None]
    states: list[str] = []
    for phase in extended or phases:
        state = phase.get("state")
        rest = states and all(
            a in "Gg" or b not in "Gg" for a, b in zip(states[-1], state, strict=True)
        )
        if extended or not (rest or set(state) & set("yY") or not set(state) & set("gG")):
            states.append(state)
    return states


def _stages(junction: Signalised, states: Sequence[str]) -> list[frozenset[int]]:
    """Return the links with green in each stage, without conflicting ones.

    If vehicles always had green, a stage for pedestrians only follows.
    """
    # Links with right of way first, then yielding links, then pedestrians and inner links.
    order = {letter: rank for rank, letter in enumerate("Gg")}
    stages: list[set[int]] = []
    for state in states:
        green: set[int] = set()
        shown = [k for k in junction.of_index if state[k] in order]
        for k in sorted(shown, key=lambda k: (junction.is_walk(k), order[state[k]], k)):
            if junction.fits(k, green):
                green.add(k)
        if green:
            stages.append(green)
    for k in sorted(junction.of_index):
        served = any(k in green for green in stages)
        for green in stages:
            # A link within the junction goes with the links that feed it, so that no vehicle stops
            # inside.
            let_in = any(feeder.index in green for feeder in junction.feeders[k])
            if (let_in or not served) and junction.fits(k, green):
                green.add(k)
        if not any(k in green for green in stages):
            stages.append({k})
    if len(stages) == 1:
        stages.append({k for k in stages[0] if junction.is_walk(k)})
    return [frozenset(green) for green in stages]


@dataclass(frozen=True)
class _Timing:
    """Durations of the stages of a junction, seconds."""

    junction: Signalised
    stages: Sequence[frozenset[int]]
    flows: Flows

    @cached_property
    def changes(self) -> list[Change]:
        """The change after each stage."""
        changes = Changes(self.junction)
        after = [*self.stages[1:], self.stages[0]]
        return [changes.between(*pair) for pair in zip(self.stages, after, strict=True)]

    @cached_property
    def lost_s(self) -> float:
        """Time between the stages in one cycle, seconds."""
        return sum(change.seconds for change in self.changes)

    @cached_property
    def least_s(self) -> list[float]:
        """Minimum green of each stage, seconds."""
        minima = []
        for k, green in enumerate(self.stages):
            before, change = self.changes[k - 1], self.changes[k]
            driven = any(not self.junction.is_walk(index) for index in green)
            # The previous stage's clearance ends before the next change.
            shortest = SHORTEST_GREEN_S if driven else CROSSING_RED_S
            least = [shortest, before.over - before.seconds]
            for index in green:
                was_green = index in self.stages[k - 1]
                late = (
                    0.0 if was_green else before.starts.get(index, before.seconds) - before.seconds
                )
                early = min(change.ends.get(index, 0.0), 0.0)
                least.append((0.0 if was_green else WALK_S) + late - early)
            minima.append(max(least))
        if len(minima) == 2 and not any(self.ratios[1:]):
            minima[0] = max(minima[0], SHORTEST_CYCLE_S - self.lost_s - minima[1])
        return minima

    @cached_property
    def ratios(self) -> list[float]:
        """Flow ratio of the critical lane of each stage."""
        carried = on_lanes(choices_of(self.junction, self.flows), lambda link: SATURATION_VEH_H)
        of_lane: dict[str, float] = defaultdict(float)
        serving: dict[str, set[int]] = defaultdict(set)
        for link, count in carried.items():
            # Flow that the link yields to in each stage with green, vehicles per hour.
            opposing = {
                k: sum(carried.get(other, 0.0) for other in self._opposing(link, green))
                for k, green in enumerate(self.stages)
                if link.index in green
            }
            least = min(opposing.values(), default=0.0)
            patience = min(SATURATION_VEH_H / max(gap_flow(least), 1.0), MOST_PATIENT)
            of_lane[link.lane] += count * (patience if least else 1.0) / SATURATION_VEH_H
            serving[link.lane] |= {k for k, n in opposing.items() if n == least}
        return [
            max((of_lane[x] / len(on) for x, on in serving.items() if k in on), default=0.0)
            for k in range(len(self.stages))
        ]

    def _opposing(self, link: Link, green: frozenset[int]) -> list[Link]:
        foes = self.junction.yields_to[link]
        return [x for x in foes if x.index in green and x.movement != "walk"]

    def seconds(self, cycle: float | None = None) -> list[float]:
        """Return the green of each stage for a cycle, seconds; by default Webster's cycle."""
        needed = sum(self.least_s) + self.lost_s
        if cycle is None:
            cycle = cycle_s(self.ratios, self.lost_s, needed)
        ratios = capped([max(ratio, LEAST_RATIO) for ratio in self.ratios], MOST_LOAD)
        return green_seconds(ratios, self.least_s, max(cycle, needed) - self.lost_s)

    def phases(self, seconds: Sequence[float]) -> tuple[Phase, ...]:
        """Return the phases for given greens of the stages, seconds."""
        return phases_of_stages(self.junction, self.stages, seconds, self.changes)


def _coordinated(
    timings: Sequence[_Timing], streams: Sequence[Stream]
) -> dict[str, tuple[float, int]]:
    """Return program -> common cycle and offset, seconds, of programs with streams between them."""
    of_program = {timing.junction.program: timing for timing in timings}
    plans: dict[str, tuple[float, int]] = {}
    for group in _groups(streams):
        cycle = max(sum(of_program[name].seconds()) + of_program[name].lost_s for name in group)
        phases = {name: of_program[name].phases(of_program[name].seconds(cycle)) for name in group}
        cycle = max(sum(seconds for seconds, _ in each) for each in phases.values())
        phases = {name: of_program[name].phases(of_program[name].seconds(cycle)) for name in group}
        offsets: dict[str, int] = {}
        for name in group:
            offsets[name] = best_offset_s(name, phases, offsets, streams)
        plans |= {name: (cycle, offsets[name]) for name in group}
    return plans


def _groups(streams: Sequence[Stream]) -> list[list[str]]:
    """Return the programs joined by streams, each after one that it is joined to."""
    joined: dict[str, set[str]] = defaultdict(set)
    for stream in streams:
        joined[stream.start[0]].add(stream.end[0])
        joined[stream.end[0]].add(stream.start[0])
    groups: list[list[str]] = []
    rest = sorted(joined)
    while rest:
        group = [rest[0]]
        for name in group:
            group += sorted(joined[name] - set(group))
        groups.append(group)
        rest = [name for name in rest if name not in group]
    return groups


def _write(
    logic: etree._Element, timing: _Timing, cycle: float | None, offset: int, *, fixed: bool
) -> None:
    for child in list(logic):
        logic.remove(child)
    usual = timing.seconds(cycle)
    most = [max(pair) for pair in zip(usual, timing.seconds(LONGEST_CYCLE_S), strict=True)]
    phases = timing.phases(usual)
    extended = {} if fixed else _extended(timing, phases)
    logic.set("offset", str(offset))
    logic.set("type", "actuated" if extended else "static")
    for key, value in (PARAMETERS if extended else {}).items():
        etree.SubElement(logic, "param", key=key, value=value)
    for k, (seconds, state) in enumerate(phases):
        phase = etree.SubElement(logic, "phase", duration=f"{seconds:g}", state=state)
        if k in extended:
            stage = extended[k]
            rest = seconds - usual[stage]  # changes before and after the main phase
            phase.set("minDur", f"{max(rest + timing.least_s[stage], 1.0):g}")
            phase.set("maxDur", f"{rest + most[stage]:g}")
    etree.indent(logic, space=" ", level=1)


def _extended(timing: _Timing, phases: Sequence[Phase]) -> Mapping[int, int]:
    """Return phase -> the vehicle stage that it is the main part of."""
    by_phase: dict[int, int] = {}
    for stage, green in enumerate(timing.stages):
        if all(timing.junction.is_walk(k) for k in green):
            continue
        fully_green = [
            k
            for k, (_, state) in enumerate(phases)
            if k not in by_phase and all(state[index] in "Gg" for index in green)
        ]
        if fully_green:
            by_phase[max(fully_green, key=lambda k: phases[k][0])] = stage
    return by_phase
