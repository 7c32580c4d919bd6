"""The elevation of the bare earth."""

from urbantwin.ground.elevation import Elevation
from urbantwin.ground.patch import ElevationPatch

__all__ = ["Elevation", "ElevationPatch"]
