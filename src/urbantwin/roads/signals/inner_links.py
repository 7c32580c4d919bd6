"""Ways from one stop line to the next: what lets traffic into links that wait farther on."""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from lxml import etree

from urbantwin.roads.signals.controlled_links import Link, Signalised

__all__ = ["Feed", "feeds"]


@dataclass(frozen=True)
class Feed:
    """Traffic of one signal that comes to another, with none between.

    Attributes:
        program, index: the signal that lets it go.
        to_program, to_index: the signal that it comes to, at another junction.
        length: from stop line to stop line, metres.
        room: of that what lies between the two junctions, where it can wait, metres.
        seconds: that it takes at the speed limit.
    """

    program: str
    index: int
    to_program: str
    to_index: int
    length: float
    room: float
    seconds: float


def feeds(root: etree._Element, junctions: Sequence[Signalised], reach_m: float) -> list[Feed]:
    """Return every way between signals that are at most ``reach_m`` apart, the shortest of each.

    Args:
        root: the network.
        junctions: all that is signalised in it.
        reach_m: from stop line to stop line, metres.
    """
    network = _Lanes(root)
    waiting: dict[str, list[tuple[str, Link]]] = defaultdict(list)
    for junction in junctions:
        for link in junction.links:
            if link.movement != "walk":
                waiting[link.lane].append((junction.program, link))
    found: dict[tuple[str, int, str, int], Feed] = {}
    for program, link in (pair for pairs in waiting.values() for pair in pairs):
        for lane, way in network.beyond(link, reach_m, waiting):
            for other_program, other in waiting[lane]:
                key = (program, link.index, other_program, other.index)
                known = found.get(key)
                if other.junction != link.junction and (not known or way.length < known.length):
                    found[key] = Feed(*key, way.length, way.room, way.seconds)
    return sorted(found.values(), key=lambda feed: (feed.program, feed.index, feed.length))


class _Way(NamedTuple):
    """How far it is from a stop line, how much of that lies on edges, and how long it takes."""

    length: float
    room: float
    seconds: float


class _Lanes:
    """Lanes of a network, and what follows on each."""

    def __init__(self, root: etree._Element) -> None:
        self.lanes = {lane.get("id"): lane for lane in root.iter("lane")}
        self.beside: dict[str, list[str]] = defaultdict(list)
        for name in self.lanes:
            self.beside[name.rpartition("_")[0]].append(name)
        self.onward: dict[str, list[tuple[str, float]]] = defaultdict(list)
        for item in root.iter("connection"):
            # Who turns round where streets end comes back as somebody else.
            if not item.get("from").startswith(":") and item.get("dir") != "t":
                start, end = (f"{item.get(k)}_{item.get(k + 'Lane')}" for k in ("from", "to"))
                via = self.lanes.get(item.get("via", ""))
                self.onward[start].append((end, 0.0 if via is None else float(via.get("length"))))

    def beyond(
        self, link: Link, reach_m: float, stops: Collection[str]
    ) -> Iterator[tuple[str, _Way]]:
        """Yield the next of some lanes that traffic of a link comes to, changing lanes or not."""
        seen: set[str] = set()
        heap = [(_Way(link.length, 0.0, link.length / link.speed), link.to)]
        while heap:
            way, lane = heapq.heappop(heap)
            way = self._along(way, lane, float(self.lanes[lane].get("length")))
            if way.length > reach_m or lane in seen:
                continue
            seen.add(lane)
            for name in self.beside[lane.rpartition("_")[0]]:
                if name in stops:
                    yield name, way
                    continue
                for target, length in self.onward[name]:
                    heapq.heappush(heap, (self._along(way, target, length), target))

    def _along(self, way: _Way, lane: str, length: float) -> _Way:
        seconds = length / float(self.lanes[lane].get("speed"))
        return _Way(way.length + length, way.room + length, way.seconds + seconds)
