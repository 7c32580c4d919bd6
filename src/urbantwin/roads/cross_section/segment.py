"""Segments of ways between junctions: each becomes one edge of SUMO's network."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from urbantwin.site.extract import WayPiece

__all__ = ["Segment", "segments_of"]


@dataclass(frozen=True, eq=False)
class Segment:
    """A part of a way that no other way meets between its ends.

    Attributes:
        piece: the part, with an id of its own.
        origin: id of the piece that it was cut from.
        first, last: the share of the way that lies before its start and before its end.
    """

    piece: WayPiece
    origin: int
    first: float
    last: float


def segments_of(pieces: Sequence[WayPiece], nodes: Collection[int]) -> tuple[Segment, ...]:
    """Cut ways where others meet them.

    netconvert cuts them there itself and numbers the parts; cut beforehand, every part is one edge
    whose name is known, and can be given its shape.

    Args:
        pieces: ways of the network.
        nodes: further nodes where edges end: signals.
    """
    # netconvert takes nodes at one place for one node.
    place = {
        node: (round(float(x), 4), round(float(y), 4))
        for piece in pieces
        for node, (x, y) in zip(piece.nodes, piece.points, strict=True)
    }
    same: dict[tuple[float, float], int] = {}
    for node, at in place.items():
        same.setdefault(at, node)
    cuts = {same[place[node]] for node in nodes if node in place}
    use: Counter[int] = Counter()
    merged = []
    seen: set[tuple[int, ...]] = set()
    for piece in pieces:
        one = _merged(piece, [same[place[node]] for node in piece.nodes])
        if len(one.nodes) < 2 or one.nodes in seen:
            continue
        seen.add(one.nodes)
        merged.append(one)
        use.update(one.nodes)
    cuts |= {node for node, number in use.items() if number > 1}
    unused = max((piece.id for piece in pieces), default=0) + 1
    found: list[Segment] = []
    for piece in merged:
        for number, segment in enumerate(_cut(piece, cuts)):
            if number:
                segment = replace(segment, piece=replace(segment.piece, id=unused))  # noqa: PLW2901
                unused += 1
            found.append(segment)
    return tuple(found)


def _merged(piece: WayPiece, nodes: list[int]) -> WayPiece:
    """Return a piece without nodes that repeat the one before."""
    keep = [k for k in range(len(nodes)) if k == 0 or nodes[k] != nodes[k - 1]]
    return replace(piece, nodes=tuple(nodes[k] for k in keep), points=piece.points[keep])


def _cut(piece: WayPiece, cuts: Collection[int]) -> list[Segment]:
    along = _along(piece.points)
    inner = [k for k in range(1, len(piece.nodes) - 1) if piece.nodes[k] in cuts]
    ends = [0, *inner, len(piece.nodes) - 1]
    parts: list[tuple[int, int]] = []
    for a, b in pairwise(ends):
        if piece.nodes[a] == piece.nodes[b] and b - a > 1:
            # A loop: netconvert needs two edges.
            parts += [(a, (a + b) // 2), ((a + b) // 2, b)]
        else:
            parts.append((a, b))
    return [
        Segment(
            replace(piece, nodes=piece.nodes[a : b + 1], points=piece.points[a : b + 1]),
            piece.id,
            float(along[a]),
            float(along[b]),
        )
        for a, b in parts
    ]


def _along(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the share of a line's length before each of its points."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(along / max(float(along[-1]), 1e-9))
