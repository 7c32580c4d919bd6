"""Mouths of a junction's arms: at stop lines, at crossings, else at corners."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.junctions.cluster import Chain
from urbantwin.roads.junctions.mapped_crossings import Marks
from urbantwin.roads.junctions.strip import Strip

__all__ = ["Arm", "marks_of_junctions", "mouths"]

#: Maximum distance of a junction's stop line and of its crossing along the arm, and of a crossing
#: beyond the place where arms separate, metres.
STOP_LINE_M, CROSSING_M, BEYOND_M = 40.0, 25.0, 12.0
#: Distance from a crossing's centre line to the end of the entry and of the exit (StVO-VwV to
#: section 25: stop lines 1 m before crossings of 3 to 4 m), metres.
BEFORE_M, BEHIND_M = 3.2, 2.7
#: Length for a corner's curve beyond the place where arms separate, metres.
CORNER_M = 2.0
#: Arms that separate at an angle below the first (radians) overlap for long; they end at the second
#: at most, metres.
FLAT, FLAT_M = np.radians(30.0), 9.0
#: Maximum distance of an unmarked mouth, metres, and the maximum share of an arm's length.
FURTHEST_M, SHARE = 25.0, 0.6
#: Minimum remaining length of an arm, metres.
SHORTEST_M = 4.0
STEP_M = 0.5
#: Overlaps of arms that begin farther out than this do not count, metres.
NEAR_M = 4.0
#: Advantage of a signalised junction when a crossing is assigned to one of two, metres.
SIGNALS_M = 6.0
#: Range of a crossing's own stop line before and behind it, metres.
STOP_BEFORE_M, STOP_BEHIND_M = 12.0, 1.0


@dataclass(frozen=True, eq=False)
class Arm:
    """A street at a junction.

    Attributes:
        inward: chain of edges into the junction; ``None`` for a one-way street out.
        outward: chain out of it; ``None`` for a one-way street in.
    """

    inward: Chain | None
    outward: Chain | None

    @property
    def length(self) -> float:
        """Length of the shorter of its chains, metres."""
        return min(chain.length for chain in (self.inward, self.outward) if chain)


@dataclass(frozen=True)
class _Profile:
    """An arm sampled outwards: places (N, 2) every `STEP_M`, and half its width there (N,)."""

    places: NDArray[np.float64]
    half: NDArray[np.float64]
    heading: float


def mouths(
    arms: Sequence[Arm], strips: Mapping[str, Strip], marks: Marks
) -> list[tuple[float, bool]]:
    """Return the distance of each arm's mouth along it, metres, and whether it is mapped.

    Both directions of a street end at the same place.

    Args:
        arms: the arms of one junction.
        strips: the strips of their edges.
        marks: the map's stop lines and crossings.
    """
    profiles = [_profile(arm, strips) for arm in arms]
    rows = []
    for k, arm in enumerate(arms):
        parting_m = _parting(k, profiles)
        marked = _marked(arm, marks, min(CROSSING_M, parting_m + BEYOND_M))
        if marked is None:
            reach = min(parting_m + CORNER_M, FURTHEST_M, SHARE * arm.length)
        else:
            reach = max(marked, min(parting_m, marked + 6.0))
        reach = float(np.clip(reach, 0.5, max(arm.length - SHORTEST_M, 0.5)))
        rows.append((reach, marked is not None))
    return rows


def _marked(arm: Arm, marks: Marks, furthest: float) -> float | None:
    """Return the mapped distance of an arm's mouth, metres; ``None`` without marks.

    Crossings farther out than ``furthest`` do not belong to the junction.
    """
    distances = []
    if arm.inward is not None:
        length = arm.inward.length
        lines = [length - s for s in arm.inward.stations(marks.stop_lines)]
        crossed = [length - s for s in arm.inward.stations(marks.crossings)]
        crossing_m = min((d for d in crossed if d <= furthest), default=None)
        line = min((d for d in lines if d <= STOP_LINE_M), default=None)
        if line is not None and (crossing_m is None or line > crossing_m + 1.0):
            distances.append(line)
        elif crossing_m is not None:
            distances.append(crossing_m + BEFORE_M)
    if arm.outward is not None:
        crossed = [d for d in arm.outward.stations(marks.crossings) if d <= furthest]
        if crossed:
            distances.append(min(crossed) + BEHIND_M)
    return max(distances, default=None)


def _profile(arm: Arm, strips: Mapping[str, Strip]) -> _Profile:
    """Return an arm's centre line outwards, and half its width, over all its lanes."""
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
            # Both directions: the centre line of all their lanes.
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
    in_range = reach <= FURTHEST_M + 10.0
    places = places[in_range]
    ahead = places[min(len(places) - 1, int(10.0 / STEP_M))] - places[0]
    return _Profile(places, np.concatenate(halves)[in_range], float(np.arctan2(ahead[1], ahead[0])))


