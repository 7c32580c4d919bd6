"""Movements in a traffic engineer's words: ``north left``, ``southbound``, ``Main Street``."""

from __future__ import annotations

import re

from urbantwin.roads.signals.controlled_links import COMPASS, Link, Signalised, turn_between

__all__ = ["UnknownMovement", "approaches", "crossings", "vehicle_links"]

MOVEMENT_WORDS = {
    "left": "left",
    "through": "through",
    "thru": "through",
    "straight": "through",
    "right": "right",
    "u-turn": "u-turn",
    "uturn": "u-turn",
}
#: An arm answers to a direction's name when it lies within this angle of it, degrees.
WITHIN_DEG = 45.0


class UnknownMovement(Exception):  # noqa: N818 - callers turn it into an InputError
    """Words that match no movement of a junction."""

    def __init__(self, problem: str, expected: str) -> None:
        super().__init__(problem)
        self.problem, self.expected = problem, expected


def vehicle_links(junction: Signalised, words: str | int) -> list[Link]:
    """Return the links that words name.

    Raises:
        UnknownMovement: they name none.
    """
    text = " ".join(str(words).split())
    vehicles = [link for link in junction.links if link.movement != "walk"]
    parts = text.replace("+", " ").replace(",", " ").split()
    movements = set()
    while parts and parts[-1].lower() in MOVEMENT_WORDS:
        movements.add(MOVEMENT_WORDS[parts.pop().lower()])
    chosen = _of_approach(junction, vehicles, " ".join(parts) or "all")
    found = [link for link in chosen if not movements or link.movement in movements]
    if not found:
        turns = sorted({link.movement for link in chosen})
        raise UnknownMovement(
            f"{text!r} names no way through the junction",
            f"one of {', '.join(turns)} from there" if turns else _choices(junction),
        )
    return found


def crossings(junction: Signalised, words: str) -> list[Link]:
    """Return the crossings over the arms that words name.

    Raises:
        UnknownMovement: they name none.
    """
    walkers = [link for link in junction.links if link.movement == "walk"]
    found = _of_approach(junction, walkers, " ".join(words.split()))
    if not found:
        arms = sorted({link.arm for link in walkers})
        raise UnknownMovement(
            f"{words!r} names no crossing with signals",
            f"one of {', '.join(arms)}" if arms else "none: no such crossings here",
        )
    return found


def approaches(junction: Signalised) -> list[tuple[str, str]]:
    """Return (arm, street) of every approach, clockwise from north."""
    order = list(COMPASS)
    arms = {(link.arm, link.street) for link in junction.links if link.movement != "walk"}
    return sorted(arms, key=lambda pair: (order.index(pair[0]), pair[1]))


def _of_approach(junction: Signalised, links: list[Link], name: str) -> list[Link]:
    lower = name.lower()
    if lower == "all":
        return links
    kind, _, rest = lower.partition(" ")
    if kind in ("link", "links") and rest:
        wanted = _numbers(rest)
        return [link for link in links if link.index in wanted]
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
        found = [link for link in links if link.street.casefold() == name.casefold()]
        if found:
            return found
    raise UnknownMovement(f"{name!r} is not an approach of the junction", _choices(junction))


def _numbers(text: str) -> set[int]:
    found: set[int] = set()
    for part in text.replace(",", " ").split():
        first, _, last = part.partition("-")
        if not all(re.fullmatch("[0-9]{1,4}", one) for one in (first, last or first)):
            raise UnknownMovement(f"{text!r} is not a list of links", "numbers such as 0-3, 7")
        found |= set(range(int(first), int(last or first) + 1))
    return found


def _choices(junction: Signalised) -> str:
    listed = [f"{arm} ({street})" if street else arm for arm, street in approaches(junction)]
    return "one of " + ", ".join(listed)
