"""Positions of the ends of roads and of their lanes."""

from __future__ import annotations

import math

from urbantwin.roads.model import LaneSection, ModelRoad
from urbantwin.roads.opendrive.cubics import value

__all__ = ["Poses", "end_section", "middles"]


class Poses:
    """Where the reference lines of roads start and end; each is looked up once."""

    def __init__(self) -> None:
        self._known: dict[int, dict[str, tuple[float, float, float]]] = {}

    def at(self, road: ModelRoad, end: str) -> tuple[float, float, float]:
        """Return x, y and heading at ``start`` or ``end`` of a road."""
        if road.id not in self._known:
            (x0, y0, h0), (x1, y1, h1) = road.curve.at([0.0, road.length]).tolist()
            self._known[road.id] = {"start": (x0, y0, h0), "end": (x1, y1, h1)}
        return self._known[road.id][end]

    def gap(self, road: ModelRoad, end: str, other: ModelRoad, contact: str) -> float:
        """Return how far the ends of two reference lines lie apart, metres."""
        return math.dist(self.at(road, end)[:2], self.at(other, contact)[:2])

    def nearer(self, road: ModelRoad, end: str, other: ModelRoad) -> str:
        """Return which end of another road lies nearer to an end of a road."""
        return min(("start", "end"), key=lambda contact: self.gap(road, end, other, contact))


def end_section(road: ModelRoad, end: str) -> LaneSection:
    """Return the lane section at the start or the end of a road."""
    return road.sections[0 if end == "start" else -1]


def middles(road: ModelRoad, end: str, poses: Poses) -> dict[int, tuple[float, float]]:
    """Return where the middles of lanes lie at one end of a road."""
    section = end_section(road, end)
    s = 0.0 if end == "start" else road.length
    x, y, heading = poses.at(road, end)
    level = math.cos(value(road.bank, s))
    left = (-math.sin(heading) * level, math.cos(heading) * level)
    found = {}
    for sign in (1, -1):
        t = value(road.offset, s)
        for lane in sorted((e for e in section.lanes if e.id * sign > 0), key=lambda e: abs(e.id)):
            width = value(lane.width, s - section.s)
            middle = t + sign * width / 2
            found[lane.id] = (x + middle * left[0], y + middle * left[1])
            t += sign * width
    return found
