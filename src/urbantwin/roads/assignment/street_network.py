"""The street network of a class of actors: entries, exits and routes.

A SUMO network is a graph of edges. For one of SUMO's vehicle classes it becomes a sparse matrix of
travel times from edge to edge and a list of *gates*: edges over which traffic enters or leaves the
site. A gate at the border of the region carries through traffic; one inside is a dead end with
little traffic.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse
import shapely
import sumolib.net
from lxml import etree
from numpy.typing import NDArray

from urbantwin.errors import StageError
from urbantwin.roads.junctions.plain import CYCLE_TRACK_TYPE
from urbantwin.roads.sumo_check import reading_sumo_network
from urbantwin.site.usual_traffic import LANE_PER_HOUR, OTHER_PER_HOUR

__all__ = ["Edge", "Gates", "StreetNetwork", "Streets", "has_walkway", "is_cycle_track"]

Edge = Any  # sumolib.net.edge.Edge; sumolib has no types
_BORDER_M = 30.0  # a gate nearer to the region's border is a street cut by it
#: Relative traffic of bicycles on a separate cycle track: that of two lanes of the class of street
#: that has such tracks.
CYCLE_TRACK_PER_HOUR = 2 * LANE_PER_HOUR["primary"]
_DEAD_END_SHARE = 0.1  # traffic of a gate inside the region relative to one at its border


@dataclass(frozen=True, eq=False)
class Gates:
    """Ends of edges where traffic enters or leaves.

    Attributes:
        edge: (G,) index of the edge.
        at_start: (G,) whether the gate is the edge's start, else its end.
        weight: (G,) relative traffic.
    """

    edge: NDArray[np.int64]
    at_start: NDArray[np.bool_]
    weight: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Streets:
    """The part of a network open to one class of actors.

    Attributes:
        edges: ids of edges; those from ``street_count`` on are walking areas and crossings.
        street_count: number of edges that are streets, which routes name.
        length_m: (E,) lengths of edges, metres.
        ends: (E, 2, 2) first and last point of each edge, site frame.
        seconds: (E, E) sparse, time from the start of one edge to the start of the next.
        turn_back: pairs of edges that are the two directions of one street.
        entries: gates where actors enter.
        exits: gates where actors leave.
    """

    edges: tuple[str, ...]
    street_count: int
    length_m: NDArray[np.float64]
    ends: NDArray[np.float64]
    seconds: scipy.sparse.csr_array
    turn_back: frozenset[tuple[int, int]]
    entries: Gates
    exits: Gates


class StreetNetwork:
    """A network written by netconvert, in the site frame.

    Args:
        path: the ``.net.xml``.
        region: the site's region (site frame); ``None`` for equal weights of all gates.
        without: ids of edges to ignore: outer roads, where traffic passes through.

    Raises:
        StageError: the file is not a SUMO network.
    """

    def __init__(
        self,
        path: Path,
        region: shapely.Polygon | None,
        *,
        without: Set[str] = frozenset(),
    ) -> None:
        try:
            etree.parse(path)  # first, because sumolib does not close a file that it cannot read
        except etree.XMLSyntaxError as error:
            raise StageError(f"{path.name} is not a SUMO network ({error})") from error
        with reading_sumo_network(path):
            self._net: Any = sumolib.net.readNet(
                str(path), withInternal=True, withPedestrianConnections=True, withFoes=False
            )
        self._border = None if region is None else shapely.boundary(region)
        streets = self._net.getEdges(withInternal=False)
        edges = (edge for edge in streets if edge.getID() not in without)
        self._streets = sorted(edges, key=lambda edge: str(edge.getID()))

    @property
    def streets(self) -> list[Edge]:
        """Edges outside junctions, sorted by id."""
        return self._streets

    @property
    def corners(self) -> list[Edge]:
        """Walking areas and crossings, sorted by id."""
        inside = self._net.getEdges(withInternal=True)
        edges = [edge for edge in inside if edge.getFunction() in ("walkingarea", "crossing")]
        return sorted(edges, key=lambda edge: str(edge.getID()))

    def allowing(self, vclass: str) -> list[Edge]:
        """Return the streets that a SUMO class may use; trams use rails only."""
        edges = [edge for edge in self._streets if edge.allows(vclass)]
        if vclass == "tram":
            return [edge for edge in edges if not edge.allows("passenger")]
        return edges

    def way_over(self, edge: Edge, following: Edge) -> float:
        """Return the length of the connection between two edges over the junction, metres."""
        lanes = (item.getViaLaneID() for item in edge.getOutgoing().get(following, []))
        return max(
            (float(self._net.getLane(lane).getLength()) for lane in lanes if lane), default=0.0
        )

    def driven_by(self, vclass: str) -> Streets | None:
        """Return the streets of a SUMO vehicle class; ``None`` if there are none.

        A street without successor is an exit, one without predecessor an entry; U-turns do not
        count. In a network without such ends (a ring) every edge is both.
        """
        edges = self.allowing(vclass)
        if not edges:
            return None
        index = {edge.getID(): number for number, edge in enumerate(edges)}
        turn_back = _opposite_directions(edges)
        arcs: dict[tuple[int, int], float] = {}
        for number, edge in enumerate(edges):
            for following in edge.getAllowedOutgoing(vclass):
                other = index.get(following.getID())
                if other is not None and (number, other) not in turn_back:
                    arcs[number, other] = edge.getLength() / edge.getSpeed()
        leads_on = {start for start, _ in arcs}
        led_to = {end for _, end in arcs}
        rank = np.array([self.rank(edge, vclass) for edge in edges])
        all_numbers = list(range(len(edges)))
        entries = [number for number in all_numbers if number not in led_to] or all_numbers
        exits = [number for number in all_numbers if number not in leads_on] or all_numbers
        return Streets(
            tuple(index),
            len(edges),
            np.array([float(edge.getLength()) for edge in edges]),
            _ends(edges),
            _matrix(arcs, len(edges)),
            turn_back,
            self._gates(edges, [(number, True) for number in entries], rank),
            self._gates(edges, [(number, False) for number in exits], rank),
        )

    def walked(self) -> Streets | None:
        """Return the streets of pedestrians, both directions; ``None`` if walking is impossible."""
        streets = [edge for edge in self._streets if has_walkway(edge)]
        if not streets:
            return None
        edges = streets + self.corners
        index = {edge.getID(): number for number, edge in enumerate(edges)}
        arcs: dict[tuple[int, int], float] = {}
        joined: set[tuple[int, bool]] = set()
        for number, edge in enumerate(edges):
            for following in edge.getOutgoing():
                other = index.get(following.getID())
                # Sidewalks connect through walking areas; other connections are for bicycles.
                if other is None or "walkingarea" not in (
                    edge.getFunction(),
                    following.getFunction(),
                ):
                    continue
                joined |= {(number, False), (other, True)}
                half = (edge.getLength() + following.getLength()) / 2
                arcs[number, other] = arcs[other, number] = half
        neighbours = self._neighbours()
        ends = []
        for number, edge in enumerate(streets):
            for at_start in (True, False):
                node = edge.getFromNode() if at_start else edge.getToNode()
                if len(neighbours[node.getID()]) < 2 or (number, at_start) not in joined:
                    ends.append((number, at_start))
        if not ends:
            ends = [(number, True) for number in range(len(streets))]
        rank = np.sqrt([self.rank(edge, "pedestrian") for edge in streets])
        gates = self._gates(streets, ends, rank)
        return Streets(
            tuple(index),
            len(streets),
            np.array([float(edge.getLength()) for edge in edges]),
            _ends(edges),
            _matrix(arcs, len(edges)),
            frozenset(),
            gates,
            gates,
        )

    def _neighbours(self) -> dict[str, set[str]]:
        """Return the adjacent nodes of each node."""
        neighbours: dict[str, set[str]] = defaultdict(set)
        for edge in self._streets:
            start, end = edge.getFromNode().getID(), edge.getToNode().getID()
            neighbours[start].add(end)
            neighbours[end].add(start)
        return neighbours

    def rank(self, edge: Edge, vclass: str) -> float:
        """Return the relative traffic of an edge for a class: that of its kind times its lanes."""
        if vclass == "bicycle" and is_cycle_track(edge):
            return CYCLE_TRACK_PER_HOUR
        names = re.findall(r"highway\.(\w+)", edge.getType() or "")
        per_hour = [LANE_PER_HOUR.get(name, OTHER_PER_HOUR) for name in names]
        kind = max(per_hour, default=OTHER_PER_HOUR)
        return kind * float(sum(lane.allows(vclass) for lane in edge.getLanes()))

    def _gates(
        self, edges: list[Edge], ends: list[tuple[int, bool]], rank: NDArray[np.float64]
    ) -> Gates:
        number = np.array([edge for edge, _ in ends], np.int64)
        at_start = np.array([start for _, start in ends], np.bool_)
        weight = rank[number].astype(np.float64)
        if self._border is not None:
            points = _ends(edges)[number, np.where(at_start, 0, 1)]
            is_dead_end = shapely.distance(self._border, shapely.points(points)) > _BORDER_M
            weight = weight * np.where(is_dead_end, _DEAD_END_SHARE, 1.0)
        return Gates(number, at_start, weight)


def _opposite_directions(edges: list[Edge]) -> frozenset[tuple[int, int]]:
    """Return the pairs of edges that link the same two nodes in opposite directions."""
    between: dict[tuple[str, str], list[int]] = defaultdict(list)
    for number, edge in enumerate(edges):
        between[edge.getFromNode().getID(), edge.getToNode().getID()].append(number)
    return frozenset(
        (number, other)
        for (start, end), numbers in between.items()
        for number in numbers
        for other in between.get((end, start), ())
    )


def _ends(edges: list[Edge]) -> NDArray[np.float64]:
    shapes = (edge.getShape() for edge in edges)
    return np.array([(shape[0][:2], shape[-1][:2]) for shape in shapes], np.float64)


def _matrix(arcs: dict[tuple[int, int], float], count: int) -> scipy.sparse.csr_array:
    pairs = np.array(list(arcs), np.int64).reshape(-1, 2)
    cost = np.array(list(arcs.values()), np.float64)
    return scipy.sparse.csr_array((cost, (pairs[:, 0], pairs[:, 1])), shape=(count, count))


def has_walkway(edge: Edge) -> bool:
    """Return whether an edge has a lane for pedestrians that is closed to cars."""
    return any(
        lane.allows("pedestrian") and not lane.allows("passenger") for lane in edge.getLanes()
    )


def is_cycle_track(edge: Edge) -> bool:
    """Return whether an edge is a separate cycle track, not the cycle lane of a street."""
    return edge.getType() == CYCLE_TRACK_TYPE and not edge.allows("passenger")
