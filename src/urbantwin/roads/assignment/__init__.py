"""Route assignment: the street network of a class of actors, their circuits and flows."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.roads.assignment.circuit import Circuit
    from urbantwin.roads.assignment.movement_flows import flows_of_circuits, movement_flows
    from urbantwin.roads.assignment.routing_graph import WayGraph, driven_graph, walked_graph
    from urbantwin.roads.assignment.street_network import StreetNetwork, has_walkway

__all__ = [
    "Circuit",
    "StreetNetwork",
    "WayGraph",
    "driven_graph",
    "flows_of_circuits",
    "has_walkway",
    "movement_flows",
    "walked_graph",
]

names_on_demand(__name__)
