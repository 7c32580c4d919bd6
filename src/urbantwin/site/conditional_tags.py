"""Conditional tags of a map (OSM wiki, "Conditional restrictions").

``motor_vehicle:conditional = no @ (Mo-Fr 07:00-19:00)`` gives the key another value at these times.
Of several matching rules the last counts. Times of day are those of a Wednesday, since traffic
guesses are those of weekdays. Conditions on weight, holidays, dates or the sun's position are not
supported.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import replace

from urbantwin.site.access import KEYS
from urbantwin.site.extract import Extract

__all__ = ["at_time"]

CONDITIONAL = ":conditional"
#: Evaluated keys of ways: access, speed limit, and one-way. Of relations, turn restrictions; ways
#: use the same key for parking.
HEEDED = frozenset((*KEYS, "maxspeed", "oneway"))
OF_TURNS = frozenset({"restriction"})
DAYS = ("Mo", "Tu", "We", "Th", "Fr", "Sa", "Su")
WEDNESDAY = DAYS.index("We")
#: A value and its condition, with or without parentheses.
_RULE = re.compile(r"\s*([^@;]+?)\s*@\s*(\([^)]*\)|[^;()]+)\s*(?:;|$)")
_DAY = r"(?:Mo|Tu|We|Th|Fr|Sa|Su)"
_CLOCK = r"(\d{1,2}):(\d{2})"
_DAYS = re.compile(rf"{_DAY}(?:\s*-\s*{_DAY})?(?:\s*,\s*{_DAY}(?:\s*-\s*{_DAY})?)*")
_HOURS = re.compile(rf"{_CLOCK}\s*-\s*{_CLOCK}")


def at_time(extract: Extract, time: str | None) -> tuple[Extract, list[str]]:
    """Return a map evaluated at a time of day, and the restrictions that could not be evaluated.

    Args:
        extract: the map.
        time: such as ``08:00``; ``None`` ignores all conditions.
    """
    left: list[str] = []
    ways = {
        way.id: replace(way, tags=_tags_at(way.tags, keys, time, left))
        for way in extract.highways()
        if (keys := _conditional(way.tags, HEEDED))
    }
    relations = {
        identity: replace(relation, tags=_tags_at(relation.tags, keys, time, left))
        for identity, relation in extract.relations.items()
        if (keys := _conditional(relation.tags, OF_TURNS))
    }
    if not (ways or relations):
        return extract, left
    ways, relations = {**extract.ways, **ways}, {**extract.relations, **relations}
    return replace(extract, ways=ways, relations=relations), left


def _conditional(tags: Mapping[str, str], heeded: Set[str]) -> list[str]:
    """Return the conditional keys of evaluated keys."""
    known = (key for key in tags if key.endswith(CONDITIONAL))
    return sorted(key for key in known if key.split(":", maxsplit=1)[0] in heeded)


def _tags_at(
    tags: Mapping[str, str], keys: Iterable[str], time: str | None, left: list[str]
) -> dict[str, str]:
    """Return tags at a time; append conditions that were not evaluated to ``left``."""
    found = dict(tags)
    for key in keys:
        value = None
        for told, condition in _rules(tags[key]):
            holds = None if time is None else _holds(condition, time)
            if holds is None:
                if not key.startswith("maxspeed"):
                    left.append(f"{key}={tags[key]}")
                break
            value = told if holds else value
        else:
            if value is not None:
                found[key.removesuffix(CONDITIONAL)] = value
    return found


def _rules(value: str) -> Iterator[tuple[str, str]]:
    """Yield the values of a conditional tag and their conditions."""
    end = 0
    for match in _RULE.finditer(value):
        if match.start() != end:
            break
        end = match.end()
        yield match[1], match[2].strip("() ")
    if end != len(value):
        yield "", "?"


def _holds(condition: str, time: str) -> bool | None:
    """Return whether a condition holds on a Wednesday at a time; ``None`` if not supported."""
    holds = False
    for part in condition.split(";"):
        rest = part.strip()
        today = True
        if days := _DAYS.match(rest):
            today = any(_covers_today(span) for span in days[0].split(","))
            rest = rest[days.end() :].strip()
        hours = [span.strip() for span in rest.split(",")] if rest else []
        found = [_HOURS.fullmatch(span) for span in hours]
        if not (days or hours) or None in found:
            return None
        now = not hours or any(_covers(match.groups(), time) for match in found if match)
        # A later rule for the same day replaces an earlier one (opening_hours).
        if today:
            holds = now
    return holds


def _covers_today(span: str) -> bool:
    """Return whether days such as ``Mo-Fr`` include Wednesday."""
    ends = [DAYS.index(day.strip()) for day in span.split("-")]
    first, last = ends[0], ends[-1]
    return (WEDNESDAY - first) % 7 <= (last - first) % 7


def _covers(hours: Sequence[str], time: str) -> bool:
    """Return whether a time is in a span, which may extend past midnight."""
    now = int(time[:2]) * 60 + int(time[3:])
    from_h, from_min, to_h, to_min = map(int, hours)
    begin, end = from_h * 60 + from_min, to_h * 60 + to_min
    return (now - begin) % 1440 < ((end - begin) % 1440 or 1440)
