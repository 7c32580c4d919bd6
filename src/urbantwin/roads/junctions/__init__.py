"""Junctions with mapped crossings and footways, one node each, prepared for netconvert."""

from urbantwin.roads.junctions.from_map import with_junctions_of_map
from urbantwin.roads.junctions.ring import Ring, is_mini_roundabout, small_rings

__all__ = ["Ring", "is_mini_roundabout", "small_rings", "with_junctions_of_map"]
