"""The strip that a plain edge covers, as netconvert lays it out."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
import shapely.ops
from numpy.typing import NDArray

from urbantwin.geometry import moved_left
from urbantwin.roads.junctions.plain import PlainEdge, PlainLink, PlainNetwork, PlainNode

__all__ = ["Strip", "cut", "heading_of", "split_edges"]

#: Length over which a line's heading at an end is averaged: mapped lines have short kinks, metres.
HEADING_M = 6.0
#: Points closer than this to the ends of a cut line are dropped, metres: so short a leg has no
#: reliable heading.
LEG_M = 0.2


@dataclass(frozen=True, eq=False)
class Strip:
    """An edge in plan.

    Attributes:
        edge: the edge.
        outward: side of the lanes of edges that are not centred on their line: -1 to its right
            (right-hand traffic), 1 to its left.
    """

    edge: PlainEdge
    outward: int

    @cached_property
    def middle(self) -> shapely.LineString:
        """The centre line of all lanes, in the direction of travel."""
        if self.edge.centred:
            return self.edge.line
        half = self.outward * self.edge.width / 2
        return shapely.LineString(moved_left(self.edge.shape, half))

    def across(self, lane: int) -> float:
        """Return the offset of a lane's centre to the left of the strip's centre line, metres.

        Lanes are counted from the kerb, which is at the outward side.
        """
        before = sum(other.width for other in self.edge.lanes[:lane])
        return self.outward * (self.edge.width / 2 - before - self.edge.lanes[lane].width / 2)

    def driven(self) -> tuple[float, float]:
        """Return the range of offsets to the left of the centre line that vehicles use, metres."""
        ends = [
            self.across(k) + side * lane.width / 2
            for k, lane in enumerate(self.edge.lanes)
            for side in (-1, 1)
            if any(lane.admits(name) for name in ("passenger", "bus", "bicycle"))
        ]
        return (min(ends), max(ends)) if ends else (0.0, 0.0)

    def at(self, station: float) -> NDArray[np.float64]:
        """Return x, y, heading (3,) of the centre line at a station from the start, metres."""
        return pose_on(self.middle, station)

    def corners(self, station: float, *, driven: bool = False) -> NDArray[np.float64]:
        """Return the right and left ends (2, 2) of the line across the strip at a station."""
        low, high = self.driven() if driven else (-self.edge.width / 2, self.edge.width / 2)
        x, y, heading = self.at(station)
        left = np.array([-np.sin(heading), np.cos(heading)])
        return np.array([[x, y] + low * left, [x, y] + high * left])

    def area(self, first: float, last: float) -> shapely.Polygon:
        """Return the area between two stations."""
        part = shapely.ops.substring(self.middle, first, last)
        if part.geom_type != "LineString":
            return shapely.Polygon()
        return part.buffer(self.edge.width / 2, cap_style="flat", join_style="mitre")


def pose_on(line: shapely.LineString, station: float) -> NDArray[np.float64]:
    """Return x, y, heading (3,) of a line at a station, with the heading over about 1 m."""
    half = min(0.5, line.length / 4)
    along = float(np.clip(station, 0.0, line.length))
    a, b = (line.interpolate(float(np.clip(along + d, 0.0, line.length))) for d in (-half, half))
    point = line.interpolate(along)
    return np.array([point.x, point.y, np.arctan2(b.y - a.y, b.x - a.x)])


def heading_of(line: shapely.LineString, *, at_end: bool) -> float:
    """Return the heading of a line at its start or end, averaged over `HEADING_M`, radians."""
    reach = min(HEADING_M, line.length)
    first, last = (line.length - reach, line.length) if at_end else (0.0, reach)
    a, b = line.interpolate(first), line.interpolate(last)
    return float(np.arctan2(b.y - a.y, b.x - a.x))


def cut(line: shapely.LineString, first: float, last: float) -> NDArray[np.float64]:
    """Return the points (N, 2) of a line between two stations."""
    points = np.asarray(shapely.get_coordinates(shapely.ops.substring(line, first, last)))
    ends = points[[0, -1]]
    is_near = np.linalg.norm(points[:, None] - ends[None], axis=2).min(axis=1) < LEG_M
    is_near[[0, -1]] = False
    return np.asarray(points[~is_near])


def split_edges(
    plain: PlainNetwork, node: PlainNode, stations: Mapping[str, float]
) -> tuple[PlainNetwork, dict[str, str]]:
    """Split edges at a new node; each lane continues on itself.

    The second part keeps the edge's name, and thereby its links at the end.

    Args:
        plain: the network.
        node: the new node.
        stations: edge -> station of the split along its shape, metres.

    Returns:
        The network, and edge -> name of the part that leads to the new node.
    """
    edges: dict[str, PlainEdge] = {}
    before: dict[str, str] = {}
    for name in stations:
        before[name] = _unused(name, {*plain.edges, *before.values()})
    links = [
        replace(link, end=before[link.end]) if link.end in before else link for link in plain.links
    ]
    for name, edge in plain.edges.items():
        if name not in stations:
            edges[name] = edge
            continue
        station, first = stations[name], before[name]
        shapes = cut(edge.line, 0.0, station), cut(edge.line, station, edge.line.length)
        edges[first] = replace(edge, id=first, end=node.id, shape=shapes[0])
        edges[name] = replace(edge, start=node.id, shape=shapes[1])
        links += [
            PlainLink(first, name, k, k)
            for k, lane in enumerate(edge.lanes)
            if lane.admits("passenger") or lane.admits("bus") or lane.admits("bicycle")
        ]
    nodes = {**plain.nodes, node.id: node}
    crossings = tuple(
        replace(item, edges=tuple(_part_at(item.node, name, before, edges) for name in item.edges))
        for item in plain.crossings
    )
    split = replace(plain, nodes=nodes, edges=edges, links=tuple(links), crossings=crossings)
    return split, before


def _part_at(
    node: str, name: str, before: Mapping[str, str], edges: Mapping[str, PlainEdge]
) -> str:
    """Return the part of an edge that is connected to a node."""
    first = before.get(name, name)
    return first if edges[first].start == node else name


def _unused(name: str, used: Collection[str]) -> str:
    """Return a name for the first part of an edge, numbered as by netconvert."""
    base, number = name.partition("#")[0], 1
    while f"{base}#{number}" in used:
        number += 1
    return f"{base}#{number}"
