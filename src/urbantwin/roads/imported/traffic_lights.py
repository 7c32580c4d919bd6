"""Traffic lights of a lane model's nodes, and which nodes share one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.imported.nodes import Nodes
from urbantwin.roads.model import LaneModel, RoadSignal

__all__ = ["lights_of_model", "lights_of_places", "node_of_signal"]

#: Signals stand at most this far before the end of the street that they are for, metres.
FARTHEST_M = 40.0
#: A place that a person gives may be this far from its junction, metres.
NEAREST_M = 40.0


def lights_of_model(model: LaneModel, nodes: Nodes) -> dict[str, str]:
    """Return node -> id of its traffic light.

    Nodes of one signal program, as a program of our own maps may span, are one light; else each
    node has a light of its own, named as the node is.
    """
    found: dict[str, str] = {}
    at_junction = {junction: node for node, junction in nodes.junctions.items()}
    for signal in model.signals:
        node = node_of_signal(model, nodes, signal) if signal.dynamic else None
        if node is not None and (signal.program or node not in found):
            found[node] = signal.program or node
    dynamic = {signal.id for signal in model.signals if signal.dynamic}
    for controller in model.controllers:
        for junction in controller.junctions:
            if junction in at_junction and dynamic & set(controller.signals):
                node = at_junction[junction]
                found.setdefault(node, controller.name if controller.phases else node)
    return found


def lights_of_places(
    nodes: Nodes,
    outlines: Mapping[int, NDArray[np.float64]],
    places: Sequence[NDArray[np.float64]],
) -> dict[str, str]:
    """Return node -> id of a traffic light for the junctions nearest to places.

    Some maps have no signals where there are some: who plans a program for a place says that there
    is a light.

    Args:
        nodes: of the lane model.
        outlines: junction -> its outline (M, 2).
        places: (2,) each, site frame, metres; those without a junction nearby are left alone.
    """
    areas = {
        node: shapely.Polygon(outlines[junction])
        for node, junction in nodes.junctions.items()
        if len(outlines.get(junction, ())) > 2
    }
    found: dict[str, str] = {}
    for place in places:
        away = {node: shapely.distance(area, shapely.Point(place)) for node, area in areas.items()}
        node = min(away, key=lambda one: (away[one], one), default=None)
        if node is not None and away[node] <= NEAREST_M:
            found[node] = node
    return found


def node_of_signal(model: LaneModel, nodes: Nodes, signal: RoadSignal) -> str | None:
    """Return the node whose traffic a signal governs; ``None`` where it stands at none."""
    road = model.road_by_id.get(signal.road)
    if road is None:
        return None
    if road.junction >= 0:
        by_junction = {junction: node for node, junction in nodes.junctions.items()}
        return by_junction.get(road.junction)
    end = {"+": "end", "-": "start"}.get(signal.orientation)
    if end is None:
        end = "end" if signal.s > road.length / 2 else "start"
    away = abs((road.length if end == "end" else 0.0) - signal.s)
    node = nodes.of_end[road.id, end]
    return node if away <= FARTHEST_M and node in nodes.junctions else None
