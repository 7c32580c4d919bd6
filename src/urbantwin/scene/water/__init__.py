"""Rivers, canals, ponds and the sea: level sheets in the ground, their banks, and piers."""

from urbantwin.scene.water.pier import pier_mesh
from urbantwin.scene.water.plan import WaterBody, water_bodies, with_water

__all__ = ["WaterBody", "pier_mesh", "water_bodies", "with_water"]
