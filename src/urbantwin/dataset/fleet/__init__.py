"""Fleets: several nodes, fixed or on vehicles, that record one motion together."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.dataset.fleet.node import Node, placed_nodes
    from urbantwin.dataset.fleet.recording import record_fleet

__all__ = [
    "Node",
    "placed_nodes",
    "record_fleet",
]

names_on_demand(__name__)