def _parting(k: int, profiles: Sequence[_Profile]) -> float:
    """Return the distance at which an arm no longer overlaps others, metres."""
    profile, furthest = profiles[k], 0.0
    along = np.linalg.norm(np.diff(profile.places, axis=0), axis=1)
    reach = np.concatenate([[0.0], np.cumsum(along)])
    for j, other in enumerate(profiles):
        if j == k:
            continue
        gap = np.linalg.norm(profile.places[:, None] - other.places[None], axis=2)
        nearest = gap.argmin(axis=1)
        overlap = gap.min(axis=1) < profile.half + other.half[nearest]
        if not overlap.any():
            continue
        # Farther out, arms may approach each other again at the next junction.
        gaps = np.flatnonzero(~overlap & (reach > NEAR_M))
        last = np.flatnonzero(overlap[: gaps[0]] if len(gaps) else overlap)
        if not len(last):
            continue
        overlap_m = float(reach[last[-1]])
        angle = abs((profile.heading - other.heading + np.pi) % (2 * np.pi) - np.pi)
        furthest = max(furthest, min(overlap_m, FLAT_M) if angle < FLAT else overlap_m)
    return furthest


def marks_of_junctions(
    junctions: Sequence[tuple[Sequence[Arm], bool]], marks: Marks
) -> list[Marks]:
    """Return the marks of each junction without the crossings of its neighbours.

    Args:
        junctions: the arms of each, and whether it has signals.
        marks: the map's stop lines and crossings.
    """
    ends: dict[Chain, list[int | None]] = defaultdict(lambda: [None, None])
    reverse: dict[Chain, Chain] = {}
    for number, (arms, _) in enumerate(junctions):
        for arm in arms:
            if arm.outward is not None:
                ends[arm.outward][0] = number
            if arm.inward is not None:
                ends[arm.inward][1] = number
            if arm.inward is not None and arm.outward is not None:
                reverse[arm.outward], reverse[arm.inward] = arm.inward, arm.outward
    foreign: dict[int, set[tuple[str, float]]] = defaultdict(set)
    for chain, (first, last) in ends.items():
        if first is None or last is None or first == last:
            continue
        back = reverse.get(chain)
        for edge, share, station_m in _crossings(chain, marks):
            end_cost = _cost(chain, chain.length - station_m, marks, signals=junctions[last][1])
            start_cost = station_m - SIGNALS_M * junctions[first][1]
            if back is not None:
                start_cost = _cost(back, station_m, marks, signals=junctions[first][1])
            foreign[first if end_cost < start_cost else last].add((edge, share))
    return [_without_crossings(marks, foreign.get(number, ())) for number in range(len(junctions))]


def _crossings(chain: Chain, marks: Marks) -> list[tuple[str, float, float]]:
    """Return the crossings on a chain: edge, share, and distance from the chain's start, metres."""
    crossings, before = [], 0.0
    for edge in chain.edges:
        length = float(edge.line.length)
        crossings += [(edge.id, x, before + x * length) for x in marks.crossings.get(edge.id, ())]
        before += length
    return crossings


def _cost(chain: Chain, left: float, marks: Marks, *, signals: bool) -> float:
    """Return the cost of assigning a crossing to a chain's end: its distance less bonuses, metres.

    Args:
        chain: the road that leads to the junction.
        left: distance of the crossing from the chain's end, metres.
        marks: the map's stop lines.
        signals: whether the junction has signals.
    """
    pos = chain.length - left
    stop = any(-STOP_BEHIND_M <= pos - s <= STOP_BEFORE_M for s in chain.stations(marks.stop_lines))
    return left - SIGNALS_M * signals - 1000.0 * stop


def _without_crossings(marks: Marks, lost: Collection[tuple[str, float]]) -> Marks:
    if not lost:
        return marks
    crossings: Mapping[str, tuple[float, ...]] = {
        edge: tuple(share for share in shares if (edge, share) not in lost)
        for edge, shares in marks.crossings.items()
    }
    return replace(marks, crossings=crossings)
