"""Signal plans in words turned into states of a program, checked for conflicts."""

from __future__ import annotations

from collections.abc import Sequence

from urbantwin.roads.model.furniture import Phase
from urbantwin.roads.signals.changes import (
    Change,
    all_red_s,
    crossing_s,
    phases_of_stages,
    yellow_s,
)
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
    if spec.phases is not None:
        check_greens(junction, plan, phases)
    elif spec.states is not None:
        check_greens(junction, plan, [(one.lasts[0], one.state) for one in spec.states])
    offset = junction.offset if spec.offset is None else spec.offset % cycle
    return offset, phases


def _from_words(junction: Signalised, plan: SignalPlan) -> tuple[Phase, ...]:
    specs = plan.spec.phases or []
    greens = [_greens(junction, plan, k, spec) for k, spec in enumerate(specs)]
    for k, green in enumerate(greens):
        check_conflicts(junction, green, plan, ("phases", k, "green"))
    walks = [_walks(junction, plan, k, spec, greens[k]) for k, spec in enumerate(specs)]
    stages = [
        {link.index for link in (*green, *walk)} for green, walk in zip(greens, walks, strict=True)
    ]
    between = [
        _between(spec, [link for link in green if link.index not in stages[(k + 1) % len(stages)]])
        for k, (spec, green) in enumerate(zip(specs, greens, strict=True))
    ]
    seconds = _seconds(plan, specs, sum(map(sum, between)))
    changes = [
        Change(
            yellow + all_red, yellow, ends=_walked(junction, stages, k, length, yellow + all_red)
        )
        for k, (length, (yellow, all_red)) in enumerate(zip(seconds, between, strict=True))
    ]
    return phases_of_stages(junction, stages, seconds, changes)


def _walked(
    junction: Signalised, stages: Sequence[set[int]], k: int, length: float, between: float
) -> dict[int, float]:
    """Return when people's green ends, seconds from the end of its stage: before it."""
    stopping = [
        link
        for index in stages[k] - stages[(k + 1) % len(stages)]
        for link in junction.of_index[index]
        if link.movement == "walk"
    ]
    needed = max(map(crossing_s, stopping), default=0) - between
    early = max(0.0, min(needed, length - WALK_S))
    return {link.index: -early for link in stopping}


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
            not junction.meets_walkers(other, link)
            and (other.road in through or other.road not in has_through)
            for other in green
            if junction.are_foes(link, other)
        )
    ]


def _between(spec: PhaseSpec, ending: Sequence[Link]) -> tuple[float, float]:
    """Return yellow and all-red after a phase, seconds."""
    if not ending:
        return spec.yellow or 0.0, spec.all_red or 0.0
    return (
        yellow_s(ending) if spec.yellow is None else spec.yellow,
        all_red_s(ending) if spec.all_red is None else spec.all_red,
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
