"""Surveys from the air: bare earth, buildings with the planes of their roofs, trees."""

from urbantwin.reconstruct.airborne.footprints import read_footprints
from urbantwin.reconstruct.airborne.model import AirborneModel, from_airborne

__all__ = ["AirborneModel", "from_airborne", "read_footprints"]
