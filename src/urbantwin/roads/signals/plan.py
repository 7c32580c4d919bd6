"""Signal plans in words turned into states of a program, checked for conflicts."""

from __future__ import annotations

import math
from collections.abc import Sequence

from urbantwin.roads.model.furniture import Phase
from urbantwin.roads.signals.controlled_links import Link, Signalised
from urbantwin.roads.signals.movements import UnknownMovement, crossings, vehicle_links
from urbantwin.roads.signals.plan_check import (
    WALK_S,
    check_conflicts,
    check_greens,
    checked_states,
)
from urbantwin.site.signals import PhaseSpec, SignalPlan

__all__ = ["plan_phases"]

#: Yellow by speed limit, m/s -> s (RiLSA 2015, 2.4: 3 s at 50 km/h, 4 s at 60, 5 s at 70).
YELLOW_S = ((52 / 3.6, 3.0), (62 / 3.6, 4.0), (math.inf, 5.0))
#: All red: (way + vehicle) / speed - 1 s (ITE, Guidelines for Determining Traffic Signal Change and
#: Clearance Intervals, 2020: the first second is the next driver's reaction), metres, m/s, s.
VEHICLE_M, SLOWEST_M_S, REACTION_S = 6.1, 6.0, 1.0
SHORTEST_ALL_RED_S, LONGEST_ALL_RED_S = 1.0, 5.0
#: People walk 1.2 m/s (RiLSA 2015, 2.5).
WALK_M_S = 1.2


def plan_phases(junction: Signalised, plan: SignalPlan) -> tuple[float, tuple[Phase, ...]]:
    """Return the offset, seconds, and the phases that a plan means at a junction.

    Args:
        junction: the signals that it is for.
        plan: what was written.

    Raises:
        InputError: an approach is unknown, greens conflict or are too short, a movement never gets
            green, or the phases do not last as long as the cycle.
    """
    spec = plan.spec
    if spec.phases is not None:
        phases = _from_words(junction, plan)
    elif spec.states is not None:
        phases = checked_states(junction, plan)
    else:
        phases = junction.phases
    cycle = sum(seconds for seconds, _ in phases)
    if spec.cycle is not None and abs(cycle - spec.cycle) > 0.01:
        raise plan.error(
            f"is {spec.cycle:g} s, but the phases with their yellow and all-red last {cycle:g} s",
            ("cycle",),
            f"{cycle:g}, or a phase without seconds to take what is left",
        )
    if spec.phases is not None or spec.states is not None:
        check_greens(junction, plan, phases)
    offset = junction.offset if spec.offset is None else spec.offset % cycle
    return offset, phases


def _from_words(junction: Signalised, plan: SignalPlan) -> tuple[Phase, ...]:
    specs = plan.spec.phases or []
    greens = [_greens(junction, plan, k, spec) for k, spec in enumerate(specs)]
    for k, green in enumerate(greens):
        check_conflicts(junction, green, plan, ("phases", k, "green"))
    walks = [_walks(junction, plan, k, spec, greens[k]) for k, spec in enumerate(specs)]
    ends = [
        [
            link
            for link in green
            if link.index not in {x.index for x in greens[(k + 1) % len(greens)]}
        ]
        for k, green in enumerate(greens)
    ]
    between = [_between(spec, ending) for spec, ending in zip(specs, ends, strict=True)]
    seconds = _seconds(plan, specs, sum(map(sum, between)))
    phases: list[Phase] = []
    for k, length in enumerate(seconds):
        yellow, all_red = between[k]
        later = {link.index for link in walks[(k + 1) % len(specs)]}
        base = _letters(junction, greens[k], walks[k])
        stops = [link for link in walks[k] if link.index not in later]
        needed = max((math.ceil(link.length / WALK_M_S) for link in stops), default=0)
        clear = max(0.0, min(needed - yellow - all_red, length - WALK_S))
        phases.append((length - clear, _state(junction, base)))
        stopped = base | {link.index: "r" for link in stops}
        if clear > 0:
            phases.append((clear, _state(junction, stopped)))
        ending = {link.index for link in ends[k]}
        after = stopped | dict.fromkeys(ending, "y")
        if yellow > 0:
            phases.append((yellow, _state(junction, after)))
        if all_red > 0:
            phases.append((all_red, _state(junction, after | dict.fromkeys(ending, "r"))))
    return _joined(phases)


