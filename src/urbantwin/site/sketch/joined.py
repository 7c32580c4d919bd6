"""Lines drawn by hand joined to a network: where they cross or end on each other they meet."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from itertools import combinations, pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

__all__ = ["Joined", "joined"]

#: Ends this near to another line, or its end, were meant to meet it, metres.
SNAP_M = 1.5
#: What is put on a line this near to one of its corners is put on that corner, metres.
CORNER_M = 0.3
#: Places this near are one, metres.
SAME_M = 0.01

Place = tuple[float, float]


class Joined:
    """Lines whose corners are shared where they meet.

    Attributes:
        lines: the lines (N, 2), with a corner wherever two meet.
    """

    def __init__(self, lines: Sequence[NDArray[np.float64]]) -> None:
        self.lines = [np.array(line, dtype=np.float64) for line in lines]

    def meeting(self) -> list[Place]:
        """Return the corners from where one can go on in three directions or more."""
        beside: dict[Place, set[Place]] = defaultdict(set)
        for line in self.lines:
            corners = [place_of(point) for point in line]
            for a, b in pairwise(corners):
                beside[a].add(b)
                beside[b].add(a)
        return [place for place, others in beside.items() if len(others) > 2]

    def put(self, number: int, at: NDArray[np.float64]) -> Place:
        """Put a corner on the line ``number`` where it is nearest to a place; return it."""
        line = shapely.LineString(self.lines[number])
        station = float(line.project(shapely.Point(at)))
        near = shapely.get_coordinates(line.interpolate(station))[0]
        return self.insert(number, near)

    def insert(self, number: int, at: NDArray[np.float64], *, exact: bool = False) -> Place:
        """Put a corner on the line ``number``; ``exact``: a corner near it moves there."""
        line = self.lines[number]
        gap = np.linalg.norm(line - at, axis=1)
        k = int(gap.argmin())
        if gap[k] <= (SAME_M if not exact else CORNER_M):
            if exact:
                line[k] = at
            return place_of(line[k])
        whole = shapely.LineString(line)
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        k = int(np.searchsorted(along, whole.project(shapely.Point(at))))
        k = min(max(k, 1), len(line) - 1)
        self.lines[number] = np.insert(line, k, at, axis=0)
        return place_of(at)


def place_of(point: NDArray[np.float64]) -> Place:
    """Return a place as what tells it from others: to the centimetre."""
    return round(float(point[0]), 2), round(float(point[1]), 2)


def joined(
    lines: Sequence[NDArray[np.float64]], layers: Sequence[int], through: Sequence[bool]
) -> Joined:
    """Return lines that meet where they cross, and where an end lies on another line.

    Args:
        lines: (N, 2) each.
        layers: of each line; those of different layers meet at their ends alone.
        through: which lines meet others at their own ends alone.
    """
    network = Joined([np.round(line, 2) for line in lines])
    groups = _joined_ends(network)
    _end_on_lines(network, groups, layers, through)
    _cross(network, layers, through)
    for number, line in enumerate(network.lines):
        line = np.round(line, 2)  # noqa: PLW2901
        apart = np.linalg.norm(np.diff(line, axis=0), axis=1) > SAME_M / 2
        network.lines[number] = line[np.concatenate([[True], apart])]
    return network


def _joined_ends(network: Joined) -> list[list[tuple[int, int]]]:
    """Move ends that are near each other to one place; return them (line, 0 or -1) by place."""
    ends = [(k, at) for k in range(len(network.lines)) for at in (0, -1)]
    places = np.array([network.lines[k][at] for k, at in ends]).reshape(-1, 2)
    group = list(range(len(ends)))
    for i, j in combinations(range(len(ends)), 2):
        if ends[i][0] != ends[j][0] and np.linalg.norm(places[i] - places[j]) <= SNAP_M:
            first, last = sorted((group[i], group[j]))
            group = [first if one == last else one for one in group]
    found = []
    for one in dict.fromkeys(group):
        members = [k for k, of in enumerate(group) if of == one]
        middle = np.round(places[members].mean(axis=0), 2)
        found.append([ends[k] for k in members])
        _move(network, found[-1], middle)
    return found


def _move(network: Joined, ends: Sequence[tuple[int, int]], to: NDArray[np.float64]) -> None:
    for k, at in ends:
        network.lines[k][at] = to


def _end_on_lines(
    network: Joined,
    groups: Sequence[Sequence[tuple[int, int]]],
    layers: Sequence[int],
    through: Sequence[bool],
) -> None:
    """Move ends that lie near another line onto it."""
    for ends in groups:
        own = {k for k, _ in ends}
        end = network.lines[ends[0][0]][ends[0][1]].copy()
        near = [
            (shapely.LineString(line).distance(shapely.Point(end)), j)
            for j, line in enumerate(network.lines)
            if j not in own and layers[j] in {layers[k] for k in own} and not through[j]
        ]
        gap, j = min(near, default=(np.inf, -1))
        if gap > SNAP_M:
            continue
        line = shapely.LineString(network.lines[j])
        place = line.interpolate(line.project(shapely.Point(end)))
        xy = np.round([place.x, place.y], 2)
        _move(network, ends, xy)
        network.insert(j, xy, exact=True)


def _cross(network: Joined, layers: Sequence[int], through: Sequence[bool]) -> None:
    """Put a shared corner wherever two lines cross."""
    for i, j in combinations(range(len(network.lines)), 2):
        if layers[i] != layers[j] or through[i] or through[j]:
            continue
        a, b = (shapely.LineString(network.lines[k]) for k in (i, j))
        for part in shapely.get_parts(shapely.intersection(a, b)):
            for xy in shapely.get_coordinates(part):
                xy = np.round(xy, 2)  # noqa: PLW2901
                for k in (i, j):
                    network.insert(k, xy, exact=True)
