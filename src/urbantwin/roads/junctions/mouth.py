"""Where the arms of a junction end: at stop lines, before and behind crossings, else at corners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.junctions.cluster import Chain
from urbantwin.roads.junctions.mapped_marks import Marks
from urbantwin.roads.junctions.strip import Strip

__all__ = ["Arm", "mouths"]

#: How far from a junction its stop line, and a crossing of it, may lie, metres along the arm, and
#: how far a crossing may lie beyond the place where arms part.
STOP_LINE_M, CROSSING_M, BEYOND_M = 40.0, 25.0, 12.0
#: Room between a crossing's middle and the road's end, on the side of its traffic and behind it
#: (StVO-VwV to section 25: stop lines 1 m before crossings of 3 to 4 m).
BEFORE_M, BEHIND_M = 3.2, 2.7
#: Room for a corner's curve beyond the place where arms part, metres.
CORNER_M = 2.0
#: Arms that part at a small angle overlap for long; they end no further out than this, metres.
FLAT, FLAT_M = np.radians(30.0), 9.0
#: No arm ends further out than this without a mark of the map, nor gives up more of its length.
FURTHEST_M, SHARE = 25.0, 0.6
#: What is left of an arm at least, metres.
SHORTEST_M = 4.0
STEP_M = 0.5
#: Arms that overlap do so from this far out at the latest, metres.
NEAR_M = 4.0


@dataclass(frozen=True, eq=False)
class Arm:
    """A street at a junction.

    Attributes:
        inward: the chain of edges that leads in; ``None`` for a one-way street out.
        outward: the one that leads out.
    """

    inward: Chain | None
    outward: Chain | None

    @property
    def length(self) -> float:
        """The shorter of its chains, metres."""
        return min(chain.length for chain in (self.inward, self.outward) if chain)


@dataclass(frozen=True)
class _Profile:
    """An arm sampled outwards: places (N, 2) every `STEP_M` and half the width there (N,)."""

    places: NDArray[np.float64]
    half: NDArray[np.float64]
    heading: float


def mouths(
    arms: Sequence[Arm], strips: Mapping[str, Strip], marks: Marks
) -> list[tuple[float, bool]]:
    """Return how far out of the junction each arm ends, metres along it, and if the map says so.

    Both directions of a street end at one place.

    Args:
        arms: the arms of one junction.
        strips: the strips of their edges.
        marks: the map's stop lines and crossings.
    """
    profiles = [_profile(arm, strips) for arm in arms]
    found = []
    for k, arm in enumerate(arms):
        apart = _parting(k, profiles)
        marked = _marked(arm, marks, min(CROSSING_M, apart + BEYOND_M))
        if marked is None:
            reach = min(apart + CORNER_M, FURTHEST_M, SHARE * arm.length)
        else:
            reach = max(marked, min(apart, marked + 6.0))
        reach = float(np.clip(reach, 0.5, max(arm.length - SHORTEST_M, 0.5)))
        found.append((reach, marked is not None))
    return found


def _marked(arm: Arm, marks: Marks, furthest: float) -> float | None:
    """Return where the map says that an arm ends, metres; ``None`` where it does not say.

    Crossings further out than ``furthest`` are not the junction's.
    """
    found = []
    if arm.inward is not None:
        length = arm.inward.length
        lines = [length - s for s in arm.inward.stations(marks.stop_lines)]
        crossed = [length - s for s in arm.inward.stations(marks.crossings)]
        near = min((d for d in crossed if d <= furthest), default=None)
        line = min((d for d in lines if d <= STOP_LINE_M), default=None)
        if line is not None and (near is None or line > near + 1.0):
            found.append(line)
        elif near is not None:
            found.append(near + BEFORE_M)
    if arm.outward is not None:
        crossed = [d for d in arm.outward.stations(marks.crossings) if d <= furthest]
        if crossed:
            found.append(min(crossed) + BEHIND_M)
    return max(found, default=None)


def _profile(arm: Arm, strips: Mapping[str, Strip]) -> _Profile:
    """Return an arm's middle outwards, and half its width, over all of its lanes."""
    chain = arm.outward or arm.inward
    assert chain is not None
    edges = chain.edges if arm.outward is not None else chain.edges[::-1]
    lines, halves = [], []
    for edge in edges:
        strip = strips[edge.id]
        line = strip.middle if arm.outward is not None else strip.middle.reverse()
        low, high = strip.driven()
        half = (high - low) / 2
        shift = (high + low) / 2 * (1 if arm.outward is not None else -1)
        other = arm.inward if arm.outward is not None else None
        if other is not None:
            # Both directions: about the line between them.
            against = strips[other.edges[-1].id].driven()
            width = half + (against[1] - against[0]) / 2
            shift += -strip.outward * (width - half)
            half = width
        points = shapely.get_coordinates(line.segmentize(STEP_M))
        leg = np.gradient(points, axis=0)
        leg /= np.maximum(np.linalg.norm(leg, axis=1, keepdims=True), 1e-9)
        lines.append(points + shift * np.column_stack([-leg[:, 1], leg[:, 0]]))
        halves.append(np.full(len(points), half))
    places = np.vstack(lines)
    reach = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    near = reach <= FURTHEST_M + 10.0
    places = places[near]
    ahead = places[min(len(places) - 1, int(10.0 / STEP_M))] - places[0]
    return _Profile(places, np.concatenate(halves)[near], float(np.arctan2(ahead[1], ahead[0])))


def _parting(k: int, profiles: Sequence[_Profile]) -> float:
    """Return how far out an arm no longer overlaps any other."""
    mine, furthest = profiles[k], 0.0
    along = np.linalg.norm(np.diff(mine.places, axis=0), axis=1)
    reach = np.concatenate([[0.0], np.cumsum(along)])
    for j, other in enumerate(profiles):
        if j == k:
            continue
        gap = np.linalg.norm(mine.places[:, None] - other.places[None], axis=2)
        nearest = gap.argmin(axis=1)
        overlap = gap.min(axis=1) < mine.half + other.half[nearest]
        if not overlap.any():
            continue
        # Further out, arms may come near each other again: at the next junction.
        gaps = np.flatnonzero(~overlap & (reach > NEAR_M))
        last = np.flatnonzero(overlap[: gaps[0]] if len(gaps) else overlap)
        if not len(last):
            continue
        at = float(reach[last[-1]])
        angle = abs((mine.heading - other.heading + np.pi) % (2 * np.pi) - np.pi)
        furthest = max(furthest, min(at, FLAT_M) if angle < FLAT else at)
    return furthest
