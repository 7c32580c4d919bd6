"""Checks of a signal plan: no conflicting greens, long enough, for everybody."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import combinations

from urbantwin.roads.model.furniture import Phase
from urbantwin.roads.signals.controlled_links import FACING_DEG, Link, Signalised, turn_between
from urbantwin.site.signals import SignalPlan

__all__ = ["WALK_S", "check_conflicts", "check_greens", "checked_states", "link_in_words"]

#: Pedestrians get at least 4 s to set out (MUTCD 2009, 4E.06).
WALK_S = 4.0
GREEN = "Gg"


def _conflict(junction: Signalised, a: Link, b: Link) -> bool:
    """Whether two simultaneous greens conflict beyond one driver giving way to another."""
    if not junction.are_foes(a, b) or a.road == b.road:
        return False
    if "walk" in (a.movement, b.movement):
        return junction.meets_walkers(*((b, a) if a.movement == "walk" else (a, b)))
    facing = turn_between(a.bearing, b.bearing) > FACING_DEG
    return not (facing and (a.is_turn or b.is_turn))


def check_conflicts(
    junction: Signalised, green: Iterable[Link], plan: SignalPlan, where: tuple[int | str, ...]
) -> None:
    """Check that links that have green together do not cross each other.

    Raises:
        InputError: two do.
    """
    pairs = [pair for pair in combinations(green, 2) if _conflict(junction, *pair)]
    if pairs:
        # Through movements make the clearest message.
        a, b = max(pairs, key=lambda pair: sum(not link.is_turn for link in pair))
        raise plan.error(
            f"gives green to conflicting traffic: {link_in_words(a)} and {link_in_words(b)}",
            where,
            "approaches that do not cross each other in one phase",
        )


def link_in_words(link: Link) -> str:
    """Return a link in words: ``north through (First Street)``."""
    street = f" ({link.street})" if link.street else ""
    if link.movement == "walk":
        return f"the crossing over the {link.arm} arm{street}"
    return f"{link.arm} {link.movement}{street}"


def checked_states(junction: Signalised, plan: SignalPlan) -> tuple[Phase, ...]:
    """Return the phases of a plan that is written letter by letter.

    Raises:
        InputError: a state has too many or too few letters, gives right of way to conflicting
            traffic, or goes to red without yellow.
    """
    phases = tuple((spec.seconds, spec.state) for spec in plan.spec.states or [])
    size = len(junction.phases[0][1]) if junction.phases else junction.size
    for k, (_, state) in enumerate(phases):
        where = ("states", k, "state")
        if len(state) != size:
            raise plan.error(f"has {len(state)} letters", where, f"{size}, one per link")
        protected = [link for link in junction.links if state[link.index] == "G"]
        for a, b in combinations(protected, 2):
            if junction.are_foes(a, b) and a.road != b.road:
                raise plan.error(
                    "gives right of way to conflicting traffic: "
                    f"{link_in_words(a)} (link {a.index}) and "
                    f"{link_in_words(b)} (link {b.index})",
                    where,
                    "the letter g for who gives way, or one of them red",
                )
        following = phases[(k + 1) % len(phases)][1]
        for link in junction.links:
            abrupt = state[link.index] in GREEN and following[link.index] in "rs"
            if abrupt and link.movement != "walk" and len(phases) > 1:
                raise plan.error(
                    f"is followed by red without yellow for {link_in_words(link)} "
                    f"(link {link.index})",
                    where,
                    "a phase with y between them",
                )
    return phases


def check_greens(junction: Signalised, plan: SignalPlan, phases: Sequence[Phase]) -> None:
    """Check that everybody gets green, and none that is too short.

    Raises:
        InputError: a movement never gets green, or too short a one.
    """
    where = ("phases",) if plan.spec.phases is not None else ("states",)
    never = [
        link for link in junction.links if all(state[link.index] in "rs" for _, state in phases)
    ]
    if never:
        names = ", ".join(dict.fromkeys(map(link_in_words, never)))
        raise plan.error(f"never gives green to {names}", where, "green for everybody in the cycle")
    for link in junction.links:
        on = [state[link.index] in GREEN for _, state in phases]
        if not any(on):
            continue
        shortest = _shortest(on, [seconds for seconds, _ in phases])
        least = min(plan.spec.minimum_green, WALK_S if link.movement == "walk" else math.inf)
        if shortest < least - 1e-6:
            raise plan.error(
                f"gives {link_in_words(link)} {shortest:g} s of green",
                where,
                f"at least {least:g} s (minimum_green)",
            )


def _shortest(on: Sequence[bool], seconds: Sequence[float]) -> float:
    """Return the shortest unbroken green, the program running round and round."""
    if all(on):
        return math.inf
    start = on.index(False)
    runs, run = [], 0.0
    for k in range(len(on) + 1):
        j = (start + k) % len(on)
        if on[j] and k < len(on):
            run += seconds[j]
        elif run:
            runs.append(run)
            run = 0.0
    return min(runs, default=math.inf)
