"""The elevation of the bare earth, raw and smoothed."""

from urbantwin.ground.elevation import SMOOTHING_M, Elevation

__all__ = ["SMOOTHING_M", "Elevation"]
