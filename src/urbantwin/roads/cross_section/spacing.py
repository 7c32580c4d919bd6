"""Spacing of parallel carriageways: moved apart where their lanes would overlap.

Lines of the map are accurate to a metre or two, and default lane widths may exceed the real ones.
Parallel carriageways share the missing distance.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.cross_section.layout import Middle
from urbantwin.roads.cross_section.section import CrossSection
from urbantwin.roads.cross_section.segment import Segment
from urbantwin.roads.grade_separation import way_layer

__all__ = ["spaced"]

#: Maximum displacement of a carriageway, metres.
FURTHEST_M = 2.5
#: Lines closer than this are one road mapped twice, metres.
CLOSEST_M = 1.5
#: Minimum cosine of the angle between parallel carriageways, and their minimum common length,
#: metres.
PARALLEL, SHORTEST_M = 0.98, 25.0
STEP_M = 5.0
ROUNDS = 40


@dataclass(frozen=True)
class _Pair:
    """Two parallel segments.

    Attributes:
        a, b: their indices.
        side: 1 where b lies to the left of a, else -1.
        apart: distance between their centre lines, metres.
        need: distance that their widths require, metres.
        along: 1 where they are drawn in the same direction, else -1.
    """

    a: int
    b: int
    side: int
    apart: float
    need: float
    along: int


def spaced(
    segments: Sequence[Segment], sections: Sequence[CrossSection], middles: Sequence[Middle]
) -> list[Middle]:
    """Return the middles of roads with overlapping parallel carriageways moved apart.

    A way with a mapped ``placement`` is not moved.

    Args:
        segments: parts of ways.
        sections: their cross sections.
        middles: their middles as mapped.
    """
    lines, half = [], []
    for section, middle in zip(sections, middles, strict=True):
        ahead, back = (
            sum(lane.width for lane in lanes) for lanes in (section.forward, section.backward)
        )
        half.append((ahead + back) / 2)
        lines.append(middle.beside(section.outward * (ahead - back) / 2))
    group, sign = _roads(segments)
    pairs = _pairs(segments, lines, half, group)
    if all(pair.apart >= pair.need for pair in pairs):
        return list(middles)
    fixed = {
        group[k]
        for k, segment in enumerate(segments)
        if any(key.startswith("placement") for key in segment.piece.tags)
    }
    push: dict[int, float] = dict.fromkeys(group, 0.0)
    for _ in range(ROUNDS):
        for pair in pairs:
            a, b = group[pair.a], group[pair.b]
            moved_m = sign[pair.a] * push[a], pair.along * sign[pair.b] * push[b]
            apart = pair.apart + pair.side * (moved_m[1] - moved_m[0])
            free = {a, b} - fixed
            if apart >= pair.need or not free:
                continue
            step = (pair.need - apart) / len(free)
            if a in free:
                push[a] -= sign[pair.a] * pair.side * step
            if b in free:
                push[b] += sign[pair.b] * pair.side * pair.along * step
    result = []
    for k, middle in enumerate(middles):
        shift_m = sign[k] * float(np.clip(push[group[k]], -FURTHEST_M, FURTHEST_M))
        result.append(replace(middle, offset=middle.offset + shift_m) if shift_m else middle)
    return result


def _roads(segments: Sequence[Segment]) -> tuple[list[int], list[int]]:
    """Return the road index of each segment, and 1 or -1 for its direction in the road.

    A road consists of all parts of a way and of continuations without other branches.
    """
    ends: dict[int, list[tuple[int, bool]]] = defaultdict(list)
    beside: dict[int, list[tuple[int, int]]] = defaultdict(list)
    first: dict[int, int] = {}
    for k, segment in enumerate(segments):
        ends[segment.piece.nodes[0]].append((k, False))
        ends[segment.piece.nodes[-1]].append((k, True))
        other = first.setdefault(segment.origin, k)
        if other != k:
            beside[k].append((other, 1))
            beside[other].append((k, 1))
    for meeting in ends.values():
        if len(meeting) == 2 and meeting[0][0] != meeting[1][0]:
            (a, a_end), (b, b_end) = meeting
            turn = 1 if a_end != b_end else -1
            beside[a].append((b, turn))
            beside[b].append((a, turn))
    group, sign = [-1] * len(segments), [1] * len(segments)
    for k in range(len(segments)):
        ahead = [(k, 1)] if group[k] < 0 else []
        while ahead:
            current, direction = ahead.pop()
            if group[current] < 0:
                group[current], sign[current] = k, direction
                ahead += [(other, direction * turn) for other, turn in beside[current]]
    return group, sign


def _pairs(
    segments: Sequence[Segment],
    lines: Sequence[NDArray[np.float64]],
    half: Sequence[float],
    group: Sequence[int],
) -> list[_Pair]:
    shapes = [shapely.LineString(line) for line in lines]
    # Segments that do not overlap yet may do so after others have moved.
    bands = [s.buffer(width + FURTHEST_M) for s, width in zip(shapes, half, strict=True)]
    tree = shapely.STRtree(bands)
    pairs = []
    for a, b in tree.query(bands, predicate="intersects").T.tolist():
        first, other = segments[a].piece, segments[b].piece
        if (
            a >= b
            or group[a] == group[b]
            or not set(first.nodes).isdisjoint(other.nodes)
            or way_layer(first.tags) != way_layer(other.tags)
            or any(piece.tags.get("highway", "").endswith("_link") for piece in (first, other))
        ):
            continue
        pair = _pair(a, b, shapes, half)
        if pair is not None:
            pairs.append(pair)
    return pairs


def _pair(
    a: int, b: int, shapes: Sequence[shapely.LineString], half: Sequence[float]
) -> _Pair | None:
    line, other = shapes[a], shapes[b]
    stations = np.arange(0.0, line.length, STEP_M)
    points = shapely.line_interpolate_point(line, stations)
    along = shapely.line_locate_point(other, points)
    beside = (along > 0.0) & (along < other.length)
    xy = shapely.get_coordinates(points)
    step = _directions(line, stations)
    other_step = _directions(other, along)
    cosine = (step * other_step).sum(axis=1)
    beside &= np.abs(cosine) > PARALLEL
    if beside.sum() * STEP_M < SHORTEST_M:
        return None
    gap = shapely.get_coordinates(shapely.line_interpolate_point(other, along)) - xy
    left = step[:, 0] * gap[:, 1] - step[:, 1] * gap[:, 0]
    offset = float(np.median(left[beside]))
    needed_m = half[a] + half[b]
    if abs(offset) < CLOSEST_M or abs(offset) >= needed_m + 2 * FURTHEST_M:
        return None
    direction = 1 if float(np.median(cosine[beside])) > 0 else -1
    return _Pair(a, b, 1 if offset > 0 else -1, abs(offset), needed_m, direction)


def _directions(line: shapely.LineString, at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return unit vectors (N, 2) along a line at distances along it."""
    ends = [
        shapely.get_coordinates(
            shapely.line_interpolate_point(line, np.clip(at + d, 0.0, line.length))
        )
        for d in (-0.5, 0.5)
    ]
    step = ends[1] - ends[0]
    return np.asarray(step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9))
