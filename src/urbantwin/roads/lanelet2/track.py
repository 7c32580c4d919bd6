"""Tracks: lanes that continue through several groups of lanelets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads.lanelet2.group import Group, Member

__all__ = ["Track", "joined", "tracks_of"]


@dataclass(frozen=True, eq=False)
class Track:
    """A lane that goes on through several groups.

    Attributes:
        first: number of the first group in the chain.
        members: one lanelet for each group from there on.
        left: its left border along the chain (N, 3).
        right: its right border.
    """

    first: int
    members: tuple[Member, ...]
    left: NDArray[np.float64]
    right: NDArray[np.float64]

    def member(self, group: int) -> Member:
        """Return its lanelet in a group of the chain."""
        return self.members[group - self.first]


def joined(lines: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return polylines as one, without points that repeat the one before."""
    points = np.vstack(lines)
    step = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1)
    kept = points[np.concatenate([[True], step > 1e-4])]
    return kept if len(kept) > 1 else points[[0, -1]]


def tracks_of(groups: Sequence[Group], follows: Callable[[int, int], bool]) -> tuple[Track, ...]:
    """Return the lanes of a chain of groups.

    Args:
        groups: all looked along the same way.
        follows: whether one lanelet leads to another.
    """
    open_: list[tuple[int, list[Member]]] = []
    done: list[tuple[int, list[Member]]] = []
    for k, group in enumerate(groups):
        still = []
        waiting = list(open_)
        for member in group.members:
            row = next((row for row in waiting if _goes_on(row[1][-1], member, follows)), None)
            if row is None:
                row = (k, [])
            else:
                waiting.remove(row)
            row[1].append(member)
            still.append(row)
        done += waiting
        open_ = still
    return tuple(
        Track(
            first,
            tuple(members),
            joined([m.left for m in members]),
            joined([m.right for m in members]),
        )
        for first, members in done + open_
    )


def _goes_on(a: Member, b: Member, follows: Callable[[int, int], bool]) -> bool:
    if not a.lanelet.drives or not b.lanelet.drives:
        ends = np.vstack([a.left[-1] - b.left[0], a.right[-1] - b.right[0]])
        return a.lanelet.kind == b.lanelet.kind and bool(np.abs(ends).max() < 1e-6)
    if a.forward != b.forward:
        return False
    one, two = (a, b) if a.forward else (b, a)
    return follows(one.lanelet.id, two.lanelet.id)
