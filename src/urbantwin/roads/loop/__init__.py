"""The closed loop: outer roads that lead each exit of the region back to an entry."""

from urbantwin.roads.loop.dubins import dubins_path
from urbantwin.roads.loop.outer_roads import OuterRoads, close_loop

__all__ = ["OuterRoads", "close_loop", "dubins_path"]
