"""The elevation of the bare earth."""

from urbantwin.ground.elevation import Elevation
from urbantwin.ground.merge import merged_elevation
from urbantwin.ground.patch import ElevationPatch

__all__ = ["Elevation", "ElevationPatch", "merged_elevation"]
