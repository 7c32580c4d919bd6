"""Airborne surveys: bare earth, buildings with roof planes, trees."""

from urbantwin.reconstruct.airborne.footprints import read_footprints
from urbantwin.reconstruct.airborne.model import AirborneModel, from_airborne

__all__ = ["AirborneModel", "from_airborne", "read_footprints"]
