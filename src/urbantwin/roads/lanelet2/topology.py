"""Topology of lanelets: successors, connections of groups, and crossings."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from urbantwin.roads.lanelet2.group import Group
from urbantwin.roads.lanelet2.lanelet import Lanelet

__all__ = ["End", "Topology"]

#: Index of a group, and its end: 0 start, 1 end.
End = tuple[int, int]
#: Minimum vertical distance of roads on different levels, metres.
CLEARANCE_M = 2.5


@dataclass(frozen=True)
class Topology:
    """Links between lanelets and groups.

    Attributes:
        lanelets: lanelets for vehicles, by id.
        groups: groups of parallel lanelets; their sidewalks are not part of the topology.
    """

    lanelets: Mapping[int, Lanelet]
    groups: Sequence[Group]

    @cached_property
    def successors(self) -> dict[int, tuple[int, ...]]:
        """Lanelet -> lanelets whose bounds begin with the last points of its own."""
        starts = defaultdict(list)
        for lanelet in self.lanelets.values():
            starts[lanelet.start].append(lanelet.id)
        return {
            i: tuple(sorted(k for k in starts[lanelet.end] if k != i))
            for i, lanelet in self.lanelets.items()
        }

    @cached_property
    def place(self) -> dict[int, tuple[int, bool]]:
        """Lanelet -> its group, and whether it runs along the group."""
        return {
            member.lanelet.id: (k, member.forward)
            for k, group in enumerate(self.groups)
            for member in group.members
        }

    @cached_property
    def links(self) -> list[tuple[End, End, int, int]]:
        """All links between lanelets: the two ends of groups, and the two lanelets."""
        rows = []
        for a, following in self.successors.items():
            for b in following:
                (ga, fa), (gb, fb) = self.place[a], self.place[b]
                rows.append(((ga, 1 if fa else 0), (gb, 0 if fb else 1), a, b))
        return rows

    @cached_property
    def partners(self) -> dict[End, set[End]]:
        """End -> ends linked to it."""
        partners: dict[End, set[End]] = defaultdict(set)
        for e, f, _, _ in self.links:
            partners[e].add(f)
            partners[f].add(e)
        return partners

    def is_through(self, group: int) -> bool:
        """Return whether both ends of a group are linked."""
        return bool(self.partners.get((group, 0))) and bool(self.partners.get((group, 1)))

    def is_plain(self, end: End) -> bool:
        """Return whether an end has one link, to an end of another group without other links."""
        linked = self.partners.get(end, set())
        if len(linked) != 1:
            return False
        other = next(iter(linked))
        return self.partners[other] == {end} and other[0] != end[0]

    @cached_property
    def crossing(self) -> list[tuple[tuple[int, float], tuple[int, float]]]:
        """Pairs of lanelets whose centre lines cross at the same height, without a common end.

        Each with the distance of the crossing from its start, metres.
        """
        ids = list(self.lanelets)
        lines = [self.lanelets[i].centre for i in ids]
        tree = shapely.STRtree(lines)
        crossings = []
        for a, b in zip(*tree.query(lines, predicate="intersects"), strict=True):
            first, second = self.lanelets[ids[a]], self.lanelets[ids[b]]
            if a >= b or first.start == second.start or first.end == second.end:
                continue
            if first.end == second.start or second.end == first.start:
                continue
            if self.place[ids[a]][0] == self.place[ids[b]][0]:
                continue
            common = shapely.intersection(lines[a], lines[b])
            point = shapely.Point(shapely.get_coordinates(common)[0])
            heights = [_height(line, point) for line in (lines[a], lines[b])]
            if abs(heights[0] - heights[1]) < CLEARANCE_M:
                along = [shapely.line_locate_point(line, point) for line in (lines[a], lines[b])]
                crossings.append(((ids[a], float(along[0])), (ids[b], float(along[1]))))
        return crossings

    def overlap(self, end: End) -> float:
        """Return the length from an end where a group overlaps groups of the same origin."""
        group = self.groups[end[0]]
        siblings = {e for p in self.partners[end] for e in self.partners[p]} - {end}
        reach = 0.0
        for other, _ in siblings - {(end[0], 1 - end[1])}:
            common = shapely.intersection(group.area, self.groups[other].area)
            common = common.buffer(-0.05)
            if common.is_empty:
                continue
            corners = shapely.points(shapely.get_coordinates(common))
            for member in group.members:
                line = member.lanelet.centre
                along = shapely.line_locate_point(line, corners)
                beside = shapely.distance(line, corners) < 3.0
                if not beside.any():
                    continue
                ahead = member.forward == (end[1] == 0)
                distance_m = along[beside] if ahead else line.length - along[beside]
                reach = max(reach, float(np.max(distance_m)))
        return reach


def _height(line: shapely.LineString, point: shapely.Point) -> float:
    on_line = shapely.line_interpolate_point(line, shapely.line_locate_point(line, point))
    return float(shapely.get_z(on_line))
