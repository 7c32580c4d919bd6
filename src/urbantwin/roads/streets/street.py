"""Streets: edges that share a road, and the road's reference line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import moved_left
from urbantwin.roads.model.curve import Curve, filleted
from urbantwin.roads.network import Lane, Road, RoadNetwork

__all__ = ["Street", "Strip", "build_streets", "vehicle_lanes"]

#: Two directions share a road where their inner borders are closer than this, metres.
PAIRED_M = 0.3
#: Smaller deviations of lines are mapping inaccuracies, metres.
THINNED_M = 0.1
#: Minimum length of a road after its ends are cut back for junctions, metres.
SHORTEST_M = 0.5


@dataclass(frozen=True)
class Strip:
    """A lane as part of a road.

    Attributes:
        lane: the lane of the network.
        id: negative to the right of the reference line, positive to the left.
        t: offset of its centre from the reference line, metres to the left.
        forward: whether traffic runs along the reference line.
    """

    lane: Lane
    id: int
    t: float
    forward: bool


@dataclass(frozen=True)
class Street:
    """A road outside junctions.

    Attributes:
        number: id of the road.
        edge: the edge of the network that runs along the reference line.
        strips: its lanes, from left to right.
        curve: the reference line, site frame.
        ways: ids of its OSM ways.
    """

    number: int
    edge: Road
    strips: tuple[Strip, ...]
    curve: Curve
    ways: tuple[int, ...]

    @cached_property
    def strip_of(self) -> Mapping[str, Strip]:
        """Strips by lane id."""
        return {strip.lane.id: strip for strip in self.strips}

    @property
    def start(self) -> str:
        """Id of the junction at station 0."""
        return self.edge.from_junction

    @property
    def end(self) -> str:
        """Id of the junction at the last station."""
        return self.edge.to_junction

    def end_of(self, strip: Strip, *, leaving: bool) -> float:
        """Return the station where traffic leaves a lane (``leaving``) or enters it, metres."""
        return self.curve.length if strip.forward == leaving else 0.0


def vehicle_lanes(network: RoadNetwork, edge: Road) -> list[Lane]:
    """Return the lanes of an edge that are not sidewalks, from the kerb inwards; if none, all."""
    lanes = [network.lane_by_id[name] for name in edge.lanes]
    return [lane for lane in lanes if lane.kind != "sidewalk"] or lanes


def build_streets(
    network: RoadNetwork,
    edges: list[Road],
    trims: Mapping[tuple[str, str], float],
    *,
    side: int,
) -> tuple[Street, ...]:
    """Return roads made of edges; the two directions of a street share one.

    Args:
        network: the network.
        edges: edges that become roads.
        trims: (edge id, ``start`` or ``end``) -> length left to the junction there, metres.
        side: -1: lanes along the reference line lie to its right; 1: to its left.
    """
    streets: list[Street] = []
    used: set[str] = set()
    partner = _partners(network, edges, side)
    for edge in sorted(edges, key=lambda e: (e.id.startswith("-"), e.id)):
        if edge.id in used:
            continue
        other = partner.get(edge.id)
        used |= {edge.id} | ({other.id} if other else set())
        streets.append(_street(network, len(streets) + 1, edge, other, trims, side))
    return tuple(streets)


def _partners(network: RoadNetwork, edges: list[Road], side: int) -> dict[str, Road]:
    partners: dict[str, Road] = {}
    by_ends: dict[tuple[str, str], list[Road]] = {}
    for edge in edges:
        by_ends.setdefault((edge.from_junction, edge.to_junction), []).append(edge)
    for edge in edges:
        for other in by_ends.get((edge.to_junction, edge.from_junction), []):
            if {edge.id, other.id} & partners.keys() or other.id == edge.id:
                continue
            inner = network.lane_by_id[edge.lanes[-1]]
            borders = [_inner_border(network, e, side) for e in (edge, other)]
            shorter, longer = sorted(borders, key=lambda line: float(line.length))
            if inner.opposite == other.lanes[-1] or _furthest(shorter, longer) < PAIRED_M:
                partners[edge.id], partners[other.id] = other, edge
    return partners


def _inner_border(network: RoadNetwork, edge: Road, side: int) -> shapely.LineString:
    lane = network.lane_by_id[edge.lanes[-1]]
    return shapely.LineString(moved_left(lane.centre[:, :2], -side * lane.width / 2))


def _furthest(line: shapely.LineString, other: shapely.LineString) -> float:
    inner = line.segmentize(2.0)
    return float(shapely.distance(shapely.points(shapely.get_coordinates(inner)), other).max())


def _street(
    network: RoadNetwork,
    number: int,
    edge: Road,
    other: Road | None,
    trims: Mapping[tuple[str, str], float],
    side: int,
) -> Street:
    outwards = [network.lane_by_id[name] for name in edge.lanes[::-1]]
    strips = _strips(outwards, side, forward=True)
    if other is not None:
        against = [network.lane_by_id[name] for name in other.lanes[::-1]]
        if outwards[0].opposite == against[0].id:
            # One lane for both directions: it lies on the side of the forward lanes.
            strips.append(replace(strips[0], lane=against[0], forward=False))
            against = against[1:]
        strips += _strips(against, -side, forward=False)
    base = next((s for s in strips if s.forward and s.lane.kind != "sidewalk"), strips[0])
    line = moved_left(_thinned(base.lane.centre[:, :2]), -base.t)
    reach = [strip.t + strip.lane.width / 2 for strip in strips]
    reach += [strip.t - strip.lane.width / 2 for strip in strips]
    full_curve = filleted(line, left=max(reach), right=-min(reach))
    first, last = _extent(full_curve, strips)
    first += max(trims.get((edge.id, "start"), 0.0), _trim(trims, other, "end"))
    last -= max(trims.get((edge.id, "end"), 0.0), _trim(trims, other, "start"))
    if last - first < SHORTEST_M:
        # Too short to be cut: keep the middle, or the whole road.
        half = min(SHORTEST_M, full_curve.length) / 2
        middle = float(np.clip((first + last) / 2, half, full_curve.length - half))
        first, last = middle - half, middle + half
    curve = full_curve.between(first, last)
    strips = sorted(strips, key=lambda strip: -strip.t)
    ways = {*edge.ways, *(other.ways if other else ())}
    return Street(number, edge, tuple(strips), curve, tuple(sorted(ways)))


def _trim(trims: Mapping[tuple[str, str], float], edge: Road | None, end: str) -> float:
    return trims.get((edge.id, end), 0.0) if edge is not None else 0.0


def _strips(lanes: list[Lane], side: int, *, forward: bool) -> list[Strip]:
    result = []
    inner = 0.0
    for number, lane in enumerate(lanes, start=1):
        result.append(Strip(lane, side * number, side * (inner + lane.width / 2), forward))
        inner += lane.width
    return result


def _thinned(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Remove points that are collinear within the accuracy of maps."""
    return np.asarray(shapely.get_coordinates(shapely.LineString(points).simplify(THINNED_M)))


def _extent(curve: Curve, strips: list[Strip]) -> tuple[float, float]:
    """Return the range of stations where all lanes for vehicles exist, metres."""
    vehicles = [strip for strip in strips if strip.lane.kind != "sidewalk"] or strips
    xy = np.vstack([strip.lane.centre[[0, -1], :2] for strip in vehicles])
    ends = curve.locate(xy)[0].reshape(-1, 2)
    first, last = float(ends.min(axis=1).max()), float(ends.max(axis=1).min())
    return max(0.0, first), min(curve.length, last)
