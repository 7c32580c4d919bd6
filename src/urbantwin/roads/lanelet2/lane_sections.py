"""Lane sections from borders: offsets, widths, marks, and heights of the reference line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads.lanelet2.border import Measured, profile_of, stations_between
from urbantwin.roads.lanelet2.traffic_rules import mark_of
from urbantwin.roads.model import Curve, LaneSection, Profile, SectionLane, fitted

__all__ = ["Row", "heights_of", "section_of"]

#: Spacing of the samples to which cubics are fitted, metres.
FINE_M = 0.25
#: Tolerance of heights, metres, and of superelevation, radians.
HEIGHT_M, BANK_RAD = 0.01, 0.001

Pair = tuple[Measured, Measured]


@dataclass(frozen=True)
class Row:
    """Attributes of a lane.

    Attributes:
        kind: kind of lane.
        forward: whether it runs along the road.
        speed_limit: m/s.
        allowed: classes of actors.
        lines: way of the left and of the right border, each with whether it is drawn against the
            road.
    """

    kind: str
    forward: bool
    speed_limit: float
    allowed: tuple[str, ...]
    lines: tuple[tuple[int, bool], tuple[int, bool]]


def section_of(
    reach: tuple[float, float],
    borders: Sequence[Pair],
    split: int,
    rows: Sequence[Row],
    bank: Profile,
    ways: Mapping[int, dict[str, str]],
) -> tuple[LaneSection, Profile]:
    """Return a lane section and the offset of its lanes.

    Args:
        reach: stations of its start and end, metres.
        borders: left and right border of each lane, from left to right.
        split: number of lanes to the left of the reference line.
        rows: attributes of each lane.
        bank: superelevation: widths are measured along the tilted surface.
        ways: tags of the map's ways.
    """
    knots = stations_between(*reach, [border for pair in borders for border in pair])
    fine = _fine(knots)
    tilt = np.cos(bank.at(fine))
    middle = borders[split][0] if split < len(borders) else borders[-1][1]
    offset = middle.at(fine)[0] / tilt
    lanes: dict[int, SectionLane] = {}
    for step, numbers, outer in (
        (1, range(split - 1, -1, -1), 0),
        (-1, range(split, len(borders)), 1),
    ):
        edge = offset
        for j in numbers:
            outer_t = borders[j][outer].at(fine)[0] / tilt
            width = np.maximum(step * (outer_t - edge), 0.0)
            edge = edge + step * width
            identity = step * (len([k for k in lanes if k * step > 0]) + 1)
            row = rows[j]
            mark, change = _mark(row.lines[outer], identity, ways)
            lanes[identity] = SectionLane(
                identity,
                row.kind,
                profile_of(knots, fine, width),
                row.forward,
                row.speed_limit,
                row.allowed,
                mark=mark,
                change=change,
            )
    line = rows[split].lines[0] if split < len(rows) else rows[-1].lines[1]
    mark, change = mark_of(ways.get(line[0], {}), turned=line[1])
    ordered = tuple(lanes[k] for k in sorted(lanes, reverse=True))
    return LaneSection(reach[0], ordered, mark, change), profile_of(knots, fine, offset)


def heights_of(
    curve: Curve,
    stations: Sequence[float],
    orders: Sequence[Sequence[tuple[object, Pair]]],
) -> tuple[Profile, Profile]:
    """Return elevation and superelevation: the least-squares line through each section's borders.

    Args:
        curve: the reference line.
        stations: start stations of the sections, and the end, metres.
        orders: borders of the lanes of each section.
    """
    s = np.linspace(0.0, curve.length, max(3, int(curve.length) + 2))
    height, slope = np.zeros(len(s)), np.zeros(len(s))
    for k, order in enumerate(orders):
        last = k == len(orders) - 1
        in_section = (s >= stations[k]) & ((s < stations[k + 1]) | last)
        rows = [border.at(s[in_section]) for _, pair in order for border in pair]
        t, z = (np.array([row[i] for row in rows]) for i in (0, 1))
        mean_t, mean_z = t.mean(axis=0), z.mean(axis=0)
        spread = ((t - mean_t) ** 2).sum(axis=0)
        rise = ((t - mean_t) * (z - mean_z)).sum(axis=0)
        slope[in_section] = np.where(spread > 1e-6, rise / np.maximum(spread, 1e-6), 0.0)
        height[in_section] = mean_z - slope[in_section] * mean_t
    if np.abs(height).max() < 1e-9 and np.abs(slope).max() < 1e-9:
        return Profile.constant(0.0), Profile.constant(0.0)
    bank = np.arctan(slope)
    return fitted(s, height, tolerance=HEIGHT_M), fitted(s, bank, tolerance=BANK_RAD)


def _fine(knots: NDArray[np.float64]) -> NDArray[np.float64]:
    parts = [np.linspace(a, b, max(6, int((b - a) / FINE_M) + 2))[:-1] for a, b in pairwise(knots)]
    return np.concatenate([*parts, knots[-1:]])


def _mark(
    line: tuple[int, bool], identity: int, ways: Mapping[int, dict[str, str]]
) -> tuple[str, str]:
    mark, change = mark_of(ways.get(line[0], {}), turned=line[1])
    if identity > 0 and " " in mark:
        # Double lines are named from the inside outwards.
        mark = " ".join(reversed(mark.split()))
    return mark, change
