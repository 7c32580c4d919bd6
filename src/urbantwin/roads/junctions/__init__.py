"""Junctions of many nodes made one, and crossings where the map has them, before netconvert."""

from urbantwin.roads.junctions.from_map import with_junctions_of_map
from urbantwin.roads.junctions.ring import Ring, is_mini_roundabout, small_rings

__all__ = ["Ring", "is_mini_roundabout", "small_rings", "with_junctions_of_map"]
