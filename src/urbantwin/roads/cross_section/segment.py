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
    """A part of a way without other ways between its ends.

    Attributes:
        piece: the part, with its own id.
        origin: id of the original piece.
        first, last: shares of the original piece's length before its start and its end.
    """

    piece: WayPiece
    origin: int
    first: float
    last: float


def segments_of(pieces: Sequence[WayPiece], nodes: Collection[int]) -> tuple[Segment, ...]:
    """Cut ways at nodes that they share.

    netconvert would cut and number them itself. When they are cut before, each part is one edge
    with a known name, and its shape can be set.

    Args:
        pieces: ways of the network.
        nodes: further nodes where edges end: signals.
    """
    # netconvert merges nodes at the same position.
    place = {
        node: (round(float(x), 4), round(float(y), 4))
        for piece in pieces
        for node, (x, y) in zip(piece.nodes, piece.points, strict=True)
    }
    same: dict[tuple[float, float], int] = {}
    for node, position in place.items():
        same.setdefault(position, node)
    cuts = {same[place[node]] for node in nodes if node in place}
    uses: Counter[int] = Counter()
    merged = []
    seen: set[tuple[int, ...]] = set()
    for piece in pieces:
        distinct = _merged(piece, [same[place[node]] for node in piece.nodes])
        if len(distinct.nodes) < 2 or distinct.nodes in seen:
            continue
        seen.add(distinct.nodes)
        merged.append(distinct)
        uses.update(distinct.nodes)
    cuts |= {node for node, number in uses.items() if number > 1}
    unused = max((piece.id for piece in pieces), default=0) + 1
    segments: list[Segment] = []
    for piece in merged:
        for number, segment in enumerate(_cut(piece, cuts)):
            if number:
                segment = replace(segment, piece=replace(segment.piece, id=unused))  # noqa: PLW2901
                unused += 1
            segments.append(segment)
    return tuple(segments)


def _merged(piece: WayPiece, nodes: list[int]) -> WayPiece:
    """Return a piece without consecutive duplicate nodes."""
    keep = [k for k in range(len(nodes)) if k == 0 or nodes[k] != nodes[k - 1]]
    return replace(piece, nodes=tuple(nodes[k] for k in keep), points=piece.points[keep])


def _cut(piece: WayPiece, cuts: Collection[int]) -> list[Segment]:
    along = _shares_along(piece.points)
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


def _shares_along(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the share of a line's length before each of its points (N,)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(along / max(float(along[-1]), 1e-9))
