"""Lanelet2 maps, read as a lane model."""

from urbantwin.roads.lanelet2.document import is_lanelet2
from urbantwin.roads.lanelet2.projection import anchor_of
from urbantwin.roads.lanelet2.read import read_lanelet2

__all__ = ["anchor_of", "is_lanelet2", "read_lanelet2"]
