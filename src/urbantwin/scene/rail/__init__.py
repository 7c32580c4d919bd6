"""Tracks of trams and trains: rails, sleepers, ballast, platforms."""

from urbantwin.scene.rail.mesh import rail_mesh

__all__ = ["rail_mesh"]
