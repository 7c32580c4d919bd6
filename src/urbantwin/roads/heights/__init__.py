"""Heights of roads: elevation, superelevation, crown, and the one surface that they lie in."""

from urbantwin.roads.heights.blend import RoadSurface
from urbantwin.roads.heights.heights import with_heights

__all__ = ["RoadSurface", "with_heights"]
