"""Turns drawn through junctions in a sketch, with checks that they can be driven."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from itertools import combinations, pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import smoothed, stations_of_points, tightest_bend
from urbantwin.site.sketch.drawing import Feature
from urbantwin.site.sketch.kinds import Street, Turn

__all__ = ["FOLLOWED", "Joined", "attached", "check_turns", "is_followed", "joined", "line_text"]

#: An end this close to another line or its end is connected to it, metres.
SNAP_M = 1.5
#: A point inserted on a line this close to a corner is moved to the corner, metres.
CORNER_M = 0.3
#: Points this close are equal, metres.
SAME_M = 0.01

Place = tuple[float, float]


class Joined:
    """Lines with shared corners where they meet."""

    def __init__(self, lines: Sequence[NDArray[np.float64]]) -> None:
        self.lines = [np.array(line, dtype=np.float64) for line in lines]

    def meeting(self) -> list[Place]:
        """Return the corners from which lines lead in at least three directions."""
        beside: dict[Place, set[Place]] = defaultdict(set)
        for line in self.lines:
            corners = [place_of(point) for point in line]
            for a, b in pairwise(corners):
                beside[a].add(b)
                beside[b].add(a)
        return [place for place, others in beside.items() if len(others) > 2]

    def put(self, number: int, at: NDArray[np.float64]) -> Place:
        """Insert a corner on the line ``number`` at the point nearest to a place; return it."""
        line = shapely.LineString(self.lines[number])
        station = float(line.project(shapely.Point(at)))
        near = shapely.get_coordinates(line.interpolate(station))[0]
        return self.insert(number, near)

    def insert(self, number: int, at: NDArray[np.float64], *, exact: bool = False) -> Place:
        """Insert a corner on the line ``number``; ``exact``: move a nearby corner to it."""
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
    """Return a point rounded to centimetres, as a key."""
    return round(float(point[0]), 2), round(float(point[1]), 2)


def joined(
    lines: Sequence[NDArray[np.float64]], layers: Sequence[int], through: Sequence[bool]
) -> Joined:
    """Return lines connected where they cross, and where an end lies on another line.

    Args:
        lines: (N, 2) each.
        layers: layer of each line; lines of different layers connect at their ends only.
        through: whether a line connects with others at its own ends only.
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
    """Move ends close to each other to one place; return them (line, 0 or -1) by place."""
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
    """Move ends close to another line onto it."""
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
    """Insert a shared corner wherever two lines cross."""
    for i, j in combinations(range(len(network.lines)), 2):
        if layers[i] != layers[j] or through[i] or through[j]:
            continue
        a, b = (shapely.LineString(network.lines[k]) for k in (i, j))
        for part in shapely.get_parts(shapely.intersection(a, b)):
            for xy in shapely.get_coordinates(part):
                xy = np.round(xy, 2)  # noqa: PLW2901
                for k in (i, j):
                    network.insert(k, xy, exact=True)


#: Tag of a way through a junction with a prescribed path; its value is that of `line_text`.
FOLLOWED = "urbantwin:followed"
#: Smallest radius that can be driven, metres: that of the rear axle's centre of a car with a
#: turning circle of 9 m and a wheelbase of 2.5 m (cars have 9 to 12 m between kerbs).
TIGHTEST_M = 3.0
#: Largest distance of a path from the line drawn for it, metres.
NEAR_M = 0.5
#: Length of the streets before and behind that determines how a turn begins and ends, metres.
LEAD_M = 8.0

Error = Callable[[Feature, str, str | None], InputError]


def is_followed(one: Feature) -> bool:
    """Return whether traffic follows a line as drawn: a turn with points between its ends."""
    return isinstance(one.drawn, Turn) and len(shapely.get_coordinates(one.geometry)) > 2


def line_text(one: Feature) -> str:
    """Return the points of a feature in SUMO's notation: ``x,y x,y``, metres, site frame."""
    points = shapely.get_coordinates(one.geometry)
    return " ".join(f"{x:.3f},{y:.3f}" for x, y in points)


def attached(streets: Sequence[Feature]) -> list[NDArray[np.float64]]:
    """Return the lines of streets and turns (N, 2) each, turns from street to street.

    A turn may begin and end anywhere across the lanes of a street's end: its line is the centre of
    the turning lanes. In the network of lines it begins and ends at the street's centre line.
    """
    lines = [shapely.get_coordinates(one.geometry) for one in streets]
    found = [line.copy() for line in lines]
    for line, one in zip(found, streets, strict=True):
        if isinstance(one.drawn, Turn):
            line[0] = _attached(line[0], streets, lines, leaving=False)
            line[-1] = _attached(line[-1], streets, lines, leaving=True)
    return found


def _attached(
    end: NDArray[np.float64],
    streets: Sequence[Feature],
    lines: Sequence[NDArray[np.float64]],
    *,
    leaving: bool,
) -> NDArray[np.float64]:
    """Return the end of the street whose lanes end at a turn's end, or else the turn's end."""
    best: list[tuple[bool, float, int, int]] = []
    for k, (one, line) in enumerate(zip(streets, lines, strict=True)):
        street = one.drawn
        if not isinstance(street, Street) or isinstance(street, Turn):
            continue
        for at, before in ((0, 1), (-1, -2)):
            ahead = line[at] - line[before]
            ahead = ahead / np.linalg.norm(ahead)
            gap = end - line[at]
            along, across = abs(float(gap @ ahead)), abs(float(gap @ [-ahead[1], ahead[0]]))
            if along <= SNAP_M and across <= street.half_width_m + SNAP_M:
                wrong_way = not street.lanes_back and leaving != (at == 0)
                best.append((wrong_way, along + across, k, at))
    if not best:
        return end
    _, _, k, at = min(best)
    return np.array(lines[k][at])


