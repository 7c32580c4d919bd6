"""Queues at signals that are near each other: what waits, and what finds no room to go on.

A lane before a stop line stores as many vehicles as have room since the stop line before it. What
leaves one arrives at the next after the way there, and leaves that when it is green; nothing leaves
into a lane that is full, and who waits for that holds up all behind. Room is free again when the
queue has moved up. That is the cell transmission of C. F. Daganzo (Transportation Research B 28,
1994, and 29, 1995) with one cell for each lane, in steps of a second; what offsets make of it is
what TRANSYT (Robertson, RRL report LR 253, 1969) minimises, but queues have lengths here.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads.compiled.queues import queues
from urbantwin.roads.model.furniture import Phase
from urbantwin.roads.signals.capacity import FOLLOWING_M, Flows, LaneLoad, lane_loads
from urbantwin.roads.signals.controlled_links import Link, Signalised
from urbantwin.roads.signals.inner_links import Feed

__all__ = ["QueueModel", "Queues"]

#: How fast free room moves back through a queue, m/s (4 to 6: HCM 2016, 25, and Daganzo).
BACK_M_S = 5.0
#: Queues fill for so long before anything counts, and each of the two spans that are compared then
#: lasts so long, seconds, and to the end of a cycle.
FIRST_S, SPAN_S = 240, 180
#: On shorter roads between signals everybody stays on the lane, metres; and of so many such roads
#: one after the other it is known who comes to which lane.
CHANGING_M, CHAIN = 30.0, 4
#: Lanes count by what comes to them and so many vehicles an hour.
FEW_PER_H = 40.0
#: What flows between two lanes by less than this share is nothing.
LITTLE = 0.02


@dataclass(frozen=True, eq=False)
class Queues:
    """What became of the traffic of each of K cases, on L lanes.

    Attributes:
        waiting: (K,) vehicles that wait, in the mean.
        left_over: (K, L) share of what comes to each lane that waits longer and longer.
    """

    waiting: NDArray[np.float64]
    left_over: NDArray[np.float64]

    @property
    def worst(self) -> NDArray[np.float64]:
        """The largest share that a lane does not carry (K,)."""
        return np.asarray(self.left_over.max(axis=1, initial=0.0))


class QueueModel:
    """The lanes of some signals, what comes to them and how much has room.

    Args:
        junctions: what is signalised.
        programs: program -> phases, in whole seconds.
        feeds: ways from stop line to stop line.
        flows: cars an hour.
    """

    def __init__(
        self,
        junctions: Sequence[Signalised],
        programs: Mapping[str, Sequence[Phase]],
        feeds: Sequence[Feed],
        flows: Flows,
    ) -> None:
        self.programs = tuple(item.program for item in junctions)
        loads = [
            (number, one)
            for number, item in enumerate(junctions)
            for one in lane_loads(item, programs[item.program], flows)
            if one.flow > 0
        ]
        self.lanes = tuple(one for _, one in loads)
        self._of = np.array([number for number, _ in loads], np.int64)
        self._shown = [_open(one, programs[self.programs[number]]) for number, one in loads]
        # What a lane lets go in a second of green is what it carries in all, over its greens.
        share = np.array([shown.mean() for shown in self._shown])
        capacity = np.array([min(one.capacity, 3600.0) for one in self.lanes])
        self._rate = capacity / np.maximum(share, 1e-6) / 3600.0
        self._arrives = np.array([one.flow for one in self.lanes]) / 3600.0
        self._joined(feeds)

    @property
    def room_m(self) -> NDArray[np.float64]:
        """Room on each lane behind the signals before it, metres; infinite where none is (L,)."""
        return self._room * FOLLOWING_M

    def ahead(self, lane: int) -> int | None:
        """Return the lane with least room that one comes to from a lane, by their numbers."""
        onward = np.flatnonzero(self._share[lane])
        return int(onward[np.argmin(self._room[onward])]) if len(onward) else None

    def _joined(self, feeds: Sequence[Feed]) -> None:
        """Find what goes from lane to lane (L, L), and lengths and times of the ways (L,)."""
        count = len(self.lanes)
        number = {
            (self.programs[self._of[k]], link.index, link.lane): k
            for k, one in enumerate(self.lanes)
            for link in one.links
        }
        lanes_at: dict[tuple[str, int], set[int]] = defaultdict(set)
        for (program, index, _), k in number.items():
            lanes_at[program, index].add(k)
        behind: dict[tuple[str, int], list[Feed]] = defaultdict(list)
        for feed in feeds:
            behind[feed.program, feed.index].append(feed)
        self._share = np.zeros((count, count))
        self._room = np.full(count, np.inf)
        self._way_s = np.zeros(count)
        for k, one in enumerate(self.lanes):
            for link, flow in one.links.items():
                ways = {
                    other: feed
                    for feed in behind[self.programs[self._of[k]], link.index]
                    for other in lanes_at[feed.to_program, feed.to_index]
                    if other != k
                }
                ways = _ahead(link, ways, self.lanes)
                whole = sum(self.lanes[other].flow for other in ways)
                for other, feed in ways.items():
                    part = flow / one.flow * self.lanes[other].flow / whole
                    self._share[k, other] += part
                    self._room[other] = min(self._room[other], feed.room / FOLLOWING_M)
                    self._way_s[other] = max(self._way_s[other], feed.seconds)
        self._share[self._share < LITTLE] = 0.0
        self._spread()
        # No more comes from other signals than there is; the rest comes from elsewhere.
        coming = self._arrives @ self._share
        self._share *= np.minimum(1.0, self._arrives / np.maximum(coming, 1e-9))
        self._others = np.maximum(self._arrives - self._arrives @ self._share, 0.0)
        self._room = np.maximum(self._room, 1.0)

    def _spread(self) -> None:
        """Let what comes to a short road stay on the lanes that it comes to."""
        roads: dict[str, list[int]] = defaultdict(list)
        for k, one in enumerate(self.lanes):
            if self._room[k] * FOLLOWING_M < CHANGING_M:
                roads[one.lane.rpartition("_")[0]].append(k)
        for _ in range(CHAIN):
            coming = self._arrives @ self._share
            for lanes in roads.values():
                whole, came = self._arrives[lanes].sum(), coming[lanes].sum()
                if came > whole / 2:
                    self._arrives[lanes] = coming[lanes] * whole / came

    def run(self, offsets: NDArray[np.int64], scale: NDArray[np.float64]) -> Queues:
        """Return what becomes of the traffic.

        Args:
            offsets: (K, P) of each program, seconds.
            scale: (K,) traffic as a multiple of what comes.
        """
        if not self.lanes:
            return Queues(np.zeros(len(scale)), np.zeros((len(scale), 0)))
        cycle = np.array([len(shown) for shown in self._shown])
        longest = int(cycle.max())
        span_s = -(-SPAN_S // longest) * longest
        shown = np.zeros((len(cycle), longest))
        for k, one in enumerate(self._shown):
            shown[k, : len(one)] = one * self._rate[k]
        narrow = np.isfinite(self._room)
        room = np.where(narrow, self._room, 1e9)
        back_s = np.where(narrow, np.ceil(room * FOLLOWING_M / BACK_M_S), 1).astype(np.int64)
        # Contiguous arrays: numba compiles a function again for each other layout.
        comes_from, into = (np.ascontiguousarray(one) for one in np.nonzero(self._share))
        before, after = queues(
            offsets[:, self._of],
            scale,
            shown,
            cycle,
            self._others,
            # Who comes from elsewhere takes no room that those who come from other signals need.
            1.0 - self._others / np.maximum(self._arrives, 1e-12),
            room,
            np.maximum(np.round(self._way_s), 1).astype(np.int64),
            back_s,
            comes_from,
            into,
            self._share[comes_from, into],
            -(-FIRST_S // longest) * longest + 2 * span_s,
            span_s,
        )
        growth = np.maximum(after - before, 0.0) / span_s**2
        comes = (self._arrives + FEW_PER_H / 3600.0) * scale[:, None]
        return Queues(after.sum(axis=1) / span_s, growth / comes)


def _open(one: LaneLoad, phases: Sequence[Phase]) -> NDArray[np.float64]:
    """Return the share of a lane's traffic that has green in each second of the cycle."""
    seconds = [round(length) for length, _ in phases]
    shown = np.zeros(sum(seconds))
    for link, flow in one.links.items():
        green = [state[link.index] in "gG" for _, state in phases]
        shown += np.repeat(np.array(green, np.float64), seconds) * flow / one.flow
    return shown


def _ahead(link: Link, ways: Mapping[int, Feed], lanes: Sequence[LaneLoad]) -> dict[int, Feed]:
    """Return of the lanes that a link may lead to those on the road that it leads to, if any is.

    On a short road nobody changes lanes.
    """
    road = link.to.rpartition("_")[0]
    own = {k: feed for k, feed in ways.items() if lanes[k].lane.rpartition("_")[0] == road}
    same = {k: feed for k, feed in own.items() if lanes[k].lane == link.to}
    if any(feed.room < CHANGING_M for feed in same.values()):
        return same
    return own or dict(ways)
