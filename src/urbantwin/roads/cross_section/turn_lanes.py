"""Turn lanes consistent with junctions: arrows only to existing streets with enough lanes.

netconvert discards all arrows of an approach if one of them leads nowhere, or if more lanes lead to
a street than it has. It then leaves lanes without a connection.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import wrapped
from urbantwin.roads.cross_section.section import CarriagewayLane, CrossSection
from urbantwin.roads.cross_section.segment import Segment

__all__ = ["SignedTurns", "fitting_turns", "signed_turns"]

#: Two junction nodes closer than this may become one junction whose exits start elsewhere, metres.
ALONE_M = 40.0
#: Minimum angle of a turn, radians.
TURN = math.radians(45.0)
#: Directions of arrows.
DIRECTIONS = {
    "left": "left", "sharp_left": "left", "slight_left": "left", "through": "through",
    "right": "right", "sharp_right": "right", "slight_right": "right",
}  # fmt: skip


@dataclass(frozen=True)
class _Arm:
    """A street at a node: its heading away from the node, its number of car lanes, its segment."""

    heading: float
    lanes: int
    segment: int


@dataclass(frozen=True, eq=False)
class SignedTurns:
    """Signed turns of lanes; they apply to the junction at the end of the way.

    Attributes:
        rows: edge -> turns of each lane, from the kerb inwards, the sidewalk first.
        onward: edge -> next edge of the same way; absent where the way ends.
    """

    rows: Mapping[str, tuple[tuple[str, ...], ...]]
    onward: Mapping[str, str]

    def on(self, edges: Collection[str]) -> dict[str, tuple[tuple[str, ...], ...]]:
        """Return the turns of those of the edges that are the last ones of a way.

        Parts of a way inside a junction are not among the edges. The edge before them is then the
        last one, at the first carriageway of a crossing street.
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


def fitting_turns(
    segments: Sequence[Segment], sections: Sequence[CrossSection]
) -> list[CrossSection]:
    """Return the cross sections with arrows that fit the streets at their ends.

    Arrows near other junctions are kept: they may apply to those.
    """
    arms: dict[int, list[_Arm]] = defaultdict(list)
    ends: dict[int, int] = defaultdict(int)
    place: dict[int, NDArray[np.float64]] = {}
    for k, (segment, section) in enumerate(zip(segments, sections, strict=True)):
        points = segment.piece.points
        for node, step, lanes in (
            (segment.piece.nodes[0], points[1] - points[0], section.forward),
            (segment.piece.nodes[-1], points[-2] - points[-1], section.backward),
        ):
            ends[node] += 1
            place[node] = points[0] if node == segment.piece.nodes[0] else points[-1]
            number = sum("car" in lane.allowed for lane in lanes)
            if number:
                arms[node].append(_Arm(math.atan2(step[1], step[0]), number, k))
    junctions = [node for node, number in ends.items() if number > 2]
    alone = _without_near_junction(junctions, place)
    result = []
    for k, (segment, section) in enumerate(zip(segments, sections, strict=True)):
        points, nodes = segment.piece.points, segment.piece.nodes
        changed = {"forward": section.forward, "backward": section.backward}
        for name, node, step in (
            ("forward", nodes[-1], points[-1] - points[-2]),
            ("backward", nodes[0], points[0] - points[1]),
        ):
            lanes = changed[name]
            if node in alone and any(lane.turns for lane in lanes):
                heading = math.atan2(step[1], step[0])
                exits = _exit_lanes(heading, [arm for arm in arms[node] if arm.segment != k])
                changed[name] = _fitted(lanes, exits, section.driving_side)
        result.append(replace(section, forward=changed["forward"], backward=changed["backward"]))
    return result


def _without_near_junction(
    junctions: Sequence[int], place: Mapping[int, NDArray[np.float64]]
) -> set[int]:
    if not junctions:
        return set()
    xy = np.array([place[node] for node in junctions])
    gap = np.linalg.norm(xy[:, None] - xy[None], axis=2)
    np.fill_diagonal(gap, np.inf)
    return {node for node, gap_m in zip(junctions, gap.min(axis=1), strict=True) if gap_m > ALONE_M}


def _exit_lanes(heading: float, arms: Sequence[_Arm]) -> dict[str, int] | None:
    """Return direction -> number of lanes; ``None`` if two streets share a direction."""
    exits: dict[str, int] = {}
    for arm in arms:
        bend = wrapped(arm.heading - heading)
        name = "through" if abs(bend) < TURN else ("left" if bend > 0 else "right")
        if name in exits:
            return None
        exits[name] = arm.lanes
    return exits


def _fitted(
    lanes: Sequence[CarriagewayLane], ways: Mapping[str, int] | None, driving_side: str
) -> tuple[CarriagewayLane, ...]:
    if ways is None:
        return tuple(lanes)
    cars = [k for k, lane in enumerate(lanes) if "car" in lane.allowed]
    turns = {k: {DIRECTIONS[turn] for turn in lanes[k].turns if turn in DIRECTIONS} for k in cars}
    blank = [k for k in cars if not turns[k]]
    outer = driving_side
    for k in blank:
        turns[k] = {"through"}
    signed = set().union(*turns.values())
    if blank and cars[-1] in blank and outer not in signed:
        turns[cars[-1]].add(outer)
    inner = "left" if driving_side == "right" else "right"
    if blank and cars[0] in blank and inner not in signed:
        turns[cars[0]].add(inner)
    for k in cars:
        turns[k] &= ways.keys()
    for name, room in ways.items():
        users = [k for k in cars if name in turns[k]]
        # Lanes with another option are removed first, from the side away from the turn.
        spare = [k for k in users if len(turns[k]) > 1]
        spare = spare if name == inner else spare[::-1]
        for k in spare[: max(0, len(users) - room)]:
            turns[k].discard(name)
    without_turn = [k for k in cars if not turns[k]]
    if without_turn:
        # A lane without a valid arrow gets the turns of its neighbour.
        for k in without_turn:
            closest = min((j for j in cars if turns[j]), key=lambda j: abs(j - k), default=None)
            turns[k] = set(turns[closest]) if closest is not None else set()
    order = ("left", "through", "right")
    return tuple(
        replace(lane, turns=tuple(t for t in order if t in turns[k])) if k in turns else lane
        for k, lane in enumerate(lanes)
    )


def signed_turns(segments: Sequence[Segment], sections: Sequence[CrossSection]) -> SignedTurns:
    """Return the signed turns of segments, given in the order of their way."""
    rows: dict[str, tuple[tuple[str, ...], ...]] = {}
    onward: dict[str, str] = {}
    for segment, section in zip(segments, sections, strict=True):
        for forward, sign in ((True, ""), (False, "-")):
            lanes = section.lanes(forward=forward)
            if any(lane.turns for lane in lanes):
                walk = ((),) if section.side(forward=forward).sidewalk else ()
                rows[f"{sign}{segment.piece.id}"] = (*walk, *(lane.turns for lane in lanes[::-1]))
    for before, after in pairwise(segments):
        if before.origin == after.origin:
            onward[f"{before.piece.id}"] = f"{after.piece.id}"
            onward[f"-{after.piece.id}"] = f"-{before.piece.id}"
    return SignedTurns(rows, onward)
