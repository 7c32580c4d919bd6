"""Stages written as the phases of a program: one letter for every link."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise

from urbantwin.roads.model.furniture import Phase
from urbantwin.roads.signals.controlled_links import Signalised
from urbantwin.roads.signals.intergreen import Change

__all__ = ["phases_of_stages", "walks"]


def walks(junction: Signalised, index: int) -> bool:
    """Whether a link is a crossing."""
    return junction.of_index[index][0].movement == "walk"


def phases_of_stages(
    junction: Signalised,
    stages: Sequence[Collection[int]],
    seconds: Sequence[float],
    changes: Sequence[Change],
) -> tuple[Phase, ...]:
    """Return the phases of a program.

    Args:
        junction: its links.
        stages: links that have green in each stage.
        seconds: of each stage, without the change after it.
        changes: from each stage to the next.
    """
    begins = [0.0]
    for length, change in zip(seconds, changes, strict=True):
        begins.append(begins[-1] + length + change.seconds)
    cycle = begins.pop()
    greens: list[tuple[int, float, float]] = []
    yellows: list[tuple[int, float, float]] = []
    for k, stage in enumerate(stages):
        before, change = changes[k - 1], changes[k]
        end = begins[k] + seconds[k]
        for index in sorted(stage):
            goes_on = index in stages[(k + 1) % len(stages)] and len(stages) > 1
            came = index in stages[k - 1] and len(stages) > 1
            early = 0.0 if came else before.starts.get(index, before.seconds) - before.seconds
            stop = end + (change.seconds if goes_on else change.ends.get(index, 0.0))
            greens.append((index, begins[k] + early, stop))
            if not goes_on and not walks(junction, index):
                yellows.append((index, stop, stop + change.yellow))
    times = {0.0, cycle, *(round(t % cycle, 6) for _, *ends in (*greens, *yellows) for t in ends)}
    phases = []
    for start, stop in pairwise(sorted(times)):
        green, yellow = (_at((start + stop) / 2, spans, cycle) for spans in (greens, yellows))
        phases.append((stop - start, _state(junction, green, yellow - green)))
    return _joined(phases)


def _at(time: float, spans: Sequence[tuple[int, float, float]], cycle: float) -> set[int]:
    """Return which links something is shown to at a time of the cycle."""
    return {
        index
        for index, start, stop in spans
        if start < time < stop or start < time - cycle < stop or start < time + cycle < stop
    }


def _state(junction: Signalised, green: set[int], yellow: set[int]) -> str:
    """Return the letters of a phase: ``g`` where another that drives has right of way."""
    found: Mapping[int, str] = dict.fromkeys(green, "G") | dict.fromkeys(yellow, "y")
    on = [link for index in sorted(found) for link in junction.of_index[index]]
    waiting = {
        link.index
        for link in on
        if link.movement != "walk"
        and any(other.index in found for other in junction.yields_to[link] if other is not link)
    }
    letters = {k: "g" if letter == "G" and k in waiting else letter for k, letter in found.items()}
    return "".join(letters.get(index, "r") for index in range(junction.size))


def _joined(phases: Sequence[Phase]) -> tuple[Phase, ...]:
    """Join phases that show the same."""
    found: list[Phase] = []
    for seconds, state in phases:
        if found and found[-1][1] == state:
            found[-1] = (found[-1][0] + seconds, state)
        else:
            found.append((seconds, state))
    return tuple((round(seconds, 3), state) for seconds, state in found)
