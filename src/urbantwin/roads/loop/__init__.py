"""The closed loop: outer roads that lead every way out of the region back to a way in."""

from urbantwin.roads.loop.bulb import bulb
from urbantwin.roads.loop.outer import OuterRoads, close_loop

__all__ = ["OuterRoads", "bulb", "close_loop"]
