"""When each link of one junction has green: its stages, cycle and phases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from urbantwin.roads.model.furniture import Phase
from urbantwin.roads.signals.capacity import (
    Choices,
    Flows,
    LaneLoad,
    choices_of,
    lane_loads,
    on_lanes,
)
from urbantwin.roads.signals.controlled_links import Link, Signalised
from urbantwin.roads.signals.green_times import (
    LONGEST_CYCLE_S,
    MOST_RATIO,
    SATURATION_VEH_H,
    SHORTEST_CYCLE_S,
    STEP_S,
    capped,
    cycle_s,
    green_seconds,
)
from urbantwin.roads.signals.inner_links import Feed
from urbantwin.roads.signals.intergreen import Change, Intergreens
from urbantwin.roads.signals.lane_flows import flow_ratios
from urbantwin.roads.signals.phases import phases_of_stages, walks
from urbantwin.roads.signals.plan_check import WALK_S
from urbantwin.roads.signals.stages import Stage, critical_ratios, stages_of
from urbantwin.roads.signals.streams import Traffic

__all__ = ["Timing", "timings_of"]

#: Nobody has green for less, seconds, or than the second where the cycle would be too long (RiLSA
#: 2015, 2.7.2: 5 s, 10 s on main streets).
SHORTEST_GREEN_S, LEAST_GREEN_S = 8.0, 5.0
#: Red of a crossing's own signals: 5 s to set out and 8 m to walk at 1.2 m/s (RiLSA 2015, 2.5).
CROSSING_RED_S = 12.0
#: A cycle is long enough that lasts this share less than the best one: delays differ by 10 to 20 %
#: between 0.75 and 1.5 of the best (Webster, 1958).
NEARLY = 1.25
#: A lane that carries more than this share of what it can is full (0.85 to 0.9 by HCM 2016, 19, and
#: RiLSA 2015, of all lanes of an approach; drivers do not spread over them that evenly); one that
#: carries less than the other has ample green.
FULL, AMPLE = 0.75, 0.6
#: Greens are shared out anew so often, each time so much (exponent) towards the fullest lanes.
SHARED_OUT, TOWARDS, LITTLE = 10, 0.6, 0.02
#: So often turns of full lanes are taken apart; a second of too long a cycle is this bad.
APART, TOO_LONG = 3, 100.0


def timings_of(
    junction: Signalised, ways: Sequence[Feed], flows: Flows, *, left_hand: bool
) -> list[Timing]:
    """Return a junction's best timing, then others that may suit its neighbours better.

    First turns across have stages of their own, then none, then traffic may wait at all inner stop
    lines, then greens are as short as they may be. Where lanes are full that turns across hold up,
    their streets go one after the other, if that helps.
    """
    found: list[Timing] = []
    others: list[Timing] = []
    behind = {
        link: {feed.to_index: feed.room for feed in feeds}
        for link, feeds in Traffic(junction, ways, left_hand=left_hand).inner.items()
    }
    for protects, inner, shortest in (
        (True, ways, SHORTEST_GREEN_S),
        (False, ways, SHORTEST_GREEN_S),
        (False, (), SHORTEST_GREEN_S),
        (False, (), LEAST_GREEN_S),
    ):
        apart: frozenset[int] = frozenset()
        for _ in range(APART):
            traffic = Traffic(junction, inner, left_hand=left_hand, protects=protects, apart=apart)
            found.append(Timing(junction, traffic, flows, shortest, behind))
            if not apart:
                others.append(found[-1])
            held_up = found[-1].held_up
            if held_up <= apart:
                break
            apart |= held_up
        if min(timing.score for timing in found) <= FULL:
            break
    best = min(found, key=lambda timing: timing.score)
    stages = [best.stages]
    kept = [best]
    for timing in others:
        if timing.stages not in stages and timing.cycle <= LONGEST_CYCLE_S:
            stages.append(timing.stages)
            kept.append(timing)
    return kept


@dataclass(frozen=True)
class Timing:
    """Stages of a junction, and how long they take.

    Attributes:
        junction: its links.
        traffic: its streams.
        flows: cars an hour.
        shortest_s: of greens.
        behind: link -> inner links that what it lets go comes to -> room to wait there, metres.
    """

    junction: Signalised
    traffic: Traffic
    flows: Flows
    shortest_s: float
    behind: Mapping[int, Mapping[int, float]]

    @cached_property
    def carried(self) -> dict[Link, float]:
        """Cars an hour on each link."""
        return on_lanes(self._choices, lambda link: SATURATION_VEH_H)

    @cached_property
    def _choices(self) -> Choices:
        return choices_of(self.junction, self.flows)

    @cached_property
    def _flow(self) -> list[float]:
        return flow_ratios(self.traffic, self.carried)

    @cached_property
    def _intergreens(self) -> Intergreens:
        return Intergreens(self.traffic)

    @cached_property
    def stages(self) -> list[frozenset[int]]:
        """Links with green in each stage; where vehicles would always have it, people alone last.

        There may be nobody on foot in the network where no sidewalk is mapped.
        """
        found = [stage.green for stage in self._stages]
        if len(found) > 1:
            return self._brisk(found)
        return [found[0], frozenset(k for k in found[0] if walks(self.junction, k))]

    @cached_property
    def _stages(self) -> tuple[Stage, ...]:
        return stages_of(self.traffic, self._flow, self._intergreens)

    def _brisk(self, stages: list[frozenset[int]]) -> list[frozenset[int]]:
        """Let people cross in fewer of the stages that they could while that shortens the cycle."""
        while self._needed(stages) > SHORTEST_CYCLE_S:
            fewer = []
            for k, green in enumerate(stages):
                for index in sorted(green):
                    rest = [*stages[:k], green - {index}, *stages[k + 1 :]]
                    if walks(self.junction, index) and any(index in other for other in rest):
                        fewer.append(rest)
            best = min(fewer, key=self._needed, default=stages)
            if self._needed(best) >= self._needed(stages):
                break
            stages = best
        return stages

    @property
    def shortest_cycle(self) -> float:
        """The shortest cycle in which everybody has the least green, seconds."""
        return self._needed(self.stages)

    def _needed(self, stages: Sequence[frozenset[int]]) -> float:
        """Return the seconds that the shortest greens and the changes between them need."""
        return sum(self._least(stages)) + self._lost(stages)

    def _changes(self, stages: Sequence[frozenset[int]]) -> list[Change]:
        after = [*stages[1:], stages[0]]
        return [self._intergreens.change(*pair) for pair in zip(stages, after, strict=True)]

    def _lost(self, stages: Sequence[frozenset[int]]) -> float:
        return sum(change.seconds for change in self._changes(stages))

    @cached_property
    def ratios(self) -> list[float]:
        """Critical flow ratio of each stage, of none more than can be green."""
        found = capped(critical_ratios(self._stages, self._flow))
        return found + [0.0] * (len(self.stages) - len(found))

    def _least(self, stages: Sequence[frozenset[int]]) -> list[float]:
        """Return the shortest green of each stage, whole seconds."""
        changes = self._changes(stages)
        found = []
        for k, green in enumerate(stages):
            before, change = changes[k - 1], changes[k]
            driven = any(not walks(self.junction, index) for index in green)
            # What the last stage left is over before the next change.
            least = [self.shortest_s if driven else CROSSING_RED_S, before.over - before.seconds]
            for index in green:
                came = index in stages[k - 1]
                late = 0.0 if came else before.starts.get(index, before.seconds) - before.seconds
                early = min(change.ends.get(index, 0.0), 0.0)
                least.append((0.0 if came else WALK_S) + late - early)
            found.append(max(least))
        return found

    @cached_property
    def cycle(self) -> float:
        """The cycle that the junction needs, seconds: longer where lanes would be full."""
        needed = self._needed(self.stages)
        cycle = cycle_s(self.ratios, self._lost(self.stages), needed)
        while cycle < LONGEST_CYCLE_S and self._shared_out(cycle)[0] > FULL:
            cycle += STEP_S
        return cycle

    @cached_property
    def score(self) -> float:
        """How full the fullest lane is; worse than any where the cycle is too long."""
        too_long = max(self.cycle - LONGEST_CYCLE_S, 0.0)
        return too_long * TOO_LONG or max(self._shared_out(self.cycle)[0], FULL)

    @cached_property
    def held_up(self) -> frozenset[int]:
        """Links of full lanes that wait for gaps in opposing traffic."""
        full = {one.lane for one in self._loads(self.phases(self.cycle)) if one.load > FULL}
        behind = {
            inner.lane
            for link in self.junction.links
            if link.lane in full
            for k in self.behind.get(link.index, ())
            for inner in self.junction.of_index[k]
        }
        links = (link for link in self.junction.links if link.lane in full | behind)
        return frozenset(link.index for link in links if self.traffic.waits_for_gaps(link))

    def fits(self, cycle: float) -> bool:
        """Whether half of a common cycle, seconds, is long enough, or nearly so.

        Twice as often a green lets fewer vehicles wait between neighbours.
        """
        least = self._needed(self.stages)
        fits = cycle.is_integer() and least <= cycle and self.cycle <= NEARLY * cycle
        return fits and self._shared_out(cycle)[0] <= max(self.score, FULL)

    def phases(self, cycle: float) -> tuple[Phase, ...]:
        """Return the phases for a cycle, seconds."""
        return self._shared_out(cycle)[1]

    def _loads(self, phases: Sequence[Phase]) -> list[LaneLoad]:
        return lane_loads(
            self.junction,
            phases,
            self.flows,
            self.behind,
            in_bends=False,
            even=self.carried,
            choices=self._choices,
        )

    @cached_property
    def _known(self) -> dict[float, tuple[float, tuple[Phase, ...]]]:
        return {}

    def _shared_out(self, cycle: float) -> tuple[float, tuple[Phase, ...]]:
        """Return how full the fullest lane is, and the phases, where greens are fair.

        Greens in proportion to critical flow ratios, then more of it where lanes are fullest.
        Beyond capacity lanes are equally full, but for those that the whole cycle would not do for:
        they take no green from others that it does for.
        """
        if cycle not in self._known:
            changes, stages = self._changes(self.stages), self.stages
            least, lost = self._least(stages), self._lost(stages)
            green_on = [
                {link.lane for k in green for link in self.junction.of_index[k]} for green in stages
            ]
            ratios = np.maximum(self.ratios, LITTLE)
            found: list[tuple[float, tuple[Phase, ...]]] = []
            for _ in range(SHARED_OUT):
                seconds = green_seconds(ratios.tolist(), least, cycle - lost)
                phases = phases_of_stages(self.junction, stages, seconds, changes)
                loads = self._loads(phases)
                fullest = loads[0].load if loads else 0.0
                found.append((fullest, phases))
                if fullest <= AMPLE:
                    break
                load_of = {one.lane: one.load for one in loads}
                full = np.array(
                    [max((load_of.get(x, 0.0) for x in on), default=0.0) for on in green_on]
                )
                if fullest <= 1.0:
                    ratios *= np.maximum(full / fullest, LITTLE) ** TOWARDS
                else:
                    wanted = np.array(seconds) * np.maximum(full / MOST_RATIO, LITTLE) ** TOWARDS
                    ratios = np.array(capped(wanted.tolist(), cycle - lost))
            best = min(found, key=lambda one: round(one[0], 6))
            self._known[cycle] = best if best[0] <= 1.0 else found[-1]
        return self._known[cycle]
