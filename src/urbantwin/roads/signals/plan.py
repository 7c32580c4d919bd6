"""Signal plans in words, converted to program states and checked for conflicts.

Movements are named as by traffic engineers: ``north left``, ``southbound``, ``Main Street``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from itertools import combinations

from urbantwin.roads.model.furniture import Phase
from urbantwin.roads.signals.changes import (
    Change,
    all_red_s,
    crossing_s,
    phases_of_stages,
    yellow_s,
)
from urbantwin.roads.signals.controlled_links import (
    COMPASS,
    FACING_DEG,
    Link,
    Signalised,
    turn_between,
)
from urbantwin.site.signals import PhaseSpec, SignalPlan

__all__ = [
    "WALK_S",
    "UnknownMovement",
    "approaches",
    "check_conflicts",
    "check_greens",
    "checked_states",
    "crossings",
    "link_in_words",
    "plan_phases",
    "vehicle_links",
]

MOVEMENT_WORDS = {
    "left": "left",
    "through": "through",
    "thru": "through",
    "straight": "through",
    "right": "right",
    "u-turn": "u-turn",
    "uturn": "u-turn",
}
#: Maximum angle between an arm and a named direction, degrees.
WITHIN_DEG = 45.0


class UnknownMovement(Exception):  # noqa: N818 - callers turn it into an InputError
    """No movement of a junction matches the words."""

    def __init__(self, problem: str, expected: str) -> None:
        super().__init__(problem)
        self.problem, self.expected = problem, expected


def vehicle_links(junction: Signalised, words: str | int) -> list[Link]:
    """Return the vehicle links that match words.

    Raises:
        UnknownMovement: none matches.
    """
    text = " ".join(str(words).split())
    vehicles = [link for link in junction.links if link.movement != "walk"]
    parts = text.replace("+", " ").replace(",", " ").split()
    movements = set()
    while parts and parts[-1].lower() in MOVEMENT_WORDS:
        movements.add(MOVEMENT_WORDS[parts.pop().lower()])
    chosen = _links_of_approach(junction, vehicles, " ".join(parts) or "all")
    matching = [link for link in chosen if not movements or link.movement in movements]
    if not matching:
        turns = sorted({link.movement for link in chosen})
        raise UnknownMovement(
            f"{text!r} names no way through the junction",
            f"one of {', '.join(turns)} from there" if turns else _choices(junction),
        )
    return matching


def crossings(junction: Signalised, words: str) -> list[Link]:
    """Return the crossings over the arms that match words.

    Raises:
        UnknownMovement: none matches.
    """
    walkers = [link for link in junction.links if link.movement == "walk"]
    matching = _links_of_approach(junction, walkers, " ".join(words.split()))
    if not matching:
        arms = sorted({link.arm for link in walkers})
        raise UnknownMovement(
            f"{words!r} names no crossing with signals",
            f"one of {', '.join(arms)}" if arms else "none: no such crossings here",
        )
    return matching


def approaches(junction: Signalised) -> list[tuple[str, str]]:
    """Return (arm, street) of each approach, clockwise from north."""
    order = list(COMPASS)
    arms = {(link.arm, link.street) for link in junction.links if link.movement != "walk"}
    return sorted(arms, key=lambda pair: (order.index(pair[0]), pair[1]))


def _links_of_approach(junction: Signalised, links: list[Link], name: str) -> list[Link]:
    lower = name.lower()
    if lower == "all":
        return links
    kind, _, rest = lower.partition(" ")
    if kind in ("link", "links") and rest:
        numbers = _numbers(rest)
        return [link for link in links if link.index in numbers]
    if kind == "lane" and rest:
        return [link for link in links if link.lane == name[5:].strip()]
    for ending in ("bound", ""):
        word = lower.removesuffix(ending).replace("-", "")
        if (ending and not lower.endswith(ending)) or word not in COMPASS:
            continue
        # Southbound traffic comes from the north.
        bearing = COMPASS[word] + (180.0 if ending else 0.0)
        return [link for link in links if turn_between(link.bearing, bearing) < WITHIN_DEG]
    if name in {link.road for link in links}:
        return [link for link in links if link.road == name]
    if not name.isdigit():
        on_street = [link for link in links if link.street.casefold() == name.casefold()]
        if on_street:
            return on_street
    raise UnknownMovement(f"{name!r} is not an approach of the junction", _choices(junction))


def _numbers(text: str) -> set[int]:
    numbers: set[int] = set()
    for part in text.replace(",", " ").split():
        first, _, last = part.partition("-")
        if not all(re.fullmatch("[0-9]{1,4}", number) for number in (first, last or first)):
            raise UnknownMovement(f"{text!r} is not a list of links", "numbers such as 0-3, 7")
        numbers |= set(range(int(first), int(last or first) + 1))
    return numbers


def _choices(junction: Signalised) -> str:
    listed = [f"{arm} ({street})" if street else arm for arm, street in approaches(junction)]
    return "one of " + ", ".join(listed)


#: Minimum walk interval, seconds (MUTCD 2009, 4E.06).
WALK_S = 4.0
GREEN = "Gg"


def _conflict(junction: Signalised, a: Link, b: Link) -> bool:
    """Return whether simultaneous greens conflict beyond permitted yielding."""
    if not junction.are_foes(a, b) or a.road == b.road:
        return False
    if "walk" in (a.movement, b.movement):
        return junction.meets_walkers(*((b, a) if a.movement == "walk" else (a, b)))
    facing = turn_between(a.bearing, b.bearing) > FACING_DEG
    return not (facing and (a.is_turn or b.is_turn))


def check_conflicts(
    junction: Signalised, green: Iterable[Link], plan: SignalPlan, where: tuple[int | str, ...]
) -> None:
    """Check that links with simultaneous green do not conflict.

    Raises:
        InputError: two of them conflict.
    """
    pairs = [pair for pair in combinations(green, 2) if _conflict(junction, *pair)]
    if pairs:
        # Name through movements in the message if possible.
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
    """Return the phases of a plan with explicit states.

    Raises:
        InputError: a state has the wrong number of letters, gives right of way to conflicting
            traffic, or changes to red without yellow.
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
                    "the letter g for the movement that yields, or one of them red",
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
    """Check that each link gets green, and none that is too short.

    Raises:
        InputError: a movement never gets green, or too short a green.
    """
    where = ("phases",) if plan.spec.phases is not None else ("states",)
    never = [
        link for link in junction.links if all(state[link.index] in "rs" for _, state in phases)
    ]
    if never:
        names = ", ".join(dict.fromkeys(map(link_in_words, never)))
        raise plan.error(
            f"never gives green to {names}", where, "green for each movement in the cycle"
        )
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
    """Return the shortest continuous green of a cyclic program, seconds."""
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


