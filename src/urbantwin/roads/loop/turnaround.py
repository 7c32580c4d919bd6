"""Turnarounds of streets just beyond the border."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import Protocol, TypeVar

import numpy as np
import shapely

from urbantwin.roads.loop.dubins import BUS_RADIUS_M
from urbantwin.roads.loop.free_space import Points, band, dubins_points, unit
from urbantwin.roads.loop.layout import (
    CLEARANCE_M,
    Gate,
    Layout,
    half_width,
    outer_tags,
    turning_radius,
)
from urbantwin.roads.loop.road_ends import LooseEnd

__all__ = ["BENDS", "NEAR_M", "add_turnaround", "join_carriageways", "near_pairs"]

#: Half of the angle between the two legs of a turnaround, radians.
SPLAY = math.radians(35.0)
#: Candidate lengths of the straight part before a turnaround, metres, which keep junctions out of
#: the region.
STEMS_M = (14.0, 22.0, 32.0, 44.0, 58.0, 75.0, 95.0, 120.0)
#: Candidate bends of a street at the border to find room, radians.
BENDS = tuple(math.radians(angle) for angle in (0, 15, -15, 30, -30, 45, -45, 60, -60))
#: Maximum distance between two carriageways that are joined directly: sideways, and in total,
#: metres.
NEAR_M, NEAR_AHEAD_M = 45.0, 120.0
#: Length of the straight part of their legs, metres, and candidate angles apart, radians.
LEG_M = 4.0
SPLAYS = tuple(math.radians(angle) for angle in (0, 15, 30, 45, 55))
#: Speed limit on a turnaround, km/h: about 2.8 m/s^2 lateral at the usual radius of 11 m.
DROP_KMH = 20


def add_turnaround(layout: Layout, end: LooseEnd, street: int) -> Gate:
    """Extend a two-way street to a turnaround, and return the turnaround's far point."""
    lanes, width = end.enters, end.enters * end.lane_m
    tags = _tags(layout, end.piece.tags, lanes, end.lane_m)
    half = half_width(width, tags) + CLEARANCE_M
    stem_half = half_width((end.leaves + end.enters) * end.lane_m, end.piece.tags)

    def choice(radius: float, stem: float, bend: float) -> tuple[float, Points, shapely.Geometry]:
        heading = end.heading + bend
        tip = end.point + unit(heading) * stem
        line = _turnaround_line(tip, heading, radius, layout.turn)
        road = band(np.array([end.point + unit(heading), tip]), stem_half)
        area = road.union(shapely.Polygon(line).buffer(half))
        return heading, line, area

    radii = (turning_radius(width), BUS_RADIUS_M)
    places = (choice(*option) for option in product(radii, STEMS_M, BENDS))
    heading, line, area = layout.with_most_room(places, lambda place: place[2], street)
    layout.space.take(area)
    node, far_node, middle = layout.new_node(), layout.new_node(), len(line) // 2
    layout.lengthen(street, node, line[0], at_start=end.at_start)
    out = layout.add(line[: middle + 1], tags, first=node, last=far_node)
    back = layout.add(line[middle:], tags, first=far_node, last=node)
    layout.no_turns.append((back, node, out))
    return Gate(far_node, line[middle], heading, -1, end.piece.tags, lanes, end.lane_m)


class Directed(Protocol):
    """A position (2,) and a heading outwards, radians."""

    @property
    def point(self) -> Points: ...
    @property
    def heading(self) -> float: ...


End = TypeVar("End", bound=Directed)


def near_pairs(exits: Sequence[End], entries: Sequence[End]) -> list[tuple[End, End]]:
    """Return pairs of adjacent exits and entries, the nearest first: two carriageways each."""
    pairs = sorted(
        (_lateral_distance(a, b), i, j)
        for i, a in enumerate(exits)
        for j, b in enumerate(entries)
        if math.cos(a.heading - b.heading) > 0.5
        and float(np.linalg.norm(a.point - b.point)) < NEAR_AHEAD_M
    )
    chosen: list[tuple[End, End]] = []
    for distance, i, j in pairs:
        used = any(exits[i] is a or entries[j] is b for a, b in chosen)
        if distance < NEAR_M and not used:
            chosen.append((exits[i], entries[j]))
    return chosen


