"""Elevation and superelevation of roads."""

from urbantwin.roads.heights.fitted_ground import with_heights

__all__ = ["with_heights"]
