"""Junctions of many nodes made one, and crossings where the map has them, before netconvert."""

from urbantwin.roads.junctions.from_map import with_junctions_of_map

__all__ = ["with_junctions_of_map"]
