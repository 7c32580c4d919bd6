"""The elevation of the bare earth."""

from urbantwin.ground.elevation import Elevation

__all__ = ["Elevation"]
