"""SUMO nodes of the lane model: junctions, joined ends of roads, and section borders."""

from __future__ import annotations

from collections.abc import Iterable

from urbantwin.roads.imported.edges import Edge
from urbantwin.roads.model import LaneModel

__all__ = ["Nodes"]

#: A road and one of its ends (``start`` or ``end``).
RoadEnd = tuple[int, str]


class Nodes:
    """The nodes of a lane model's edges.

    Args:
        model: the lane model.

    Attributes:
        of_end: the node at each end of each road outside junctions.
        junctions: node -> junction of the model; not those where roads only meet.
    """

    def __init__(self, model: LaneModel) -> None:
        self._parent: dict[str, str] = {}
        streets = {road.id for road in model.roads if road.junction < 0}
        known = model.junction_by_id
        for road in model.roads:
            for end, link in (("start", road.predecessor), ("end", road.successor)):
                here = f"{road.id}.{end}"
                if road.junction >= 0:
                    # What a way through a junction is joined to ends at that junction.
                    if link and link.element == "road" and link.id in streets:
                        self._unite(f"J{road.junction}", f"{link.id}.{link.contact}")
                elif link and link.element == "junction" and link.id in known:
                    self._unite(f"J{link.id}", here)
                elif link and link.element == "road" and link.id in streets:
                    self._unite(here, f"{link.id}.{link.contact}")
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
        """Return the nodes where an edge begins and ends, in the order of travel."""
        first, last = edge.sections[0], edge.sections[-1] + 1
        road = edge.road
        start = self.of_end[road.id, "start"] if first == 0 else f"{road.id}#{first}"
        whole = last == len(road.sections)
        end = self.of_end[road.id, "end"] if whole else f"{road.id}#{last}"
        return (start, end) if edge.forward else (end, start)

    def _direct(self, model: LaneModel, streets: set[int]) -> None:
        """Roads that a direct junction joins end at that junction."""
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


def _rank(name: str) -> tuple[bool, str]:
    """Junctions name their nodes."""
    return (not name.startswith("J"), name)


def loops(edges: Iterable[Edge], nodes: Nodes) -> set[int]:
    """Return the roads that have an edge from a node to itself, which SUMO does not know."""
    return {edge.road.id for edge in edges if len(set(nodes.of_edge(edge))) == 1}
