"""The elevation of the bare earth."""

from urbantwin.ground.elevation import Elevation, ElevationPatch, merged_elevation

__all__ = ["Elevation", "ElevationPatch", "merged_elevation"]