def join_carriageways(layout: Layout, exit_: Gate, entry: Gate) -> None:
    """Join the two carriageways of a street by a turnaround."""
    lane_m = max(exit_.lane_m, entry.lane_m)
    width = entry.lanes * lane_m
    tags = _tags(layout, exit_.tags, entry.lanes, lane_m)
    half, radius = half_width(width, tags) + CLEARANCE_M, turning_radius(width)
    ahead = exit_.ahead + entry.ahead
    ahead /= np.linalg.norm(ahead)
    across = entry.point - exit_.point
    side = 1.0 if ahead[0] * across[1] - ahead[1] * across[0] > 0 else -1.0
    # Both turns begin at the same distance outwards.
    front = max(float(exit_.point @ ahead), float(entry.point @ ahead))

    def turnaround_line(stem: float, splay: float) -> Points:
        """Return legs straight to the front, then apart by the splay, then joined."""
        poses = []
        for gate, bend in ((exit_, -side * splay), (entry, side * splay)):
            step = front - float(gate.point @ ahead) + LEG_M
            knee = gate.point + gate.ahead * step / float(gate.ahead @ ahead)
            tip = knee + unit(gate.heading + bend) * (stem - LEG_M) / math.cos(splay)
            poses.append((knee, tip, gate.heading + bend))
        (knee, tip, course), (last_knee, last_tip, last_course) = poses
        start = (float(tip[0]), float(tip[1]), course)
        end = (float(last_tip[0]), float(last_tip[1]), last_course + math.pi)
        turn = "left" if side > 0 else "right"
        return np.vstack(
            [exit_.point, knee, dubins_points(start, end, radius, turn), last_knee, entry.point]
        )

    def area_of(line: Points) -> shapely.Polygon:
        return band(line, half)

    def twice(line: Points) -> float:
        length = float(shapely.LineString(line).length)
        return max(length * width - float(band(line, width / 2).area), 0.0)

    lines = (turnaround_line(stem, splay) for stem in STEMS_M for splay in SPLAYS)
    streets = (exit_.street, entry.street, *exit_.beside, *entry.beside)
    line = layout.with_most_room(lines, area_of, *streets, twice=twice)
    layout.space.take(area_of(line))
    # The halves meet at the tip: one leg may be much longer than the other, and where the two ways
    # are side by side netconvert would make a junction of the turn.
    tip = int((line[1:-1] @ ahead).argmax()) + 1
    layout.add_halves(line, tags, first=exit_.node, last=entry.node, half=tip)


def _lateral_distance(gate: Directed, other: Directed) -> float:
    """Return the lateral distance of a gate from another, metres."""
    ahead = unit(gate.heading) + unit(other.heading)
    gap = other.point - gate.point
    return abs(float(ahead[0] * gap[1] - ahead[1] * gap[0])) / float(np.linalg.norm(ahead))


def _tags(layout: Layout, street: dict[str, str], lanes: int, lane_m: float) -> dict[str, str]:
    """Return the tags of a turnaround, with a sidewalk on its outer side."""
    side = layout.side
    return outer_tags(street, lanes, lane_m, side=side, kmh=DROP_KMH, sidewalks=side)


def _turnaround_line(tip: Points, heading: float, radius: float, turn: str) -> Points:
    """Return the line (N, 2) of a turnaround from the end of a street and back."""
    splay = SPLAY if turn == "left" else -SPLAY
    x, y = (float(v) for v in tip)
    start, end = (x, y, heading - splay), (x, y, heading + math.pi + splay)
    return dubins_points(start, end, radius, turn)
