"""The elevation of the bare earth, raw and smoothed."""

from urbantwin.ground.elevation import Elevation

__all__ = ["Elevation"]
