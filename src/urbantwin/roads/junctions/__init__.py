"""Junctions of many nodes made one, and crossings where the map has them, before netconvert."""
