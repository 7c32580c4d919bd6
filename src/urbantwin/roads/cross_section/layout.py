"""Layout of lanes in plan: the middle of each segment, offset from its mapped line."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads.cross_section.section import CarriagewayLane, CrossSection
from urbantwin.roads.cross_section.segment import Segment

__all__ = ["MIDDLE", "Middle", "middle_of_road", "middles_of"]

#: Maximum length of a mitred normal; corners that would exceed it are not fully mitred.
MITRE = 2.0
#: An end of a segment: its index, and whether it is the last node.
End = tuple[int, bool]
#: Tag of a way with corrected lanes: offset of the middle to the left of the line at its start and
#: end, metres. No OSM tag keeps one kerb in place while the other one moves.
MIDDLE = "urbantwin:middle"
TWO_NUMBERS = re.compile(r"(-?\d{1,3}(?:\.\d{1,4})?);(-?\d{1,3}(?:\.\d{1,4})?)")
PLACE = re.compile(r"(left_of|middle_of|right_of):(\d+)")


@dataclass(frozen=True, eq=False)
class Middle:
    """The middle of the road along a segment.

    Attributes:
        points: (N, 2) points of the way, site frame, metres.
        normal: (N, 2) mitred normals to the left.
        offset: (N,) offset of the middle to the left of each point, metres.
    """

    points: NDArray[np.float64]
    normal: NDArray[np.float64]
    offset: NDArray[np.float64]

    def beside(self, distance: float) -> NDArray[np.float64]:
        """Return the line (N, 2) at a distance to the left of the middle, metres."""
        return np.asarray(self.points + (self.offset + distance)[:, None] * self.normal)


def middles_of(segments: Sequence[Segment], sections: Sequence[CrossSection]) -> list[Middle]:
    """Return the middle of the road along each segment.

    Args:
        segments: parts of ways.
        sections: their cross sections.
    """
    meeting: dict[int, list[End]] = defaultdict(list)
    for k, segment in enumerate(segments):
        meeting[segment.piece.nodes[0]].append((k, False))
        meeting[segment.piece.nodes[-1]].append((k, True))
    result = []
    for k, segment in enumerate(segments):
        section = sections[k]
        first, last = (
            _offset(k, at_end=at_end, segments=segments, sections=sections, meeting=meeting)
            for at_end in (False, True)
        )
        if None not in section.middle:
            # The offsets of a way that is cut in parts are interpolated along it.
            a, b = float(section.middle[0] or 0.0), float(section.middle[1] or 0.0)
            first, last = a + (b - a) * segment.first, a + (b - a) * segment.last
        points = segment.piece.points
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(steps)]) / max(float(steps.sum()), 1e-9)
        offset = first + (last - first) * along
        normal = _normals(points)
        for at_end, row in ((False, 0), (True, -1)):
            other = _continuation(k, at_end, segments, meeting)
            if other is not None:
                other_dir = _end_direction(segments[other[0]], other[1])
                own_dir = _end_direction(segment, at_end)
                # Both directions lead away from the node; the road goes through it.
                along_road = (other_dir - own_dir) if not at_end else (own_dir - other_dir)
                normal[row] = _mitre(own_dir if at_end else -own_dir, along_road)
        result.append(Middle(points, normal, offset))
    return result


def _offset(
    k: int,
    *,
    at_end: bool,
    segments: Sequence[Segment],
    sections: Sequence[CrossSection],
    meeting: Mapping[int, Sequence[End]],
) -> float:
    """Return the offset at an end; where the tags leave it open, that of the continuing road."""
    section = sections[k]
    own_offset = section.middle[int(at_end)]
    default_offset = centred_middle(section.forward, section.backward, section.outward)
    if own_offset is not None:
        return own_offset
    other = _continuation(k, at_end, segments, meeting)
    if other is None:
        return default_offset
    next_section = sections[other[0]]
    other_offset = next_section.middle[int(other[1])]
    if other_offset is None:
        return default_offset
    # A way drawn in the other direction has its sides swapped.
    same_direction = other[1] != at_end
    ahead, back = (
        (next_section.forward, next_section.backward)
        if same_direction
        else (next_section.backward, next_section.forward)
    )
    other_offset = other_offset if same_direction else -other_offset
    extra = sum(lane.width for lane in ahead) - sum(lane.width for lane in section.forward)
    if len(back) != len(section.backward) or abs(extra) < 1e-6 or not section.forward:
        return other_offset
    wider = ahead if extra > 0 else section.forward
    inner = "left" if section.driving_side == "right" else "right"
    turning = any(inner in turn for turn in wider[0].turns) if wider else False
    # An inner turn lane opens at the inner side: the outer border continues.
    return other_offset + (section.outward * extra if turning and not section.backward else 0.0)


def _continuation(
    k: int, at_end: bool, segments: Sequence[Segment], meeting: Mapping[int, Sequence[End]]
) -> End | None:
    """Return the only other segment end at a node; ``None`` at junctions and dead ends."""
    node = segments[k].piece.nodes[-1 if at_end else 0]
    ends = [end for end in meeting[node] if end != (k, at_end)]
    return ends[0] if len(ends) == 1 else None


def _end_direction(segment: Segment, at_end: bool) -> NDArray[np.float64]:
    """Return the direction (2,) towards a segment's end, unit length."""
    points = segment.piece.points
    step = points[-1] - points[-2] if at_end else points[0] - points[1]
    return np.asarray(step / max(float(np.linalg.norm(step)), 1e-9))


