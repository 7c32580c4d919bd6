"""SUMO edges of the lane model: one direction of a road, with constant lanes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

from urbantwin.roads.model import LaneModel, LaneSection, ModelRoad, SectionLane

__all__ = [
    "TRAFFIC_KINDS",
    "Edge",
    "Nodes",
    "carries_traffic",
    "edges_of_model",
    "edges_of_road",
    "loops",
]

#: Kinds of lanes with traffic, including pedestrians, and their minimum width, metres: a lane that
#: is narrower all along a section is a taper that has not opened yet.
TRAFFIC_KINDS = {"driving": 1.5, "bus": 1.5, "bicycle": 0.5, "sidewalk": 0.5}
#: A road and one of its ends (``start`` or ``end``).
RoadEnd = tuple[int, str]


@dataclass(frozen=True)
class Edge:
    """A part of a road in one direction with constant lanes.

    Attributes:
        id: ``12`` along the reference line of road 12, ``-12`` against it; ``12#1`` for one of
            several parts.
        road: the road.
        sections: indices of its sections, in the order of the reference line.
        lanes: for each lane, from the kerb inwards, its id in each of the sections.
        forward: whether it runs along the reference line.
    """

    id: str
    road: ModelRoad
    sections: tuple[int, ...]
    lanes: tuple[tuple[int, ...], ...]
    forward: bool

    @property
    def start(self) -> float:
        """Start station on the reference line, metres."""
        return self.road.sections[self.sections[0]].s

    @property
    def end(self) -> float:
        """End station on the reference line, metres."""
        return self.road.section_ends[self.sections[-1]]

    def strip(self, index: int) -> str:
        """Return the id of a lane in the SUMO network."""
        return f"{self.id}_{index}"

    def lane(self, index: int, position: int = 0) -> SectionLane:
        """Return a lane in the first (0) or last (-1) of the sections."""
        return self.road.sections[self.sections[position]].by_id[self.lanes[index][position]]


class Nodes:
    """The nodes of a lane model's edges.

    Args:
        model: the lane model.

    Attributes:
        of_end: the node at each end of each road outside junctions.
        junctions: node -> junction of the model; nodes between two roads only have none.
    """

    def __init__(self, model: LaneModel) -> None:
        self._parent: dict[str, str] = {}
        streets = {road.id for road in model.roads if road.junction < 0}
        junctions = model.junction_by_id
        for road in model.roads:
            for end, link in (("start", road.predecessor), ("end", road.successor)):
                end_name = f"{road.id}.{end}"
                if road.junction >= 0:
                    # Streets linked to a connecting road end at its junction.
                    if link and link.element == "road" and link.id in streets:
                        self._unite(f"J{road.junction}", f"{link.id}.{link.contact}")
                elif link and link.element == "junction" and link.id in junctions:
                    self._unite(f"J{link.id}", end_name)
                elif link and link.element == "road" and link.id in streets:
                    self._unite(end_name, f"{link.id}.{link.contact}")
        self._direct(model, streets)
        self.of_end: dict[RoadEnd, str] = {
            (road, end): self._top(f"{road}.{end}")
            for road in sorted(streets)
            for end in ("start", "end")
        }
        used = set(self.of_end.values())
        self.junctions: dict[str, int] = {}
        for junction in model.junctions:
            node = self._top(f"J{junction.id}")
            if node in used:
                self.junctions.setdefault(node, junction.id)

    def of_edge(self, edge: Edge) -> tuple[str, str]:
        """Return the nodes at the start and the end of an edge, in the order of travel."""
        first, last = edge.sections[0], edge.sections[-1] + 1
        road = edge.road
        start = self.of_end[road.id, "start"] if first == 0 else f"{road.id}#{first}"
        at_road_end = last == len(road.sections)
        end = self.of_end[road.id, "end"] if at_road_end else f"{road.id}#{last}"
        return (start, end) if edge.forward else (end, start)

    def _direct(self, model: LaneModel, streets: set[int]) -> None:
        """Let the roads that a direct junction links end at that junction."""
        for junction in model.junctions:
            for connection in junction.connections:
                if connection.connecting in streets:
                    self._unite(f"J{junction.id}", f"{connection.connecting}.{connection.contact}")

    def _unite(self, first: str, second: str) -> None:
        a, b = sorted((self._top(first), self._top(second)), key=_rank)
        self._parent[b] = a

    def _top(self, name: str) -> str:
        while self._parent.setdefault(name, name) != name:
            name = self._parent[name]
        return name


def carries_traffic(road: ModelRoad, number: int, lane: SectionLane) -> bool:
    """Return whether a lane of a section has traffic: by its kind and its largest width."""
    least = TRAFFIC_KINDS.get(lane.kind)
    if least is None:
        return False
    length = road.section_ends[number] - road.sections[number].s
    return float(lane.width.at([0.0, length / 2, length]).max()) >= least


def edges_of_model(model: LaneModel, borders: Iterable[tuple[int, int]] = ()) -> tuple[Edge, ...]:
    """Return the edges of all roads outside junctions, in the order of the roads.

    Args:
        model: the lane model.
        borders: (road, section) of further boundaries between edges.
    """
    forced = set(borders)
    edges: list[Edge] = []
    for road in model.roads:
        if road.junction < 0:
            cuts = {number for identity, number in forced if identity == road.id}
            edges += edges_of_road(road, model.driving_side, cuts)
    return tuple(edges)


def edges_of_road(road: ModelRoad, side: str, cuts: Iterable[int] = ()) -> list[Edge]:
    """Return the edges of a road; both directions are cut at the same stations.

    Args:
        road: a road outside junctions.
        side: driving side, which is the side of the kerb: ``right`` or ``left``.
        cuts: indices of sections at which an edge begins in any case.
    """
    both = [
        tuple(_lanes(road, number, side, forward=forward) for forward in (True, False))
        for number in range(len(road.sections))
    ]
    stretches: list[list[int]] = [[0]]
    cuts = set(cuts)
    for before, number in pairwise(range(len(road.sections))):
        goes_on = number not in cuts and all(
            _go_on(road.sections[before], a, road.sections[number], b)
            for a, b in zip(both[before], both[number], strict=True)
        )
        if goes_on:
            stretches[-1].append(number)
        else:
            stretches.append([number])
    edges = []
    for k, sections in enumerate(stretches):
        for direction, sign in ((0, ""), (1, "-")):
            lanes = tuple(zip(*(both[number][direction] for number in sections), strict=True))
            if lanes:
                name = f"{sign}{road.id}" + (f"#{k}" if len(stretches) > 1 else "")
                edges.append(Edge(name, road, tuple(sections), lanes, direction == 0))
    return edges


def _lanes(road: ModelRoad, number: int, side: str, *, forward: bool) -> tuple[int, ...]:
    """Return the ids of a section's lanes in one direction, from the kerb inwards."""
    # The kerb is on the driving side.
    kerb = -1 if (side == "right") == forward else 1
    lanes = [
        lane.id
        for lane in road.sections[number].lanes
        if carries_traffic(road, number, lane)
        # Pedestrians use both directions: a sidewalk belongs to the traffic beside it.
        and (lane.id * kerb > 0 if lane.kind == "sidewalk" else lane.forward == forward)
    ]
    return tuple(sorted(lanes, key=lambda identity: -kerb * identity))


def _go_on(
    before: LaneSection, first: tuple[int, ...], after: LaneSection, second: tuple[int, ...]
) -> bool:
    """Return whether all lanes of a section continue unchanged in the next, without new ones."""
    return len(first) == len(second) and all(
        linked(before.by_id[a], after.by_id[b]) and _same_use(before.by_id[a], after.by_id[b])
        for a, b in zip(first, second, strict=True)
    )


def linked(before: SectionLane, after: SectionLane) -> bool:
    """Return whether a lane continues as another one in the next section of its road."""
    return before.successor == after.id or after.predecessor == before.id


def _same_use(a: SectionLane, b: SectionLane) -> bool:
    return (a.kind, a.speed_limit, a.allowed) == (b.kind, b.speed_limit, b.allowed)


def _rank(name: str) -> tuple[bool, str]:
    """Sort key that lets junctions name their nodes."""
    return (not name.startswith("J"), name)


def loops(edges: Iterable[Edge], nodes: Nodes) -> set[int]:
    """Return the ids of roads with an edge from a node to itself, which SUMO does not support."""
    return {edge.road.id for edge in edges if len(set(nodes.of_edge(edge))) == 1}
