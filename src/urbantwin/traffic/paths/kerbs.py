"""Kerbs: where people's ways lead onto crossings, and when signals let them begin."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads import RoadNetwork

__all__ = ["NO_CROSSINGS", "Crossings"]

#: At these letters of a link people begin to cross.
_BEGIN = frozenset("Ggo")
#: Where one waits is looked for so many rows before.
_BACK = 80


@dataclass(frozen=True, eq=False)
class Crossings:
    """The crossings among the lanes of a motion, and their signals.

    Attributes:
        light: (L,) of each lane: -2 for what is no crossing, -1 for a crossing without a signal,
            else the row of ``green``.
        green: (K, S) uint8: whether one may begin to cross, by step from the first one on.
    """

    light: NDArray[np.int64]
    green: NDArray[np.uint8]

    @classmethod
    def of(
        cls,
        network: RoadNetwork,
        lanes: Sequence[str],
        shown: Sequence[tuple[int, str, str]],
        first: int,
        end: int,
    ) -> Crossings:
        """Return the crossings of a network.

        Args:
            network: the lanes and the heads of their signals.
            lanes: names of lanes, by their numbers.
            shown: (step, program, one letter per link) where a program's state changed.
            first: the first step that is looked at.
            end: the one after the last.
        """
        links: dict[str, list[tuple[str, int]]] = defaultdict(list)
        for head in network.signals:
            links[head.lane] += [(head.program, link) for link in head.links]
        light = np.full(len(lanes), -2, np.int64)
        count = end - first
        rows: list[NDArray[np.uint8]] = []
        states: dict[str, list[tuple[int, str]]] = defaultdict(list)
        for step, program, state in sorted(shown, key=lambda one: one[0]):
            states[program].append((step, state))
        for number, name in enumerate(lanes):
            lane = network.lane_by_id.get(name)
            if lane is None or lane.kind != "crossing":
                continue
            light[number] = -1
            mine = [link for link in links[name] if states[link[0]]]
            if mine:
                light[number] = len(rows)
                rows.append(_green(mine, states, first, count))
        return cls(light, np.array(rows, np.uint8).reshape(len(rows), count))

    def kerbs(
        self,
        lane: NDArray[np.integer],
        joined: NDArray[np.bool_],
        last: NDArray[np.int64],
        on_footway: Callable[[NDArray[np.int64]], NDArray[np.bool_]],
    ) -> NDArray[np.int64]:
        """Return of every row where the next crossing begins (N, 4).

        That is the first row on it from this one on, -1 for none; with such a row the last one on
        the same crossing, its signal, and the row at which one waits: the last one before it that
        is on the footway, as the areas of corners reach far into the roads.

        Args:
            lane: (N,) number of the lane.
            joined: (N,) whether the row before is the same actor's, a step earlier.
            last: (N,) the last row of the same actor that follows without a gap.
            on_footway: returns which rows (K,) of some are on the footway.
        """
        count = len(lane)
        found = np.full((count, 4), -1, np.int64)
        if not (self.light > -2).any():
            return found
        light = self.light[lane]
        new = np.concatenate([[True], lane[1:] != lane[:-1]]) | ~joined
        begins = np.flatnonzero(new & joined & (light > -2))
        runs = np.flatnonzero(new)
        ends = np.append(runs[1:], count) - 1
        found[begins, 1] = ends[np.searchsorted(runs, begins)]
        found[begins, 2] = light[begins]
        first = np.maximum.accumulate(np.where(joined, 0, np.arange(count)))[begins]
        # Not before the crossing that one comes from; in the middle of an island without a footway.
        first[1:] = np.maximum(first[1:], found[begins[:-1], 1] + 1)
        begun = np.maximum(runs[np.searchsorted(runs, begins) - 1], first)
        found[begins, 3] = np.minimum((begun + begins - 1) // 2, begins - 1)
        waits = np.zeros(len(begins), np.bool_)
        for back in range(1, _BACK + 1):
            looks = np.flatnonzero(~waits & (begins - back >= first))
            looks = looks[on_footway(begins[looks] - back)]
            found[begins[looks], 3] = begins[looks] - back
            waits[looks] = True
        following = np.searchsorted(begins, np.arange(count))
        at = np.append(begins, count)[following]
        found[:, 0] = np.where(at <= last, at, -1)
        return found


#: Nothing is a crossing.
NO_CROSSINGS = Crossings(np.full(1, -2, np.int64), np.zeros((0, 1), np.uint8))


def _green(
    links: Sequence[tuple[str, int]],
    states: dict[str, list[tuple[int, str]]],
    first: int,
    count: int,
) -> NDArray[np.uint8]:
    """Return in which of the steps (S,) any of a crossing's links lets people begin."""
    green = np.zeros(count, np.uint8)
    for program, link in links:
        every = states[program]
        begins = [max(step - first, 0) for step, _ in every]
        for begin, end, (_, state) in zip(begins, [*begins[1:], count], every, strict=True):
            if link < len(state) and state[link] in _BEGIN:
                green[begin:end] = 1
    return green
