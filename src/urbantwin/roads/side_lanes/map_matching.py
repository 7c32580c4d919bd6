"""Map matching: which way of OpenStreetMap runs along which part of a road."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from urbantwin.roads.cross_section import (
    CarriagewayLane,
    CrossSection,
    MappedSegment,
    Roadside,
)
from urbantwin.roads.model import ModelRoad

__all__ = ["MatchedWay", "by_way", "match_ways"]

#: A way further from a road than this is not the way of this part of it, metres.
OFF_M = 15.0
#: Shorter parts are left out, metres.
SHORTEST_M = 0.5


@dataclass(frozen=True)
class MatchedWay:
    """A part of a road, from station ``first`` to ``last``, that is one way of the map.

    ``aligned``: whether the way is drawn along the road's reference line.
    """

    first: float
    last: float
    section: CrossSection
    aligned: bool

    def roadside(self, side: int) -> Roadside:
        """Return the roadside to the left (1) or right (-1) of the road."""
        return self.section.left if (side > 0) == self.aligned else self.section.right

    def lanes(self, side: int) -> tuple[CarriagewayLane, ...]:
        """Return the lanes on the left (1) or right (-1) of the middle of the road."""
        forward = self.section.outward == (side if self.aligned else -side)
        return self.section.lanes(forward=forward)


def by_way(segments: Iterable[MappedSegment]) -> dict[int, list[MappedSegment]]:
    """Return segments by the ids of their ways."""
    found: dict[int, list[MappedSegment]] = {}
    for segment in segments:
        found.setdefault(segment.way, []).append(segment)
    return found


def match_ways(
    road: ModelRoad, segments: Mapping[int, Sequence[MappedSegment]]
) -> list[MatchedWay]:
    """Return the parts of a road by ways, from its start to its end, without gaps."""
    mine = [segment for way in road.ways for segment in segments.get(way, ())]
    if not mine:
        return []
    every, aside = road.curve.locate(np.concatenate([segment.points for segment in mine]))
    found = []
    end = 0
    for segment in mine:
        begin, end = end, end + len(segment.points)
        if np.abs(aside[begin:end]).max() >= OFF_M:
            continue
        start, goal = float(every[begin]), float(every[end - 1])
        first = min(max(min(start, goal), 0.0), road.length)
        last = min(max(start, goal, 0.0), road.length)
        if last - first >= min(SHORTEST_M, road.length / 2):
            found.append(MatchedWay(first, last, segment.section, goal > start))
    found.sort(key=lambda part: (part.first, part.last))
    whole: list[MatchedWay] = []
    for k, part in enumerate(found):
        first = whole[-1].last if whole else 0.0
        last = road.length if k == len(found) - 1 else part.last
        if last > first:
            whole.append(MatchedWay(first, last, part.section, part.aligned))
    return whole