def check_turns(streets: Sequence[Feature], network: Joined, error: Error) -> None:
    """Check that turns can be driven as drawn.

    Args:
        streets: the streets and turns.
        network: their connected lines.
        error: function that makes the error of a feature, from problem and expectation.

    Raises:
        InputError: a turn does not lead from the end of a street to the start of another, is drawn
            twice, crosses itself, or is tighter than cars can turn.
    """
    ends = _Ends(streets, network)
    known: dict[tuple[Place, Place], Feature] = {}
    for k, one in enumerate(streets):
        if not isinstance(one.drawn, Turn):
            continue
        line = network.lines[k]
        first, last = place_of(line[0]), place_of(line[-1])
        if not shapely.LineString(line).is_simple:
            raise error(one, "crosses itself", None)
        before, after = ends.before(first, k), ends.after(last, k)
        if not before and not after and ends.before(last, k) and ends.after(first, k):
            raise error(one, "is drawn against the way that it is driven", "its points reversed")
        for what, found, at in (("begins", before, first), ("ends", after, last)):
            if not found:
                raise error(one, *ends.missing(what, at))
        if (first, last) in known:
            other = known[first, last].place
            expected = "one of them, with as many lanes as turn side by side"
            raise error(one, f"leads from and to the same streets as {other}", expected)
        known[first, last] = one
        if is_followed(one):
            _check_bends(one, before[0], after[0], error)


def _check_bends(
    one: Feature,
    before: NDArray[np.float64],
    after: NDArray[np.float64],
    error: Error,
) -> None:
    """Check the curvature of a turn between the points (N, 2) before it and after it."""
    line = shapely.get_coordinates(one.geometry)
    # Lanes beside a street's centre line are parallel to it.
    lead, tail = before[:-1] + line[0] - before[-1], after[1:] + line[-1] - after[0]
    whole = np.vstack([lead, line, tail])
    radius, (x, y) = tightest_bend(smoothed(whole, NEAR_M, step_m=0.5))
    if radius < TIGHTEST_M:
        problem = f"bends to a radius of {radius:.1f} m at {x:.1f}, {y:.1f} m"
        expected = (
            f"{TIGHTEST_M:g} m or more, as cars turn, within {NEAR_M:g} m of the line; "
            "or its two ends alone: then the way is as gentle as it can be"
        )
        raise error(one, problem, expected)


class _Ends:
    """Streets and turns that lead to places, and away from them."""

    def __init__(self, streets: Sequence[Feature], network: Joined) -> None:
        self._streets, self._network = streets, network

    def before(self, at: Place, turn: int) -> list[NDArray[np.float64]]:
        """Return the lines (N, 2) driven towards a place; they end there."""
        return self._driven(at, turn, towards=True)

    def after(self, at: Place, turn: int) -> list[NDArray[np.float64]]:
        """Return the lines (N, 2) driven away from a place; they begin there."""
        return [points[::-1] for points in self._driven(at, turn, towards=False)]

    def _driven(self, at: Place, turn: int, *, towards: bool) -> list[NDArray[np.float64]]:
        found = []
        for k, line in enumerate(self._network.lines):
            street = self._streets[k].drawn
            assert isinstance(street, Street)
            corners = [place_of(point) for point in line]
            if k == turn or at not in corners:
                continue
            here = corners.index(at)
            # A line driven in its drawn direction reaches the place from the points before it.
            ways = [line[: here + 1] if towards else line[here:][::-1]]
            if street.lanes_back:
                ways.append(line[here:][::-1] if towards else line[: here + 1])
            found += [_last(way) for way in ways if len(way) > 1]
        return found

    def missing(self, what: str, at: Place) -> tuple[str, str]:
        """Return problem and expectation for a turn that starts or ends at no street."""
        kind, end = ("end", -1) if what == "begins" else ("start", 0)
        places = []
        for line, one in zip(self._network.lines, self._streets, strict=True):
            street = one.drawn
            if isinstance(street, Street) and not isinstance(street, Turn):
                places.append((line[end], street.name or one.place))
                if street.lanes_back:
                    places.append((line[-1 - end], street.name or one.place))
        gaps = [float(np.linalg.norm(place - at)) for place, _ in places]
        k = int(np.argmin(gaps)) if gaps else -1
        near = f": {gaps[k]:.1f} m from that of {places[k][1]}" if gaps else ""
        problem = f"{what} where no street {kind}s{near}"
        return problem, f"the {kind} of a street, across its lanes"


def _last(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the part of a line (N, 2) within `LEAD_M` of its last point."""
    along = stations_of_points(points[::-1])[::-1]
    k = int(np.searchsorted(-along, -LEAD_M, side="right"))
    if k == 0:
        return points
    a, b = points[k - 1], points[k]
    share = (LEAD_M - along[k]) / max(along[k - 1] - along[k], 1e-9)
    return np.vstack([b + (a - b) * share, points[k:]])
