"""Streets: chains of groups of lanelets as roads of the lane model."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads.lanelet2.border import Border, Measured
from urbantwin.roads.lanelet2.group import Group, Member
from urbantwin.roads.lanelet2.lane_sections import Row, heights_of, section_of
from urbantwin.roads.lanelet2.plan import Chain
from urbantwin.roads.lanelet2.reference_line import Pose, smooth_curve, trimmed
from urbantwin.roads.model import Curve, LaneSection, ModelRoad, Profile

__all__ = ["Street", "StreetTooShort", "Track", "joined", "street_of"]

#: Minimum remaining length of a street between its junctions, metres.
LEAST_M = 1.0
#: Minimum length of a lane section, metres.
LEAST_SECTION_M = 0.2
#: Length over which the direction of a border at its end is measured, metres.
END_M = 3.0


class StreetTooShort(Exception):  # noqa: N818 - not an error: the chain is planned anew
    """A chain has no station that all its borders reach."""


@dataclass(frozen=True, eq=False)
class Street:
    """A road with its measurements.

    Attributes:
        road: the road.
        chain: the groups that it was made from.
        lanes: per section: track -> id of the lane.
        spans: per section: indices of its groups in the chain.
        whole: per track, both borders on the untrimmed reference line.
        reach: stations of that line at which the road begins and ends, metres.
        dropped: number of border corners that turn back.
    """

    road: ModelRoad
    chain: Chain
    lanes: tuple[dict[Track, int], ...]
    spans: tuple[tuple[int, ...], ...]
    whole: dict[Track, tuple[Measured, Measured]]
    reach: tuple[float, float]
    dropped: int


@dataclass(frozen=True, eq=False)
class Track:
    """A lane that continues through several groups.

    Attributes:
        first: index of the first group in the chain.
        members: one lanelet per group from there on.
        left: its left border along the chain (N, 3).
        right: its right border.
    """

    first: int
    members: tuple[Member, ...]
    left: NDArray[np.float64]
    right: NDArray[np.float64]

    def member(self, group: int) -> Member:
        """Return its lanelet in a group of the chain."""
        return self.members[group - self.first]


def street_of(
    identity: int,
    chain: Chain,
    follows: Callable[[int, int], bool],
    side: str,
    attributes: Callable[[Member], Row],
    ways: Mapping[int, dict[str, str]],
) -> Street:
    """Return a chain of groups as a road.

    Args:
        identity: id of the road.
        chain: the groups.
        follows: whether one lanelet leads to another.
        side: driving side, ``right`` or ``left``.
        attributes: function that returns the attributes of a lanelet along its road.
        ways: tags of the map's ways, for the lines between lanes.

    Raises:
        StreetTooShort: its ends are so oblique that nothing remains between them.
    """
    tracks = tracks_of(chain.groups, follows)
    # Adjacent lanes share a border, which is measured once.
    borders = {
        line.tobytes(): Border(line) for track in tracks for line in (track.left, track.right)
    }
    line = _middle_line(chain, side)
    pins = (_pose(line[0], line[1]), _pose(line[-1], 2 * line[-1] - line[-2]))
    followed = smooth_curve(line, list(borders.values()), pins)
    seen = dict(zip(borders, followed.borders, strict=True))
    borders_of = {
        track: (seen[track.left.tobytes()], seen[track.right.tobytes()]) for track in tracks
    }
    first, last = _reach(chain, tracks, borders_of)
    if last - first < LEAST_M:
        raise StreetTooShort
    curve = trimmed(followed.curve, first, last)
    in_range = {
        key: border.window(first - 1.0, last + 1.0).along(curve) for key, border in seen.items()
    }
    measured = {t: (in_range[t.left.tobytes()], in_range[t.right.tobytes()]) for t in tracks}
    spans, stations = _sections(chain, tracks, curve, attributes)
    orders = [_across(chain, tracks, span[0], measured) for span in spans]
    elevation, bank = heights_of(curve, stations, orders)
    sections: list[LaneSection] = []
    lanes: list[dict[Track, int]] = []
    offsets: list[Profile] = []
    for span, start, order in zip(spans, stations[:-1], orders, strict=True):
        row = [track for track, _ in order]
        split = divider(Group(tuple(track.member(span[0]) for track in row)), side)
        ids = {t: split - j if j < split else split - j - 1 for j, t in enumerate(row)}
        end = stations[len(sections) + 1]
        rows = [attributes(track.member(span[0])) for track in row]
        section, offset = section_of(
            (start, end), [pair for _, pair in order], split, rows, bank, ways
        )
        sections.append(section)
        offsets.append(offset)
        lanes.append(ids)
    linked = _linked(sections, lanes)
    members = [member for group in chain.groups for member in group.members]
    road = ModelRoad(
        identity,
        _most_frequent_tag(members, "name"),
        _most_frequent_tag(members, "highway") or _class(members),
        tuple(member.lanelet.id for member in members),
        -1,
        curve,
        Profile(
            np.concatenate([p.start + s for p, s in zip(offsets, stations, strict=False)]),
            np.vstack([p.abcd for p in offsets]),
        ),
        elevation,
        bank,
        Profile.constant(0.0),
        linked,
    )
    dropped = sum(border.dropped for border in in_range.values())
    return Street(road, chain, tuple(lanes), spans, borders_of, (first, last), dropped)


def divider(group: Group, side: str) -> int:
    """Return the number of lanes to the left of the reference line.

    In right-hand traffic: all before the first lane that runs along the group. In left-hand
    traffic: all up to the last such lane.
    """
    ahead = [k for k, m in enumerate(group.members) if m.lanelet.drives and m.forward]
    if not ahead:
        return 0 if side == "right" else len(group.members)
    return ahead[0] if side == "right" else ahead[-1] + 1


def _middle_line(chain: Chain, side: str) -> NDArray[np.float64]:
    """Return the border (N, 2) between directions, extended beyond all other borders."""
    lines = []
    for group in chain.groups:
        k = divider(group, side)
        lines.append(group.members[k].left if k < len(group.members) else group.members[-1].right)
    line = joined(lines)[:, :2]
    for k, group in ((0, chain.groups[0]), (-1, chain.groups[-1])):
        if k == 0:
            line = line[::-1]
        back = np.linalg.norm(line - line[-1], axis=1) > END_M
        before = line[np.flatnonzero(back)[-1]] if back.any() else line[0]
        ahead = (line[-1] - before) / np.linalg.norm(line[-1] - before)
        ends = np.array([p[k][:2] for m in group.members for p in (m.left, m.right)])
        reach = max(0.0, float(((ends - line[-1]) @ ahead).max())) + 1.0
        line = np.vstack([line, line[-1] + reach * ahead])
        if k == 0:
            line = line[::-1]
    return line


def _pose(point: NDArray[np.float64], ahead: NDArray[np.float64]) -> Pose:
    dx, dy = ahead - point
    return float(point[0]), float(point[1]), math.atan2(dy, dx)


def _reach(
    chain: Chain, tracks: Sequence[Track], whole: Mapping[Track, tuple[Measured, Measured]]
) -> tuple[float, float]:
    """Return the stations at which the road begins and ends, metres.

    At a junction all lanes must exist across the road; at a free end it is sufficient that one
    does.
    """
    last = len(chain.groups) - 1
    head, tail = chain.cuts
    starts = [
        border.s[0]
        for t in tracks
        if t.first == 0 and (head is None or t.members[0].lanelet.drives)
        for border in whole[t]
    ]
    ends = [
        border.s[-1]
        for t in tracks
        if t.first + len(t.members) - 1 == last and (tail is None or t.members[-1].lanelet.drives)
        for border in whole[t]
    ]
    first = min(starts) if head is None else max(starts) + head
    end = max(ends) if tail is None else min(ends) - tail
    if head is None or tail is None:
        # No other road could contain the missing part.
        short = max(0.0, LEAST_M + 1e-6 - (end - first))
        first, end = (first - short, end) if head is None else (first, end + short)
    return max(float(first), 0.0), min(float(end), next(iter(whole.values()))[0].curve.length)


def _sections(
    chain: Chain,
    tracks: Sequence[Track],
    curve: Curve,
    attributes: Callable[[Member], Row],
) -> tuple[tuple[tuple[int, ...], ...], list[float]]:
    """Return the groups of each lane section, and the stations between them with both ends."""
    spans, stations = [[0]], [0.0]
    for k in range(1, len(chain.groups)):
        before = [t for t in tracks if t.first <= k - 1 < t.first + len(t.members)]
        after = [t for t in tracks if t.first <= k < t.first + len(t.members)]
        same_tracks = len(before) == len(after) and all(t in after for t in before)
        if same_tracks and all(
            attributes(t.member(k - 1)) == attributes(t.member(k)) for t in after
        ):
            spans[-1].append(k)
            continue
        seams = [
            curve.locate(point[None, :2])[0][0]
            for t in after
            for point in (t.member(k).left[0], t.member(k).right[0])
            if t.member(k).lanelet.drives
        ]
        seam_s = float(np.mean(seams))
        if seam_s < stations[-1] + LEAST_SECTION_M:
            # The previous section was cut off: this one begins at its start.
            spans[-1] = [k]
        elif seam_s < curve.length - LEAST_SECTION_M:
            spans.append([k])
            stations.append(seam_s)
        else:
            break
    return tuple(map(tuple, spans)), [*stations, curve.length]


def _across(
    chain: Chain,
    tracks: Sequence[Track],
    group: int,
    measured: Mapping[Track, tuple[Measured, Measured]],
) -> list[tuple[Track, tuple[Measured, Measured]]]:
    """Return the tracks of a group from left to right with their borders."""
    track_of = {
        t.member(group).lanelet.id: t for t in tracks if 0 <= group - t.first < len(t.members)
    }
    row = [track_of[member.lanelet.id] for member in chain.groups[group].members]
    return [(track, measured[track]) for track in row]


def _linked(
    sections: Sequence[LaneSection], lanes: Sequence[Mapping[Track, int]]
) -> tuple[LaneSection, ...]:
    linked = []
    for k, section in enumerate(sections):
        track_of = {identity: track for track, identity in lanes[k].items()}
        before = lanes[k - 1] if k else {}
        after = lanes[k + 1] if k + 1 < len(lanes) else {}
        linked.append(
            replace(
                section,
                lanes=tuple(
                    replace(
                        lane,
                        predecessor=before.get(track_of[lane.id]),
                        successor=after.get(track_of[lane.id]),
                    )
                    for lane in section.lanes
                ),
            )
        )
    return tuple(linked)


def _most_frequent_tag(members: Sequence[Member], key: str) -> str:
    """Return the most frequent value of a tag; of equals the first."""
    values = [m.lanelet.tags[key] for m in members if m.lanelet.tags.get(key)]
    return max(values, key=values.count, default="")


def _class(members: Sequence[Member]) -> str:
    subtypes = {m.lanelet.tags.get("subtype") for m in members}
    if "highway" in subtypes:
        return "motorway"
    return "living_street" if "play_street" in subtypes else ""


def joined(lines: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return polylines joined to one, without consecutive duplicate points."""
    points = np.vstack(lines)
    step = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1)
    distinct = points[np.concatenate([[True], step > 1e-4])]
    return distinct if len(distinct) > 1 else points[[0, -1]]


