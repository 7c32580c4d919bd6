"""Roads that lead back to where they begin: SUMO knows no edge from a node to itself."""

from __future__ import annotations

from urbantwin.roads.imported.edges import edges_of_model
from urbantwin.roads.imported.nodes import Nodes, loops
from urbantwin.roads.imported.road_cut import with_border
from urbantwin.roads.model import LaneModel

__all__ = ["without_loops"]


def without_loops(model: LaneModel) -> tuple[LaneModel, set[tuple[int, int]]]:
    """Return the model with a section border amid every such road, and those borders."""
    wanted = loops(edges_of_model(model), Nodes(model))
    roads, borders = [], set()
    for road in model.roads:
        changed = road
        if road.id in wanted:
            changed, number = with_border(road, road.length / 2)
            borders.add((road.id, number))
        roads.append(changed)
    return model.with_roads(tuple(roads)), borders
