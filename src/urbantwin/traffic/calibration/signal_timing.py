"""Signal timing: the recorded group of each link, and the observed cycle."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads.signals.changes import crossing_s
from urbantwin.roads.signals.controlled_links import Link, Signalised
from urbantwin.traffic.calibration.actuated import ActuatedCycle, actuated_cycle
from urbantwin.traffic.calibration.passages import JunctionLinks, Passage
from urbantwin.traffic.recorded.track import RecordedSignals

__all__ = ["Timing", "groups_of_links", "timing_of"]

Shown = Sequence[tuple[float, str]]
#: Time before green, and after its end, in which passages count as at green, seconds. Some drivers
#: pass at yellow (RiLSA 2015, 2.5: 3 s at 50 km/h), and tracks and phases may be off by some
#: tenths.
_BEFORE_S, _AFTER_S = 0.5, 4.0
_STEP_S = 0.1
_YELLOW_S = 3.0
#: Least green of pedestrians, and clearance after the yellow of conflicting vehicles, seconds.
_MIN_WALK_S, _WALK_CLEARANCE_S = 5.0, 1.0
_RED_PASSAGE_PROBABILITY = 0.02  # probability of a passage at red
_CYCLE_LIMITS_S = (20.0, 180.0)
#: Least number of green begins for the number of greens per cycle.
_MIN_GREEN_BEGINS = 4


@dataclass(frozen=True)
class Timing:
    """The timing of a junction's signals.

    Attributes:
        cycle_s: median time between two begins of green of a group.
        cycles: number of such times.
        group_of: link -> group.
        certain: links whose group follows from passages.
        states: (seconds, one letter for each link) of one cycle; the usual one for actuated
            signals.
        greens: group -> seconds of green in it.
        lasts: least and largest duration of each state, seconds.
        actuated: the cycle of actuated signals; ``None`` for fixed ones.
    """

    cycle_s: float
    cycles: int
    group_of: dict[int, str]
    certain: tuple[int, ...]
    states: tuple[tuple[float, str], ...]
    greens: dict[str, float]
    lasts: tuple[tuple[float, float], ...]
    actuated: ActuatedCycle | None = None

    @property
    def program(self) -> list[dict[str, Any]]:
        """The states in the form of a site's ``signals``."""
        return [
            {"seconds": seconds, "state": state}
            | ({} if least == most else {"at_least": least, "at_most": most})
            for (seconds, state), (least, most) in zip(self.states, self.lasts, strict=True)
        ]


def timing_of(
    signals: RecordedSignals, passages: Sequence[Passage], links: JunctionLinks, until_s: float
) -> Timing | None:
    """Return the recorded timing; ``None`` if no group is periodic, or there are no signals.

    Each link gets the group that was green when its vehicles passed (maximum likelihood, with
    independent passages). Links without passages get the group of their lane's other links, else of
    their road's.

    Args:
        signals: recorded states of groups.
        passages: passages with times.
        links: movements of the junction.
        until_s: end of the part that is used, seconds.
    """
    shown = _of_vehicles(signals)
    periods = _periods([_starts(changes, until_s) for changes in shown.values()])
    periods = [
        period_s for period_s in periods if _CYCLE_LIMITS_S[0] <= period_s <= _CYCLE_LIMITS_S[1]
    ]
    if links.signals is None or not periods:
        return None
    cycle_s = round(float(np.median(periods)), 1)
    group_of, certain = _groups(shown, passages, links, until_s)
    if not group_of:
        return None
    groups = set(group_of.values())
    times = np.arange(0.0, until_s - _STEP_S / 2, _STEP_S)
    actuated = actuated_cycle({group: _letters(shown[group], times) for group in groups}, _STEP_S)
    if actuated is not None and actuated.driven:
        letters, phase = actuated.sampled(_STEP_S)
    else:
        times = np.arange(0.0, cycle_s - _STEP_S / 2, _STEP_S)
        letters = {group: _letters(shown[group], times) for group in groups}
        phase = np.zeros(len(times), np.int64)
    states = _states(letters, group_of, links.signals, phase)
    lasts = [(seconds, seconds) for seconds, _, _ in states]
    if actuated is not None and actuated.driven:
        lasts = _duration_ranges(states, actuated)
    return Timing(
        cycle_s,
        len(periods),
        group_of,
        certain,
        tuple((seconds, state) for seconds, state, _ in states),
        {
            group: round(float(np.isin(group_letters, ["G", "g"]).sum() * _STEP_S), 1)
            for group, group_letters in sorted(letters.items())
        },
        tuple(lasts),
        actuated,
    )


def groups_of_links(
    signals: RecordedSignals, passages: Sequence[Passage], links: JunctionLinks, until_s: float
) -> dict[int, str]:
    """Return link -> group, as far as passages tell; see `timing_of`."""
    return _groups(_of_vehicles(signals), passages, links, until_s)[0]