def _greens(junction: Signalised, plan: SignalPlan, k: int, spec: PhaseSpec) -> list[Link]:
    found: dict[int, Link] = {}
    for number, words in enumerate(spec.green):
        try:
            chosen = vehicle_links(junction, words)
        except UnknownMovement as error:
            where = ("phases", k, "green", number)
            raise plan.error(error.problem, where, error.expected) from None
        # Links that share an index are switched together.
        found |= {x.index: x for link in chosen for x in junction.of_index[link.index]}
    return [found[index] for index in sorted(found)]


def _walks(
    junction: Signalised, plan: SignalPlan, k: int, spec: PhaseSpec, green: Sequence[Link]
) -> list[Link]:
    """Return the crossings with green: as told, else those crossed by turning traffic at most."""
    if spec.walk is not None:
        found: dict[int, Link] = {}
        for number, words in enumerate(spec.walk):
            where = ("phases", k, "walk", number)
            try:
                chosen = crossings(junction, words)
            except UnknownMovement as error:
                raise plan.error(error.problem, where, error.expected) from None
            found |= {link.index: link for link in chosen}
            check_conflicts(junction, [*green, *chosen], plan, where)
        return [found[index] for index in sorted(found)]
    through = {link.road for link in green if link.movement == "through"}
    has_through = {link.road for link in junction.links if link.movement == "through"}
    return [
        link
        for link in junction.links
        if link.movement == "walk"
        and all(
            # A protected turn is not crossed: its drivers do not expect pedestrians.
            other.is_turn and (other.road in through or other.road not in has_through)
            for other in green
            if junction.are_foes(link, other)
        )
    ]


def _between(spec: PhaseSpec, ending: Sequence[Link]) -> tuple[float, float]:
    """Return yellow and all-red after a phase, seconds."""
    if not ending:
        return spec.yellow or 0.0, spec.all_red or 0.0
    fastest = max(link.speed for link in ending)
    yellow = next(seconds for limit, seconds in YELLOW_S if fastest <= limit)
    clear = max(
        (link.length + VEHICLE_M) / max(link.speed, SLOWEST_M_S) - REACTION_S for link in ending
    )
    all_red = float(min(max(math.ceil(clear - 1e-6), SHORTEST_ALL_RED_S), LONGEST_ALL_RED_S))
    return (
        yellow if spec.yellow is None else spec.yellow,
        all_red if spec.all_red is None else spec.all_red,
    )


def _seconds(plan: SignalPlan, specs: Sequence[PhaseSpec], between: float) -> list[float]:
    """Return the green of each phase, those that give none sharing what the cycle leaves."""
    given = [spec.seconds for spec in specs]
    open_ = given.count(None)
    if not open_:
        return [seconds for seconds in given if seconds is not None]
    if plan.spec.cycle is None:
        where = ("phases", given.index(None))
        raise plan.error("has no seconds", where, "seconds, or a cycle to share out")
    known = sum(seconds for seconds in given if seconds is not None)
    share = (plan.spec.cycle - known - between) / open_
    if share < plan.spec.minimum_green:
        raise plan.error(
            f"is {plan.spec.cycle:g} s, which leaves {max(share, 0.0):g} s of green for each "
            "phase without seconds",
            ("cycle",),
            f"at least {known + between + open_ * plan.spec.minimum_green:g}",
        )
    return [share if seconds is None else seconds for seconds in given]


def _letters(junction: Signalised, green: Sequence[Link], walks: Sequence[Link]) -> dict[int, str]:
    """Return index -> ``G``, or ``g`` where it must give way to another green."""
    on = [*green, *walks]
    found = dict.fromkeys([link.index for link in on], "G")
    for link in green:
        if any(junction.gives_way(link, other) for other in on if other is not link):
            found[link.index] = "g"
    return found


def _state(junction: Signalised, letters: dict[int, str]) -> str:
    return "".join(letters.get(index, "r") for index in range(junction.size))


def _joined(phases: Sequence[Phase]) -> tuple[Phase, ...]:
    """Join phases that show the same."""
    found: list[Phase] = []
    for seconds, state in phases:
        if found and found[-1][1] == state:
            found[-1] = (found[-1][0] + seconds, state)
        elif seconds > 0:
            found.append((seconds, state))
    return tuple((round(seconds, 3), state) for seconds, state in found)
