"""Parked vehicles: the spaces of parking lanes and car parks, and their occupancy."""

from urbantwin.traffic.parked.occupancy import FIRST_PARKED_TRACK, ParkedVehicles, park

__all__ = ["FIRST_PARKED_TRACK", "ParkedVehicles", "park"]
