"""Common cycle and offsets of signals with a short road between them.

Such a road holds few vehicles: with independent programs, the queue at one signal blocks the other.
The signals get fixed-time programs with one cycle, and offsets with which the largest share of the
vehicles on these roads arrives at green.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from urbantwin.roads.model.furniture import Phase
from urbantwin.roads.signals.capacity import Flows
from urbantwin.roads.signals.controlled_links import Link, Signalised

__all__ = ["Stream", "best_offset_s", "passing_shares", "streams_between"]

#: Maximum length of a road whose signals are coordinated, metres: the queue of half a cycle.
COORDINATED_M = 60.0
#: Speed of vehicles between two stop lines, m/s.
PLATOON_M_S = 8.0


class Stream(NamedTuple):
    """Vehicles from a stop line of one program to a stop line of another.

    Attributes:
        start: program and index of the first stop line.
        end: program and index of the second.
        per_hour: cars per hour.
        seconds: travel time.
    """

    start: tuple[str, int]
    end: tuple[str, int]
    per_hour: float
    seconds: float


def streams_between(
    root: etree._Element, junctions: Sequence[Signalised], flows: Flows
) -> list[Stream]:
    """Return the streams of vehicles over short roads between signals of different programs.

    Args:
        root: the network.
        junctions: all its signalised junctions.
        flows: cars per hour.
    """
    lengths = {lane.get("id"): float(lane.get("length")) for lane in root.iter("lane")}
    driven = [(j.program, x) for j in junctions for x in j.links if x.movement != "walk"]
    per_hour: dict[tuple[str, str], float] = {}
    for (road, onto, _), count in flows.items():
        per_hour[road, onto] = per_hour.get((road, onto), 0.0) + count
    streams = []
    for program, before in driven:
        road = _edge(before.to)
        if lengths[before.to] > COORDINATED_M:
            continue
        after = [(name, link) for name, link in driven if name != program and link.road == road]
        total = sum(_flow(link, per_hour) for _, link in after)
        for name, link in after:
            share = _flow(link, per_hour) / total if total else 1.0 / len(after)
            metres = before.length + lengths[before.to]
            streams.append(
                Stream(
                    (program, before.index),
                    (name, link.index),
                    max(_flow(before, per_hour), 1.0) * share,
                    metres / min(PLATOON_M_S, before.speed),
                )
            )
    return streams


def best_offset_s(
    name: str,
    phases: Mapping[str, Sequence[Phase]],
    offsets: Mapping[str, int],
    streams: Sequence[Stream],
) -> int:
    """Return the offset of a program with which the most vehicles arrive at green, seconds.

    Args:
        name: the program.
        phases: phases of all programs of the group, with one cycle.
        offsets: offsets of the other programs that are determined already, seconds.
        streams: streams between the programs.
    """
    cycle = len(_green(phases[name], 0))
    arriving = np.zeros(cycle)
    for stream in streams:
        (start, i), (end, j) = stream.start, stream.end
        if (start == name) == (end == name) or not {start, end} <= {name, *offsets}:
            continue
        leaving, green = _green(phases[start], i), _green(phases[end], j)
        per_cycle = stream.per_hour * leaving / max(leaving.sum(), 1)
        for offset in range(cycle):
            first, second = offsets.get(start, offset), offsets.get(end, offset)
            arrival = np.roll(per_cycle, first + round(stream.seconds) - second)
            arriving[offset] += float(arrival @ green)
    return int(np.argmax(np.round(arriving, 6)))


def passing_shares(
    root: etree._Element, junctions: Sequence[Signalised], flows: Flows
) -> dict[tuple[str, int], float]:
    """Return (program, index) -> share of its green in which vehicles can leave it.

    Vehicles that arrive at a red signal fill the road between and block the stop line before it.
    Programs with different cycles are left out.
    """
    programs = {junction.program: junction for junction in junctions}
    passing: dict[tuple[str, int], list[tuple[float, float]]] = defaultdict(list)
    streams = streams_between(root, junctions, flows)
    for stream in streams:
        first, second = (programs[name] for name, _ in (stream.start, stream.end))
        if first.cycle != second.cycle:
            continue
        leaving = _green(first.phases, stream.start[1])
        green = _green(second.phases, stream.end[1])
        late = round(first.offset + stream.seconds - second.offset)
        green_s = float(leaving.sum())
        usable_s = float(np.roll(leaving, late) @ green)
        passing[stream.start].append((stream.per_hour, usable_s / max(green_s, 1.0)))
    return {
        start: sum(count * share for count, share in shares) / sum(count for count, _ in shares)
        for start, shares in passing.items()
    }


def _green(phases: Sequence[Phase], index: int) -> NDArray[np.float64]:
    """Return 1 for each second of the cycle in whose middle an index has green, else 0."""
    ends = np.cumsum([seconds for seconds, _ in phases])
    middles = np.arange(round(float(ends[-1]))) + 0.5
    at = np.minimum(np.searchsorted(ends, middles, side="right"), len(phases) - 1)
    return np.array([state[index] in "gG" for _, state in phases], np.float64)[at]


def _edge(lane: str) -> str:
    return lane.rpartition("_")[0]


def _flow(link: Link, per_hour: Mapping[tuple[str, str], float]) -> float:
    return per_hour.get((link.road, _edge(link.to)), 0.0)
