"""Turns that are drawn through junctions: whether somebody could drive them as they are drawn."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import smoothed, stations_of_points, tightest_bend
from urbantwin.site.sketch.drawing import Feature
from urbantwin.site.sketch.joined import SNAP_M, Joined, Place, place_of
from urbantwin.site.sketch.kinds import Street, Turn

__all__ = [
    "FOLLOWED",
    "attached",
    "check_turns",
    "is_followed",
    "line_text",
]

#: Tag of a way through a junction whose traffic keeps to a line: its value, as `line_text` has it.
FOLLOWED = "urbantwin:followed"
#: Nobody drives more tightly than this, metres: so turns the middle of the rear axle of a car with
#: a turning circle of 9 m and a wheelbase of 2.5 m (cars have 9 to 12 m between kerbs).
TIGHTEST_M = 3.0
#: How far a way may leave the line that was drawn for it, metres.
NEAR_M = 0.5
#: So much of the streets before and behind tells how a turn begins and ends, metres.
LEAD_M = 8.0

Error = Callable[[Feature, str, str | None], InputError]


def is_followed(one: Feature) -> bool:
    """Whether traffic keeps to a line as it is drawn: a turn with points between its ends."""
    return isinstance(one.drawn, Turn) and len(shapely.get_coordinates(one.geometry)) > 2


def line_text(one: Feature) -> str:
    """Return the points of a feature as SUMO writes them: ``x,y x,y``, metres, site frame."""
    points = shapely.get_coordinates(one.geometry)
    return " ".join(f"{x:.3f},{y:.3f}" for x, y in points)


def attached(streets: Sequence[Feature]) -> list[NDArray[np.float64]]:
    """Return the lines of streets and turns (N, 2) each, turns from street to street.

    A turn may begin and end anywhere across the lanes of a street's end: its line is the middle of
    the lanes that turn. In the network of lines it begins and ends at the street's own middle.
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
    """Return the end of the street whose lanes end at a turn's end, else that end itself."""
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
    """Refuse turns that nobody could drive as they are drawn.

    Args:
        streets: the features that are streets and turns.
        network: their lines, which meet.
        error: makes the error of a feature: what is wrong with it, and what is expected.

    Raises:
        InputError: a turn does not lead from the end of a street to the start of another, is drawn
            twice, crosses itself, or bends more tightly than cars turn.
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
    """Refuse a turn that nobody drives, between the points (N, 2) before it and after it."""
    line = shapely.get_coordinates(one.geometry)
    # Lanes beside the middle of a street lead where the street does.
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
    """What leads to places, and away from them."""

    def __init__(self, streets: Sequence[Feature], network: Joined) -> None:
        self._streets, self._network = streets, network

    def before(self, at: Place, turn: int) -> list[NDArray[np.float64]]:
        """Return what is driven towards a place, as points (N, 2) that end there."""
        return self._driven(at, turn, towards=True)

    def after(self, at: Place, turn: int) -> list[NDArray[np.float64]]:
        """Return what is driven away from a place, as points (N, 2) that begin there."""
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
            # Driven as drawn, what leads to a place lies before it on the line.
            ways = [line[: here + 1] if towards else line[here:][::-1]]
            if street.lanes_back:
                ways.append(line[here:][::-1] if towards else line[: here + 1])
            found += [_last(way) for way in ways if len(way) > 1]
        return found

    def missing(self, what: str, at: Place) -> tuple[str, str]:
        """Return what is wrong where no street leads to the start of a turn, or from its end."""
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
    """Return what a line (N, 2) has within `LEAD_M` of its last point."""
    along = stations_of_points(points[::-1])[::-1]
    k = int(np.searchsorted(-along, -LEAD_M, side="right"))
    if k == 0:
        return points
    a, b = points[k - 1], points[k]
    share = (LEAD_M - along[k]) / max(along[k - 1] - along[k], 1e-9)
    return np.vstack([b + (a - b) * share, points[k:]])
