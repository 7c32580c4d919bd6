"""The closed loop: outer roads that lead every way out of the region back to a way in."""

from urbantwin.roads.loop.dubins import bulb
from urbantwin.roads.loop.outer_roads import OuterRoads, close_loop

__all__ = ["OuterRoads", "bulb", "close_loop"]