def tracks_of(groups: Sequence[Group], follows: Callable[[int, int], bool]) -> tuple[Track, ...]:
    """Return the lanes of a chain of groups.

    Args:
        groups: the groups, all in the same direction.
        follows: whether one lanelet leads to another.
    """
    open_: list[tuple[int, list[Member]]] = []
    finished: list[tuple[int, list[Member]]] = []
    for k, group in enumerate(groups):
        continuing = []
        waiting = list(open_)
        for member in group.members:
            row = next((row for row in waiting if _goes_on(row[1][-1], member, follows)), None)
            if row is None:
                row = (k, [])
            else:
                waiting.remove(row)
            row[1].append(member)
            continuing.append(row)
        finished += waiting
        open_ = continuing
    return tuple(
        Track(
            first,
            tuple(members),
            joined([m.left for m in members]),
            joined([m.right for m in members]),
        )
        for first, members in finished + open_
    )


def _goes_on(a: Member, b: Member, follows: Callable[[int, int], bool]) -> bool:
    if not a.lanelet.drives or not b.lanelet.drives:
        ends = np.vstack([a.left[-1] - b.left[0], a.right[-1] - b.right[0]])
        return a.lanelet.kind == b.lanelet.kind and bool(np.abs(ends).max() < 1e-6)
    if a.forward != b.forward:
        return False
    before, after = (a, b) if a.forward else (b, a)
    return follows(before.lanelet.id, after.lanelet.id)