def _normals(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return mitred normals (N, 2) to the left of a line's points."""
    step = np.diff(points, axis=0)
    step /= np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9)
    left = np.column_stack([-step[:, 1], step[:, 0]])
    corner = np.vstack([left[:1], left[:-1] + left[1:], left[-1:]])
    square = np.maximum((corner * corner).sum(axis=1, keepdims=True), 1e-9)
    scale = 2.0 / square
    scale[[0, -1]] = 1.0
    normal = corner * scale
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return np.asarray(normal * np.minimum(1.0, MITRE / np.maximum(length, 1e-9)))


def _mitre(direction: NDArray[np.float64], through: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the normal at a node that one road passes through: the bisector of both sides."""
    length = float(np.linalg.norm(through))
    along = through / length if length > 1e-6 else direction
    cosine = max(float(along @ direction), 1.0 / MITRE)
    return np.array([-along[1], along[0]]) / cosine


def middle_of_road(
    tags: Mapping[str, str],
    forward: Sequence[CarriagewayLane],
    backward: Sequence[CarriagewayLane],
    outward: int,
) -> tuple[float | None, float | None]:
    """Return the offset of the road's middle to the left of the line at its start and end, metres.

    The middle is the border between both directions; on a one-way road, the inner border of its
    lanes. Without ``placement`` the line runs along the middle of the carriageway (OSM wiki,
    "Proposal:Placement").

    Args:
        tags: the way's tags.
        forward: lanes along the way, from the middle outwards.
        backward: lanes against it.
        outward: 1 where lanes along the way lie to the left of the middle, else -1.

    Returns:
        ``None`` where ``placement=transition`` leaves it to the adjacent ways.
    """
    if (numbers := TWO_NUMBERS.fullmatch(tags.get(MIDDLE, ""))) is not None:
        return float(numbers[1]), float(numbers[2])
    default_offset = centred_middle(forward, backward, outward)
    ends = []
    for end in ("start", "end"):
        offset: float | None = default_offset
        for key, value in _values(tags, end):
            if value == "transition":
                offset = None
                break
            placed = _placement_offset(key, value, forward, backward, outward)
            if placed is not None:
                offset = placed
                break
        ends.append(offset)
    return ends[0], ends[1]


def _values(tags: Mapping[str, str], end: str) -> list[tuple[str, str]]:
    keys = ("placement:forward", "placement", "placement:backward")
    # placement:start and placement:end of a transition give its values at the two ends.
    return [(key, tags[full]) for key in keys for full in (f"{key}:{end}", key) if full in tags]


def centred_middle(
    forward: Sequence[CarriagewayLane], backward: Sequence[CarriagewayLane], outward: int
) -> float:
    """Return the offset of the middle to the left of the carriageway's centre line, metres."""
    ahead, back = (
        sum(lane.width for lane in lanes if not lane.track) for lanes in (forward, backward)
    )
    return -outward * (ahead - back) / 2


def _placement_offset(
    key: str,
    value: str,
    forward: Sequence[CarriagewayLane],
    backward: Sequence[CarriagewayLane],
    outward: int,
) -> float | None:
    match = PLACE.fullmatch(value)
    if not match:
        return None
    number = int(match[2])
    # Lanes from left to right as seen along the way; ``edge`` is their offset from the middle.
    ahead = list(forward) if outward < 0 else list(forward)[::-1]
    back = list(backward)[::-1] if outward < 0 else list(backward)
    if key.endswith("backward"):
        # Lanes count from the left in the direction of travel: from right to left along the way.
        edge = 0.0 if outward < 0 else -sum(lane.width for lane in back)
        position = _lane_position(back[::-1], match[1], number)
        return None if position is None else -(edge + position)
    if backward and not key.endswith("forward"):
        left, right = (back, ahead) if outward < 0 else (ahead, back)
        lanes, edge = left + right, sum(lane.width for lane in left)
    else:
        lanes, edge = ahead, 0.0 if outward < 0 else sum(lane.width for lane in ahead)
    position = _lane_position(lanes, match[1], number)
    return None if position is None else position - edge


def _lane_position(lanes: Sequence[CarriagewayLane], word: str, number: int) -> float | None:
    """Return the distance of a lane's place from the outer border of the first lane, metres."""
    share = {"left_of": 0.0, "middle_of": 0.5}.get(word, 1.0)
    before, counted = 0.0, 0
    for lane in lanes:
        counted += lane.listed
        if lane.listed and counted == number:
            return before + lane.width * share
        before += lane.width
    return None
