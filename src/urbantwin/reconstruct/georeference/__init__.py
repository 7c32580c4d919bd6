"""Georeferencing of models: by CRS, control points, similarity, geotag or registration."""

from urbantwin.reconstruct.georeference.height_system import SiteHeights
from urbantwin.reconstruct.georeference.placement import Placed, placed
from urbantwin.reconstruct.georeference.registration import Registration

__all__ = ["Placed", "Registration", "SiteHeights", "placed"]
