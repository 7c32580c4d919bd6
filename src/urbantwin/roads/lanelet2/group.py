"""Groups of parallel lanelets: neighbours share the way of a bound."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.lanelet2.lanelet import Lanelet

__all__ = ["Group", "Member", "groups_of"]


@dataclass(frozen=True)
class Member:
    """A lanelet in a group; ``forward``: whether it runs in the group's direction."""

    lanelet: Lanelet
    forward: bool

    @property
    def left(self) -> NDArray[np.float64]:
        """The border on the group's left (N, 3), in the group's direction."""
        return self.lanelet.left if self.forward else self.lanelet.right[::-1]

    @property
    def right(self) -> NDArray[np.float64]:
        """The border on the group's right (N, 3), in the group's direction."""
        return self.lanelet.right if self.forward else self.lanelet.left[::-1]

    @property
    def flipped(self) -> Member:
        """The same in the opposite direction."""
        return Member(self.lanelet, not self.forward)


@dataclass(frozen=True)
class Group:
    """Parallel lanelets from left to right."""

    members: tuple[Member, ...]

    @property
    def flipped(self) -> Group:
        """The same in the opposite direction."""
        return Group(tuple(member.flipped for member in reversed(self.members)))

    @property
    def ids(self) -> tuple[int, ...]:
        """Ids of the lanelets."""
        return tuple(member.lanelet.id for member in self.members)

    @property
    def length(self) -> float:
        """Mean length of its lanelets, metres."""
        return float(np.mean([member.lanelet.centre.length for member in self.members]))

    @property
    def area(self) -> shapely.Geometry:
        """Its area in plan."""
        return shapely.union_all([member.lanelet.polygon for member in self.members])


def groups_of(lanelets: Mapping[int, Lanelet], apart: frozenset[int]) -> tuple[Group, ...]:
    """Return groups of lanelets that share bounds, in the direction of the majority.

    Sidewalks end a group. If several lanelets lie on the same side of a way they overlap, and none
    is a neighbour.

    Args:
        lanelets: lanelets that may be grouped.
        apart: lanelets that form groups of their own.
    """
    beside = _beside(lanelets)
    seen: set[int] = set()
    groups = []
    for identity in sorted(lanelets, key=lambda i: (not lanelets[i].drives, i)):
        if identity in seen:
            continue
        first = lanelets[identity]
        seen.add(identity)
        row = [Member(first, forward=True)]
        if identity not in apart and first.drives:
            for turn in (False, True):
                # First to the right, then, turned round, to the other side.
                row = [member.flipped for member in reversed(row)] if turn else row
                while row[-1].lanelet.drives or len(row) == 1:
                    other = _right_of(row[-1], beside, lanelets)
                    if other is None or other.lanelet.id in seen or other.lanelet.id in apart:
                        break
                    row.append(other)
                    seen.add(other.lanelet.id)
        group = Group(tuple(row))
        ahead = sum(m.forward if m.forward else -1 for m in row if m.lanelet.drives)
        tie = next((m.forward for m in row if m.lanelet.id == identity), True)
        groups.append(group if ahead > 0 or (ahead == 0 and tie) else group.flipped)
    return tuple(groups)


def _beside(lanelets: Mapping[int, Lanelet]) -> dict[tuple[int, bool], list[int]]:
    """Return (way, whether to the left of the way as drawn) -> lanelets there."""
    by_side = defaultdict(list)
    for lanelet in lanelets.values():
        for k in (0, 1):
            # A lanelet lies to the right of its left bound, and to the left of its right one.
            by_side[lanelet.ways[k], (k == 1) != lanelet.turned[k]].append(lanelet.id)
    return by_side


def _right_of(
    member: Member, beside: Mapping[tuple[int, bool], list[int]], lanelets: Mapping[int, Lanelet]
) -> Member | None:
    k = 1 if member.forward else 0
    way_id = member.lanelet.ways[k]
    is_left = (k == 1) != member.lanelet.turned[k]
    if len(beside[way_id, is_left]) != 1 or len(beside.get((way_id, not is_left), ())) != 1:
        return None
    other = lanelets[beside[way_id, not is_left][0]]
    # In the group's direction the shared bound is its left one.
    return Member(other, forward=other.ways[0] == way_id)
