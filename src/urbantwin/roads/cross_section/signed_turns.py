"""Turns that ways sign for their lanes, and the edges at whose ends they hold."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from urbantwin.roads.cross_section.section import CrossSection
from urbantwin.roads.cross_section.segment import Segment

__all__ = ["SignedTurns", "signed_turns"]


@dataclass(frozen=True, eq=False)
class SignedTurns:
    """The turns that ways sign for their lanes; they are for what comes where the way ends.

    Attributes:
        rows: edge -> the turns of each lane, from the kerb inwards, the sidewalk first.
        onward: edge -> the next one of the same way; none where the way ends.
    """

    rows: Mapping[str, tuple[tuple[str, ...], ...]]
    onward: Mapping[str, str]

    def on(self, edges: Collection[str]) -> dict[str, tuple[tuple[str, ...], ...]]:
        """Return the turns of those edges with which a way ends.

        What a junction has swallowed of the way is not among the edges: the one before it ends
        there, at the first carriageway of a street that has two.
        """
        return {
            name: row
            for name, row in self.rows.items()
            if name in edges and self._ends(name, edges)
        }

    def _ends(self, name: str, edges: Collection[str]) -> bool:
        after = self.onward.get(name)
        while after is not None and after not in edges:
            after = self.onward.get(after)
        return after is None


def signed_turns(segments: Sequence[Segment], sections: Sequence[CrossSection]) -> SignedTurns:
    """Return what the cross sections of segments sign, the segments of a way in its order."""
    rows: dict[str, tuple[tuple[str, ...], ...]] = {}
    onward: dict[str, str] = {}
    for segment, section in zip(segments, sections, strict=True):
        for forward, sign in ((True, ""), (False, "-")):
            lanes = section.lanes(forward=forward)
            if any(lane.turns for lane in lanes):
                walk = ((),) if section.side(forward=forward).sidewalk else ()
                rows[f"{sign}{segment.piece.id}"] = (*walk, *(x.turns for x in lanes[::-1]))
    for before, after in pairwise(segments):
        if before.origin == after.origin:
            onward[f"{before.piece.id}"] = f"{after.piece.id}"
            onward[f"-{after.piece.id}"] = f"-{before.piece.id}"
    return SignedTurns(rows, onward)