def _of_vehicles(signals: RecordedSignals) -> dict[str, Shown]:
    """Return the groups of vehicles: those with green and yellow."""
    return {
        group: changes
        for group, changes in signals.shown.items()
        if any(letter == "y" for _, letter in changes) and any(x in "Gg" for _, x in changes)
    }


def _starts(changes: Shown, until_s: float) -> list[float]:
    """Return the begins of green; changes between protected and permitted green do not count."""
    return [
        time_s
        for (_, was), (time_s, letter) in pairwise(changes)
        if letter in "Gg" and was not in "Gg" and time_s < until_s
    ]


def _periods(starts: Sequence[Sequence[float]]) -> list[float]:
    """Return the durations of whole cycles between two begins of green of a group, seconds.

    Some groups have green twice in a cycle: those with twice as many begins as usual.
    """
    usual = float(np.median([len(begins) for begins in starts if begins] or [0]))
    periods: list[float] = []
    for begins in starts:
        times = max(round(len(begins) / usual), 1) if usual >= _MIN_GREEN_BEGINS else 1
        periods += (np.array(begins[times:]) - np.array(begins[:-times])).tolist()
    return periods


def _letters(changes: Shown, times: NDArray[np.float64]) -> NDArray[np.str_]:
    begins = np.array([time_s for time_s, _ in changes])
    number = np.searchsorted(begins, times + 1e-9, side="right") - 1
    return np.asarray(np.array([letter for _, letter in changes])[number.clip(0)])


def _groups(
    shown: Mapping[str, Shown],
    passages: Sequence[Passage],
    links: JunctionLinks,
    until_s: float,
) -> tuple[dict[int, str], tuple[int, ...]]:
    passed: dict[tuple[str, str], list[float]] = defaultdict(list)
    for passage in passages:
        movement = (passage.lane, passage.leaving)
        if movement in links.links and np.isfinite(passage.passed_s) and passage.passed_s < until_s:
            passed[movement].append(passage.passed_s)
        for other, when in _other_movements(passage) if links.beside else ():
            if other in links.beside and when < until_s:
                passed[other].append(when)
    chosen: dict[tuple[str, str], str] = {}
    all_times = np.arange(0.0, until_s, _STEP_S)
    share = {group: float(_is_green(changes, all_times).mean()) for group, changes in shown.items()}
    for movement, times in passed.items():
        times_s = np.array(times)
        score = {
            group: float(
                np.where(
                    _is_green(changes, times_s),
                    np.log((1 - _RED_PASSAGE_PROBABILITY) / max(share[group], 1e-3)),
                    0.0,
                ).sum()
                + np.where(_is_green(changes, times_s), 0.0, np.log(_RED_PASSAGE_PROBABILITY)).sum()
            )
            for group, changes in shown.items()
        }
        best = max(score, key=lambda group: (score[group], -len(group), group))
        if score[best] > 0:
            chosen[movement] = str(best)
    group_of: dict[int, str] = {}
    numbers_of = {**links.links, **links.beside}
    for movement, numbers in numbers_of.items():
        candidates = [
            *([chosen[movement]] if movement in chosen else []),
            *(group for other, group in chosen.items() if other[0] == movement[0]),
            *(group for other, group in chosen.items() if _road(other) == _road(movement)),
        ]
        for number in numbers if candidates else ():
            group_of[number] = candidates[0]
    certain = tuple(sorted(k for movement in chosen for k in numbers_of[movement]))
    return group_of, certain


def _other_movements(one: Passage) -> list[tuple[tuple[str, str], float]]:
    """Return the movements of a vehicle from any road: (lane, road after), with times."""
    on = [
        (str(lane), float(time_s))
        for lane, time_s in zip(one.lanes, one.seen.time_s, strict=True)
        if lane and not str(lane).startswith(":")
    ]
    return [
        ((lane, following.rpartition("_")[0]), time_s)
        for (lane, time_s), (following, _) in pairwise(on)
        if following.rpartition("_")[0] != lane.rpartition("_")[0]
    ]


