"""Which of two junctions a crossing on the road between them belongs to.

The road of the one ends before it, that of the other would begin behind it: a crossing that both
claimed would leave nothing of the road between.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from urbantwin.roads.junctions.cluster import Chain
from urbantwin.roads.junctions.mapped_marks import Marks
from urbantwin.roads.junctions.mouth import Arm

__all__ = ["marks_of_junctions"]

#: A junction with signals has a crossing sooner than one without that is nearer by this, metres.
SIGNALS_M = 6.0
#: A stop line this far before a crossing, or a little behind it, is the crossing's, metres.
STOP_BEFORE_M, STOP_BEHIND_M = 12.0, 1.0


def marks_of_junctions(
    junctions: Sequence[tuple[Sequence[Arm], bool]], marks: Marks
) -> list[Marks]:
    """Return for each junction the marks without the crossings that belong to its neighbours.

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
    lost: dict[int, set[tuple[str, float]]] = defaultdict(set)
    for chain, (first, last) in ends.items():
        if first is None or last is None or first == last:
            continue
        back = reverse.get(chain)
        for edge, share, at in _crossings(chain, marks):
            there = _cost(chain, chain.length - at, marks, signals=junctions[last][1])
            here = at - SIGNALS_M * junctions[first][1]
            if back is not None:
                here = _cost(back, at, marks, signals=junctions[first][1])
            lost[first if there < here else last].add((edge, share))
    return [_without(marks, lost.get(number, ())) for number in range(len(junctions))]


def _crossings(chain: Chain, marks: Marks) -> list[tuple[str, float, float]]:
    """Return the crossings on a chain: edge, share of it, and metres from the chain's start."""
    found, before = [], 0.0
    for edge in chain.edges:
        length = float(edge.line.length)
        found += [(edge.id, x, before + x * length) for x in marks.crossings.get(edge.id, ())]
        before += length
    return found


def _cost(chain: Chain, left: float, marks: Marks, *, signals: bool) -> float:
    """Return how far a crossing is from a chain's end, less what speaks for its being that end's.

    Args:
        chain: the road that leads to the junction.
        left: how far before the chain's end the crossing is, metres.
        marks: the map's stop lines.
        signals: whether the junction has signals.
    """
    at = chain.length - left
    stop = any(-STOP_BEHIND_M <= at - s <= STOP_BEFORE_M for s in chain.stations(marks.stop_lines))
    return left - SIGNALS_M * signals - 1000.0 * stop


def _without(marks: Marks, lost: Collection[tuple[str, float]]) -> Marks:
    if not lost:
        return marks
    crossings: Mapping[str, tuple[float, ...]] = {
        edge: tuple(share for share in shares if (edge, share) not in lost)
        for edge, shares in marks.crossings.items()
    }
    return replace(marks, crossings=crossings)