def plan_phases(junction: Signalised, plan: SignalPlan) -> tuple[float, tuple[Phase, ...]]:
    """Return the offset, seconds, and the phases of a plan at a junction.

    Args:
        junction: the signalised junction.
        plan: its plan from ``site.yaml``.

    Raises:
        InputError: an approach is unknown, greens conflict or are too short, a movement never gets
            green, or the phases do not add up to the cycle.
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
        check_greens(junction, plan, [(state.lasts[0], state.state) for state in spec.states])
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
        _clearance_s(
            spec, [link for link in green if link.index not in stages[(k + 1) % len(stages)]]
        )
        for k, (spec, green) in enumerate(zip(specs, greens, strict=True))
    ]
    seconds = _seconds(plan, specs, sum(map(sum, between)))
    changes = [
        Change(
            yellow + all_red,
            yellow,
            ends=_pedestrian_green_ends(junction, stages, k, length, yellow + all_red),
        )
        for k, (length, (yellow, all_red)) in enumerate(zip(seconds, between, strict=True))
    ]
    return phases_of_stages(junction, stages, seconds, changes)


def _pedestrian_green_ends(
    junction: Signalised, stages: Sequence[set[int]], k: int, length: float, between: float
) -> dict[int, float]:
    """Return the ends of pedestrian greens, seconds relative to the end of the stage (negative)."""
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
    greens: dict[int, Link] = {}
    for number, words in enumerate(spec.green):
        try:
            chosen = vehicle_links(junction, words)
        except UnknownMovement as error:
            where = ("phases", k, "green", number)
            raise plan.error(error.problem, where, error.expected) from None
        # Links that share an index switch together.
        greens |= {x.index: x for link in chosen for x in junction.of_index[link.index]}
    return [greens[index] for index in sorted(greens)]


def _walks(
    junction: Signalised, plan: SignalPlan, k: int, spec: PhaseSpec, green: Sequence[Link]
) -> list[Link]:
    """Return the crossings with green: those planned, else those crossed only by turns."""
    if spec.walk is not None:
        by_index: dict[int, Link] = {}
        for number, words in enumerate(spec.walk):
            where = ("phases", k, "walk", number)
            try:
                chosen = crossings(junction, words)
            except UnknownMovement as error:
                raise plan.error(error.problem, where, error.expected) from None
            by_index |= {link.index: link for link in chosen}
            check_conflicts(junction, [*green, *chosen], plan, where)
        return [by_index[index] for index in sorted(by_index)]
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


def _clearance_s(spec: PhaseSpec, ending: Sequence[Link]) -> tuple[float, float]:
    """Return yellow and all-red time after a phase, seconds."""
    if not ending:
        return spec.yellow or 0.0, spec.all_red or 0.0
    return (
        yellow_s(ending) if spec.yellow is None else spec.yellow,
        all_red_s(ending) if spec.all_red is None else spec.all_red,
    )


def _seconds(plan: SignalPlan, specs: Sequence[PhaseSpec], between: float) -> list[float]:
    """Return the green of each phase; phases without a duration share the rest of the cycle."""
    durations = [spec.seconds for spec in specs]
    open_ = durations.count(None)
    if not open_:
        return [seconds for seconds in durations if seconds is not None]
    if plan.spec.cycle is None:
        where = ("phases", durations.index(None))
        raise plan.error("has no seconds", where, "seconds, or a cycle to share out")
    fixed_s = sum(seconds for seconds in durations if seconds is not None)
    share = (plan.spec.cycle - fixed_s - between) / open_
    if share < plan.spec.minimum_green:
        raise plan.error(
            f"is {plan.spec.cycle:g} s, which leaves {max(share, 0.0):g} s of green for each "
            "phase without seconds",
            ("cycle",),
            f"at least {fixed_s + between + open_ * plan.spec.minimum_green:g}",
        )
    return [share if seconds is None else seconds for seconds in durations]