def _is_green(changes: Shown, times: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether times are within green, or shortly before or after."""
    is_open = np.zeros(len(times), np.bool_)
    ends = [time_s for time_s, _ in changes[1:]] + [np.inf]
    for (begin, letter), end in zip(changes, ends, strict=True):
        if letter in "Gg":
            is_open |= (times >= begin - _BEFORE_S) & (times <= end + _AFTER_S)
    return is_open


def _road(way: tuple[str, str]) -> str:
    return way[0].rpartition("_")[0]


def _states(
    letters: Mapping[str, NDArray[np.str_]],
    group_of: Mapping[int, str],
    signals: Signalised,
    phase: NDArray[np.int64],
) -> list[tuple[float, str, int]]:
    """Return a cycle as states: seconds, letters, and phase.

    Links with an unknown group blink, which means yielding. Crossings are green when no conflicting
    vehicle has green (`_add_walk_greens`).
    """
    moments = len(phase)
    rows = np.full((moments, signals.size), "o")
    for link, group in group_of.items():
        rows[:, link] = letters[group]
    for column in rows.T:
        _end_with_yellow(column)
    _add_walk_greens(rows, signals)
    whole = [_with_right_of_way(row, signals) for row in rows]
    parts = list(zip(whole, phase.tolist(), strict=True))
    cuts = [0, *(k for k in range(1, moments) if parts[k] != parts[k - 1]), moments]
    return [(round((end - begin) * _STEP_S, 1), *parts[begin]) for begin, end in pairwise(cuts)]


def _duration_ranges(
    states: Sequence[tuple[float, str, int]], cycle: ActuatedCycle
) -> list[tuple[float, float]]:
    """Return the least and largest duration of each state, seconds.

    Of the states of a phase the longest is variable: starting and clearing times of pedestrians
    stay.
    """
    lasts = [(seconds, seconds) for seconds, _, _ in states]
    for phase in range(len(cycle.letters)):
        own = [k for k, (_, _, phase_of_state) in enumerate(states) if phase_of_state == phase]
        longest = max(own, key=lambda k: states[k][0])
        seconds = states[longest][0]
        least = seconds - (cycle.seconds[phase] - cycle.at_least[phase])
        if len(own) > 1:
            least = max(least, min(seconds, _MIN_WALK_S))
        most = seconds + cycle.at_most[phase] - cycle.seconds[phase]
        lasts[longest] = round(least, 1), round(most, 1)
    return lasts


def _add_walk_greens(rows: NDArray[np.str_], signals: Signalised) -> None:
    """Let crossings be green between the greens of conflicting vehicles.

    No passage shows the group of a crossing. Blinking crossings would let pedestrians walk at any
    time, also into the green of vehicles, which would then stand beyond their stop line and block a
    queue. As in assumed programs (``roads/signals``), turning traffic yields to pedestrians if
    through traffic from its road has green, and green ends a crossing time before conflicts.
    """
    moves = np.isin(rows, ["G", "g", "y"])
    through = {
        road: moves[:, [x.index for x in signals.links if x.road == road and _goes_on(x)]].any(1)
        for road in {link.road for link in signals.links if _goes_on(link)}
    }
    for index, links in signals.of_index.items():
        if not signals.is_walk(index):
            continue
        in_conflict = np.zeros(len(rows), np.bool_)
        for walk in links:
            for other in signals.links:
                is_relevant = rows[0, other.index] != "o" and other.movement != "walk"
                if not is_relevant or not signals.are_foes(walk, other):
                    continue
                alone = ~through[other.road] if other.road in through else False
                in_conflict |= moves[:, other.index] & (signals.meets_walkers(other, walk) | alone)
        if not in_conflict.any() or in_conflict.all():
            continue
        first = int(np.argmin(~in_conflict))  # for a cycle that begins within a conflict
        in_conflict = np.roll(in_conflict, -first)
        green = ~in_conflict
        edges = np.flatnonzero(np.diff(np.concatenate([[False], green, [False]]).astype(int)))
        needed = max(map(crossing_s, links))
        for begin, end in edges.reshape(-1, 2):
            clear, last = round(_WALK_CLEARANCE_S / _STEP_S), round(needed / _STEP_S)
            if end - begin - clear - last < round(_MIN_WALK_S / _STEP_S):
                green[begin:end] = False
            else:
                green[begin : begin + clear] = green[end - last : end] = False
        if green.any():  # otherwise it keeps blinking, so that pedestrians can cross at all
            rows[:, index] = np.where(np.roll(green, first), "G", "r")


def _goes_on(link: Link) -> bool:
    return link.movement == "through"


def _end_with_yellow(column: NDArray[np.str_]) -> None:
    """Let green end with yellow where the cycle is cut."""
    if column[-1] in ("G", "g") and column[0] in ("r", "u"):
        column[-round(_YELLOW_S / _STEP_S) :] = "y"


def _with_right_of_way(row: NDArray[np.str_], signals: Signalised) -> str:
    """Return a state in which one of each two conflicting green links yields."""
    lit = [link for link in signals.links if row[link.index] in ("G", "g")]
    state = list(row)
    first: list[Link] = []
    for link in sorted(lit, key=lambda link: (link.is_turn, link.index)):
        waits = any(signals.gives_way(link, other) for other in lit)
        meets = any(signals.are_foes(link, other) and link.road != other.road for other in first)
        state[link.index] = "g" if waits or meets else "G"
        if not waits and not meets:
            first.append(link)
    return "".join(state)
